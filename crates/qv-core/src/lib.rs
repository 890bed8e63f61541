//! Types that every QuadVerse crate speaks: rigid [`Pose`]s between named frames, labelled [`TriangleMesh`]es,
//! sampled [`JointSeries`], [`GaussianCloud`]s and the pinhole [`Camera`]s that see them; and what several of them draw
//! and count with: seeded numbers ([`random`]) and the median ([`statistics`]).
//!
//! Conventions (all crates): SI units, radians, seconds; world right-handed with z up; quaternions are `w, x, y, z`
//! at every boundary; a transform named `a_from_b` takes coordinates in frame `b` to coordinates in frame `a`.

/// Types of this stand in the interface of this crate.
pub use glam;

mod camera;
mod error;
mod gaussians;
mod mesh;
mod pose;
pub mod random;
mod series;
mod sow;
pub mod statistics;

pub use camera::Camera;
pub use error::{CoreError, Mismatch};
pub use gaussians::GaussianCloud;
pub use mesh::{Material, TriangleMesh, label_colour};
pub use pose::Pose;
pub use series::JointSeries;
pub use sow::sow;

/// Standard gravity used throughout \[m/s²\], along -z of the world.
pub const GRAVITY: f64 = 9.81;
