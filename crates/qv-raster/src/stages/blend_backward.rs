//! Derivatives of the blending: each tile walks its entries from far to near.

use super::blend::{PixelSums, Source, half_height, touched_rows};
use super::resolve::SumGradients;
use crate::constants::{MAX_ALPHA, MIN_ALPHA, TILE_PIXELS};
use crate::lanes::{LANES, Lanes, exp_negative, widest};
use rayon::prelude::*;

/// Derivatives of an entry besides those of its channels: mean (2), opacity last; between
/// them those by U in whitened offsets e = U δ, with G the derivative by |e|²/2: sums of G e_x²/2, G e_x e_y, G e_y²/2. In offsets themselves a
/// needle's would cancel when they are brought to its axes.
pub const SHAPE_GRADIENTS: usize = 6;
/// Most derivatives of an entry.
const MOST: usize = SHAPE_GRADIENTS + 8 + qv_core::GaussianCloud::MAX_FEATURES;

/// Derivatives of each entry, summed over the pixels of its tile, in the order in which entries were made, shape
/// `[entries, 6 + channels]`.
pub fn blend_backward(source: &Source, blended: &PixelSums, gradients: &SumGradients) -> Vec<f32> {
    let width = SHAPE_GRADIENTS + source.channels.count();
    let views = source.batch.view_of_tile();
    // Tiles fill their part in sorted order; it is put where its entries were made afterwards.
    let mut sorted = vec![0.0; source.sorted.len() * width];
    let mut parts = Vec::with_capacity(source.ranges.len());
    let mut rest = sorted.as_mut_slice();
    for range in source.ranges {
        let (part, after) = rest.split_at_mut((range[1] - range[0]) as usize * width);
        rest = after;
        parts.push(part);
    }
    parts.into_par_iter().enumerate().for_each(|(tile, part)| {
        tile_backward(source, blended, gradients, tile, views[tile] as usize, part);
    });
    let mut out = vec![0.0; sorted.len()];
    for (from, &entry) in sorted.chunks_exact(width).zip(source.sorted) {
        out[entry as usize * width..][..width].copy_from_slice(from);
    }
    out
}

widest! {
    /// Fills the derivatives of one tile's entries, which are zeros.
    fn tile_backward = tile_backward_body(
        source: &Source,
        blended: &PixelSums,
        gradients: &SumGradients,
        tile: usize,
        view: usize,
        out: &mut [f32],
    )
}

#[inline(always)]
fn tile_backward_body(
    source: &Source,
    blended: &PixelSums,
    gradients: &SumGradients,
    tile: usize,
    view: usize,
    out: &mut [f32],
) {
    let corner = source.corner(tile, view);
    let columns: Lanes = std::array::from_fn(|lane| corner[0] + lane as f32);
    let channels = source.channels.count();
    let width = SHAPE_GRADIENTS + channels;
    let mut values = [0.0; MOST - SHAPE_GRADIENTS];
    let values = &mut values[..channels];
    let pixels = tile * TILE_PIXELS..(tile + 1) * TILE_PIXELS;
    let last = &blended.last[pixels.clone()];
    let wanted = &gradients.sums[tile * channels * TILE_PIXELS..][..channels * TILE_PIXELS];
    let mut left = [0.0; TILE_PIXELS];
    left.copy_from_slice(&blended.transmittance[pixels.clone()]);
    // Derivative of what lies behind, times its weight.
    let mut behind = [0.0; TILE_PIXELS];
    for (pixel, behind) in behind.iter_mut().enumerate() {
        *behind = left[pixel] * gradients.transmittance[pixels.start + pixel];
    }
    let [first, _] = source.ranges[tile];
    let end = last.iter().copied().max().unwrap_or(0);
    for index in (first..end).rev() {
        let record = source.record(index);
        let splat = &source.projections.records[record];
        source.channels.fill(source.scene, source.projections, record, values);
        let [u00, u01, u11] = splat.factor;
        let mut shape_sums = [[0.0; LANES]; SHAPE_GRADIENTS];
        let mut sums = [[0.0; LANES]; MOST - SHAPE_GRADIENTS];
        for row in touched_rows(splat.mean[1], half_height(u11, splat.opacity), corner[1]) {
            let dy = corner[1] + row as f32 - splat.mean[1];
            let (shift, across) = (u01 * dy, u11 * dy);
            let from = row * LANES;
            let mut product = [0.0; LANES];
            for (channel, value) in values.iter().enumerate() {
                let wanted = &wanted[channel * TILE_PIXELS + from..][..LANES];
                for lane in 0..LANES {
                    product[lane] += wanted[lane] * value;
                }
            }
            // Copies let the compiler use vectors.
            let newest: [u32; LANES] = std::array::from_fn(|lane| last[from + lane]);
            let mut before: Lanes = std::array::from_fn(|lane| left[from + lane]);
            let mut after: Lanes = std::array::from_fn(|lane| behind[from + lane]);
            let mut weight = [0.0; LANES];
            let [mut by_u, mut by_v, mut by_xx, mut by_xy, mut by_yy, mut by_opacity] = shape_sums;
            for lane in 0..LANES {
                let dx = columns[lane] - splat.mean[0];
                let along = u00 * dx + shift;
                let falloff = exp_negative(0.5 * (along * along + across * across));
                let raw = splat.opacity * falloff;
                let alpha = if raw < MAX_ALPHA { raw } else { MAX_ALPHA };
                let taken = alpha >= MIN_ALPHA && index < newest[lane];
                let alpha = if taken { alpha } else { 0.0 };
                let inverse = 1.0 / (1.0 - alpha);
                before[lane] *= inverse;
                let by_alpha = before[lane] * product[lane] - after[lane] * inverse;
                // Where the opacity is cut off it does not depend on the Gaussian.
                let by_raw = if taken && raw < MAX_ALPHA { by_alpha } else { 0.0 };
                weight[lane] = alpha * before[lane];
                after[lane] += weight[lane] * product[lane];
                let by_exponent = -raw * by_raw;
                by_u[lane] -= by_exponent * (u00 * along);
                by_v[lane] -= by_exponent * (u01 * along + u11 * across);
                by_xx[lane] += by_exponent * (0.5 * along * along);
                by_xy[lane] += by_exponent * (along * across);
                by_yy[lane] += by_exponent * (0.5 * across * across);
                by_opacity[lane] += by_raw * falloff;
            }
            left[from..from + LANES].copy_from_slice(&before);
            behind[from..from + LANES].copy_from_slice(&after);
            shape_sums = [by_u, by_v, by_xx, by_xy, by_yy, by_opacity];
            for channel in 0..channels {
                let wanted = &wanted[channel * TILE_PIXELS + from..][..LANES];
                let sum = &mut sums[channel];
                for lane in 0..LANES {
                    sum[lane] += weight[lane] * wanted[lane];
                }
            }
        }
        let out = &mut out[(index - first) as usize * width..][..width];
        for (out, sum) in out.iter_mut().zip(shape_sums.iter().chain(&sums)) {
            *out = fold(sum);
        }
    }
}

/// Sum of a row in a fixed order.
#[inline(always)]
fn fold(lanes: &Lanes) -> f32 {
    let mut part = *lanes;
    let mut half = LANES / 2;
    while half > 0 {
        for lane in 0..half {
            part[lane] += part[lane + half];
        }
        half /= 2;
    }
    part[0]
}
