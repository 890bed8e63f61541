//! Gaussians and cameras to images, forward and backward.
//!
//! A [`Scene`] is a cloud that all environments share, with groups of Gaussians that move in each environment on their own. A
//! batch of [`View`]s is drawn in stages ([`stages`]): cull, project, sort by depth, emit an entry for each tile that a Gaussian
//! touches, sort by tile, blend. The CPU does all of it in parallel and gives the same bits on any number of threads. See
//! `docs/theory/rasteriser.md` for the equations.
//!
//! ```
//! use qv_core::{Camera, GaussianCloud, Pose};
//! use qv_raster::{Scene, Settings, View, render};
//! let cloud = GaussianCloud {
//!     means: vec![[0.0, 0.0, 2.0]],
//!     log_scales: vec![[-2.0; 3]],
//!     rotations: vec![[1.0, 0.0, 0.0, 0.0]],
//!     opacity_logits: vec![2.0],
//!     sh: vec![[1.0, 0.0, -1.0]],
//!     ..Default::default()
//! };
//! let camera =
//!     Camera { fx: 50.0, fy: 50.0, cx: 32.0, cy: 24.0, width: 64, height: 48, camera_from_world: Pose::IDENTITY };
//! let (images, faulty) = render(&Scene::still(&cloud), &[View::of(camera)], &Settings::default())?;
//! assert!(images[0].alpha[24 * 64 + 32] > 0.8 && faulty == 0);
//! # Ok::<(), qv_raster::RasterError>(())
//! ```

/// Types of these stand in the interface of this crate.
pub use {glam, qv_core};

pub mod channels;
pub mod constants;
mod ellipse;
mod error;
mod frame;
#[cfg(feature = "gpu")]
pub mod gpu;
mod harmonics;
mod lanes;
pub mod lens;
mod memory;
mod scene;
pub mod shaders;
pub mod stages;
pub mod training;
pub mod workload;

pub use error::RasterError;
pub use frame::{Frame, render};
pub use scene::{Gradients, Image, Outputs, Scene, Settings, View};
