//! Poses, joint axes, velocities and inertias of all bodies, in world axes about the base origin.

use super::block::{Block, Work};
use super::topology::{Axis, Body, Topology};
use super::vector::*;
use crate::lanes::{Real, sin_cos};
use crate::model::JointKind;

/// Fills `rotation`, `position`, `subspace`, `velocity` and `inertia` of the work space.
#[inline(always)]
pub(crate) fn kinematics<L: Real>(topology: &Topology, block: &Block<L>, work: &mut Work<L>) {
    for (index, body) in topology.bodies.iter().enumerate() {
        match body.joint {
            None => base(block, work),
            Some(joint) => {
                let q = block.q[topology.base_positions + joint];
                let dq = block.v[body.dof];
                place(index, body, q, block, work);
                let parent_velocity = body.parent.map_or([L::zero(); 6], |p| work.velocity[p]);
                work.velocity[index] = add6(parent_velocity, scale6(&work.subspace[body.dof], dq));
            }
        }
        work.inertia[index] = world_inertia(
            &work.rotation[index],
            work.position[index],
            block.mass[index],
            block.com[index],
            &block.inertia[index],
        );
    }
}

#[inline(always)]
fn base<L: Real>(block: &Block<L>, work: &mut Work<L>) {
    let q = &block.q;
    let rotation = matrix_of_quaternion([q[3], q[4], q[5], q[6]]);
    work.rotation[0] = rotation;
    work.position[0] = [L::zero(); 3];
    for k in 0..3 {
        let mut along = [L::zero(); 6];
        along[3 + k] = L::one();
        work.subspace[k] = along;
        work.subspace[3 + k] = join([rotation[k], rotation[3 + k], rotation[6 + k]], [L::zero(); 3]);
    }
    let v = &block.v;
    let turning = rotate(&rotation, [v[3], v[4], v[5]]);
    work.velocity[0] = join(turning, [v[0], v[1], v[2]]);
}

#[inline(always)]
fn place<L: Real>(index: usize, body: &Body, q: L, block: &Block<L>, work: &mut Work<L>) {
    let rest_position = splat3(body.rest_position);
    let (frame, mut position) = match body.parent {
        None => (splat9(&body.rest_rotation), rest_position),
        Some(parent) => {
            let rotation = work.rotation[parent];
            let rest_position = scale(rest_position, block.length[parent]);
            let position = add(work.position[parent], rotate(&rotation, rest_position));
            if body.rest_is_identity {
                (rotation, position)
            } else {
                (multiply(&rotation, &splat9(&body.rest_rotation)), position)
            }
        }
    };
    // The axis is the same before and after its own motion.
    let axis = rotate(&frame, splat3(body.axis));
    match body.kind {
        JointKind::Revolute => {
            work.rotation[index] = turned(&frame, body, q);
            work.subspace[body.dof] = join(axis, cross(position, axis));
        }
        JointKind::Prismatic => {
            work.rotation[index] = frame;
            position = add(position, scale(axis, q));
            work.subspace[body.dof] = join([L::zero(); 3], axis);
        }
    }
    work.position[index] = position;
}

/// `frame` turned by `q` about the joint's axis (Rodrigues for a general axis).
#[inline(always)]
fn turned<L: Real>(frame: &M3<L>, body: &Body, q: L) -> M3<L> {
    let (s, c) = sin_cos(q);
    let (a, b) = match body.axis_name {
        Axis::X => (1, 2),
        Axis::Y => (2, 0),
        Axis::Z => (0, 1),
        Axis::General => {
            let [x, y, z] = splat3(body.axis);
            let t = L::one() - c;
            let local = [
                t * x * x + c,
                t * x * y - s * z,
                t * x * z + s * y,
                t * x * y + s * z,
                t * y * y + c,
                t * y * z - s * x,
                t * x * z - s * y,
                t * y * z + s * x,
                t * z * z + c,
            ];
            return multiply(frame, &local);
        }
    };
    let mut out = *frame;
    for row in 0..3 {
        let (u, v) = (frame[3 * row + a], frame[3 * row + b]);
        out[3 * row + a] = u * c + v * s;
        out[3 * row + b] = v * c - u * s;
    }
    out
}

/// Inertia of a body (given about its centre of mass in its own axes) in world axes about the origin.
#[inline(always)]
fn world_inertia<L: Real>(r: &M3<L>, position: V3<L>, mass: L, com: V3<L>, local: &[L; 6]) -> Inertia<L> {
    let [xx, yy, zz, xy, xz, yz] = *local;
    let d = add(position, rotate(r, com));
    let h = scale(d, mass);
    // r * local, row by row, then its product with r transposed.
    let mut half = [[L::zero(); 3]; 3];
    for i in 0..3 {
        let [a, b, c] = [r[3 * i], r[3 * i + 1], r[3 * i + 2]];
        half[i] = [a * xx + b * xy + c * xz, a * xy + b * yy + c * yz, a * xz + b * yz + c * zz];
    }
    [
        mass,
        h[0],
        h[1],
        h[2],
        entry(&half, r, 0, 0) + (h[1] * d[1] + h[2] * d[2]),
        entry(&half, r, 1, 1) + (h[0] * d[0] + h[2] * d[2]),
        entry(&half, r, 2, 2) + (h[0] * d[0] + h[1] * d[1]),
        entry(&half, r, 0, 1) - h[0] * d[1],
        entry(&half, r, 0, 2) - h[0] * d[2],
        entry(&half, r, 1, 2) - h[1] * d[2],
    ]
}

/// Entry (i, j) of `half * rᵀ`.
#[inline(always)]
fn entry<L: Real>(half: &[V3<L>; 3], r: &M3<L>, i: usize, j: usize) -> L {
    dot(half[i], [r[3 * j], r[3 * j + 1], r[3 * j + 2]])
}
