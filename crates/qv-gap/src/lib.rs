//! Diagnosis of the gap between a robot and its simulator: where it lies, what causes it, how far it shrinks.

pub mod columns;
mod error;
pub mod evidence;
pub mod forward;
pub mod law;
pub mod library;
pub mod null;
pub mod observe;
pub mod output;
pub mod problem;
mod random;
pub mod report;
pub mod search;
pub mod study;
pub mod whiten;

pub use error::GapError;
