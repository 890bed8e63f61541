//! Images on the graphics card.

use super::buffers::{Buffers, is_borrowed};
use super::rasteriser::GpuRasteriser;
use crate::RasterError;
use crate::lens::Batch;
use crate::scene::Image;

/// The images of a batch. All views follow one another, each row by row.
#[derive(Debug)]
pub struct GpuImages<'a> {
    rasteriser: &'a GpuRasteriser,
    buffers: &'a Buffers,
    batch: &'a Batch,
}

impl GpuRasteriser {
    /// The images of the batch that was drawn last.
    ///
    /// # Errors
    /// Nothing was drawn.
    pub fn images(&self) -> Result<GpuImages<'_>, RasterError> {
        match (&self.buffers, &self.batch) {
            (Some(buffers), Some(batch)) if self.drawn => Ok(GpuImages { rasteriser: self, buffers, batch }),
            _ => Err(RasterError::Device("expected a drawn batch, found none".into())),
        }
    }
}

impl GpuImages<'_> {
    /// Pixels of all views of the batch.
    pub fn pixels(&self) -> usize {
        self.batch.pixels
    }

    /// Colour and alpha, four floats or four bytes per pixel, red first.
    pub fn colour(&self) -> &wgpu::Buffer {
        self.buffers.get("colours")
    }

    /// Expected depth \[m\], a float per pixel; `None` when it was not drawn.
    pub fn depth(&self) -> Option<&wgpu::Buffer> {
        self.buffers.sizes.variant.depth.then(|| self.buffers.get("depths"))
    }

    /// Normal and plane depth \[m\], four floats per pixel; `None` when they were not drawn.
    pub fn plane(&self) -> Option<&wgpu::Buffer> {
        self.buffers.sizes.variant.plane.then(|| self.buffers.get("plane_image"))
    }

    /// Features, k floats per pixel; `None` when they were not drawn.
    pub fn features(&self) -> Option<&wgpu::Buffer> {
        (self.buffers.sizes.variant.features > 0).then(|| self.buffers.get("feature_image"))
    }

    /// Red, green, blue, alpha as bytes, shape `[views, height, width, 4]` when all views are of one size.
    ///
    /// # Errors
    /// The batch was drawn in floats, or the device fails.
    pub fn read_bytes(&self) -> Result<Vec<u8>, RasterError> {
        if !self.buffers.sizes.variant.bytes {
            return Err(RasterError::Device("expected images in bytes, found floats".into()));
        }
        self.rasteriser.gpu.read(self.colour(), 4 * self.batch.pixels)
    }

    /// All that was drawn, in floats.
    ///
    /// # Errors
    /// The device fails.
    pub fn read(&self) -> Result<Vec<Image>, RasterError> {
        let gpu = &self.rasteriser.gpu;
        let pixels = self.batch.pixels;
        let variant = &self.buffers.sizes.variant;
        let rgba: Vec<[f32; 4]> = if variant.bytes {
            let bytes: Vec<[u8; 4]> = gpu.read(self.colour(), pixels)?;
            bytes.iter().map(|pixel| pixel.map(|byte| byte as f32 / 255.0)).collect()
        } else {
            gpu.read(self.colour(), pixels)?
        };
        let depth: Vec<f32> = self.depth().map_or(Ok(vec![]), |buffer| gpu.read(buffer, pixels))?;
        let plane: Vec<[f32; 4]> = self.plane().map_or(Ok(vec![]), |buffer| gpu.read(buffer, pixels))?;
        let k = variant.features as usize;
        let features: Vec<f32> = self.features().map_or(Ok(vec![]), |buffer| gpu.read(buffer, k * pixels))?;
        let image = |lens: &crate::lens::Lens| {
            let (width, height) = (lens.size[0] as usize, lens.size[1] as usize);
            let range = lens.first_pixel as usize..lens.first_pixel as usize + width * height;
            let some = |all: &[f32], each: usize| match all.is_empty() {
                true => vec![],
                false => all[each * range.start..each * range.end].to_vec(),
            };
            let of_plane = if plane.is_empty() { &plane[..] } else { &plane[range.clone()] };
            Image {
                width,
                height,
                colour: rgba[range.clone()].iter().flat_map(|p| [p[0], p[1], p[2]]).collect(),
                alpha: rgba[range.clone()].iter().map(|p| p[3]).collect(),
                depth: some(&depth, 1),
                plane_depth: of_plane.iter().map(|p| p[3]).collect(),
                normal: of_plane.iter().flat_map(|p| [p[0], p[1], p[2]]).collect(),
                features: some(&features, k),
            }
        };
        Ok(self.batch.lenses.iter().map(image).collect())
    }
}

impl GpuRasteriser {
    /// The first numbers of a buffer of the batch that was drawn last, by its name in `Sizes`: to look at what a stage gave.
    /// What early stages leave only until later ones write cannot be had.
    ///
    /// # Errors
    /// Nothing was drawn, there is no such buffer, it holds less, or the device fails.
    pub fn read_stage<T: bytemuck::Pod>(&self, name: &str, count: usize) -> Result<Vec<T>, RasterError> {
        let drawn = self.buffers.as_ref().filter(|_| self.drawn);
        let buffer = drawn.and_then(|buffers| buffers.find(name)).filter(|_| !is_borrowed(name));
        let buffer = buffer.ok_or_else(|| RasterError::Device(format!("expected a drawn batch with `{name}`")))?;
        let (limit, found) = (buffer.size(), (count * size_of::<T>()) as u64);
        if found > limit {
            return Err(RasterError::TooLarge { what: format!("bytes of `{name}`"), limit, found });
        }
        self.gpu.read(buffer, count)
    }
}
