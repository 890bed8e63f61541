//! The law of a motor driver, for lanes of environments and for whoever compares it with measured torques.
//!
//! `tau = strength u + asymmetry |u|`, `u = clip(kp s_p (q_des - q) + tau_ff) + kd s_d (dq_des - dq)`, then a first-order lag, then the limits of the motor. Along the
//! motion the limit is flat up to a knee and falls to zero; a motor that brakes keeps all of its torque.
//!
//! A spring in series (compliance `c`) puts the motor and its encoder ahead of the joint by `c tau`, in balance at every instant: the rotor's
//! inertia stays at the joint. The law is then an equation for `tau`, whose right side falls with `tau` in straight pieces, and is solved in
//! closed form: a gain `kp` becomes `kp / (1 + c strength kp)`.

use crate::lanes::Real;

/// The parameters of the law in each lane, ready for use.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Law<L> {
    pub strength: L,
    pub asymmetry: L,
    pub kp_scale: L,
    pub kd_scale: L,
    pub torque_limit: L,
    pub position_torque_limit: L,
    pub speed_knee: L,
    /// 1 / (speed_zero - speed_knee).
    pub speed_slope: L,
    pub half_backlash: L,
    /// Of the spring between motor and joint \[rad/(N m)\].
    pub compliance: L,
}

/// A motor behind its spring.
pub(crate) struct Sprung<L> {
    /// Torque behind the lag.
    pub lagged: L,
    /// What the spring leaves of the velocity gain.
    pub softening: L,
}

/// One low-level command of one joint.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CommandLanes<L> {
    pub q: L,
    pub dq: L,
    pub kp: L,
    pub kd: L,
    pub tau: L,
}

impl<L: Real> Law<L> {
    /// The law of a motor that gives `share` of its torque.
    #[inline(always)]
    pub fn weakened(&self, share: L) -> Self {
        Self { strength: self.strength * share, asymmetry: self.asymmetry * share, ..*self }
    }

    /// Where the motor is when its joint is at `q`, of one that was at `motor`: play lets it stay.
    #[inline(always)]
    pub fn within_play(&self, motor: L, q: L) -> L {
        motor.max(q - self.half_backlash).min(q + self.half_backlash)
    }

    /// Torque that the controller asks for; `q` is what the encoder of the motor says.
    #[inline(always)]
    pub fn demand(&self, command: &CommandLanes<L>, q: L, dq: L) -> L {
        let position = self.kp_scale * command.kp * (command.q - q) + command.tau;
        let clipped = position.max(-self.position_torque_limit).min(self.position_torque_limit);
        let asked = clipped + self.kd_scale * command.kd * (command.dq - dq);
        self.strength * asked + self.asymmetry * asked.abs()
    }

    /// The same through the spring in series, behind a lag: `q` is what the encoder would say without the spring, `before` the lagged torque of
    /// the step before, `share` the way that the lag goes to what is asked for, `least` and `most` the limits.
    #[inline(always)]
    pub fn sprung(
        &self,
        command: &CommandLanes<L>,
        q: L,
        dq: L,
        before: L,
        share: L,
        (least, most): (L, L),
    ) -> Sprung<L> {
        let (zero, one, limit) = (L::zero(), L::one(), self.position_torque_limit);
        let kp = self.kp_scale * command.kp;
        let damping = self.kd_scale * command.kd * (command.dq - dq);
        let position = |torque: L| kp * (command.q - q - self.compliance * torque) + command.tau;
        let clip = |position: L| position.max(-limit).min(limit);
        let rest = (one - share) * before;
        // More torque asks for less, so that the sign of what is asked for at `rest` is that of what is asked for at the solution.
        let pushes = zero.lt(clip(position(rest)) + damping);
        let strength = share * (self.strength + L::select(pushes, self.asymmetry, -self.asymmetry));
        let softening = one / (one + (strength * kp * self.compliance).max(zero));
        let free = (rest + strength * (position(zero) + damping)) * softening;
        let clipped = clip(position(free));
        let is_clipped = limit.lt(position(free).abs());
        let torque = L::select(is_clipped, rest + strength * (clipped + damping), free);
        // At its limit the motor stands still on the spring, and the lag goes on towards what is asked for there.
        let delivered = torque.max(least).min(most);
        let wound = rest + share * self.demand(command, q + self.compliance * delivered, dq);
        let within = least.le(torque) & torque.le(most);
        Sprung { lagged: L::select(within, torque, wound), softening: L::select(is_clipped, one, softening) }
    }

    /// Least and greatest torque at a speed.
    #[inline(always)]
    pub fn limits(&self, dq: L) -> (L, L) {
        let fall = (dq.abs() - self.speed_knee) * self.speed_slope;
        let along = self.torque_limit * (L::one() - fall).max(L::zero()).min(L::one());
        let forward = L::zero().lt(dq);
        (L::select(forward, -self.torque_limit, -along), L::select(forward, along, self.torque_limit))
    }
}

