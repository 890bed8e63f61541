//! The stages in a row, on the CPU.

use crate::channels::Channels;
use crate::lens::Batch;
use crate::scene::{Gradients, Image, Scene, Settings, View};
use crate::stages::blend::{PixelSums, Source, blend};
use crate::stages::blend_backward::blend_backward;
use crate::stages::cull::{Candidate, cull};
use crate::stages::emit::{Entries, emit};
use crate::stages::project::{Projections, project};
use crate::stages::project_backward::{project_backward, pulls, red_sums};
use crate::stages::ranges::ranges;
use crate::stages::resolve::{blank, resolve, resolve_backward};
use crate::stages::sort::{depth_key, sort};
use crate::{RasterError, memory};
use rayon::prelude::*;

/// A drawn batch with what every stage gave, as the derivatives need it.
#[derive(Debug, Clone)]
pub struct Frame {
    /// The views.
    pub batch: Batch,
    /// What was asked for.
    pub settings: Settings,
    /// What was blended.
    pub channels: Channels,
    /// Gaussians and degree of the cloud.
    pub cloud: (usize, u8),
    /// Stage `cull`.
    pub candidates: Vec<Candidate>,
    /// Stage `project`.
    pub projections: Projections,
    /// Stage `sort`: records from near to far.
    pub order: Vec<u32>,
    /// Stage `emit`.
    pub entries: Entries,
    /// Stage `sort` again: entries by tile, in each from near to far.
    pub sorted: Vec<u32>,
    /// Stage `ranges`: sorted entries of each tile, first and one past the last.
    pub ranges: Vec<[u32; 2]>,
    /// Stage `blend`.
    pub blended: PixelSums,
}

impl Frame {
    /// Draws views of a scene as one batch.
    ///
    /// # Errors
    /// Scene or views are off, or the batch has more entries than 32-bit indices hold.
    pub fn new(scene: &Scene, views: &[View], settings: &Settings) -> Result<Self, RasterError> {
        scene.check()?;
        Self::of_checked(scene, views, settings)
    }

    fn of_checked(scene: &Scene, views: &[View], settings: &Settings) -> Result<Self, RasterError> {
        let batch = Batch::new(scene, views)?;
        let channels = Channels::new(settings.outputs, scene.cloud.feature_count);
        let candidates = cull(scene, &batch);
        let projections = project(scene, &batch, &candidates, settings);
        memory::check_entries(&projections.counts)?;
        let records = projections.records.iter().zip(&projections.counts);
        let keys: Vec<u32> = records.map(|(record, &count)| depth_key(record.depth, count)).collect();
        let order = sort(&keys, 32);
        let entries = emit(&batch, &projections.records, &projections.counts, &order);
        let sorted = sort(&entries.tiles, u32::BITS - (batch.tiles as u32).leading_zeros());
        let ranges = ranges(sorted.iter().map(|&entry| entries.tiles[entry as usize]), batch.tiles);
        let mut frame = Self {
            batch,
            settings: *settings,
            channels,
            cloud: (scene.cloud.len(), scene.cloud.sh_degree),
            candidates,
            projections,
            order,
            entries,
            sorted,
            ranges,
            blended: PixelSums::default(),
        };
        frame.blended = blend(&frame.source(scene));
        Ok(frame)
    }

    /// The images, shape `[views]`.
    pub fn images(&self) -> Vec<Image> {
        resolve(&self.batch, &self.blended, &self.channels, &self.settings)
    }

    /// Derivatives of a scalar, given its derivatives with respect to the images, which must have the images' shapes.
    ///
    /// # Errors
    /// An array of another length than the image's, or a scene of another shape than the one that was drawn; that its numbers are the
    /// same is not looked at.
    pub fn gradients(&self, scene: &Scene, by_images: &[Image]) -> Result<Gradients, RasterError> {
        Ok(self.gradients_and_pulls(scene, by_images)?.0)
    }

