//! How alike patches are on each of the planes.

use super::options::StereoOptions;
use super::views::{View, Way};
use glam::Vec3;

/// Correlation where a patch is not wholly in both images.
const NONE: f32 = -2.0;

/// Costs of all planes: 1 - NCC, at most 1, in 255ths, shape `[height, width, planes]`.
pub struct Costs {
    pub values: Vec<u8>,
    pub planes: usize,
}

/// Compares a photograph with its neighbours on all of its planes. At each pixel the better half of them counts.
pub fn costs(view: &View, views: &[View], options: &StereoOptions) -> Costs {
    let count = view.grey.len();
    let others: Vec<(&View, Way)> =
        view.neighbours.iter().map(|&k| (&views[k], Way::new(&view.camera, &views[k].camera))).collect();
    let mut patches = Patches::new(view, options);
    let mut best = vec![vec![NONE; count]; others.len().div_ceil(2)];
    let mut values = vec![255; count * view.planes];
    for plane in 0..view.planes {
        best.iter_mut().for_each(|slot| slot.fill(NONE));
        for (other, way) in &others {
            patches.warp(other, way, view.inverse_depth(plane as f32));
            patches.compare(&mut best);
        }
        for pixel in 0..count {
            let (mut sum, mut number) = (0.0, 0.0);
            for slot in &best {
                let is_one = slot[pixel] > NONE;
                sum += if is_one { slot[pixel] } else { 0.0 };
                number += f32::from(u8::from(is_one));
            }
            if number > 0.0 {
                values[pixel * view.planes + plane] = (255.0 * (1.0 - sum / number).clamp(0.0, 1.0) + 0.5) as u8;
            }
        }
    }
    Costs { values, planes: view.planes }
}

/// Patches of a photograph and of another that is laid over it.
struct Patches {
    width: usize,
    height: usize,
    radius: usize,
    noise: f32,
    /// Grey less one half. What is masked is NaN, and so is all that is summed over it.
    own: Vec<f32>,
    /// Of each patch: mean, and 1 / deviation with noise.
    own_mean: Vec<f32>,
    own_scale: Vec<f32>,
    /// The other one on a plane.
    other: Vec<f32>,
    /// Of a row: where its pixels are in the other one, sums of columns and of patches, correlations.
    places: Vec<[f32; 2]>,
    columns: [Vec<f32>; 3],
    windows: [Vec<f32>; 3],
    row: Vec<f32>,
}

impl Patches {
    fn new(view: &View, options: &StereoOptions) -> Self {
        let (width, height, count) = (view.width, view.height, view.grey.len());
        let inner = width.saturating_sub(2 * options.radius);
        let own: Vec<f32> = view.grey.iter().map(|g| g - 0.5).collect();
        let mut out = Self {
            width,
            height,
            radius: options.radius,
            noise: options.noise,
            other: own.clone(),
            own,
            own_mean: vec![f32::NAN; count],
            own_scale: vec![f32::NAN; count],
            places: vec![[0.0; 2]; width],
            columns: std::array::from_fn(|_| vec![0.0; width]),
            windows: std::array::from_fn(|_| vec![0.0; inner]),
            row: vec![NONE; inner],
        };
        for y in out.rows() {
            out.sum_patches(y);
            let share = out.share();
            let from = y * width + options.radius;
            for (x, (sum, squares)) in out.windows[0].iter().zip(&out.windows[1]).enumerate() {
                let mean = sum * share;
                out.own_mean[from + x] = mean;
                out.own_scale[from + x] = 1.0 / (variance(squares * share, mean) + out.noise * out.noise).sqrt();
            }
        }
        out
    }

    /// Rows in which patches are whole.
    fn rows(&self) -> std::ops::Range<usize> {
        let end = if self.row.is_empty() { 0 } else { self.height.saturating_sub(self.radius) };
        self.radius..end
    }

    /// One by the number of pixels of a patch.
    fn share(&self) -> f32 {
        1.0 / ((2 * self.radius + 1) * (2 * self.radius + 1)) as f32
    }

