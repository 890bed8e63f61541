//! Constraint rows as data: what a contact slot acts on, and the numbers of each row.

use super::array::Array;
use super::topology::Topology;
use crate::lanes::{Mask, Real};

/// What a contact slot belongs to: the same in all environments.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ActsOn {
    pub geom: usize,
    pub body: usize,
    /// Second body when the robot touches itself.
    pub other: Option<usize>,
    /// Sum of the bodies' inverse weights.
    pub weight: f64,
}

/// Rows of one live contact.
#[derive(Debug, Clone)]
pub(crate) struct ContactRows<L: Real> {
    /// `[stored rows][columns]` of the Jacobian; columns as in `Topology::force_columns`.
    pub jacobian: Array<L>,
    pub reference: [L; 6],
    /// Inverse regularisation.
    pub weight: [L; 6],
    /// Regularised coefficient of the cone, `mu / sqrt(impratio)`.
    pub cone: L,
    /// Weight of the cost on the cone, `weight[0] / (cone² (1 + cone²))`.
    pub scale: L,
    /// Friction coefficient of rows 1.. (two tangents, torsion, two of rolling).
    pub friction: [L; 5],
    pub active: L::Mask,
}

/// All rows of a step.
#[derive(Debug, Clone)]
pub(crate) struct Rows<L: Real> {
    /// 3, 4 or 6.
    pub dimension: usize,
    /// One entry per slot; only live ones are current.
    pub contacts: Array<ContactRows<L>>,
    pub friction_reference: Array<L>,
    /// Inverse regularisation of joint friction, per degree of freedom.
    pub friction_weight: Array<L>,
    /// Largest friction of each degree of freedom in this step \[N m\].
    pub friction_limit: Array<L>,
    pub limits: Vec<LimitRow<L>>,
}

/// A joint at its limit.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LimitRow<L: Real> {
    pub dof: usize,
    /// +1 pushes up from the lower limit, -1 down from the upper.
    pub sign: L,
    pub reference: L,
    pub weight: L,
    pub active: L::Mask,
}

impl<L: Real> Rows<L> {
    pub fn new(topology: &Topology, slots: &[ActsOn], dimension: usize) -> Self {
        let zero = L::zero();
        let contact = |slot: &ActsOn| ContactRows {
            jacobian: vec![zero; stored_rows(dimension) * topology.force_columns(slot.body).len()].into(),
            reference: [zero; 6],
            weight: [zero; 6],
            cone: zero,
            scale: zero,
            friction: [zero; 5],
            active: L::Mask::splat(false),
        };
        Self {
            dimension,
            contacts: slots.iter().map(contact).collect::<Vec<_>>().into(),
            friction_reference: vec![zero; topology.nv].into(),
            friction_weight: vec![zero; topology.nv].into(),
            friction_limit: vec![zero; topology.nv].into(),
            limits: Vec::with_capacity(topology.joints),
        }
    }
}

/// Rows that the engine is compiled for: contacts of dimension 4 carry two rows of rolling that weigh nothing.
pub(crate) fn stored_rows(dimension: usize) -> usize {
    if dimension == 3 { 3 } else { 6 }
}
