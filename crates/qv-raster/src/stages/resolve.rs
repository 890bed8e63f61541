//! Sums of tiles to images, and derivatives of images to derivatives of sums.

use super::blend::PixelSums;
use crate::channels::Channels;
use crate::constants::{MIN_FACING, TILE, TILE_PIXELS};
use crate::lens::{Batch, Lens};
use crate::scene::{Image, Settings};
use glam::Vec3;
use rayon::prelude::*;

/// One image for each view.
pub fn resolve(batch: &Batch, blended: &PixelSums, channels: &Channels, settings: &Settings) -> Vec<Image> {
    batch.lenses.par_iter().map(|lens| image(lens, blended, channels, settings)).collect()
}

fn image(lens: &Lens, blended: &PixelSums, channels: &Channels, settings: &Settings) -> Image {
    let mut out = blank(lens, channels);
    let at = |channel: usize, place: Place| blended.sums[place.of(channel, channels)];
    for pixel in 0..out.width * out.height {
        let place = Place::new(lens, pixel);
        let left = blended.transmittance[place.tile * TILE_PIXELS + place.within];
        out.alpha[pixel] = 1.0 - left;
        for c in 0..3 {
            out.colour[3 * pixel + c] = at(c, place) + left * settings.background[c];
        }
        if let Some(depth) = channels.depth().filter(|_| left < 1.0) {
            out.depth[pixel] = at(depth, place) / (1.0 - left);
        }
        if let Some(plane) = channels.plane() {
            let normal = Vec3::new(at(plane, place), at(plane + 1, place), at(plane + 2, place));
            out.normal[3 * pixel..3 * pixel + 3].copy_from_slice(&normal.to_array());
            let facing = -normal.dot(ray(lens, pixel));
            if facing > MIN_FACING {
                out.plane_depth[pixel] = at(plane + 3, place) / facing;
            }
        }
        let features = channels.features();
        for (k, channel) in features.clone().enumerate() {
            out.features[features.len() * pixel + k] = at(channel, place);
        }
    }
    out
}

/// An image of zeros with the arrays that the channels call for.
pub(crate) fn blank(lens: &Lens, channels: &Channels) -> Image {
    let (width, height) = (lens.size[0] as usize, lens.size[1] as usize);
    let some = |wanted: bool, n: usize| vec![0.0; if wanted { n * width * height } else { 0 }];
    Image {
        width,
        height,
        colour: some(true, 3),
        alpha: some(true, 1),
        depth: some(channels.depth().is_some(), 1),
        plane_depth: some(channels.plane().is_some(), 1),
        normal: some(channels.plane().is_some(), 3),
        features: some(true, channels.features().len()),
    }
}

/// Where a pixel of an image stands among the tiles.
#[derive(Clone, Copy)]
struct Place {
    tile: usize,
    within: usize,
}

impl Place {
    fn new(lens: &Lens, pixel: usize) -> Self {
        let (x, y) = (pixel as u32 % lens.size[0], pixel as u32 / lens.size[0]);
        let tile = lens.first_tile + y / TILE * lens.tiles[0] + x / TILE;
        Self { tile: tile as usize, within: (y % TILE * TILE + x % TILE) as usize }
    }

    fn of(&self, channel: usize, channels: &Channels) -> usize {
        (self.tile * channels.count() + channel) * TILE_PIXELS + self.within
    }
}

/// Direction through a pixel's centre with z = 1, in camera axes.
fn ray(lens: &Lens, pixel: usize) -> Vec3 {
    let (x, y) = (pixel as u32 % lens.size[0], pixel as u32 / lens.size[0]);
    let at = |i: usize, pixel: u32| (pixel as f32 + 0.5 - lens.centre[i]) / lens.focal[i];
    Vec3::new(at(0, x), at(1, y), 1.0)
}

/// Derivatives with respect to the sums of the tiles; pixels beyond the images have zeros.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SumGradients {
    /// Shape `[tiles, channels, 256]`.
    pub sums: Vec<f32>,
    /// With respect to the transmittance that is left, shape `[tiles, 256]`.
    pub transmittance: Vec<f32>,
}

/// From derivatives with respect to the images, which have the images' shapes.
pub fn resolve_backward(
    batch: &Batch,
    blended: &PixelSums,
    channels: &Channels,
    settings: &Settings,
    images: &[Image],
) -> SumGradients {
    let mut out =
        SumGradients { sums: vec![0.0; blended.sums.len()], transmittance: vec![0.0; blended.transmittance.len()] };
    for (lens, image) in batch.lenses.iter().zip(images) {
        for pixel in 0..image.width * image.height {
            pixel_backward(lens, blended, channels, settings, image, pixel, &mut out);
        }
    }
    out
}

fn pixel_backward(
    lens: &Lens,
    blended: &PixelSums,
    channels: &Channels,
    settings: &Settings,
    image: &Image,
    pixel: usize,
    out: &mut SumGradients,
) {
    let place = Place::new(lens, pixel);
    let of = |channel: usize| place.of(channel, channels);
    let whole = place.tile * TILE_PIXELS + place.within;
    let alpha = 1.0 - blended.transmittance[whole];
    let mut left = -image.alpha[pixel];
    for c in 0..3 {
        out.sums[of(c)] = image.colour[3 * pixel + c];
        left += image.colour[3 * pixel + c] * settings.background[c];
    }
    if let Some(depth) = channels.depth().filter(|_| alpha > 0.0) {
        out.sums[of(depth)] = image.depth[pixel] / alpha;
        left += image.depth[pixel] * blended.sums[of(depth)] / (alpha * alpha);
    }
    if let Some(plane) = channels.plane() {
        let normal = Vec3::from_array([0, 1, 2].map(|c| blended.sums[of(plane + c)]));
        let ray = ray(lens, pixel);
        let facing = -normal.dot(ray);
        let mut gradient = Vec3::from_slice(&image.normal[3 * pixel..]);
        if facing > MIN_FACING {
            let per_distance = image.plane_depth[pixel] / facing;
            out.sums[of(plane + 3)] = per_distance;
            gradient += ray * (per_distance * blended.sums[of(plane + 3)] / facing);
        }
        for c in 0..3 {
            out.sums[of(plane + c)] = gradient[c];
        }
    }
    let features = channels.features();
    for (k, channel) in features.clone().enumerate() {
        out.sums[of(channel)] = image.features[features.len() * pixel + k];
    }
    out.transmittance[whole] = left;
}
