//! One camera after another of a cloud that lives on the card alone: what training draws.

use super::cloud::GpuCloud;
use super::device::Gpu;
use super::rasteriser::{GpuRasteriser, GpuSettings, kind};
use super::record::Recorder;
use crate::lens::Batch;
use crate::shaders::slot;
use crate::{RasterError, Scene, Settings, View};
use qv_core::GaussianCloud;

/// Cameras on the card, each a lens of 64 bytes and rows of `camera_from_world` of 48 bytes.
#[derive(Debug)]
pub struct GpuCameras {
    /// Lenses, 16 words each.
    pub lenses: wgpu::Buffer,
    /// Rows of `camera_from_world`, 12 floats each.
    pub motions: wgpu::Buffer,
    sizes: Vec<[u32; 2]>,
}

const LENS: u64 = 64;
const MOTION: u64 = 48;

impl GpuCameras {
    /// Copies cameras.
    ///
    /// # Errors
    /// One of them is off.
    pub fn new(gpu: &Gpu, views: &[View]) -> Result<Self, RasterError> {
        let nothing = GaussianCloud::default();
        let mut both = (vec![], vec![]);
        // Each by itself: its tiles and pixels are the first.
        for view in views {
            let batch = Batch::new(&Scene::still(&nothing), &[*view])?;
            both.0.extend(batch.lenses);
            both.1.extend(batch.motions);
        }
        let sizes = both.0.iter().map(|lens| lens.size).collect();
        Ok(Self { lenses: gpu.filled("all lenses", &both.0)?, motions: gpu.filled("all motions", &both.1)?, sizes })
    }
}

impl GpuRasteriser {
    /// Makes what one view at a time of a still cloud needs, with buffers for `capacity` Gaussians.
    ///
    /// # Errors
    /// As [`Self::prepare`].
    pub fn prepare_still(
        &mut self,
        cloud: &GpuCloud,
        view: &View,
        capacity: usize,
        settings: &Settings,
        how: &GpuSettings,
    ) -> Result<(), RasterError> {
        let nothing = GaussianCloud::default();
        let batch = Batch::new(&Scene::still(&nothing), &[*view])?;
        self.prepare_batch(cloud, batch, capacity.max(cloud.count), settings, how)
    }

    /// Records that the camera of the prepared view becomes one of `cameras`, which must be of the same size.
    ///
    /// # Errors
    /// Nothing was prepared, there is no such camera, or it is of another size.
    pub fn aim(&self, cameras: &GpuCameras, index: usize, recorder: &mut Recorder) -> Result<(), RasterError> {
        let (Some(batch), Some(constants)) = (&self.batch, &self.constants) else {
            return Err(RasterError::Device("expected a prepared batch, found none".into()));
        };
        let Some(size) = cameras.sizes.get(index) else {
            return Err(RasterError::Index { what: "camera".into(), count: cameras.sizes.len(), found: index });
        };
        if batch.lenses.len() != 1 || batch.lenses[0].size != *size {
            let expected =
                format!("one view of {size:?} pixels, found {:?}", batch.lenses.iter().map(|lens| lens.size));
            return Err(RasterError::Device(format!("expected {expected}")));
        }
        let (from_lens, from_motion) = (LENS * index as u64, MOTION * index as u64);
        recorder.encoder.copy_buffer_to_buffer(&cameras.lenses, from_lens, &constants.lenses, 0, LENS);
        recorder.encoder.copy_buffer_to_buffer(&cameras.motions, from_motion, &constants.motions, 0, MOTION);
        Ok(())
    }

    /// A buffer of the prepared batch by its name in `Sizes`, `state` (counts by slot) among them.
    pub fn buffer(&self, name: &str) -> Option<&wgpu::Buffer> {
        let buffers = self.buffers.as_ref()?;
        if name == "state" { Some(&buffers.state) } else { buffers.find(name) }
    }

    /// Candidates and entries for which there are buffers.
    pub fn room(&self) -> [u64; 2] {
        self.buffers.as_ref().map_or([0; 2], |buffers| [buffers.sizes.visible, buffers.sizes.entries])
    }

    /// Makes buffers for more candidates and entries; what was drawn is lost.
    ///
    /// # Errors
    /// The device has no room for them.
    pub fn make_more_room(
        &mut self,
        cloud: &GpuCloud,
        settings: &Settings,
        candidates: usize,
        entries: usize,
    ) -> Result<(), RasterError> {
        self.make_room(candidates, entries)?;
        self.remake_constants(cloud, settings)
    }

    /// Says anew how many Gaussians the cloud has, within the capacity that was prepared.
    pub fn recount(&mut self, cloud: &GpuCloud) {
        self.kind = kind(cloud);
        let (Some(constants), Some(buffers)) = (&self.constants, &self.buffers) else { return };
        let blocks = cloud.count.div_ceil(256) as u32;
        // The second word of `frame` is the number of Gaussians, the fourth that of their blocks.
        self.gpu.queue.write_buffer(&constants.frame, 4, bytemuck::bytes_of(&(cloud.count as u32)));
        self.gpu.queue.write_buffer(&constants.frame, 12, bytemuck::bytes_of(&blocks));
        self.gpu.queue.write_buffer(&buffers.state, slot::CULL_BLOCKS as u64 * 4, bytemuck::bytes_of(&blocks));
    }
}
