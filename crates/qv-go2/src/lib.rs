//! The Unitree Go2: its [`model`] as URDF and its open-loop [`gait`]s. No other crate knows this robot.

pub mod gait;
pub mod model;
