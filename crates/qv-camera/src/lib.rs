//! The camera in the diagnosis: what it sees against what a splat of the place shows at the measured pose.
//!
//! Stage one aligns each photograph with the scene and gets what it is off by (`align`); stage two asks which effect of the
//! camera all photographs share (`model`, `judge`), and shows how far photographs and scene agree in
//! photographs that the fit has not seen. What is accused is decided from that by `qv_gap::decision`. See `docs/guide/visual.md`.

/// Types of these stand in the interface of this crate.
pub use {glam, qv_core};

pub mod align;
mod calibrated;
mod error;
#[cfg(test)]
#[path = "../../../fixtures/facts.rs"]
mod facts;
mod footage;
pub mod html;
mod judge;
mod look;
pub mod model;
pub mod path;
pub mod picture;
mod see;
mod sight;

pub use calibrated::to_toml;
pub use error::CameraError;
pub use footage::{Footage, Intrinsics, Photograph, Rig};
pub use judge::{CameraEffect, EFFECTS};
pub use look::{check, look};
pub use see::{FEWEST, LookOptions};
pub use sight::{Look, Looks};
