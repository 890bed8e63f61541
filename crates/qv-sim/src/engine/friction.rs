//! Friction of geared servos, and springs beside the motors.
//!
//! Largest dry friction of a joint (Duclusaud, Passault, Padois and Ly, "Extended friction models for the physics simulation of servo
//! actuators", arXiv:2410.08650, models M1 to M6), with the torque of the motor `m` and that from outside `e`, both as they turn the joint:
//!
//! `c + |k_m m - k_e e| + s (c_s + |l_m m - l_e e| + q)`, `s = exp(-|v / v_s|^a)`,
//!
//! where the two torques oppose each other: `q = q_e e²` if the motor drives (`|e| < |m|`), `q_m m²` if it is driven back. Beside it, drag
//! `d v |v|`. The solver holds the joint with up to that much, so that it sticks.

use super::block::{Block, Work};
use super::cost::friction_force;
use super::topology::Topology;
use crate::lanes::Real;

/// Adds springs and constant torques to `work.smooth`.
#[inline(always)]
pub(crate) fn springs<L: Real>(topology: &Topology, block: &Block<L>, work: &mut Work<L>) {
    for j in 0..topology.joints {
        let joint = &block.joints[j];
        let q = block.q[topology.base_positions + j];
        work.smooth[topology.joint_dof(j)] += joint.spring.torque(q) + joint.constant_torque;
    }
}

/// Raises `friction_limit` by what load and rest add, and adds drag to `work.smooth` and `work.implicit`, once all else is there.
#[inline(always)]
pub(crate) fn servo_friction<L: Real>(topology: &Topology, block: &Block<L>, work: &mut Work<L>) {
    for j in 0..topology.joints {
        let dof = topology.joint_dof(j);
        let (servo, speed, motor) = (&block.joints[j].servo, block.v[dof], block.torque[j]);
        // All but the motor and the friction of the joint itself.
        let external = work.smooth[dof] - motor + block.viscous[dof] * speed + block.load[j];
        work.rows.friction_limit[dof] += servo.beyond_coulomb(speed, motor, external);
        let drag = servo.drag * speed.abs();
        work.smooth[dof] += -(drag * speed);
        work.implicit[dof] += L::splat(2.0) * drag;
    }
}

/// Remembers what contacts and limits turned each joint with: the load of the next step.
#[inline(always)]
pub(crate) fn keep_loads<L: Real>(topology: &Topology, block: &mut Block<L>, work: &Work<L>) {
    for j in 0..topology.joints {
        let dof = topology.joint_dof(j);
        let rows = &work.rows;
        let residual = work.newton.a[dof] - rows.friction_reference[dof];
        let (dry, _) = friction_force(rows.friction_weight[dof], rows.friction_limit[dof], residual);
        block.load[j] = work.newton.ma[dof] - work.smooth[dof] - dry;
    }
}
