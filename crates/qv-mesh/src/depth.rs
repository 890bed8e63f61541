//! Depth maps, and the local planes that are fitted to them.

use crate::MeshError;
use crate::error::off;
use qv_core::Camera;
use rayon::prelude::*;

/// Half the side of the window that a pixel's plane is fitted in \[px\].
const REACH: i64 = 3;
/// Neighbours take part in a pixel's plane when their inverse depths differ by at most this share.
const ALIKE: f32 = 0.06;
/// Share of the window, as far as it is in the image, that must take part; pixels with less are edges or noise and are left out.
const SUPPORT: f32 = 0.4;
/// Smallest cosine between ray and normal that counts \[1\].
const GRAZING: f32 = 0.05;

/// A depth map with its camera.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthFrame {
    /// The camera; no distortion.
    pub camera: Camera,
    /// Depth along the camera's z \[m\], shape `[height, width]`; 0, negative or not finite where there is none.
    pub depth: Vec<f32>,
    /// How far each depth is to be trusted, 0 to 1, shape `[height, width]`; empty for 1 everywhere.
    pub weight: Vec<f32>,
}

impl DepthFrame {
    /// Checks the camera and that the arrays fit it.
    ///
    /// # Errors
    /// Names the frame by `index`, and what is off.
    pub fn check(&self, index: usize) -> Result<(), MeshError> {
        self.camera.check().map_err(|error| off(format!("depth frame {index}"), "a camera", error))?;
        let pixels = self.camera.pixels();
        for (what, found, may_be_empty) in [("depth", self.depth.len(), false), ("weight", self.weight.len(), true)] {
            if found != pixels && !(may_be_empty && found == 0) {
                let expected = format!("{pixels} numbers for {} x {} pixels", self.camera.width, self.camera.height);
                return Err(off(format!("depth frame {index}, {what}"), expected, found));
            }
        }
        Ok(())
    }

    /// Depth of a pixel \[m\], none where there is none or it is beyond `most`.
    pub(crate) fn at(&self, pixel: usize, most: f32) -> Option<f32> {
        let depth = self.depth[pixel];
        (depth.is_finite() && depth > 0.0 && depth <= most).then_some(depth)
    }
}

/// The plane that a pixel sees. A plane n · p = 1 in camera axes has inverse depth n · ray, which is linear in the pixel's
/// coordinates, so that fitting it is linear, too.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct PixelPlane {
    /// Inverse depth at the pixel's centre \[1/m\]; 0 where there is none.
    pub inverse: f32,
    /// Change of the inverse depth per pixel to the right and down \[1/(m px)\].
    pub slope: [f32; 2],
    /// Distance of the plane from the camera, 1 / |n| \[m\].
    pub distance: f32,
    /// Trust times the cosine between ray and normal, over depth squared when that is beyond a metre.
    pub weight: f32,
}

/// Planes of all pixels, shape `[height, width]`.
pub(crate) fn planes(frame: &DepthFrame, most: f32) -> Vec<PixelPlane> {
    let width = frame.camera.width as usize;
    let inverse: Vec<f32> = (0..frame.depth.len()).map(|i| frame.at(i, most).map_or(0.0, f32::recip)).collect();
    let mut out = vec![PixelPlane::default(); inverse.len()];
    out.par_chunks_mut(width).enumerate().for_each(|(row, planes)| {
        for (column, plane) in planes.iter_mut().enumerate() {
            if let Some(found) = fit(frame, &inverse, column as i64, row as i64) {
                *plane = found;
            }
        }
    });
    out
}

