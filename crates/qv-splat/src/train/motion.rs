//! How a camera moves while its shutter is open, and what a photograph then sums up.

use super::twist::turned;
use crate::SplatError;
use crate::error::off;
use glam::{DQuat, DVec3};
use qv_core::Camera;
use qv_raster::Image;
use rayon::prelude::*;

/// How a camera moved from the beginning to the end of a photograph: a twist in its own axes, translation \[m\], then rotation \[rad\].
pub type Motion = [f32; 6];

/// How photographs are exposed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shutter {
    /// Poses that a photograph is drawn from: odd, 3 to 31.
    pub samples: usize,
    /// Time from the beginning of the first row to that of the last, as a share of the whole span: 0 where all rows are exposed together,
    /// 1 where rows are read one after the other and their exposure is short beside that.
    pub readout: f32,
    /// Exponent from the photographs' colours to linear light, in which a sensor sums up.
    pub gamma: f32,
}

impl Default for Shutter {
    fn default() -> Self {
        Self { samples: 5, readout: 0.0, gamma: 2.2 }
    }
}

/// Windows shorter than this share of the span are moments.
const MOMENT: f64 = 1e-6;

impl Shutter {
    /// Checks ranges.
    ///
    /// # Errors
    /// Names the first value that is off.
    pub fn check(&self) -> Result<(), SplatError> {
        let place = |name: &str| format!("shutter, {name}");
        if !(3..=31).contains(&self.samples) || self.samples.is_multiple_of(2) {
            return Err(off(place("samples"), "an odd number, 3 to 31", self.samples));
        }
        if !(0.0..=1.0).contains(&self.readout) {
            return Err(off(place("readout"), "a share, 0 to 1", self.readout));
        }
        if !(1.0..=4.0).contains(&self.gamma) {
            return Err(off(place("gamma"), "1 to 4", self.gamma));
        }
        Ok(())
    }

    /// When the scene is drawn, -1/2 to 1/2.
    pub(super) fn times(&self) -> impl Iterator<Item = f64> {
        let last = self.samples as f64 - 1.0;
        (0..self.samples).map(move |k| k as f64 / last - 0.5)
    }

    /// The sample at the photograph's pose.
    pub fn middle(&self) -> usize {
        self.samples / 2
    }

    /// What each sample counts in each row, shape `[height][samples]`; each row sums up to 1. It is the integral over the row's window
    /// of the function that is 1 at the sample and falls to 0 linearly to both neighbours.
    pub fn weights(&self, height: usize) -> Vec<Vec<f32>> {
        let (readout, apart) = (f64::from(self.readout), 1.0 / (self.samples as f64 - 1.0));
        let open = 1.0 - readout;
        let row = |y: usize| {
            let from = readout * (y as f64 + 0.5) / height as f64 - 0.5;
            let weight = |time: f64| match open > MOMENT {
                true => apart / open * (hat_sum((from + open - time) / apart) - hat_sum((from - time) / apart)),
                false => (1.0 - ((from - time) / apart).abs()).max(0.0),
            };
            self.times().map(|time| weight(time) as f32).collect()
        };
        (0..height).map(row).collect()
    }

    /// The cameras that a photograph is drawn from.
    pub fn cameras(&self, camera: &Camera, motion: &Motion) -> Vec<Camera> {
        let at = |time: f64| {
            let camera_from_world = turned(&camera.camera_from_world, &motion.map(|x| (time * f64::from(x)) as f32));
            Camera { camera_from_world, ..*camera }
        };
        self.times().map(at).collect()
    }

    /// The photograph that images from [`Self::cameras`] make, shape `[height, width, 3]`.
    pub fn exposed(&self, images: &[Image]) -> Vec<f32> {
        let (width, height) = (images[0].width, images[0].height);
        let (weights, mut out) = (self.weights(height), vec![0.0; 3 * width * height]);
        out.par_chunks_mut(3 * width.max(1)).zip(&weights).enumerate().for_each(|(y, (row, weights))| {
            for (image, weight) in images.iter().zip(weights).filter(|(_, weight)| **weight > 0.0) {
                let colours = &image.colour[3 * width * y..3 * width * (y + 1)];
                row.iter_mut().zip(colours).for_each(|(sum, colour)| *sum += weight * self.linear(*colour));
            }
            if self.gamma != 1.0 {
                row.iter_mut().for_each(|sum| *sum = sum.powf(1.0 / self.gamma));
            }
        });
        out
    }

    fn linear(&self, colour: f32) -> f32 {
        if self.gamma == 1.0 { colour } else { colour.max(0.0).powf(self.gamma) }
    }

    /// From the derivative by the photograph `exposed` to those by the images that made it: with linear light `c^γ`, each counts
    /// `w (c / exposed)^(γ - 1)`.
    pub fn back(&self, images: &[Image], exposed: &[f32], by: &[f32], by_images: &mut [Image]) {
        let (width, height) = (images[0].width, images[0].height);
        let weights = self.weights(height);
        let wide = 3 * width.max(1);
        for (k, (image, by_image)) in images.iter().zip(by_images).enumerate() {
            by_image.colour.par_chunks_mut(wide).enumerate().for_each(|(y, row)| {
                let (weight, from) = (weights[y][k], wide * y);
                for (at, out) in row.iter_mut().enumerate().filter(|_| weight > 0.0) {
                    let (whole, part) = (exposed[from + at], image.colour[from + at]);
                    // In black all samples count alike.
                    let share = if self.gamma == 1.0 || whole < 1e-6 {
                        1.0
                    } else {
                        (part.max(0.0) / whole).powf(self.gamma - 1.0)
                    };
                    *out = weight * share * by[from + at];
                }
            });
        }
    }

    /// Derivatives by the photograph's pose and by its motion, of those by the poses of the samples.
    pub(crate) fn by_pose_and_motion(&self, motion: &Motion, by_poses: &[[f32; 6]]) -> [[f32; 6]; 2] {
        let (shift, turn) = halves(motion);
        let mut sums = [DVec3::ZERO; 4];
        for (time, by) in self.times().zip(by_poses) {
            let (by_shift, by_turn) = halves(by);
            // The sample's pose turns about the camera; what it is a twist of stands `time * shift` beside it.
            let by_turn = by_turn + by_shift.cross(time * shift);
            let back = DQuat::from_scaled_axis(-time * turn);
            sums[0] += back * by_shift;
            sums[1] += back * by_turn;
            sums[2] += time * by_shift;
            // The left Jacobian of the rotation, to first order.
            sums[3] += time * (by_turn - 0.5 * time * turn.cross(by_turn));
        }
        let [pose, motion] = [[sums[0], sums[1]], [sums[2], sums[3]]];
        [pose, motion].map(|[v, w]| [v.x, v.y, v.z, w.x, w.y, w.z].map(|x| x as f32))
    }
}

fn halves(twist: &[f32; 6]) -> (DVec3, DVec3) {
    let [x, y, z, a, b, c] = twist.map(f64::from);
    (DVec3::new(x, y, z), DVec3::new(a, b, c))
}

/// Integral up to x of the function that rises from 0 at -1 to 1 at 0 and falls to 0 at 1.
fn hat_sum(x: f64) -> f64 {
    let x = x.clamp(-1.0, 1.0);
    if x < 0.0 { 0.5 * (1.0 + x) * (1.0 + x) } else { 1.0 - 0.5 * (1.0 - x) * (1.0 - x) }
}
