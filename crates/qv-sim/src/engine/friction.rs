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
use super::newton::friction_force;
use super::topology::Topology;
use crate::lanes::{Mask, Real, Scalar};

/// What dry friction has beyond Coulomb's, in each lane; zero is none.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ServoFriction<L> {
    /// Beyond Coulomb friction at rest \[N m\].
    pub stribeck: L,
    /// Speed by which that has fallen to 1/e \[rad/s\].
    pub speed: L,
    pub exponent: L,
    pub load_motor: L,
    pub load_external: L,
    pub stribeck_load_motor: L,
    pub stribeck_load_external: L,
    /// \[1 / (N m)\]
    pub quadratic_load_motor: L,
    pub quadratic_load_external: L,
    /// \[N m s²/rad²\]
    pub drag: L,
}

/// A spring with a dead zone, `[N m/rad]` and `[rad]`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SpringLanes<L> {
    pub stiffness: L,
    pub rest: L,
    pub slack: L,
}

impl<L: Real> ServoFriction<L> {
    pub fn none() -> Self {
        let (zero, one) = (L::zero(), L::one());
        Self {
            stribeck: zero,
            speed: one,
            exponent: one,
            load_motor: zero,
            load_external: zero,
            stribeck_load_motor: zero,
            stribeck_load_external: zero,
            quadratic_load_motor: zero,
            quadratic_load_external: zero,
            drag: zero,
        }
    }

    /// Dry friction beyond Coulomb's at a speed, under the torque of the motor and that from outside.
    #[inline(always)]
    fn beyond_coulomb(&self, speed: L, motor: L, external: L) -> L {
        let at_speed = (self.load_motor * motor - self.load_external * external).abs();
        let gear = (self.stribeck_load_motor * motor - self.stribeck_load_external * external).abs();
        let drives = external.abs().lt(motor.abs());
        let squared = L::select(
            drives,
            self.quadratic_load_external * external * external,
            self.quadratic_load_motor * motor * motor,
        );
        let opposed = (motor * external).lt(L::zero());
        let at_rest = self.stribeck + gear + L::select(opposed, squared, L::zero());
        if !L::zero().lt(at_rest).any() {
            return at_speed;
        }
        at_speed + at_rest * self.share_at_rest(speed)
    }

    /// How much of the friction at rest a speed leaves. Lane by lane, since registers have no exponential; from double precision in any
    /// lane, so that an environment gets the same bits in each.
    #[inline(always)]
    fn share_at_rest(&self, speed: L) -> L {
        let mut share = L::zero();
        for lane in 0..L::LANES {
            let of = |x: L| x.lane(lane).to_f64();
            let ratio = (of(speed) / of(self.speed)).abs();
            let exponent = of(self.exponent);
            let power = if exponent == 2.0 { ratio * ratio } else { ratio.powf(exponent) };
            share.set_lane(lane, L::Scalar::from_f64((-power).exp()));
        }
        share
    }
}

impl<L: Real> SpringLanes<L> {
    pub fn none() -> Self {
        Self { stiffness: L::zero(), rest: L::zero(), slack: L::zero() }
    }

    #[inline(always)]
    fn torque(&self, q: L) -> L {
        let away = q - self.rest;
        let stretch = (away - self.slack).max(L::zero()) + (away + self.slack).min(L::zero());
        -(self.stiffness * stretch)
    }
}

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