    /// Sums of patches in a row: of the other one's grey, its square, and its product with the own one.
    fn sum_patches(&mut self, y: usize) {
        self.columns.iter_mut().for_each(|column| column.fill(0.0));
        let [sums, squares, products] = &mut self.columns;
        for row in y - self.radius..=y + self.radius {
            let range = row * self.width..(row + 1) * self.width;
            let both = self.own[range.clone()].iter().zip(&self.other[range]);
            let columns = sums.iter_mut().zip(squares.iter_mut()).zip(products.iter_mut());
            for (((sum, square), product), (a, b)) in columns.zip(both) {
                *sum += b;
                *square += b * b;
                *product += a * b;
            }
        }
        for (window, column) in self.windows.iter_mut().zip(&self.columns) {
            let inner = window.len();
            window.copy_from_slice(&column[..inner]);
            for k in 1..=2 * self.radius {
                window.iter_mut().zip(&column[k..]).for_each(|(sum, more)| *sum += more);
            }
        }
    }

    /// Lays another photograph over this one, as if all were on the plane.
    fn warp(&mut self, other: &View, way: &Way, inverse_depth: f32) {
        let (wide, high) = (other.width as f32 - 1.0, other.height as f32 - 1.0);
        let (along, shift) = (way.turn.x_axis, way.shift * inverse_depth);
        for (y, row) in self.other.chunks_exact_mut(self.width).enumerate() {
            let first = way.turn * Vec3::new(0.5, y as f32 + 0.5, 1.0) + shift;
            for (x, at) in self.places.iter_mut().enumerate() {
                let step = x as f32;
                let scale = 1.0 / (first.z + step * along.z);
                let [u, v] = [first.x + step * along.x, first.y + step * along.y].map(|p| p * scale - 0.5);
                let inside = (scale > 0.0) & (u >= 0.0) & (v >= 0.0) & (u < wide) & (v < high);
                *at = if inside { [u, v] } else { [-1.0; 2] };
            }
            for (grey, [u, v]) in row.iter_mut().zip(&self.places) {
                *grey = if *u >= 0.0 { mixed(other, *u, *v) - 0.5 } else { f32::NAN };
            }
        }
    }

    /// Puts correlations among the best so far, which are sorted.
    fn compare(&mut self, best: &mut [Vec<f32>]) {
        let (share, noise, inner) = (self.share(), self.noise * self.noise, self.row.len());
        for y in self.rows() {
            self.sum_patches(y);
            let from = y * self.width + self.radius;
            let own = self.own_mean[from..from + inner].iter().zip(&self.own_scale[from..from + inner]);
            let [sums, squares, products] = &self.windows;
            let other = sums.iter().zip(squares).zip(products);
            for ((new, (own_mean, scale)), ((sum, square), product)) in self.row.iter_mut().zip(own).zip(other) {
                let mean = sum * share;
                let deviation = (variance(square * share, mean) + noise).sqrt();
                let ncc = (product * share - mean * own_mean) * scale / deviation;
                // Not so for NaN.
                *new = if ncc > NONE { ncc } else { NONE };
            }
            for slot in best.iter_mut() {
                for (kept, new) in slot[from..from + inner].iter_mut().zip(&mut self.row) {
                    let (a, b) = (*kept, *new);
                    *kept = if a > b { a } else { b };
                    *new = if a > b { b } else { a };
                }
            }
        }
    }
}

/// Of a mean of squares; rounding does not make it negative, NaN stays.
fn variance(squares: f32, mean: f32) -> f32 {
    let variance = squares - mean * mean;
    if variance < 0.0 { 0.0 } else { variance }
}

/// Grey between four pixels, of which (u, v) counts from the middle of the first.
fn mixed(view: &View, u: f32, v: f32) -> f32 {
    let (x, y) = (u as usize, v as usize);
    let (right, down) = (u - x as f32, v - y as f32);
    let at = y * view.width + x;
    let (above, below) = (&view.grey[at..at + 2], &view.grey[at + view.width..at + view.width + 2]);
    let upper = above[0] + right * (above[1] - above[0]);
    let lower = below[0] + right * (below[1] - below[0]);
    upper + down * (lower - upper)
}
