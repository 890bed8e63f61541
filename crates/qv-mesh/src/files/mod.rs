//! Meshes on disk: GLB with materials, PLY, STL.

pub mod glb;
mod gltf;
pub mod ply;
pub mod stl;
