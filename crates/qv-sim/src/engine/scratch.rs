//! What Newton's method is reported, and the vectors that it works with.

use super::array::Array;
use super::rows::ActsOn;
use super::topology::Topology;
use crate::lanes::{Mask, Real};
use crate::options::{LineSearch, WarmStart};

/// Vectors of the solver.
#[derive(Debug, Clone)]
pub(crate) struct Scratch<L: Real> {
    /// Acceleration, the unknown.
    pub a: Array<L>,
    /// Mass matrix times `a`.
    pub ma: Array<L>,
    pub gradient: Array<L>,
    pub search: Array<L>,
    pub m_search: Array<L>,
    /// `J a - a_ref` and `J search`, `[slot][6]`.
    pub residual: Array<[L; 6]>,
    pub along: Array<[L; 6]>,
    /// Contact forces at the residuals and where those lie, and the same at a trial step.
    pub(super) contact: Array<ContactEvaluation<L>>,
    pub(super) trial: Array<ContactEvaluation<L>>,
}

impl<L: Real> Scratch<L> {
    pub fn new(topology: &Topology, slots: usize) -> Self {
        let zero: Array<L> = vec![L::zero(); topology.nv].into();
        Self {
            a: zero.clone(),
            ma: zero.clone(),
            gradient: zero.clone(),
            search: zero.clone(),
            m_search: zero,
            residual: vec![[L::zero(); 6]; slots].into(),
            along: vec![[L::zero(); 6]; slots].into(),
            contact: vec![ContactEvaluation::new(); slots].into(),
            trial: vec![ContactEvaluation::new(); slots].into(),
        }
    }
}

/// A contact at one residual: its force, and where the residual lies in the cone's cost (MuJoCo's zones).
#[derive(Debug, Clone, Copy)]
pub(super) struct ContactEvaluation<L: Real> {
    /// Minus the gradient of the cost.
    pub force: [L; 6],
    /// Inside the polar cone: plain quadratic.
    pub bottom: L::Mask,
    /// On the cone.
    pub middle: L::Mask,
    /// N = residual[0] * cone.
    pub normal: L,
    /// One over the length of the scaled tangential residual where `middle`, else 1.
    pub inverse: L,
    /// Scaled tangential residual.
    pub u: [L; 5],
}

impl<L: Real> ContactEvaluation<L> {
    pub fn new() -> Self {
        let (zero, never) = (L::zero(), L::Mask::splat(false));
        let (force, u) = ([zero; 6], [zero; 5]);
        Self { force, bottom: never, middle: never, normal: zero, inverse: zero, u }
    }
}

/// Settings of the solver.
pub(crate) struct NewtonSettings<'a> {
    pub topology: &'a Topology,
    pub slots: &'a [ActsOn],
    pub iterations: usize,
    pub tolerance: f64,
    pub line_search: LineSearch,
    /// Most steps of a line search.
    pub line_search_iterations: usize,
    pub warm_start: WarmStart,
}
