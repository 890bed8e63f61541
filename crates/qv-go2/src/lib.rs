//! The Unitree Go2: its [`model`] as URDF, its open-loop [`gait`]s, what it says on the [`wire`], and [`synthetic`]
//! recordings of it. No other library that is published knows this robot.

/// Types of these stand in the interface of this crate.
pub use {glam, qv_core};

pub mod descriptions;
pub mod gait;
pub mod messages;
pub mod model;
pub mod synthetic;
pub mod walk;
pub mod wire;
