//! Closes the loop: learns from recordings what a simulator lacks of a robot, and trains the walking policy on under it.
//!
//! [`log`] cuts recordings to decisions of the policy; [`identify`] names parameters and torques, [`fitting`] finds them: in
//! rollouts ([`study`]), and in the simulator of the training ([`training_windows`]), which replays [`windows`] in many lanes. See `docs/guide/tuning.md`.

/// Types of this stand in the interface of this crate.
pub use qv_core;

pub mod calibrate;
pub mod close;
pub mod compensation;
mod error;
mod export;
pub mod fitting;
pub mod footing;
pub mod hidden;
pub mod identify;
pub mod log;
pub mod paths;
pub mod study;
pub mod training_windows;
pub mod tune;
pub mod windows;

pub use error::ResidualError;
