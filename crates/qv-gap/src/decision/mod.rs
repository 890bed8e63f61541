//! Deciding: from what was measured (`evidence`) by numbers that are all printed (`policy`) to a verdict (`verdict`), without a simulation.
//!
//! Each round's candidates are judged (`judge`); what is accused in the end is checked for signs that it stands for something
//! else (`checks`).

mod camera;
mod checks;
mod doubt;
pub mod evidence;
mod judge;
mod policy;
#[cfg(test)]
mod tests;
mod verdict;

pub use camera::{CameraDecision, NONE, both, decide_camera};
pub use doubt::{Doubt, Objection};
pub use judge::{Judge, Judgement};
pub use policy::{Camera, HeldWindows, Policy};
pub use verdict::{Decision, Divergence, decide, is_much_left};
