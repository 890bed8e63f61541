//! A batch of views on the graphics card.

use super::buffers::{Buffers, Sizes};
use super::cloud::GpuCloud;
use super::constants::Constants;
use super::images::GpuImages;
use super::rasteriser::{GpuRasteriser, GpuSettings, Kind, kind};
use super::record::Recorder;
use super::steps::FrameSteps;
use crate::lens::Batch;
use crate::shaders::{Variant, slot};
use crate::{RasterError, Scene, Settings, View};

/// Digits of a sort: how many bits each, and how many of them.
fn digits(bits: u32, most: u32) -> (u32, u32) {
    let passes = bits.div_ceil(most).max(1);
    (bits.div_ceil(passes).max(1), passes)
}

/// What one frame found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Counts {
    /// Pairs of view and Gaussian that passed the first test.
    pub candidates: usize,
    /// Pairs of Gaussian and tile.
    pub entries: usize,
    /// Candidates that were left out because their numbers are not finite.
    pub faulty: usize,
}

impl GpuRasteriser {
    /// Draws views of a scene as one batch and waits for it. The images stay on the card, in buffers that the next batch uses
    /// again. `cloud` is that of `scene`.
    ///
    /// When the buffers were too small, which is known only afterwards, they are made anew and the batch is drawn again.
    ///
    /// # Errors
    /// The scene or a view is off, or the batch is too large for the device: fewer views at once may do.
    pub fn render(
        &mut self,
        cloud: &GpuCloud,
        scene: &Scene,
        views: &[View],
        settings: &Settings,
        how: &GpuSettings,
    ) -> Result<(GpuImages<'_>, Counts), RasterError> {
        self.prepare(cloud, scene, views, settings, how)?;
        let mut counts = None;
        // The first run may cut off candidates, the second entries of all candidates.
        for _ in 0..4 {
            self.submit(cloud, how.timed)?;
            let state = self.state()?;
            let found = Counts {
                candidates: state[slot::NEEDED_VISIBLE as usize] as usize,
                entries: state[slot::NEEDED_ENTRIES as usize] as usize,
                faulty: state[slot::FAULTY as usize] as usize,
            };
            if !self.grow(&found)? {
                counts = Some(found);
                break;
            }
            self.remake_constants(cloud, settings)?;
        }
        let counts = counts.ok_or_else(|| RasterError::Device("buffers that never suffice".into()))?;
        Ok((self.images()?, counts))
    }

