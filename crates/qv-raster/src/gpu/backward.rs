//! Derivatives on the graphics card.

use super::cloud::GpuCloud;
use super::rasteriser::GpuRasteriser;
use super::record::{Groups, Recorder, Step};
use super::steps::FrameSteps;
use crate::RasterError;
use crate::scene::{Gradients, Image};
use crate::shaders::dispatch;

impl GpuRasteriser {
    /// Derivatives of a scalar, given its derivatives with respect to the images of the batch that was drawn last, with
    /// [`keep`](super::GpuSettings::keep). Waits for the card.
    ///
    /// # Errors
    /// Nothing was drawn so that derivatives can be had, or an array has another length than the image's.
    pub fn gradients(&mut self, cloud: &GpuCloud, by_images: &[Image]) -> Result<Gradients, RasterError> {
        self.write_image_gradients(by_images)?;
        self.submit_backward(cloud, false)?;
        self.read_gradients(cloud)
    }

    /// Puts derivatives with respect to the images where [`Self::submit_backward`] reads them. A program that computes them on the
    /// card writes the buffers itself; see [`Self::image_gradients`].
    ///
    /// # Errors
    /// As [`Self::gradients`].
    pub fn write_image_gradients(&mut self, by_images: &[Image]) -> Result<(), RasterError> {
        let (buffers, batch) = self.kept()?;
        let length = |what: String, expected: usize, found: usize| {
            if expected == found { Ok(()) } else { Err(RasterError::Length { what, expected, found }) }
        };
        length("derivatives by image".into(), batch.lenses.len(), by_images.len())?;
        let variant = buffers.sizes.variant;
        let (mut colours, mut planes) = (vec![], vec![]);
        let (mut depths, mut features): (Vec<f32>, Vec<f32>) = (vec![], vec![]);
        for (view, (lens, image)) in batch.lenses.iter().zip(by_images).enumerate() {
            let n = (lens.size[0] * lens.size[1]) as usize;
            let each = |wanted: bool, k: usize| if wanted { k * n } else { 0 };
            for (name, expected, found) in [
                ("colour", 3 * n, image.colour.len()),
                ("alpha", n, image.alpha.len()),
                ("depth", each(variant.depth, 1), image.depth.len()),
                ("plane depth", each(variant.plane, 1), image.plane_depth.len()),
                ("normal", each(variant.plane, 3), image.normal.len()),
                ("features", n * variant.features as usize, image.features.len()),
            ] {
                length(format!("derivatives by {name} of view {view}"), expected, found)?;
            }
            let joined = |three: &[f32], one: &[f32]| -> Vec<[f32; 4]> {
                three.chunks_exact(3).zip(one).map(|(a, b)| [a[0], a[1], a[2], *b]).collect()
            };
            colours.extend(joined(&image.colour, &image.alpha));
            planes.extend(joined(&image.normal, &image.plane_depth));
            depths.extend(&image.depth);
            features.extend(&image.features);
        }
        let write = |name: &str, bytes: &[u8]| {
            if !bytes.is_empty() {
                self.gpu.queue.write_buffer(buffers.get(name), 0, bytes);
            }
        };
        write("by_colours", bytemuck::cast_slice(&colours));
        write("by_depths", bytemuck::cast_slice(&depths));
        write("by_planes", bytemuck::cast_slice(&planes));
        write("by_features", bytemuck::cast_slice(&features));
        Ok(())
    }

    /// Buffers for derivatives with respect to the images: colour and alpha (four floats per pixel), depth (one), normal and plane depth
    /// (four), features (k); `None` for what is not drawn.
    ///
    /// # Errors
    /// As [`Self::gradients`].
    pub fn image_gradients(&self) -> Result<[Option<&wgpu::Buffer>; 4], RasterError> {
        let (buffers, _) = self.kept()?;
        Ok(["by_colours", "by_depths", "by_planes", "by_features"].map(|name| buffers.find(name)))
    }

    /// Records and submits the backward stages of the batch that was drawn last, and waits for nothing.
    ///
    /// # Errors
    /// Nothing was drawn so that derivatives can be had.
    pub fn submit_backward(&mut self, cloud: &GpuCloud, timed: bool) -> Result<(), RasterError> {
        self.check_drawn()?;
        let mut recorder = Recorder::new(&self.gpu, timed);
        let (buffers, _) = self.kept()?;
        for name in ["by_sh", "by_feature"] {
            if let Some(buffer) = buffers.find(name) {
                recorder.encoder.clear_buffer(buffer, 0, None);
            }
        }
        self.record_backward(cloud, &mut recorder)?;
        self.stamps = recorder.submit();
        Ok(())
    }

    /// Records the backward stages after [`Self::record_forward`] of the same batch, in the same recorder or one before. What comes to harmonics and features is added to what is in the
    /// buffers `by_sh` and `by_feature` already.
    ///
    /// # Errors
    /// Nothing was drawn so that derivatives can be had.
    pub fn record_backward(&self, cloud: &GpuCloud, recorder: &mut Recorder) -> Result<(), RasterError> {
        self.check_cloud(cloud)?;
        let (buffers, batch) = self.kept()?;
        let Some(constants) = &self.constants else { return Err(nothing()) };
        let frame = FrameSteps { batch, buffers, constants, cloud };
        let atomic = buffers.sizes.variant.atomic;
        let summed = if atomic { "record_gradients" } else { "entry_gradients" };
        if let Some(buffer) = buffers.find(summed) {
            recorder.encoder.clear_buffer(buffer, 0, None);
        }
        recorder.run("blend backward", &frame.blend_backward());
        let sums = frame.sum_entries();
        if !sums.is_empty() {
            recorder.run("sum entries", &sums);
        }
        recorder.run("project backward", &frame.project_backward());
        Ok(())
    }

