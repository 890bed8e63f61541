//! Diagnosis of the gap between a robot and its simulator: where it lies, what causes it, how far it shrinks.
//!
//! A recording is cut into windows, each simulated from its measured start; what is left is compared with what robots
//! without an effect leave (`null`), candidates are ranked by joint fits (`inference`) and measured in windows that
//! no fit has seen (`diagnose/rounds`, `checks`). What is accused is decided from these figures alone (`decision`). See `docs/theory/diagnosis.md`.
//!
//! An example, which makes its recording itself:
#![doc = concat!("```\n", include_str!("../examples/diagnose.rs"), "```")]

/// Types of these stand in the interface of this crate.
pub use {glam, qv_core, qv_rollout};

pub mod checks;
pub mod decision;
mod diagnose;
pub mod drift;
mod error;
pub mod export;
#[cfg(test)]
#[path = "../../../fixtures/facts.rs"]
mod facts;
pub mod findings;
pub mod inference;
mod jacobian;
pub mod next;
pub mod null;
pub mod problem;
pub mod report;

pub use diagnose::{Diagnosis, Options, Progress, can_tell, diagnose, validate};
pub use error::GapError;
