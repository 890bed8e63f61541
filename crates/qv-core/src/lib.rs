//! Types that every QuadVerse crate speaks: rigid [`Pose`]s between named frames, labelled [`TriangleMesh`]es and
//! sampled [`JointSeries`].
//!
//! Conventions (all crates): SI units, radians, seconds; world right-handed with z up; quaternions are `w, x, y, z`
//! at every boundary; a transform named `a_from_b` takes coordinates in frame `b` to coordinates in frame `a`.

mod error;
mod mesh;
mod pose;
mod series;

pub use error::CoreError;
pub use mesh::{Material, TriangleMesh};
pub use pose::Pose;
pub use series::JointSeries;

/// Standard gravity used throughout \[m/s²\], along -z of the world.
pub const GRAVITY: f64 = 9.81;
