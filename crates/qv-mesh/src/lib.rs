//! Depth maps to a watertight, labelled collision mesh.
//!
//! [`fuse`] makes a truncated signed distance of depth maps, in blocks of voxels where there is surface; [`extract`] takes its zero
//! surface by marching cubes; [`clean`] keeps the largest piece, [`close`] fills holes and makes the ground a solid; [`labels`] gives
//! each face the material of the Gaussians or pixels nearest to it; [`decimate()`] takes away triangles within a bound; [`similarity`]
//! brings it to metres and z up; [`files`] writes it. [`reconstruct`] does all of it. [`compare`] says how close two surfaces are.
//! `docs/guide/mesh.md` has the equations.
//!
//! All of it is parallel where that pays, and gives the same bits on any number of threads. Nothing here opens a file.

/// Types of these stand in the interface of this crate.
pub use {glam, qv_core};

pub mod agree;
pub mod clean;
pub mod close;
pub mod compare;
mod cubes;
pub mod decimate;
mod depth;
mod error;
mod extract;
#[cfg(test)]
#[path = "../../../fixtures/facts.rs"]
mod facts;
pub mod files;
pub mod labels;
mod nearest;
pub mod planes;
mod reconstruct;
pub mod similarity;
mod topology;
mod volume;

pub use decimate::decimate;
pub use depth::DepthFrame;
pub use error::MeshError;
pub use extract::extract;
pub use nearest::PointGrid;
pub use reconstruct::{MeshOptions, MeshReport, finish, reconstruct, surface};
pub use topology::Topology;
pub use volume::{FuseOptions, Volume, fuse};
