//! Pictures and learning on a graphics card, through wgpu.

mod eye;
mod layers;
mod learn;
mod product;

pub use eye::GpuEye;
pub use learn::GpuLearner;
pub use qv_raster::gpu::{Gpu, GpuOptions};