    /// Draws any number of views, as many at once as [`Self::memory`] and the device allow, and hands the images of each batch on
    /// with the index of its first view and what was counted. Batches are halved until they fit; the limits that are known are looked at
    /// before memory is taken, what the card has left is known by trying. Derivatives are had of one [`Self::render`] at a time.
    ///
    /// # Errors
    /// As [`Self::render`], with a single view; or what `each` gives.
    pub fn render_all(
        &mut self,
        cloud: &GpuCloud,
        scene: &Scene,
        views: &[View],
        settings: &Settings,
        how: &GpuSettings,
        mut each: impl FnMut(usize, GpuImages, Counts) -> Result<(), RasterError>,
    ) -> Result<(), RasterError> {
        let mut at_once = views.len().clamp(1, Batch::MAX_VIEWS);
        let mut first = 0;
        while first < views.len() {
            let batch = &views[first..(first + at_once).min(views.len())];
            match self.render(cloud, scene, batch, settings, how) {
                Ok((images, counts)) => {
                    each(first, images, counts)?;
                    first += batch.len();
                }
                Err(RasterError::TooLarge { .. } | RasterError::DeviceMemory { .. }) if batch.len() > 1 => {
                    at_once = batch.len() / 2;
                    // Without the guess that the larger batch left.
                    self.buffers = None;
                }
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Checks the batch and makes what it needs, so that [`Self::submit`] does nothing but record and submit.
    ///
    /// # Errors
    /// As [`Self::render`].
    pub fn prepare(
        &mut self,
        cloud: &GpuCloud,
        scene: &Scene,
        views: &[View],
        settings: &Settings,
        how: &GpuSettings,
    ) -> Result<(), RasterError> {
        let found = (scene.cloud.len(), scene.cloud.sh_degree, scene.cloud.feature_count, scene.group_count());
        if found != kind(cloud) {
            let what = "Gaussians of the scene, and of its copy on the GPU".to_string();
            return Err(RasterError::Length { what, expected: cloud.count, found: scene.cloud.len() });
        }
        self.prepare_batch(cloud, Batch::new(scene, views)?, cloud.count, settings, how)
    }

    /// As [`Self::prepare`], with buffers for `capacity` Gaussians.
    pub(crate) fn prepare_batch(
        &mut self,
        cloud: &GpuCloud,
        batch: Batch,
        capacity: usize,
        settings: &Settings,
        how: &GpuSettings,
    ) -> Result<(), RasterError> {
        let tiles = batch.lenses.iter().map(|lens| lens.tiles[0] * lens.tiles[1]).max().unwrap_or(0);
        let limit = self.gpu.most_workgroups();
        if tiles > limit {
            let what = "tiles of one view on this device".to_string();
            return Err(RasterError::TooLarge { what, limit: limit as u64, found: tiles as u64 });
        }
        let outputs = settings.outputs;
        let variant = Variant {
            subgroup: self.gpu.subgroup,
            sh_count: (cloud.sh_degree as u32 + 1).pow(2),
            features: if outputs.features { cloud.feature_count as u32 } else { 0 },
            depth: outputs.depth,
            plane: outputs.plane,
            bytes: how.bytes,
            keep: how.keep,
            atomic: how.atomic
                && how.keep
                && self.gpu.float_atomics
                && self.gpu.subgroup > 0
                && self.gpu.fits(batch.lenses.len()),
            antialias: settings.antialias,
            digit: 0,
        };
        let mut sizes = Sizes::guess(&batch, capacity, variant);
        if let Some(old) = self.buffers.as_ref().map(|buffers| buffers.sizes) {
            // What the last batch of as many views of as large a cloud needed is the better guess; a larger one's says nothing.
            if old.views == sizes.views && old.blocks == sizes.blocks {
                (sizes.visible, sizes.entries) = (old.visible, old.entries);
            }
        }
        self.ensure(sizes)?;
        self.batch = Some(batch);
        (self.drawn, self.kind) = (false, kind(cloud));
        self.remake_constants(cloud, settings)
    }

    fn ensure(&mut self, sizes: Sizes) -> Result<(), RasterError> {
        if !self.buffers.as_ref().is_some_and(|buffers| buffers.sizes.hold(&sizes)) {
            // The old ones are given back first.
            self.gpu.forget_bind_groups();
            self.buffers = None;
            self.buffers = Some(Buffers::new(&self.gpu, sizes, self.memory)?);
        }
        Ok(())
    }

    /// Makes buffers for so many candidates and entries.
    pub(crate) fn make_room(&mut self, candidates: usize, entries: usize) -> Result<(), RasterError> {
        let Some(old) = self.buffers.as_ref().map(|buffers| buffers.sizes) else { return Ok(()) };
        let (visible, entries) = (old.visible.max(candidates as u64), old.entries.max(entries as u64));
        self.ensure(Sizes { visible, entries, ..old })
    }

    /// Makes larger buffers when these did not suffice; true when it did.
    fn grow(&mut self, found: &Counts) -> Result<bool, RasterError> {
        let Some(old) = self.buffers.as_ref().map(|buffers| buffers.sizes) else { return Ok(false) };
        if found.entries == u32::MAX as usize {
            let what = "Gaussians times tiles of one batch".to_string();
            return Err(RasterError::TooLarge { what, limit: u32::MAX as u64 - 1, found: found.entries as u64 });
        }
        let with_room = |n: usize| n as u64 + n as u64 / 16 + 1024;
        let mut sizes = old;
        if found.candidates as u64 > old.visible {
            // Entries of the candidates that were cut off are not known: the next run shows them.
            sizes.visible = with_room(found.candidates);
            sizes.entries = old.entries.max(with_room(found.entries));
        } else if found.entries as u64 > old.entries {
            sizes.entries = with_room(found.entries);
        } else {
            return Ok(false);
        }
        self.gpu.forget_bind_groups();
        self.buffers = None;
        self.buffers = Some(Buffers::new(&self.gpu, sizes, self.memory)?);
        Ok(true)
    }

    pub(crate) fn remake_constants(&mut self, cloud: &GpuCloud, settings: &Settings) -> Result<(), RasterError> {
        let (Some(batch), Some(buffers)) = (&self.batch, &self.buffers) else { return Ok(()) };
        let (gpu, sizes) = (&self.gpu, &buffers.sizes);
        let most = sizes.variant.digit_bits();
        let (depth_bits, depth_passes) = digits(32, most);
        let (tile_bits, tile_passes) = digits(u32::BITS - (batch.tiles as u32).leading_zeros(), most);
        let blocks = cloud.count.div_ceil(256) as u32;
        let views = batch.lenses.len() as u32;
        let frame = [
            views,
            cloud.count as u32,
            batch.groups as u32,
            blocks,
            sizes.visible.min(u32::MAX as u64) as u32,
            sizes.entries.min(u32::MAX as u64) as u32,
            1 << depth_bits,
            1 << tile_bits,
        ];
        let pass = |bits: u32, k: u32, all: u32, length: u32, blocks: u32, first: bool| {
            let bits_here = bits.min(all.saturating_sub(bits * k)).max(1);
            gpu.filled("pass", &[bits * k, bits_here, length, blocks, first as u32, 0, 0, 0])
        };
        let scan = |length: u32, total: u32| gpu.filled("scan", &[length, total, 0, 0]);
        let depth = |k| pass(depth_bits, k, 32, slot::VISIBLE, slot::DEPTH_BLOCKS, k == 0);
        let keep = sizes.variant.keep;
        let tile = |k| pass(tile_bits, k, tile_bits * tile_passes, slot::ENTRIES, slot::TILE_BLOCKS, keep && k == 0);
        let [r, g, b] = settings.background;
        gpu.forget_bind_groups();
        self.constants = Some(Constants {
            lenses: gpu.filled("lenses", &batch.lenses)?,
            motions: gpu.filled("motions", &batch.motions)?,
            look: gpu.filled("look", &[[r, g, b, 0.0f32]])?,
            frame: gpu.filled("frame", &frame)?,
            scans: [
                scan(slot::CULL_BLOCKS, slot::NEEDED_VISIBLE)?,
                scan(slot::DEPTH_BINS, slot::UNUSED)?,
                scan(slot::VISIBLE, slot::NEEDED_ENTRIES)?,
                scan(slot::TILE_BINS, slot::UNUSED)?,
            ],
            emits: [gpu.filled("emit", &[0u32; 4])?, gpu.filled("emit", &[1u32, 0, 0, 0])?],
            depth_passes: (0..depth_passes).map(depth).collect::<Result<_, _>>()?,
            tile_passes: (0..tile_passes).map(tile).collect::<Result<_, _>>()?,
            depth_bits,
            tile_bits,
        });
        gpu.queue.write_buffer(&buffers.state, slot::CULL_BLOCKS as u64 * 4, bytemuck::bytes_of(&(views * blocks)));
        Ok(())
    }

    /// Records and submits the batch that was prepared last, and waits for nothing.
    ///
    /// # Errors
    /// Nothing was prepared.
    pub fn submit(&mut self, cloud: &GpuCloud, timed: bool) -> Result<(), RasterError> {
        let mut recorder = Recorder::new(&self.gpu, timed);
        self.record_forward(cloud, &mut recorder)?;
        self.stamps = recorder.submit();
        (self.after, self.drawn) = (None, true);
        Ok(())
    }

    /// Records the batch that was prepared last.
    ///
    /// # Errors
    /// Nothing was prepared.
    pub fn record_forward(&self, cloud: &GpuCloud, recorder: &mut Recorder) -> Result<(), RasterError> {
        let (Some(batch), Some(buffers), Some(constants)) = (&self.batch, &self.buffers, &self.constants) else {
            return Err(RasterError::Device("expected a prepared batch, found none".into()));
        };
        self.check_cloud(cloud)?;
        let frame = FrameSteps { batch, buffers, constants, cloud };
        recorder.encoder.clear_buffer(buffers.get("ranges"), 0, None);
        recorder.run("cull", &frame.cull());
        recorder.run("project", &frame.project());
        recorder.run("sort by depth", &frame.sort_by_depth());
        recorder.run("emit", &frame.emit());
        recorder.run("sort by tile", &frame.sort_by_tile());
        recorder.run("ranges", &frame.ranges());
        recorder.run("blend", &frame.blend());
        Ok(())
    }

    /// Shaders run without bounds checks: they may only see the cloud that the buffers were made for.
    pub(crate) fn check_cloud(&self, cloud: &GpuCloud) -> Result<(), RasterError> {
        if kind(cloud) == self.kind {
            return Ok(());
        }
        let of = |(count, degree, features, groups): Kind| {
            format!("{count} Gaussians of degree {degree} with {features} features in {groups} groups")
        };
        let (expected, found) = (of(self.kind), of(kind(cloud)));
        Err(RasterError::Device(format!("cloud of a batch: expected {expected}, found {found}")))
    }

    /// Milliseconds of each stage of the last timed batch, and in all. Waits for the device.
    ///
    /// # Errors
    /// The device fails.
    pub fn times(&self) -> Result<Vec<(&'static str, f64)>, RasterError> {
        self.stamps.as_ref().map_or(Ok(vec![]), |stamps| stamps.read(&self.gpu))
    }

    /// Bytes of the buffers of frames.
    pub fn bytes(&self) -> u64 {
        self.buffers.as_ref().map_or(0, |buffers| buffers.sizes.bytes())
    }

    fn state(&self) -> Result<Vec<u32>, RasterError> {
        match &self.buffers {
            Some(buffers) => self.gpu.read(&buffers.state, slot::COUNT as usize),
            None => Ok(vec![0; slot::COUNT as usize]),
        }
    }
}
