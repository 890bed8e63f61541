//! The stages on a graphics card, through wgpu.
//!
//! A [`Gpu`] is a device, a [`GpuCloud`] a cloud copied to it, a [`GpuRasteriser`] draws batches of views. Nothing is read back
//! within a frame: the counts of one stage become the dispatch arguments of the next on the card. Images stay there until they
//! are read.

mod backdrop;
mod backward;
mod bisect;
mod buffers;
mod cloud;
mod constants;
mod device;
mod forward;
mod images;
mod rasteriser;
mod record;
mod steps;
mod still;

pub use backdrop::Backdrop;
pub use cloud::GpuCloud;
pub use device::{Gpu, GpuOptions};
pub use forward::Counts;
pub use images::GpuImages;
pub use rasteriser::{GpuRasteriser, GpuSettings, Stage};
pub use record::{Job, Recorder, Stamps};
pub use still::GpuCameras;
