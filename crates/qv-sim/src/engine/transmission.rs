//! What lies between a motor and its joint, in each lane: friction of a servo, a spring beside it.

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
    pub(super) fn beyond_coulomb(&self, speed: L, motor: L, external: L) -> L {
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
    pub(super) fn torque(&self, q: L) -> L {
        let away = q - self.rest;
        let stretch = (away - self.slack).max(L::zero()) + (away + self.slack).min(L::zero());
        -(self.stiffness * stretch)
    }
}
