//! Where a projected Gaussian reaches an opacity of 1/255: an ellipse, its bounding box, its rows of tiles.
//!
//! With d the offset of a pixel from the projected mean and `U` the upper triangle `[[u00, u01], [0, u11]]` such that
//! `UᵀU` is the inverse of the 2D covariance, opacity is o exp(-|U d|²/2). So the ellipse is |U d|² <= 2 ln(255 o).

use crate::constants::{MIN_ALPHA, TILE};
use crate::lens::Lens;

/// Added to |U d|² so that no pixel that rounding could admit is missed.
const SLACK: f32 = 1e-4;
/// The same for offsets \[px\].
const SLACK_PIXELS: f32 = 1e-3;

/// An ellipse around a projected mean.
#[derive(Debug, Clone, Copy)]
pub struct Ellipse {
    mean: [f32; 2],
    factor: [f32; 3],
    reach: f32,
    half_height: f32,
    /// Offset along y of the rightmost point; the leftmost is opposite.
    rightmost: f32,
}

impl Ellipse {
    /// From a mean \[px\], `[u00, u01, u11]` and an opacity of at least 1/255.
    pub fn new(mean: [f32; 2], factor: [f32; 3], opacity: f32) -> Self {
        let [_, u01, u11] = factor;
        let reach = (2.0 * (opacity / MIN_ALPHA).max(1.0).ln() + SLACK).sqrt();
        let slope = (u01 * u01 + u11 * u11).sqrt();
        Self { mean, factor, reach, half_height: reach / u11, rightmost: -reach * u01 / (u11 * slope) }
    }

    /// First row of tiles and the one after the last.
    pub fn rows(&self, lens: &Lens) -> [u32; 2] {
        tiles(self.mean[1] - self.half_height, self.mean[1] + self.half_height, lens.size[1])
    }

    /// First tile of a row of tiles and the one after the last.
    pub fn row(&self, row: u32, lens: &Lens) -> [u32; 2] {
        let top = (row * TILE) as f32 + 0.5 - SLACK_PIXELS - self.mean[1];
        let bottom = top + (TILE - 1) as f32 + 2.0 * SLACK_PIXELS;
        let right = self.offset(self.rightmost.clamp(top, bottom), 1.0);
        let left = self.offset((-self.rightmost).clamp(top, bottom), -1.0);
        tiles(self.mean[0] + left, self.mean[0] + right, lens.size[0])
    }

    /// Offset along x of the right (side 1) or left (side -1) edge at an offset along y.
    fn offset(&self, y: f32, side: f32) -> f32 {
        let [u00, u01, u11] = self.factor;
        let y = y.clamp(-self.half_height, self.half_height);
        let square = self.reach * self.reach - u11 * u11 * y * y;
        (side * square.max(0.0).sqrt() - u01 * y) / u00
    }

    /// Tiles that the ellipse touches.
    pub fn count(&self, lens: &Lens) -> u32 {
        let [first, end] = self.rows(lens);
        (first..end).map(|row| self.row(row, lens)).map(|[first, end]| end - first).sum()
    }
}

/// Tiles that hold a pixel centre between two coordinates \[px\] of an image with `size` pixels: first, and after last.
fn tiles(low: f32, high: f32, size: u32) -> [u32; 2] {
    let first = (low - 0.5 - SLACK_PIXELS).ceil().max(0.0);
    let last = (high - 0.5 + SLACK_PIXELS).floor().min(size as f32 - 1.0);
    if first <= last { [first as u32 / TILE, last as u32 / TILE + 1] } else { [0, 0] }
}
