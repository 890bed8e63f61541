//! The Unitree Go2: its [`model`] as URDF, its open-loop [`gait`]s, and what it says on the [`wire`]. No other crate
//! knows this robot.

pub mod gait;
pub mod messages;
pub mod model;
pub mod wire;
