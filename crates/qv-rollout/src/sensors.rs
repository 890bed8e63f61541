//! Errors of the sensors, and rotations that they report.

use glam::DQuat;
use qv_core::{JointSeries, Pose};

/// Errors of the sensors that the simulated robot has as parameters: the start is freed of them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SensorErrors {
    /// Measured minus true joint position \[rad\], in model order; empty = none.
    pub encoder_bias: Vec<f64>,
    /// Turn of the IMU about the base's x and y \[rad\].
    pub imu_tilt: [f64; 2],
    /// Constant error of the gyroscope \[rad/s\].
    pub gyro_bias: [f64; 3],
    /// Age of a pose at its stamp \[s\].
    pub pose_delay: f64,
    /// Age of joint positions and velocities at their stamp \[s\], in model order; empty = none.
    pub encoder_latency: Vec<f64>,
}

/// Base from IMU.
pub(crate) fn tilt_of(errors: &SensorErrors) -> DQuat {
    let [roll, pitch] = errors.imu_tilt;
    Pose::from_xyz_rpy([0.0; 3], [roll, pitch, 0.0]).rotation
}

pub(crate) fn rotation_of(wxyz: &[f64]) -> Option<DQuat> {
    Pose::from_position_wxyz([0.0; 3], [wxyz[0], wxyz[1], wxyz[2], wxyz[3]]).map(|p| p.rotation)
}

/// The rotation at `time` between its neighbours, from the quaternion in columns `first` to `first + 3`.
pub(crate) fn rotation_near(series: &JointSeries, first: usize, time: f64) -> Option<DQuat> {
    if series.is_empty() {
        return None;
    }
    let i = series.index_at(time).unwrap_or(0);
    let a = rotation_of(&series.row(i)[first..first + 4])?;
    if i + 1 >= series.len() || time <= series.time[i] {
        return Some(a);
    }
    let b = rotation_of(&series.row(i + 1)[first..first + 4])?;
    let step = series.time[i + 1] - series.time[i];
    Some(a.slerp(b, ((time - series.time[i]) / step).clamp(0.0, 1.0)))
}
