//! Constraint rows: soft contacts, joint friction and joint limits.
//!
//! The equations are MuJoCo's (documentation, Computation, "Constraint model"): each row has a reference acceleration
//! `-b v - k r` and a regularisation from its impedance `d(r)`.

use super::block::{Block, GroundLanes, Work};
use super::rows::{ActsOn, LimitRow};
use super::topology::Topology;
use super::vector::*;
use super::weights::{Weights, stiffer};
use crate::lanes::{Mask, Real, Scalar};

/// Impedance at zero and at full depth, and the depth \[m\] (MuJoCo's default solimp).
const IMPEDANCE_MIN: f64 = 0.9;
pub(crate) const IMPEDANCE_MAX: f64 = 0.95;
const IMPEDANCE_WIDTH: f64 = 0.001;
/// Time constant of joint friction and joint limits \[s\] (MuJoCo's default solref).
const JOINT_TIME_CONSTANT: f64 = 0.02;
/// Friction below this is treated as this (MuJoCo's mjMINMU).
const LEAST_FRICTION: f64 = 1e-5;

/// What the rows need beside block and work space.
pub(crate) struct RowSettings<'a> {
    pub topology: &'a Topology,
    pub slots: &'a [ActsOn],
    pub weights: &'a Weights,
    /// Position limits per joint.
    pub limits: &'a [(f64, f64)],
    pub impratio: f64,
    pub timestep: f64,
}

/// Builds all rows of the live contacts, of joint friction and of violated limits.
#[inline(always)]
pub(crate) fn build_rows<L: Real, const D: usize>(settings: &RowSettings, block: &Block<L>, work: &mut Work<L>) {
    for index in 0..work.live.len() {
        contact_rows::<L, D>(settings, work.live[index], block, work);
    }
    let time_constant = JOINT_TIME_CONSTANT.max(2.0 * settings.timestep);
    let damping = 2.0 / (IMPEDANCE_MAX * time_constant);
    if block.any_coulomb {
        for dof in settings.topology.base_dofs..settings.topology.nv {
            work.rows.friction_reference[dof] = -(L::splat(damping) * block.v[dof]);
            let weight = IMPEDANCE_MIN / ((1.0 - IMPEDANCE_MIN) * settings.weights.dof[dof]);
            let stiffer = stiffer(settings.weights, dof, block.armature[dof]);
            work.rows.friction_weight[dof] = L::splat(weight) * stiffer;
        }
    }
    work.rows.limits.clear();
    for (joint, &(lower, upper)) in settings.limits.iter().enumerate() {
        let q = block.q[settings.topology.base_positions + joint];
        if lower > f64::NEG_INFINITY {
            limit_row(settings, joint, L::one(), q - L::splat(lower), time_constant, block, work);
        }
        if upper < f64::INFINITY {
            limit_row(settings, joint, -L::one(), L::splat(upper) - q, time_constant, block, work);
        }
    }
}

/// Impedance at penetration `depth >= 0` (power 2, midpoint 0.5).
#[inline(always)]
fn impedance<L: Real>(depth: L) -> L {
    let x = (depth * L::splat(1.0 / IMPEDANCE_WIDTH)).min(L::one());
    let rest = L::one() - x;
    let two = L::splat(2.0);
    let y = L::select(x.le(L::splat(0.5)), two * x * x, L::one() - two * rest * rest);
    L::splat(IMPEDANCE_MIN) + y * L::splat(IMPEDANCE_MAX - IMPEDANCE_MIN)
}

#[inline(always)]
fn limit_row<L: Real>(
    settings: &RowSettings,
    joint: usize,
    sign: L,
    distance: L,
    time_constant: f64,
    block: &Block<L>,
    work: &mut Work<L>,
) {
    let active = distance.lt(L::zero());
    if !active.any() {
        return;
    }
    let dof = settings.topology.joint_dof(joint);
    let imp = impedance(-distance);
    let stiffness = L::splat(1.0 / (IMPEDANCE_MAX * time_constant * IMPEDANCE_MAX * time_constant));
    let damping = L::splat(2.0 / (IMPEDANCE_MAX * time_constant));
    let reference = -(damping * (sign * block.v[dof])) - stiffness * imp * distance;
    let weight = imp / ((L::one() - imp) * L::splat(settings.weights.dof[dof]));
    let weight = weight * stiffer(settings.weights, dof, block.armature[dof]);
    work.rows.limits.push(LimitRow { dof, sign, reference, weight, active });
}

