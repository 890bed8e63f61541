//! Diagnosis of the gap between a robot and its simulator: where it lies, what causes it, how far it shrinks.
//!
//! A recording is cut into windows, each simulated from its measured start; what is left is compared with what robots
//! without an effect leave (`null`), suspects are ranked by joint fits (`evidence`, `search`, `local`), accused one at a
//! time (`decide`), and judged in windows that no fit has seen (`closure`). See `docs/diagnosis.md`.

pub mod baselines;
pub mod closure;
pub mod columns;
mod commands;
pub mod constancy;
pub mod decide;
mod diagnose;
mod doubt;
mod error;
pub mod evidence;
pub mod excitation;
mod forget;
pub mod forward;
pub mod law;
mod laws;
mod leads;
pub mod library;
pub mod local;
mod moved;
pub mod null;
pub mod observe;
pub mod output;
mod pictures;
pub mod problem;
mod random;
mod reference;
mod regions;
pub mod report;
mod rest;
pub mod search;
mod sensitivities;
mod shares;
pub mod slip;
pub mod study;
mod telling;
mod twins;
pub mod visual;
pub mod whiten;

pub use diagnose::{Options, diagnose};
pub use error::GapError;
