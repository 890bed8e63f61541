//! Inverse weights: the accelerations of bodies and joints per unit of force in the model's zero position.
//!
//! They scale the regularisation of constraints (MuJoCo documentation, Computation, eq. 10; `body_invweight0`,
//! `dof_invweight0`), once per model.

use super::array::Array;
use super::block::{Block, Work};
use super::dynamics::{factor, solve};
use super::topology::Topology;
use super::vector::{add, angular, cross, linear};

/// Per body (translation at the centre of mass, rotation) and per degree of freedom.
#[derive(Debug, Clone)]
pub(crate) struct Weights {
    pub body: Vec<[f64; 2]>,
    pub dof: Vec<f64>,
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
        Self { body, dof }
    }
}
