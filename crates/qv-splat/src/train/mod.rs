//! From photographs with cameras to Gaussians. See `docs/guide/reconstruction.md` for the equations and their sources.
//!
//! A [`Dataset`] is read from a capture, a [`Model`] begins at points, a [`CpuEngine`] takes steps, [`train`] is the loop. Nothing here opens
//! a file or looks at a clock.

pub mod adam;
pub mod aside;
mod bake;
mod best;
pub mod cameras;
pub mod checkpoint;
mod cpu;
mod dataset;
mod drawn;
pub mod drop;
mod engine;
pub mod exposure;
pub mod filter;
#[cfg(feature = "gpu")]
pub mod gpu;
mod ground;
pub mod growing;
pub mod loss;
pub mod mcmc;
mod model;
mod moments;
mod neighbours;
mod options;
pub mod pose;
pub mod random;
mod score;
mod shared;
mod start;
pub mod terms;
#[cfg(test)]
pub(crate) mod tiny;
pub mod transients;
mod twist;
mod undistort;

pub use bake::bake;
pub use best::{Best, Snapshot};
pub use cpu::{CpuEngine, outputs};
pub use dataset::{Dataset, Files, Photograph, ReadOptions};
pub use drawn::drawn;
pub use engine::{Engine, Progress, ground_scores, scores, train};
pub use exposure::{Exposure, NEUTRAL};
pub use ground::{Ground, GroundOptions};
pub use model::Model;
pub use options::{Rates, TrainOptions, Weights};
pub use score::{GroundScore, Score, score};
pub use start::{AT_DEPTHS, AT_RANDOM, at_depths, at_random, of_points};
pub use undistort::{Pixels, smaller, undistorted};
