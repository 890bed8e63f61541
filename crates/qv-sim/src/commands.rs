//! What joints are reported.

use crate::SimError;
use crate::error::{finite, length};

/// One low-level command, all of shape `[joints]`: `tau = kp (q - q_measured) + kd (dq - dq_measured) + tau`.
#[derive(Debug, Clone, Copy)]
pub struct JointCommand<'a> {
    /// Desired position \[rad\].
    pub q: &'a [f64],
    /// Desired speed \[rad/s\].
    pub dq: &'a [f64],
    /// Position gain \[N m/rad\].
    pub kp: &'a [f64],
    /// Velocity gain \[N m s/rad\].
    pub kd: &'a [f64],
    /// Feed-forward torque \[N m\].
    pub tau: &'a [f64],
}

impl JointCommand<'_> {
    /// # Errors
    /// When an array has another length than `joints`, or a number is not finite.
    pub(crate) fn check(&self, joints: usize) -> Result<(), SimError> {
        for (what, values) in [
            ("commanded positions", self.q),
            ("commanded speeds", self.dq),
            ("position gains", self.kp),
            ("velocity gains", self.kd),
            ("feed-forward torques", self.tau),
        ] {
            length(what, joints, values.len())?;
            finite(what, values)?;
        }
        Ok(())
    }
}

/// One low-level command for each environment: `tau = kp (q - q_measured) + kd (dq - dq_measured) + tau`.
///
/// `q` has the shape `[environments][joints]`; all others that, too, or `[joints]`, which then holds for all.
#[derive(Debug, Clone, Copy)]
pub struct BatchCommand<'a> {
    /// Desired positions \[rad\].
    pub q: &'a [f32],
    /// Desired speeds \[rad/s\]; zero if there are none.
    pub dq: Option<&'a [f32]>,
    /// Position gains \[N m/rad\].
    pub kp: &'a [f32],
    /// Velocity gains \[N m s/rad\].
    pub kd: &'a [f32],
    /// Feed-forward torques \[N m\]; zero if there are none.
    pub tau: Option<&'a [f32]>,
}