/// Least squares of the inverse depths round a pixel; the pixel's own depth is kept as it is.
fn fit(frame: &DepthFrame, inverse: &[f32], column: i64, row: i64) -> Option<PixelPlane> {
    let (width, height) = (i64::from(frame.camera.width), i64::from(frame.camera.height));
    let centre = inverse[(row * width + column) as usize];
    if centre == 0.0 {
        return None;
    }
    let (mut count, mut x, mut y, mut z, mut xx, mut xy, mut yy, mut xz, mut yz) =
        (0.0f32, 0.0f32, 0.0f32, 0.0f32, 0.0f32, 0.0f32, 0.0f32, 0.0f32, 0.0f32);
    for v in (row - REACH).max(0)..=(row + REACH).min(height - 1) {
        let dy = (v - row) as f32;
        for u in (column - REACH).max(0)..=(column + REACH).min(width - 1) {
            let w = inverse[(v * width + u) as usize] - centre;
            if w.abs() > ALIKE * centre {
                continue;
            }
            let dx = (u - column) as f32;
            count += 1.0;
            (x, y, z) = (x + dx, y + dy, z + w);
            (xx, xy, yy) = (xx + dx * dx, xy + dx * dy, yy + dy * dy);
            (xz, yz) = (xz + dx * w, yz + dy * w);
        }
    }
    let inside = |at: i64, size: i64| (at + REACH).min(size - 1) - (at - REACH).max(0) + 1;
    if count < SUPPORT * (inside(column, width) * inside(row, height)) as f32 {
        return None;
    }
    // Normal equations about the mean.
    let (xx, xy, yy) = (xx - x * x / count, xy - x * y / count, yy - y * y / count);
    let (xz, yz) = (xz - x * z / count, yz - y * z / count);
    let determinant = xx * yy - xy * xy;
    if determinant < 1e-3 * (xx + yy) * (xx + yy) {
        return None;
    }
    let slope = [(yy * xz - xy * yz) / determinant, (xx * yz - xy * xz) / determinant];
    let camera = &frame.camera;
    let ray =
        [((column as f64 + 0.5 - camera.cx) / camera.fx) as f32, ((row as f64 + 0.5 - camera.cy) / camera.fy) as f32];
    let (nx, ny) = (slope[0] * camera.fx as f32, slope[1] * camera.fy as f32);
    let nz = centre - nx * ray[0] - ny * ray[1];
    let distance = (nx * nx + ny * ny + nz * nz).sqrt().recip();
    let cosine = centre * distance / (1.0 + ray[0] * ray[0] + ray[1] * ray[1]).sqrt();
    let trust = frame.weight.get((row * width + column) as usize).copied().unwrap_or(1.0);
    if cosine.is_nan() || cosine < GRAZING || trust.is_nan() || trust <= 0.0 {
        return None;
    }
    let weight = trust.min(1.0) * cosine * (centre * centre).min(1.0);
    Some(PixelPlane { inverse: centre, slope, distance, weight })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use qv_core::Pose;

    fn camera() -> Camera {
        Camera { fx: 50.0, fy: 55.0, cx: 20.0, cy: 14.0, width: 40, height: 30, camera_from_world: Pose::IDENTITY }
    }

    #[test]
    fn planes_are_found_exactly() {
        // n · p = 1 with n = (0.1, -0.3, 0.5).
        let (camera, n) = (camera(), [0.1f64, -0.3, 0.5]);
        let depth = (0..camera.pixels()).map(|i| {
            let (u, v) = ((i % 40) as f64 + 0.5, (i / 40) as f64 + 0.5);
            (1.0 / (n[0] * (u - camera.cx) / camera.fx + n[1] * (v - camera.cy) / camera.fy + n[2])) as f32
        });
        let frame = DepthFrame { camera, depth: depth.collect(), weight: vec![] };
        let length = n.iter().map(|x| x * x).sum::<f64>().sqrt();
        for plane in planes(&frame, 100.0) {
            assert!((f64::from(plane.slope[0]) - n[0] / camera.fx).abs() < 1e-5, "{plane:?}");
            assert!((f64::from(plane.distance) - 1.0 / length).abs() < 1e-3, "{plane:?}");
        }
    }

    #[test]
    fn what_stands_alone_or_is_no_depth_is_left_out() {
        let camera = camera();
        let mut depth = vec![0.0; camera.pixels()];
        depth[500] = 2.0;
        depth[700] = f32::NAN;
        depth[800] = f32::INFINITY;
        let frame = DepthFrame { camera, depth, weight: vec![] };
        assert!(planes(&frame, 100.0).iter().all(|plane| plane.weight == 0.0));
    }

    #[test]
    fn arrays_that_do_not_fit_the_camera_are_named() {
        let camera = camera();
        let fault = |frame: DepthFrame| frame.check(7).unwrap_err().to_string();
        let short = DepthFrame { camera, depth: vec![1.0; 3], weight: vec![] };
        assert_eq!(fault(short), "depth frame 7, depth: expected 1200 numbers for 40 x 30 pixels, found 3");
        let good = DepthFrame { camera, depth: vec![1.0; 1200], weight: vec![1.0; 2] };
        assert!(fault(good.clone()).contains("weight"));
        let nan = DepthFrame { camera: Camera { fx: f64::NAN, ..camera }, ..good };
        assert!(fault(nan).states("camera"));
    }
}
