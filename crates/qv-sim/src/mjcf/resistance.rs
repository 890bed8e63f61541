//! How a joint resists an actuator: what `<position dampratio>` needs.

use crate::{BaseKind, JointKind, Model};
use glam::DVec3;

/// Mass \[kg m² or kg\] that each joint sets against its own force when all others are free, 1 / (M⁻¹)ⱼⱼ, rotors included, at
/// joint positions `joints` (shape `[n]`): MuJoCo's 1 / `dof_invweight0`.
pub(super) fn apparent_inertias(model: &Model, joints: &[f64]) -> Vec<f64> {
    let (n, free) = (model.nv(), model.base_dofs());
    let mut factor = mass_matrix(model, joints);
    // Cholesky's factor, in the lower half.
    for i in 0..n {
        for j in 0..=i {
            let dot: f64 = (0..j).map(|k| factor[i * n + k] * factor[j * n + k]).sum();
            let left = factor[i * n + j] - dot;
            factor[i * n + j] = if i == j { left.max(0.0).sqrt() } else { left / factor[j * n + j] };
        }
    }
    let apparent = |dof: usize| {
        // (M⁻¹)ⱼⱼ is the squared length of L⁻¹ eⱼ.
        let mut x = vec![0.0; n];
        for i in dof..n {
            let dot: f64 = (dof..i).map(|k| factor[i * n + k] * x[k]).sum();
            x[i] = (f64::from(u8::from(i == dof)) - dot) / factor[i * n + i];
        }
        let apparent = 1.0 / x.iter().map(|x| x * x).sum::<f64>();
        // A joint that moves no inertia, such as a point on its axis, resists nothing.
        if apparent.is_finite() { apparent } else { 0.0 }
    };
    (0..model.joints.len()).map(|j| apparent(free + j)).collect()
}

/// Row by row, shape `[nv, nv]`: the base's velocities, if any, are those of its origin and its turning.
fn mass_matrix(model: &Model, joints: &[f64]) -> Vec<f64> {
    let (n, free) = (model.nv(), model.base_dofs());
    let mut q = if model.base == BaseKind::Floating { vec![0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0] } else { Vec::new() };
    q.extend_from_slice(joints);
    let poses = model.world_from_links(&q);
    let mut matrix = vec![0.0; n * n];
    for (j, joint) in model.joints.iter().enumerate() {
        matrix[(free + j) * (n + 1)] = joint.armature;
    }
    for (l, link) in model.links.iter().enumerate() {
        let centre = poses[l].transform_point(link.com);
        let turn = poses[l].matrix();
        let inertia = turn * link.inertia * turn.transpose();
        // What moves the link: degree of freedom, velocity of its centre, turning.
        let mut moved: Vec<(usize, DVec3, DVec3)> = Vec::new();
        let mut above = Some(l);
        while let Some(at) = above {
            match model.links[at].joint {
                Some(j) => {
                    let axis = poses[at].transform_vector(model.joints[j].axis);
                    moved.push(match model.joints[j].kind {
                        JointKind::Prismatic => (free + j, axis, DVec3::ZERO),
                        JointKind::Revolute => (free + j, axis.cross(centre - poses[at].position), axis),
                    });
                }
                None => {
                    let arm = centre - poses[at].position;
                    moved.extend(DVec3::AXES.iter().enumerate().map(|(k, axis)| (k, *axis, DVec3::ZERO)));
                    moved.extend(DVec3::AXES.iter().enumerate().map(|(k, axis)| (3 + k, axis.cross(arm), *axis)));
                }
            }
            above = model.links[at].parent;
        }
        for (a, moving, turning) in &moved {
            for (b, other, spin) in &moved {
                matrix[a * n + b] += link.mass * moving.dot(*other) + turning.dot(inertia * *spin);
            }
        }
    }
    matrix
}