    /// As [`Self::gradients`], and for each Gaussian the sum over views of the length of the derivative by its projected mean, in units
    /// of half the image's sides, and the number of views that it touches, shape `[N, 2]`: what densification goes by.
    ///
    /// # Errors
    /// As [`Self::gradients`].
    pub fn gradients_and_pulls(
        &self,
        scene: &Scene,
        by_images: &[Image],
    ) -> Result<(Gradients, Vec<[f32; 2]>), RasterError> {
        self.check(scene, by_images)?;
        let source = self.source(scene);
        let by_sums = resolve_backward(&self.batch, &self.blended, &self.channels, &self.settings, by_images);
        let by_entries = blend_backward(&source, &self.blended, &by_sums);
        Ok((project_backward(&source, &by_entries), pulls(&source, &by_entries)))
    }

    /// What each Gaussian has of a number that pixels have, shape `[views][height, width]`: the sum over views and pixels of its weight in
    /// the pixel times the number.
    ///
    /// # Errors
    /// As [`Self::gradients`].
    pub fn shares(&self, scene: &Scene, numbers: &[Vec<f32>]) -> Result<Vec<f32>, RasterError> {
        let mut by_images = self.blank_images();
        for (image, numbers) in by_images.iter_mut().zip(numbers) {
            // Red is a channel like any other: the derivative by it is what pixels hand to Gaussians by weight.
            image.colour = numbers.iter().flat_map(|number| [*number, 0.0, 0.0]).collect();
        }
        self.check(scene, &by_images)?;
        let source = self.source(scene);
        let by_sums = resolve_backward(&self.batch, &self.blended, &self.channels, &self.settings, &by_images);
        Ok(red_sums(&source, &blend_backward(&source, &self.blended, &by_sums)))
    }

    /// An image of zeros for each view, to be filled with derivatives.
    pub fn blank_images(&self) -> Vec<Image> {
        self.batch.lenses.iter().map(|lens| blank(lens, &self.channels)).collect()
    }

    fn source<'a>(&'a self, scene: &'a Scene<'a>) -> Source<'a> {
        Source {
            scene,
            batch: &self.batch,
            projections: &self.projections,
            entries: &self.entries,
            sorted: &self.sorted,
            ranges: &self.ranges,
            channels: self.channels,
            settings: &self.settings,
        }
    }

    fn check(&self, scene: &Scene, by_images: &[Image]) -> Result<(), RasterError> {
        scene.check()?;
        let length = |what: String, expected: usize, found: usize| {
            if expected == found { Ok(()) } else { Err(RasterError::Length { what, expected, found }) }
        };
        length("derivatives by image".into(), self.batch.lenses.len(), by_images.len())?;
        length("Gaussians that were drawn".into(), self.cloud.0, scene.cloud.len())?;
        length("degree of the Gaussians that were drawn".into(), self.cloud.1.into(), scene.cloud.sh_degree.into())?;
        length("groups of the scene that was drawn".into(), self.batch.groups, scene.group_count())?;
        let features = Channels::new(self.settings.outputs, scene.cloud.feature_count).count();
        length("channels that were drawn".into(), self.channels.count(), features)?;
        for (view, (expected, found)) in self.blank_images().iter().zip(by_images).enumerate() {
            let of = |name: &str| format!("derivatives by {name} of view {view}");
            length(of("colour"), expected.colour.len(), found.colour.len())?;
            length(of("alpha"), expected.alpha.len(), found.alpha.len())?;
            length(of("depth"), expected.depth.len(), found.depth.len())?;
            length(of("plane depth"), expected.plane_depth.len(), found.plane_depth.len())?;
            length(of("normal"), expected.normal.len(), found.normal.len())?;
            length(of("features"), expected.features.len(), found.features.len())?;
        }
        Ok(())
    }
}

/// Draws any number of views on the CPU, a few at a time. Returns one image for each view, and how many Gaussians were left
/// out, counted once for each view, because their numbers are not finite.
///
/// # Errors
/// Scene or views are off, or a single view is larger than indices hold.
pub fn render(scene: &Scene, views: &[View], settings: &Settings) -> Result<(Vec<Image>, usize), RasterError> {
    scene.check()?;
    let mut images = Vec::with_capacity(views.len());
    let mut faulty = 0;
    for chunk in views.chunks(memory::views_at_once(scene, views)) {
        let frames: Vec<Frame> =
            chunk.par_iter().map(|view| Frame::of_checked(scene, &[*view], settings)).collect::<Result<_, _>>()?;
        for frame in frames {
            faulty += frame.projections.faulty;
            images.extend(frame.images());
        }
    }
    Ok((images, faulty))
}
