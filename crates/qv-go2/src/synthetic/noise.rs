//! The noise of the sensors.

use qv_core::random::SplitMix64;

/// Standard deviations of the noise on each sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct Deviations {
    /// Joint positions \[rad\].
    pub position: f64,
    /// Joint speeds \[rad/s\].
    pub velocity: f64,
    /// Torque estimates \[N m\].
    pub torque: f64,
    /// Gyroscope \[rad/s\].
    pub gyro: f64,
    /// Accelerometer \[m/s²\].
    pub acceleration: f64,
    /// Orientation by the IMU \[rad\].
    pub orientation: f64,
    /// Foot forces \[N\].
    pub force: f64,
    /// Position of the base \[m\].
    pub pose_position: f64,
    /// Orientation of the base \[rad\].
    pub pose_orientation: f64,
}

impl Deviations {
    /// What a Go2's sensors have, roughly.
    pub const NOMINAL: Self = Self {
        position: 0.0008,
        velocity: 0.03,
        torque: 0.2,
        gyro: 0.01,
        acceleration: 0.1,
        orientation: 0.001,
        force: 2.0,
        pose_position: 0.002,
        pose_orientation: 0.002,
    };

    /// Each deviation times a factor of its own, drawn between `least` and `most`.
    pub fn drawn(draws: &mut SplitMix64, least: f64, most: f64) -> Self {
        let mut out = Self::NOMINAL;
        let all = [
            &mut out.position,
            &mut out.velocity,
            &mut out.torque,
            &mut out.gyro,
            &mut out.acceleration,
            &mut out.orientation,
            &mut out.force,
            &mut out.pose_position,
            &mut out.pose_orientation,
        ];
        all.into_iter().for_each(|deviation| *deviation *= draws.between(least, most));
        out
    }
}
