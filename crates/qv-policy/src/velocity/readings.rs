//! What the simulator said of all robots after a step.

/// What the simulator said after the last step.
#[derive(Debug, Clone, Default)]
pub(super) struct Readings {
    pub q: Vec<f32>,
    pub v: Vec<f32>,
    pub torques: Vec<f32>,
    pub forces: Vec<f32>,
    /// Greatest force on each foot, upwards, of the physics steps of a decision \[N\].
    pub peaks: Vec<f32>,
    pub feet: Vec<f32>,
    pub feet_speed: Vec<f32>,
    pub gyro: Vec<f32>,
    pub acc: Vec<f32>,
    pub orientation: Vec<f32>,
    pub encoder_q: Vec<f32>,
    pub encoder_dq: Vec<f32>,
}
