//! Depth maps to a watertight, labelled collision mesh.

mod error;
pub mod files;

pub use error::MeshError;