/// Share of its torque that a motor gives whose strength drifts, `time` after the run's start; both in seconds.
#[inline(always)]
pub(crate) fn drifted<L: Real>(drift: L, time: L) -> L {
    (L::one() + drift * time).max(L::zero())
}

/// Share of its torque that a motor gives whose strength drifts by `drift` \[1/s\], `time` \[s\] after the run's start: `max(0, 1 + drift time)`.
pub fn drift_share(drift: f64, time: f64) -> f64 {
    drifted(drift, time)
}

/// 1 over the speeds between the knee of the limit and zero torque.
pub(crate) fn speed_slope(knee: f64, zero: f64) -> f64 {
    1.0 / (zero - knee).max(1e-6)
}

/// One motor, by the parameters `actuator.*` of the catalogue.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motor {
    /// Factor of all that is asked for.
    pub strength: f64,
    /// More of it where torque is positive, less where it is negative.
    pub strength_asymmetry: f64,
    /// Factor of kp.
    pub kp_scale: f64,
    /// Factor of kd.
    pub kd_scale: f64,
    /// Largest torque \[N m\].
    pub torque_limit: f64,
    /// Largest torque of position and feed-forward parts together \[N m\].
    pub position_torque_limit: f64,
    /// Speed from which torque along the motion falls \[rad/s\].
    pub speed_knee: f64,
    /// Speed at which it reaches zero \[rad/s\].
    pub speed_zero: f64,
    /// Full width of the play between motor and joint \[rad\].
    pub backlash: f64,
}

/// What a motor is reported: target \[rad\], target speed \[rad/s\], gains, feed-forward torque \[N m\].
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(missing_docs)]
pub struct MotorCommand {
    pub q: f64,
    pub dq: f64,
    pub kp: f64,
    pub kd: f64,
    pub tau: f64,
}

impl Motor {
    fn law(&self) -> Law<f64> {
        Law {
            strength: self.strength,
            asymmetry: self.strength_asymmetry,
            kp_scale: self.kp_scale,
            kd_scale: self.kd_scale,
            torque_limit: self.torque_limit,
            position_torque_limit: self.position_torque_limit,
            speed_knee: self.speed_knee,
            speed_slope: speed_slope(self.speed_knee, self.speed_zero),
            half_backlash: 0.5 * self.backlash,
            // What the encoder says is commanded to `demand`.
            compliance: 0.0,
        }
    }

    /// Where the motor is \[rad\] when its joint is at `q`, of one that was at `before`.
    pub fn within_play(&self, before: f64, q: f64) -> f64 {
        self.law().within_play(before, q)
    }

    /// Torque \[N m\] that a command asks for when the motor's encoder says `q` \[rad\] and its speed is `dq` \[rad/s\].
    pub fn demand(&self, command: &MotorCommand, q: f64, dq: f64) -> f64 {
        let MotorCommand { q: target, dq: speed, kp, kd, tau } = *command;
        self.law().demand(&CommandLanes { q: target, dq: speed, kp, kd, tau }, q, dq)
    }

    /// What its limits leave of a torque \[N m\] at a speed \[rad/s\].
    pub fn limited(&self, torque: f64, dq: f64) -> f64 {
        let (least, most) = self.law().limits(dq);
        torque.max(least).min(most)
    }
}

/// Share of the way to what is asked for that a first-order lag covers in a step, exact for a held input; both in seconds.
pub fn lag_gain(step: f64, time_constant: f64) -> f64 {
    if time_constant > 0.0 { 1.0 - (-step / time_constant).exp() } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lag_of_nothing_is_immediate() {
        assert_eq!(lag_gain(0.001, 0.0), 1.0);
        assert!((lag_gain(0.001, 0.001) - (1.0 - (-1.0f64).exp())).abs() < 1e-15);
    }

    #[test]
    fn a_motor_that_brakes_keeps_its_torque() {
        let motor = Motor {
            strength: 0.5,
            strength_asymmetry: 0.0,
            kp_scale: 1.0,
            kd_scale: 1.0,
            torque_limit: 4.0,
            position_torque_limit: 3.0,
            speed_knee: 1.0,
            speed_zero: 3.0,
            backlash: 0.2,
        };
        assert_eq!([motor.limited(9.0, 0.5), motor.limited(9.0, 2.0), motor.limited(-9.0, 2.0)], [4.0, 2.0, -4.0]);
        let command = MotorCommand { q: 1.0, dq: 0.0, kp: 10.0, kd: 1.0, tau: 0.0 };
        assert_eq!(motor.demand(&command, 0.0, 1.0), 0.5 * (3.0 - 1.0));
        assert_eq!([motor.within_play(0.0, 0.05), motor.within_play(0.0, 0.5)], [0.0, 0.4]);
    }
}
