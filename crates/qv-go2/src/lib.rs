//! The Unitree Go2: its [`model`] as URDF, its open-loop [`gait`]s, what it says on the [`wire`], and [`synthetic`]
//! recordings of it, [`sealed`] ones with a cause to be found. No other crate knows this robot.

pub mod gait;
pub mod messages;
pub mod model;
pub mod sealed;
pub mod synthetic;
pub mod walk;
pub mod wire;