    /// What [`Self::submit_backward`] found. Waits for the card.
    ///
    /// # Errors
    /// As [`Self::gradients`], or the device fails.
    pub fn read_gradients(&self, cloud: &GpuCloud) -> Result<Gradients, RasterError> {
        self.check_cloud(cloud)?;
        self.check_drawn()?;
        let (buffers, batch) = self.kept()?;
        let n = cloud.count;
        let shape: Vec<[[f32; 4]; 3]> = self.gpu.read(buffers.get("by_shape"), n)?;
        let three = |v: [f32; 4]| [v[0], v[1], v[2]];
        let count = (cloud.sh_degree as usize + 1).pow(2);
        let features = n * cloud.feature_count;
        Ok(Gradients {
            means: shape.iter().map(|s| three(s[0])).collect(),
            log_scales: shape.iter().map(|s| three(s[1])).collect(),
            rotations: shape.iter().map(|s| s[2]).collect(),
            opacity_logits: shape.iter().map(|s| s[0][3]).collect(),
            sh: self.gpu.read(buffers.get("by_sh"), n * count)?,
            features: match buffers.find("by_feature") {
                Some(buffer) => self.gpu.read(buffer, features)?,
                None => vec![0.0; features],
            },
            poses: self.gpu.read(buffers.get("by_pose"), batch.lenses.len())?,
        })
    }

    fn check_drawn(&self) -> Result<(), RasterError> {
        if self.drawn { Ok(()) } else { Err(nothing()) }
    }

    fn kept(&self) -> Result<(&super::buffers::Buffers, &crate::lens::Batch), RasterError> {
        match (&self.buffers, &self.batch, self.after) {
            (_, _, Some(stage)) => Err(RasterError::Device(format!(
                "expected a batch that the GPU drew alone, found one that the CPU drew up to {stage:?}"
            ))),
            (Some(buffers), Some(batch), None) if buffers.sizes.variant.keep => Ok((buffers, batch)),
            _ => Err(nothing()),
        }
    }
}

fn nothing() -> RasterError {
    RasterError::Device("expected a batch that was drawn with `keep`, found none".into())
}

impl<'a> FrameSteps<'a> {
    fn blend_backward(&self) -> Vec<Step<'a>> {
        let variant = &self.buffers.sizes.variant;
        let mut buffers = vec![
            (0, &self.constants.lenses),
            (1, self.get("records")),
            (2, self.get("ranges")),
            (3, self.sorted().1),
            (4, &self.constants.look),
            (5, self.get("owners")),
            (6, self.get("left_image")),
            (7, self.get(if variant.atomic { "record_gradients" } else { "entry_gradients" })),
            (8, self.get("by_colours")),
            (16, self.get("shades")),
        ];
        if variant.depth {
            buffers.extend([(9, self.get("depths")), (10, self.get("by_depths"))]);
        }
        if variant.plane {
            let plane = [(11, "planes"), (12, "plane_image"), (13, "by_planes")];
            buffers.extend(plane.map(|(binding, name)| (binding, self.get(name))));
        }
        if variant.features > 0 {
            buffers.extend([(14, &self.cloud.features), (15, self.get("by_features"))]);
        }
        let tiles = self.batch.lenses.iter().map(|lens| lens.tiles[0] * lens.tiles[1]).max().unwrap_or(0);
        let groups = Groups::Fixed(tiles, self.batch.lenses.len() as u32 * variant.groups_per_tile());
        vec![self.step("blend_backward", "blend_backward", groups, buffers)]
    }

    fn project_backward(&self) -> Vec<Step<'a>> {
        let c = self.constants;
        let mut buffers = vec![
            (0, &c.lenses),
            (1, &c.motions),
            (2, &self.cloud.means),
            (3, &self.cloud.scales),
            (4, &self.cloud.rotations),
            (5, &self.cloud.sh),
            (6, self.get("marks")),
            (7, self.get("block_counts")),
            (8, self.get("counts")),
            (10, self.get("record_gradients")),
            (11, &c.frame),
            (12, self.get("by_shape")),
            (13, self.get("by_sh")),
            (14, self.get("by_pose_parts")),
        ];
        if self.buffers.sizes.variant.features > 0 {
            buffers.push((15, self.get("by_feature")));
        }
        let blocks = Groups::Fixed(self.cloud.count.div_ceil(256) as u32, 1);
        let views = Groups::Fixed(self.batch.lenses.len() as u32, 1);
        let parts = vec![(11, &c.frame), (14, self.get("by_pose_parts")), (16, self.get("by_pose"))];
        vec![
            self.step("project_backward", "project_backward", blocks, buffers),
            self.step("project_backward", "poses", views, parts),
        ]
    }

    /// Sums of entries for each record; nothing to do where atomics made them.
    fn sum_entries(&self) -> Vec<Step<'a>> {
        if self.buffers.sizes.variant.atomic {
            return vec![];
        }
        let sum = vec![
            (8, self.get("counts")),
            (9, self.get("firsts")),
            (17, self.get("entry_gradients")),
            (18, self.get("record_gradients")),
            (19, &self.buffers.state),
        ];
        vec![self.step("project_backward", "sum_entries", self.indirect(dispatch::BY_RECORDS), sum)]
    }
}
