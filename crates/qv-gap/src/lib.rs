//! Diagnosis of the gap between a robot and its simulator: where it lies, what causes it, how far it shrinks.
//!
//! A recording is cut into windows, each simulated from its measured start; what is left is compared with what robots
//! without an effect leave (`null`), candidates are ranked by joint fits (`evidence`, `search`, `local`) and measured in windows that
//! no fit has seen (`rounds`, `closure`). What is accused is decided from these figures alone (`decision`). See `docs/diagnosis.md`.

pub mod baselines;
pub mod closure;
pub mod columns;
mod commands;
pub mod constancy;
pub mod decision;
mod diagnose;
mod error;
mod estimates;
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
pub mod rounds;
pub mod search;
mod sensitivities;
mod shares;
pub mod slip;
pub mod study;
mod telling;
pub mod visual;
pub mod whiten;

pub use diagnose::{Options, diagnose};
pub use error::GapError;
