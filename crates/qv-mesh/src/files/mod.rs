//! Meshes on disk.

pub mod glb;
