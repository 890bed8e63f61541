//! Grey pictures: made smaller, blurred, differentiated.

/// Brightness as displayed, 0 to 1, row by row from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Shape `[height, width]`.
    pub values: Vec<f32>,
}

/// Shares of red, green and blue in brightness (ITU-R BT.601).
const BRIGHTNESS: [f32; 3] = [0.299, 0.587, 0.114];

/// Brightness of a colour.
pub fn brightness(rgb: [f32; 3]) -> f32 {
    (0..3).map(|c| BRIGHTNESS[c] * rgb[c]).sum()
}

impl Picture {
    /// Of an image of three colours, shape `[height, width, 3]`.
    pub fn of_colour(width: usize, height: usize, colour: &[f32]) -> Self {
        let values = colour.chunks_exact(3).map(|c| brightness([c[0], c[1], c[2]])).collect();
        Self { width, height, values }
    }

    /// The mean over the area of each pixel of a smaller picture.
    pub(crate) fn shrunk(&self, width: usize, height: usize) -> Self {
        let columns = shares(self.width, width);
        let rows = shares(self.height, height);
        let mut narrow = vec![0.0f32; self.height * width];
        for y in 0..self.height {
            let row = &self.values[y * self.width..(y + 1) * self.width];
            for (x, parts) in columns.iter().enumerate() {
                narrow[y * width + x] = parts.iter().map(|&(at, share)| share * row[at]).sum();
            }
        }
        let mut values = vec![0.0f32; height * width];
        for (y, parts) in rows.iter().enumerate() {
            for &(at, share) in parts {
                for x in 0..width {
                    values[y * width + x] += share * narrow[at * width + x];
                }
            }
        }
        Self { width, height, values }
    }

    /// With a Gaussian blur of variance `variance` \[px²\]. A negative one sharpens: it takes half the variance times the Laplacian away, which is
    /// the same to first order (heat equation).
    pub fn blurred(&self, variance: f64) -> Self {
        if variance.abs() < 1e-6 {
            return self.clone();
        }
        if variance < 0.0 {
            let bent = self.laplacian();
            let values = self.values.iter().zip(&bent).map(|(v, l)| v + 0.5 * variance as f32 * l).collect();
            return Self { values, ..*self };
        }
        let reach = (3.0 * variance.sqrt()).ceil().max(1.0) as isize;
        let mut kernel = kernel(variance, reach);
        let total: f32 = kernel.iter().sum();
        kernel.iter_mut().for_each(|k| *k /= total);
        let (w, h) = (self.width as isize, self.height as isize);
        let pass = |from: &[f32], step_x: isize, step_y: isize| {
            let mut out = vec![0.0f32; from.len()];
            for y in 0..h {
                for x in 0..w {
                    let mut sum = 0.0;
                    for (k, weight) in (-reach..=reach).zip(&kernel) {
                        let (px, py) = ((x + k * step_x).clamp(0, w - 1), (y + k * step_y).clamp(0, h - 1));
                        sum += weight * from[(py * w + px) as usize];
                    }
                    out[(y * w + x) as usize] = sum;
                }
            }
            out
        };
        Self { values: pass(&pass(&self.values, 1, 0), 0, 1), ..*self }
    }

    /// Central differences along x and y \[1/px\], zero in the border.
    pub fn slopes(&self) -> [Vec<f32>; 2] {
        let mut out = [vec![0.0; self.values.len()], vec![0.0; self.values.len()]];
        self.inside(|at, w| {
            out[0][at] = 0.5 * (self.values[at + 1] - self.values[at - 1]);
            out[1][at] = 0.5 * (self.values[at + w] - self.values[at - w]);
        });
        out
    }

    /// Second differences along x and y, summed \[1/px²\], zero in the border.
    pub(crate) fn laplacian(&self) -> Vec<f32> {
        let mut out = vec![0.0; self.values.len()];
        self.inside(|at, w| {
            let v = &self.values;
            out[at] = v[at - 1] + v[at + 1] + v[at - w] + v[at + w] - 4.0 * v[at];
        });
        out
    }

    fn inside(&self, mut at: impl FnMut(usize, usize)) {
        for y in 1..self.height.saturating_sub(1) {
            for x in 1..self.width.saturating_sub(1) {
                at(y * self.width + x, self.width);
            }
        }
    }
}

/// A Gaussian integrated over pixels, so that narrow ones keep their variance: differences of a fine sum.
fn kernel(variance: f64, reach: isize) -> Vec<f32> {
    const FINE: i32 = 9;
    (-reach..=reach)
        .map(|k| {
            let part = |i: i32| {
                let x = k as f64 + f64::from(i - FINE / 2) / f64::from(FINE);
                (-0.5 * x * x / variance).exp()
            };
            (0..FINE).map(part).sum::<f64>() as f32
        })
        .collect()
}

/// Which old pixels make each new one, with shares that sum to 1.
fn shares(old: usize, new: usize) -> Vec<Vec<(usize, f32)>> {
    let ratio = old as f64 / new as f64;
    (0..new)
        .map(|n| {
            let (from, to) = (n as f64 * ratio, (n + 1) as f64 * ratio);
            let last = (to.ceil() as usize).min(old);
            (from as usize..last)
                .map(|o| {
                    let overlap = to.min((o + 1) as f64) - from.max(o as f64);
                    (o, (overlap / ratio) as f32)
                })
                .filter(|(_, share)| *share > 0.0)
                .collect()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(width: usize, height: usize) -> Picture {
        let value = |i: usize| ((i % width) as f32 * 0.31).sin() * ((i / width) as f32 * 0.23).cos();
        Picture { width, height, values: (0..width * height).map(value).collect() }
    }

    #[test]
    fn a_smaller_picture_keeps_the_mean() {
        let mean = |p: &Picture| p.values.iter().sum::<f32>() / p.values.len() as f32;
        let picture = wave(70, 45);
        for (w, h) in [(35, 15), (33, 20), (70, 45)] {
            assert!((mean(&picture.shrunk(w, h)) - mean(&picture)).abs() < 1e-5, "{w} {h}");
        }
        assert_eq!(picture.shrunk(70, 45), picture);
    }

    #[test]
    fn a_small_blur_is_half_its_variance_times_the_laplacian() {
        let picture = wave(60, 60);
        let (blurred, bent) = (picture.blurred(0.5), picture.laplacian());
        let at = 30 * 60 + 30;
        for at in [at, at + 7, at - 9 * 60] {
            let moved = blurred.values[at] - picture.values[at];
            assert!((moved - 0.25 * bent[at]).abs() < 0.12 * (0.25 * bent[at]).abs() + 2e-3, "{moved} {}", bent[at]);
        }
        // What a blur took, sharpening gives back to first order.
        let back = picture.blurred(0.2).blurred(-0.2);
        let off = |p: &Picture| (p.values[at] - picture.values[at]).abs();
        assert!(off(&back) < 0.35 * off(&picture.blurred(0.2)));
    }

    #[test]
    fn slopes_are_those_of_a_plane() {
        let values = (0..200).map(|i| 0.1 * (i % 20) as f32 - 0.3 * (i / 20) as f32).collect();
        let [x, y] = Picture { width: 20, height: 10, values }.slopes();
        assert!((x[4 * 20 + 5] - 0.1).abs() < 1e-6 && (y[4 * 20 + 5] + 0.3).abs() < 1e-6);
        assert_eq!((x[0], y[199]), (0.0, 0.0));
    }
}
