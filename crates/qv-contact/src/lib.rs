//! Friction of the ground by material: a prior from what its label says, refined by replaying what a robot recorded on it.
//!
//! [`calibrate`] takes runs, the robot's model, the labelled mesh and priors ([`prior`]); what it finds is plain data
//! ([`report`]), drawn by [`html`]. See `docs/guide/contact.md` for the equations.

/// Types of these stand in the interface of this crate.
pub use {glam, qv_core};

mod calibrate;
mod error;
#[cfg(test)]
#[path = "../../../fixtures/facts.rs"]
mod facts;
pub mod ground;
pub mod html;
pub mod measured;
pub mod posterior;
pub mod prior;
pub mod report;
pub mod robot;
pub mod segments;
pub mod simulate;
pub mod whiten;
pub mod windows;

pub use calibrate::{Options, calibrate};
pub use error::ContactError;
pub use ground::Ground;
pub use prior::Prior;
pub use prior::RANGE;
pub use report::Report;
