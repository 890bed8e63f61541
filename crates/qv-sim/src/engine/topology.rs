//! What all environments of a batch share: the shape of the tree, and the pattern of its mass matrix.

use super::array::Array;
use crate::model::{BaseKind, JointKind, Model};
use glam::DVec3;

/// A coordinate axis, or none of them: rotations about coordinate axes cost half.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Axis {
    X,
    Y,
    Z,
    General,
}

#[derive(Debug, Clone)]
pub(crate) struct Body {
    pub parent: Option<usize>,
    /// `None`: the free base.
    pub joint: Option<usize>,
    pub kind: JointKind,
    pub axis: [f64; 3],
    pub axis_name: Axis,
    /// Row-major rotation and position in the parent at joint zero.
    pub rest_rotation: [f64; 9],
    pub rest_is_identity: bool,
    pub rest_position: [f64; 3],
    /// First degree of freedom.
    pub dof: usize,
    /// Degrees of freedom from the root to this body, its own included, in increasing order.
    pub path: Array<usize>,
}

/// Rows of symmetric matrices are packed: row `i` holds the columns `path[i]` (its ancestors, then itself); the first six
/// rows of a free base have room for six. With
/// robot-to-robot contact on, all columns `0..=i` are kept, because such a contact couples two branches.
#[derive(Debug, Clone)]
pub(crate) struct Topology {
    pub free_base: bool,
    pub bodies: Array<Body>,
    pub nv: usize,
    pub nq: usize,
    pub joints: usize,
    /// 6 with a free base.
    pub base_dofs: usize,
    /// 7 with a free base.
    pub base_positions: usize,
    /// Body that each degree of freedom moves.
    pub dof_body: Array<usize>,
    /// Columns of each packed row.
    pub columns: Array<Array<usize>>,
    /// Where each packed row begins.
    pub row: Array<usize>,
    pub packed: usize,
    pub dense: bool,
}

impl Topology {
    pub fn new(model: &Model, dense: bool) -> Self {
        let free_base = model.base == BaseKind::Floating;
        let base_dofs = model.base_dofs();
        let mut bodies: Vec<Body> = Vec::new();
        let mut dof_body = Vec::new();
        for (index, link) in model.links.iter().enumerate() {
            let dof = dof_body.len();
            let own = if link.joint.is_some() { 1 } else { 6 };
            dof_body.extend(std::iter::repeat_n(index, own));
            let mut path = link.parent.map_or(Vec::new(), |p| bodies[p].path.to_vec());
            path.extend(dof..dof + own);
            let joint = link.joint.map(|j| &model.joints[j]);
            let axis = joint.map_or(DVec3::Z, |j| j.axis);
            let rotation = link.parent_from_link.matrix();
            let rest_is_identity = rotation.abs_diff_eq(glam::DMat3::IDENTITY, 0.0);
            bodies.push(Body {
                parent: link.parent,
                joint: link.joint,
                kind: joint.map_or(JointKind::Revolute, |j| j.kind),
                axis: axis.to_array(),
                axis_name: name_axis(axis),
                rest_rotation: rotation.transpose().to_cols_array(),
                rest_is_identity,
                rest_position: link.parent_from_link.position.to_array(),
                dof,
                path: path.into(),
            });
        }
        let nv = dof_body.len();
        let columns: Vec<Array<usize>> = (0..nv)
            .map(|i| {
                let path = &bodies[dof_body[i]].path;
                let columns: Vec<usize> =
                    if dense { (0..=i).collect() } else { path.iter().copied().filter(|&k| k <= i).collect() };
                columns.into()
            })
            .collect();
        let mut row = Vec::with_capacity(nv);
        let mut packed = 0;
        for (i, columns) in columns.iter().enumerate() {
            row.push(packed);
            // Rows of a free base take whole registers, see `dynamics::factor`.
            packed += if i < base_dofs { base_dofs } else { columns.len() };
        }
        Self {
            free_base,
            bodies: bodies.into(),
            nv,
            nq: model.nq(),
            joints: model.joints.len(),
            base_dofs,
            base_positions: if free_base { 7 } else { 0 },
            dof_body: dof_body.into(),
            columns: columns.into(),
            row: row.into(),
            packed,
            dense,
        }
    }

    /// Degree of freedom of a joint. Joints and their degrees of freedom have the same order.
    pub fn joint_dof(&self, joint: usize) -> usize {
        self.base_dofs + joint
    }

    /// Columns that a force on a body can move.
    pub fn force_columns(&self, body: usize) -> &[usize] {
        if self.dense { &self.columns[self.nv - 1] } else { &self.bodies[body].path }
    }
}

fn name_axis(axis: DVec3) -> Axis {
    if axis == DVec3::X {
        Axis::X
    } else if axis == DVec3::Y {
        Axis::Y
    } else if axis == DVec3::Z {
        Axis::Z
    } else {
        Axis::General
    }
}
