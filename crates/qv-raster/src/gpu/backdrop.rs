//! Prepared images behind those of a batch, on the card.

use super::rasteriser::GpuRasteriser;
use super::record::{Groups, Recorder, Step};
use crate::RasterError;
use crate::lens::Lens;
use crate::shaders::Variant;

/// Images of a batch that are kept: of what does not move, for views that stay. See [`GpuRasteriser::compose`].
#[derive(Debug)]
pub struct Backdrop {
    colours: wgpu::Buffer,
    depths: Option<wgpu::Buffer>,
    bytes: bool,
    lenses: Vec<Lens>,
}

impl Backdrop {
    /// Bytes on the card.
    pub fn bytes(&self) -> u64 {
        self.colours.size() + self.depths.as_ref().map_or(0, wgpu::Buffer::size)
    }
}

impl GpuRasteriser {
    /// Copies the images of the batch that was drawn last, on the card.
    ///
    /// # Errors
    /// Nothing was drawn, or there is no memory left.
    pub fn backdrop(&self) -> Result<Backdrop, RasterError> {
        let (Some(buffers), Some(batch), true) = (&self.buffers, &self.batch, self.drawn) else {
            return Err(nothing());
        };
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let mut copy = |name: &'static str, each: u64| {
            let to = self.gpu.buffer(name, batch.pixels as u64 * each)?;
            encoder.copy_buffer_to_buffer(buffers.get(name), 0, &to, 0, batch.pixels as u64 * each);
            Ok::<_, RasterError>(to)
        };
        let variant = &buffers.sizes.variant;
        let colours = copy("colours", if variant.bytes { 4 } else { 16 })?;
        let depths = variant.depth.then(|| copy("depths", 4)).transpose()?;
        self.gpu.queue.submit([encoder.finish()]);
        Ok(Backdrop { colours, depths, bytes: variant.bytes, lenses: batch.lenses.clone() })
    }

    /// Puts the images of the batch that was drawn last, over black, before a backdrop of the same views, in place. How is reported at
    /// [`compose`](crate::stages::compose::compose); depths are put together, and hide, when the backdrop has them. Waits for the card only
    /// when it is `timed`, and then gives milliseconds.
    ///
    /// # Errors
    /// Nothing was drawn; it was drawn with other lenses, in floats for bytes, without depths that the backdrop has, or with planes, features
    /// or `keep`.
    pub fn compose(&self, backdrop: &Backdrop, timed: bool) -> Result<Vec<(&'static str, f64)>, RasterError> {
        let (Some(buffers), Some(batch), true) = (&self.buffers, &self.batch, self.drawn) else {
            return Err(nothing());
        };
        let all = &buffers.sizes.variant;
        let variant = Variant { bytes: all.bytes, depth: backdrop.depths.is_some(), ..Default::default() };
        let alike = all.bytes == backdrop.bytes && (all.depth || !variant.depth);
        if batch.lenses != backdrop.lenses || !alike || all.plane || all.keep || all.features > 0 {
            let what = "before a backdrop: expected images of its views and its kind (bytes or floats, depth or none; no \
                        planes, features or derivatives), found others";
            return Err(RasterError::Device(what.into()));
        }
        let mut bound = vec![(0, buffers.get("colours")), (1, &backdrop.colours)];
        if let Some(depths) = &backdrop.depths {
            bound.extend([(2, buffers.get("depths")), (3, depths)]);
        }
        let blocks = batch.pixels.div_ceil(256) as u32;
        let groups = Groups::Fixed(blocks.min(32768), blocks.div_ceil(32768));
        let mut recorder = Recorder::new(&self.gpu, timed);
        recorder.run("compose", &[Step { stage: "compose", entry: "compose", variant, groups, buffers: bound }]);
        recorder.submit().map_or(Ok(vec![]), |stamps| stamps.read(&self.gpu))
    }
}

fn nothing() -> RasterError {
    RasterError::Device("expected a drawn batch, found none".into())
}
