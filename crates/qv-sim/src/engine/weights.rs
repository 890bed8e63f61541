//! Inverse weights: the accelerations of bodies and joints per unit of force in the model's zero position.
//!
//! They scale the regularisation of constraints (MuJoCo documentation, Computation, eq. 10; `body_invweight0`,
//! `dof_invweight0`), once per model. A joint's is that of its own rotor inertia, which is a parameter: see [`stiffer`].

use super::array::Array;
use super::block::{Block, Work};
use super::dynamics::{factor, solve};
use super::topology::Topology;
use super::vector::{add, angular, cross, linear};
use crate::lanes::Real;

/// Per body (translation at the centre of mass, rotation) and per degree of freedom.
#[derive(Debug, Clone)]
pub(crate) struct Weights {
    pub body: Vec<[f64; 2]>,
    pub dof: Vec<f64>,
    /// Rotor inertias that `dof` is of.
    pub armature: Vec<f64>,
}

/// Least share of a joint's inertia that a smaller rotor leaves.
const LEAST: f64 = 0.01;

/// By how much a joint's inverse weight w is smaller with another rotor: (M + Δ e eᵀ)⁻¹ has w / (1 + Δ w) in its place (Sherman and Morrison,
/// 1950). Exact for one joint; of several at once, what each does to the others is left out. Without it a joint whose rotor is stated
/// beside its URDF would creep under dry friction as if it had none.
#[inline(always)]
pub(crate) fn stiffer<L: Real>(weights: &Weights, dof: usize, armature: L) -> L {
    let more = (armature - L::splat(weights.armature[dof])) * L::splat(weights.dof[dof]);
    (L::one() + more).max(L::splat(LEAST))
}

impl Weights {
    /// `block` holds the neutral parameters in the zero position.
    pub fn new(topology: &Topology, block: &Block<f64>, work: &mut Work<f64>) -> Self {
        super::kinematics::kinematics(topology, block, work);
        let at: Vec<[f64; 3]> = work
            .inertia
            .iter()
            .map(|i| if i[0] > 0.0 { [i[1] / i[0], i[2] / i[0], i[3] / i[0]] } else { [0.0; 3] })
            .collect();
        super::dynamics::bias_forces(topology, [0.0; 3], block, work);
        super::dynamics::mass_matrix(topology, block, work);
        let mut factored = work.mass_matrix.clone();
        factor(topology, &mut factored);
        let inverse_weight = |jacobian: &dyn Fn(usize) -> f64, dofs: &[usize]| {
            let mut x = Array::from(vec![0.0; topology.nv]);
            dofs.iter().for_each(|&i| x[i] = jacobian(i));
            let force = x.clone();
            solve(topology, &factored, &mut x);
            x.iter().zip(&force).map(|(a, f)| a * f).sum::<f64>()
        };
        let mut dof: Vec<f64> = (0..topology.nv).map(|i| inverse_weight(&|_| 1.0, &[i])).collect();
        if topology.free_base {
            // MuJoCo averages each triple of the free joint.
            for triple in [0..3, 3..6] {
                let mean = dof[triple.clone()].iter().sum::<f64>() / 3.0;
                dof[triple].fill(mean);
            }
        }
        let body = topology
            .bodies
            .iter()
            .zip(&at)
            .map(|(body, &point)| {
                let mean = |k: usize, turning: bool| {
                    let row = |i: usize| {
                        let s = &work.subspace[i];
                        if turning { s[k] } else { add(linear(s), cross(angular(s), point))[k] }
                    };
                    inverse_weight(&row, &body.path)
                };
                [(0..3).map(|k| mean(k, false)).sum::<f64>() / 3.0, (0..3).map(|k| mean(k, true)).sum::<f64>() / 3.0]
            })
            .collect();
        let armature = block.armature.iter().copied().collect();
        Self { body, dof, armature }
    }
}
