//! Blending: each tile walks its entries from near to far.

use super::emit::Entries;
use super::project::Projections;
use crate::channels::Channels;
use crate::constants::{MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE, TILE, TILE_PIXELS};
use crate::lanes::{LANES, Lanes, exp_negative, widest};
use crate::lens::Batch;
use crate::{Scene, Settings};
use rayon::prelude::*;

/// Sums of each pixel, tile by tile; a tile's pixels row by row. Pixels of a tile beyond the image are there, too.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PixelSums {
    /// Sum of opacity times transmittance times number, shape `[tiles, channels, 256]`.
    pub sums: Vec<f32>,
    /// What is left for the background, shape `[tiles, 256]`.
    pub transmittance: Vec<f32>,
    /// One past the last sorted entry that was taken, or 0, shape `[tiles, 256]`.
    pub last: Vec<u32>,
}

/// What all tiles read.
#[derive(Clone, Copy)]
pub struct Source<'a> {
    /// Cloud and groups.
    pub scene: &'a Scene<'a>,
    /// The views.
    pub batch: &'a Batch,
    /// The records.
    pub projections: &'a Projections,
    /// The entries.
    pub entries: &'a Entries,
    /// Entries sorted by tile, near to far.
    pub sorted: &'a [u32],
    /// Sorted entries of each tile.
    pub ranges: &'a [[u32; 2]],
    /// What is blended.
    pub channels: Channels,
    /// How it is drawn.
    pub settings: &'a Settings,
}

impl Source<'_> {
    /// Pixel coordinates of the first pixel centre of a tile.
    pub(crate) fn corner(&self, tile: usize, view: usize) -> [f32; 2] {
        let lens = &self.batch.lenses[view];
        let local = tile as u32 - lens.first_tile;
        [local % lens.tiles[0] * TILE, local / lens.tiles[0] * TILE].map(|first| first as f32 + 0.5)
    }

    /// Record of a sorted entry.
    pub(crate) fn record(&self, index: u32) -> usize {
        self.entries.records[self.sorted[index as usize] as usize] as usize
    }
}

/// Rows of a tile, of which the first pixel centre is at `corner_y`, that an ellipse may touch.
pub(crate) fn touched_rows(mean_y: f32, half_height: f32, corner_y: f32) -> std::ops::Range<usize> {
    let first = (mean_y - half_height - corner_y).ceil().max(0.0) as usize;
    let end = (mean_y + half_height - corner_y).floor() + 1.0;
    first..(end.max(0.0) as usize).min(LANES)
}

/// Half the height of the ellipse of opacity 1/255, a little enlarged \[px\].
pub(crate) fn half_height(u11: f32, opacity: f32) -> f32 {
    (2.0 * (opacity / MIN_ALPHA).max(1.0).ln() + 1e-3).sqrt() / u11
}

/// Blends all tiles.
pub fn blend(source: &Source) -> PixelSums {
    let (tiles, channels) = (source.ranges.len(), source.channels.count());
    let mut out = PixelSums {
        sums: vec![0.0; tiles * channels * TILE_PIXELS],
        transmittance: vec![1.0; tiles * TILE_PIXELS],
        last: vec![0; tiles * TILE_PIXELS],
    };
    let views = source.batch.view_of_tile();
    let sums = out.sums.par_chunks_mut(channels * TILE_PIXELS);
    let rest = out.transmittance.par_chunks_mut(TILE_PIXELS).zip(out.last.par_chunks_mut(TILE_PIXELS));
    sums.zip(rest).enumerate().for_each(|(tile, (sums, (transmittance, last)))| {
        blend_tile(source, tile, views[tile] as usize, sums, transmittance, last);
    });
    out
}

widest! {
    /// Blends one tile into zeros and ones.
    fn blend_tile = blend_tile_body(
        source: &Source,
        tile: usize,
        view: usize,
        sums: &mut [f32],
        transmittance: &mut [f32],
        last: &mut [u32],
    )
}

#[inline(always)]
fn blend_tile_body(
    source: &Source,
    tile: usize,
    view: usize,
    sums: &mut [f32],
    transmittance: &mut [f32],
    last: &mut [u32],
) {
    let corner = source.corner(tile, view);
    let columns: Lanes = std::array::from_fn(|lane| corner[0] + lane as f32);
    let mut values = [0.0; 3 + 1 + 4 + qv_core::GaussianCloud::MAX_FEATURES];
    let channels = source.channels.count();
    let values = &mut values[..channels];
    // 1 while a pixel takes Gaussians, then 0.
    let mut open = [[1u32; LANES]; LANES];
    let mut open_rows = [true; LANES];
    let [first, end] = source.ranges[tile];
    for index in first..end {
        let record = source.record(index);
        let splat = &source.projections.records[record];
        source.channels.fill(source.scene, source.projections, record, values);
        let [u00, u01, u11] = splat.factor;
        for row in touched_rows(splat.mean[1], half_height(u11, splat.opacity), corner[1]) {
            if !open_rows[row] {
                continue;
            }
            let dy = corner[1] + row as f32 - splat.mean[1];
            let (shift, across) = (u01 * dy, u11 * dy);
            let across = across * across;
            let from = row * LANES;
            // Copies, and whole numbers for what is summed over the row: both let the compiler use vectors.
            let mut left: Lanes = std::array::from_fn(|lane| transmittance[from + lane]);
            let mut newest: [u32; LANES] = std::array::from_fn(|lane| last[from + lane]);
            let mut still = open[row];
            let mut weight = [0.0; LANES];
            let mut wanted_by_any = 0;
            let mut still_any = 0;
            for lane in 0..LANES {
                let along = u00 * (columns[lane] - splat.mean[0]) + shift;
                let alpha = splat.opacity * exp_negative(0.5 * (along * along + across));
                let alpha = if alpha < MAX_ALPHA { alpha } else { MAX_ALPHA };
                let after = left[lane] * (1.0 - alpha);
                let wanted = if alpha >= MIN_ALPHA { still[lane] } else { 0 };
                let take = if after > MIN_TRANSMITTANCE { wanted } else { 0 };
                still[lane] -= wanted - take;
                still_any |= still[lane];
                weight[lane] = if take > 0 { alpha * left[lane] } else { 0.0 };
                left[lane] = if take > 0 { after } else { left[lane] };
                newest[lane] = if take > 0 { index + 1 } else { newest[lane] };
                wanted_by_any |= wanted;
            }
            if wanted_by_any > 0 {
                transmittance[from..from + LANES].copy_from_slice(&left);
                last[from..from + LANES].copy_from_slice(&newest);
                open[row] = still;
                open_rows[row] = still_any > 0;
                for (channel, value) in values.iter().enumerate() {
                    let sums = &mut sums[channel * TILE_PIXELS + row * LANES..][..LANES];
                    for lane in 0..LANES {
                        sums[lane] += weight[lane] * value;
                    }
                }
            }
        }
        if open_rows == [false; LANES] {
            return;
        }
    }
}
