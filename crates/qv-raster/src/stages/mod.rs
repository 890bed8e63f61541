//! The stages of a frame, forward and backward. Each file here has a twin of the same name in WGSL beside it.

pub mod blend;
pub mod blend_backward;
pub mod compose;
pub mod cull;
pub mod emit;
pub mod project;
pub mod project_backward;
pub mod ranges;
pub mod resolve;
pub mod sort;