/// How much of the ground's friction a slip leaves. Lane by lane, since registers have no exponential; from double precision in any lane, so
/// that an environment gets the same bits in each.
#[inline(always)]
fn share_in_slip<L: Real>(ground: &GroundLanes<L>, slip: L) -> L {
    let mut share = L::one();
    for lane in 0..L::LANES {
        let of = |x: L| x.lane(lane).to_f64();
        let gone = 1.0 - (-of(slip) / of(ground.drop_speed)).exp();
        share.set_lane(lane, L::Scalar::from_f64(1.0 - of(ground.drop) * gone));
    }
    share
}

#[inline(always)]
fn contact_rows<L: Real, const D: usize>(settings: &RowSettings, index: usize, block: &Block<L>, work: &mut Work<L>) {
    let slot = &settings.slots[index];
    let contact = work.contacts[index];
    let rows = &mut work.rows.contacts[index];
    let columns = settings.topology.force_columns(slot.body);
    let (t1, t2) = tangents(contact.normal);
    let directions = [contact.normal, t1, t2];
    // A direction at the point, as a spatial force about the origin.
    let mut moments = [[L::zero(); 3]; 3];
    for k in 0..3 {
        moments[k] = cross(contact.point, directions[k]);
    }
    let mut velocity = [L::zero(); 6];
    if settings.topology.dense {
        rows.jacobian.fill(L::zero());
    }
    let bodies = [(Some(slot.body), L::one()), (slot.other, -L::one())];
    for (body, sign) in bodies {
        let Some(body) = body else { continue };
        let path = &settings.topology.bodies[body].path;
        for (position, &dof) in path.iter().enumerate() {
            let column = if settings.topology.dense { dof } else { position };
            let s = &work.subspace[dof];
            for k in 0..D {
                // Rows: normal, two tangents; torsion about the normal; rolling about the tangents.
                let entry = if k >= 3 {
                    dot(directions[k - 3], angular(s))
                } else if dof >= settings.topology.base_dofs {
                    dot(directions[k], linear(s)) + dot(moments[k], angular(s))
                } else if dof < 3 {
                    directions[k][dof]
                } else {
                    dot(moments[k], angular(s))
                };
                let target = &mut rows.jacobian[k * columns.len() + column];
                *target = if slot.other.is_some() { *target + sign * entry } else { entry };
            }
        }
        let motion = &work.velocity[body];
        for k in 0..D {
            let along = if k >= 3 {
                dot(directions[k - 3], angular(motion))
            } else {
                dot(directions[k], linear(motion)) + dot(moments[k], angular(motion))
            };
            velocity[k] += sign * along;
        }
    }
    let ground = &block.ground;
    if block.any_sinking && slot.other.is_none() {
        // The ground goes down under the shape.
        velocity[0] += block.sinking[slot.geom];
    }
    let imp = impedance(-contact.distance);
    let mut mu = contact.friction;
    if block.any_weakening && slot.other.is_none() {
        mu = mu * share_in_slip(ground, (velocity[1] * velocity[1] + velocity[2] * velocity[2]).sqrt());
    }
    let mu = mu.max(L::splat(LEAST_FRICTION));
    let normal_weight = imp / ((L::one() - imp) * L::splat(slot.weight));
    let tangent_weight = normal_weight * L::splat(settings.impratio);
    for k in 0..D {
        rows.reference[k] = -(ground.damping * velocity[k]);
    }
    rows.reference[0] -= ground.stiffness * imp * contact.distance;
    let torsional = ground.torsional.max(L::splat(LEAST_FRICTION));
    let rolling = ground.rolling.max(L::splat(LEAST_FRICTION));
    let rolling = if work.rows.dimension == 4 { L::zero() } else { rolling };
    rows.friction = [mu, mu, torsional, rolling, rolling];
    rows.weight[0] = normal_weight;
    for k in 1..D {
        let ratio = rows.friction[k - 1] / mu;
        rows.weight[k] = if k < 3 { tangent_weight } else { tangent_weight * ratio * ratio };
    }
    rows.cone = mu * L::splat((1.0 / settings.impratio).sqrt());
    let square = rows.cone * rows.cone;
    rows.scale = normal_weight / (square * (L::one() + square));
    rows.active = contact.active;
}
