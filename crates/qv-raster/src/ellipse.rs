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

#[cfg(test)]
mod tests {
    use super::*;

    fn lens() -> Lens {
        Lens {
            focal: [1.0; 2],
            centre: [0.0; 2],
            lowest: [0.0; 2],
            highest: [0.0; 2],
            size: [75, 61],
            tiles: [5, 4],
            first_tile: 0,
            first_pixel: 0,
            unused: [0; 2],
        }
    }

    /// Whether a tile has a pixel with an opacity of 1/255 or more, in double precision.
    fn seen(mean: [f32; 2], factor: [f32; 3], opacity: f32, column: u32, row: u32) -> bool {
        let [u00, u01, u11] = factor.map(|x| x as f64);
        let pixels = (0..TILE * TILE).map(|i| (column * TILE + i % TILE, row * TILE + i / TILE));
        pixels.filter(|&(x, y)| x < 75 && y < 61).any(|(x, y)| {
            let (dx, dy) = (x as f64 + 0.5 - mean[0] as f64, y as f64 + 0.5 - mean[1] as f64);
            let square = (u00 * dx + u01 * dy).powi(2) + (u11 * dy).powi(2);
            opacity as f64 * (-0.5 * square).exp() >= 1.0 / 255.0
        })
    }

    #[test]
    fn no_tile_is_missed_and_few_are_for_nothing() {
        let mut state = 9u32;
        let mut draw = |low: f32, high: f32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            low + (high - low) * (state >> 8) as f32 / (1 << 24) as f32
        };
        let (mut counted, mut needed) = (0, 0);
        for _ in 0..2000 {
            let mean = [draw(-20.0, 95.0), draw(-20.0, 80.0)];
            let size = draw(-3.5, 0.6).exp();
            let factor = [size * draw(0.3, 1.0), size * draw(-2.0, 2.0), size * draw(0.3, 1.0)];
            let opacity = draw(0.004, 1.0);
            let ellipse = Ellipse::new(mean, factor, opacity);
            let [top, bottom] = ellipse.rows(&lens());
            for row in 0..4 {
                let [first, end] = if (top..bottom).contains(&row) { ellipse.row(row, &lens()) } else { [0, 0] };
                for column in 0..5 {
                    let seen = seen(mean, factor, opacity, column, row);
                    assert!(!seen || (first..end).contains(&column), "{mean:?} {factor:?} {opacity}: {column} {row}");
                    needed += seen as u32;
                }
                counted += end - first;
            }
            assert_eq!(
                ellipse.count(&lens()),
                (top..bottom).map(|r| ellipse.row(r, &lens())).map(|[a, b]| b - a).sum()
            );
        }
        assert!(counted < needed + needed / 20, "{counted} tiles for {needed}");
    }
}
