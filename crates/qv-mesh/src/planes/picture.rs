//! A picture without its noise.

use qv_core::Camera;

/// Colours 0 to 1, smoothed over about a pixel.
pub(super) struct Picture {
    pub width: usize,
    pub height: usize,
    /// Shape `[height, width]`.
    pub colours: Vec<[f32; 3]>,
}

/// Binomial weights: a Gaussian of one pixel, nearly.
const WEIGHTS: [f32; 5] = [1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];

impl Picture {
    /// Of colours, shape `[height, width, 3]`.
    pub fn smoothed(camera: &Camera, colours: &[f32]) -> Self {
        let (width, height) = (camera.width as usize, camera.height as usize);
        // What is not a number is black, as it is drawn.
        let finite = |x: f32| if x.is_finite() { x } else { 0.0 };
        let raw: Vec<[f32; 3]> = colours.chunks_exact(3).map(|c| [c[0], c[1], c[2]].map(finite)).collect();
        let mix = |from: &[[f32; 3]], at: &dyn Fn(i64) -> usize| {
            let mut out = [0.0; 3];
            for (k, weight) in WEIGHTS.iter().enumerate() {
                (0..3).for_each(|c| out[c] += weight * from[at(k as i64 - 2)][c]);
            }
            out
        };
        let inside = |at: i64, size: usize| at.clamp(0, size as i64 - 1) as usize;
        let along = |from: &[[f32; 3]], right: bool| -> Vec<[f32; 3]> {
            let one = |pixel: usize| {
                let (x, y) = ((pixel % width) as i64, (pixel / width) as i64);
                if right {
                    mix(from, &|k| y as usize * width + inside(x + k, width))
                } else {
                    mix(from, &|k| inside(y + k, height) * width + x as usize)
                }
            };
            (0..width * height).map(one).collect()
        };
        let colours = along(&along(&raw, true), false);
        Self { width, height, colours }
    }

    /// Length of the change of colour per pixel, the largest over the three, shape `[height, width]`.
    pub fn texture(&self) -> Vec<f32> {
        let one = |pixel: usize| {
            let (x, y) = (pixel % self.width, pixel / self.width);
            let at = |x: usize, y: usize| self.colours[y * self.width + x];
            let (left, right) = (at(x.saturating_sub(1), y), at((x + 1).min(self.width - 1), y));
            let (above, below) = (at(x, y.saturating_sub(1)), at(x, (y + 1).min(self.height - 1)));
            let slope = |c: usize| 0.5 * (right[c] - left[c]).hypot(below[c] - above[c]);
            (0..3).map(slope).fold(0.0, f32::max)
        };
        (0..self.colours.len()).map(one).collect()
    }
}
