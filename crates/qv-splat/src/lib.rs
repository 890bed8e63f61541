//! Gaussian splats on disk, and the cameras of a capture.
//!
//! [`files`] reads and writes 3DGS PLY, compressed PLY, SPZ and glTF `KHR_gaussian_splatting`, and reads `.splat`;
//! `docs/reference/splat_files.md` has the layouts, their sources and their quantisation. [`captures`] reads the cameras that images were taken with:
//! nerfstudio, COLMAP, RGB-D folders, and a JSON of our own. [`lens`] draws what a distorted camera sees.
//!
//! Nothing here opens a file: callers pass bytes. No memory is taken on a file's word: a count is held against the bytes that
//! are there first.
//!
//! ```
//! use qv_core::GaussianCloud;
//! use qv_splat::files::{Format, read_any, write};
//! let cloud = GaussianCloud {
//!     means: vec![[1.0, 2.0, 3.0]],
//!     log_scales: vec![[-3.0; 3]],
//!     rotations: vec![[1.0, 0.0, 0.0, 0.0]],
//!     opacity_logits: vec![0.5],
//!     sh: vec![[0.2, 0.1, 0.0]],
//!     ..Default::default()
//! };
//! let file = read_any(&write(&cloud, Format::Ply)?)?;
//! assert_eq!((file.cloud, file.format, file.left_out), (cloud, Format::Ply, 0));
//! # Ok::<(), qv_splat::SplatError>(())
//! ```

/// Types of these stand in the interface of this crate.
pub use {glam, qv_core};

pub mod captures;
mod cursor;
mod error;
#[cfg(test)]
#[path = "../../../fixtures/facts.rs"]
mod facts;
pub mod files;
mod harmonics;
pub mod lens;
mod moved;
pub mod stereo;
pub mod train;

pub use error::{SplatError, error_at};
pub use moved::moved;
