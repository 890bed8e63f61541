//! Meshes on disk: GLB with materials, PLY, STL.

pub mod glb;
pub mod ply;
pub mod stl;
