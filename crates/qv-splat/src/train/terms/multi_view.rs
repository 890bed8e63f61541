//! Photometric consistency of two views (Chen et al., *PGSR*, 2024, eq. 8 to 10; Campbell et al., 2008): the patch around a pixel, carried
//! over by the homography of the plane that is drawn there, must look the same in the other photograph, as 1 - NCC.
//!
//! With normal N and plane depth D at a pixel with ray c, the patch's pixel with ray r shows the point X = r D (N·c) / (N·r): the
//! homography, written with points. It does not depend on the length of N. Derivatives go from NCC through the slope of the other
//! photograph and the projection to X, then to D and N.

use super::super::dataset::Photograph;
use super::super::random::{Purpose, words};
use super::ray;
use glam::{DVec3, Mat3, Vec2, Vec3};
use qv_core::Camera;
use qv_raster::Image;
use rayon::prelude::*;

/// Pixels of a patch on each side of its middle.
pub const REACH: i32 = 3;
/// Pixels of a patch.
pub const COUNT: usize = ((2 * REACH + 1) * (2 * REACH + 1)) as usize;
/// One pixel in a square of so many on a side is looked at in a step.
pub(crate) const STRIDE: u32 = 3;
/// Added to variances, so that flat patches say nothing.
const FLAT: f32 = 1e-4;
/// A patch that is less alike than this is taken to be hidden in the other view.
const UNLIKE: f32 = 0.9;
/// Largest relative difference of a point's depth from the one that the other view shows.
const HIDDEN: f32 = 0.05;

/// The other view, relative to this one.
pub struct Other<'a> {
    /// Grey values 0 to 1, row by row.
    pub grey: &'a [f32],
    /// Plane depth as drawn there.
    pub depth: &'a [f32],
    /// Its camera.
    pub camera: Camera,
    rotation: Mat3,
    shift: Vec3,
}

impl<'a> Other<'a> {
    /// Of a camera seen from another one.
    pub fn new(camera: &Camera, from: &Camera, grey: &'a [f32], depth: &'a [f32]) -> Self {
        let relative = camera.camera_from_world * from.camera_from_world.inverse();
        let (rotation, shift) = (relative.matrix().as_mat3(), relative.position.as_vec3());
        Self { grey, depth, camera: *camera, rotation, shift }
    }

    /// Grey value and its slope at a place in pixels; `None` outside.
    fn sample(&self, at: Vec2) -> Option<(f32, Vec2)> {
        let (width, height) = (self.camera.width as usize, self.camera.height as usize);
        let corner = at - 0.5;
        let most = Vec2::new(width as f32 - 1.0, height as f32 - 1.0);
        if !(corner.cmpge(Vec2::ZERO).all() && corner.cmplt(most).all()) {
            return None;
        }
        let (x, y) = (corner.x as usize, corner.y as usize);
        let f = corner - corner.floor();
        let g = |x: usize, y: usize| self.grey[y * width + x];
        let (a, b, c, d) = (g(x, y), g(x + 1, y), g(x, y + 1), g(x + 1, y + 1));
        let (top, bottom) = (a + f.x * (b - a), c + f.x * (d - c));
        Some((top + f.y * (bottom - top), Vec2::new((b - a) + f.y * ((d - c) - (b - a)), bottom - top)))
    }

    fn project(&self, p: Vec3) -> Vec2 {
        let c = &self.camera;
        Vec2::new(c.fx as f32 * p.x / p.z + c.cx as f32, c.fy as f32 * p.y / p.z + c.cy as f32)
    }
}

/// 1 - NCC of the patch around a pixel, and its derivatives by normal and plane depth; `None` where the plane faces away, the patch leaves
/// an image, is hidden, flat, or not alike.
pub fn patch(
    grey: &[f32],
    camera: &Camera,
    other: &Other,
    pixel: usize,
    normal: Vec3,
    depth: f32,
) -> Option<(f32, Vec3, f32)> {
    let (width, height) = (camera.width as i32, camera.height as i32);
    let (x, y) = (pixel as i32 % width, pixel as i32 / width);
    if x < REACH || y < REACH || x + REACH >= width || y + REACH >= height || depth <= 0.0 {
        return None;
    }
    let centre = ray(camera, pixel);
    let facing = normal.dot(centre);
    let seen = other.rotation * (centre * depth) + other.shift;
    if facing > -1e-3 || seen.z <= 0.0 {
        return None;
    }
    let at = other.project(seen);
    if !(at.cmpge(Vec2::ZERO).all() && at.x < other.camera.width as f32 && at.y < other.camera.height as f32) {
        return None;
    }
    let there = other.depth[at.y as usize * other.camera.width as usize + at.x as usize];
    if (there - seen.z).abs() > HIDDEN * seen.z {
        return None;
    }
    // Of each pixel: grey here, grey there, derivative of grey there by depth and by normal.
    let mut here = [0.0f32; COUNT];
    let mut found = [0.0f32; COUNT];
    let mut by_depth = [0.0f32; COUNT];
    let mut by_normal = [Vec3::ZERO; COUNT];
    for k in 0..COUNT {
        let (dx, dy) = (k as i32 % (2 * REACH + 1) - REACH, k as i32 / (2 * REACH + 1) - REACH);
        let at = ((y + dy) * width + x + dx) as usize;
        here[k] = grey[at];
        let r = ray(camera, at);
        let along = normal.dot(r);
        if along > -1e-3 {
            return None;
        }
        let ratio = facing / along;
        let p = other.rotation * (r * (depth * ratio)) + other.shift;
        if p.z <= 0.0 {
            return None;
        }
        let (value, slope) = other.sample(other.project(p))?;
        found[k] = value;
        let c = &other.camera;
        let (u, v) = (slope.x * c.fx as f32 / p.z, slope.y * c.fy as f32 / p.z);
        let by_point = other.rotation.transpose() * Vec3::new(u, v, -(u * p.x + v * p.y) / p.z);
        let along_ray = by_point.dot(r);
        by_depth[k] = along_ray * ratio;
        by_normal[k] = (along_ray * depth / along) * (centre - r * ratio);
    }
    let share = 1.0 / COUNT as f32;
    let (mean_here, mean_found) = (share * here.iter().sum::<f32>(), share * found.iter().sum::<f32>());
    let (mut a, mut b, mut both) = (FLAT, FLAT, 0.0);
    for k in 0..COUNT {
        let (p, q) = (here[k] - mean_here, found[k] - mean_found);
        a += share * p * p;
        b += share * q * q;
        both += share * p * q;
    }
    let norm = 1.0 / (a * b).sqrt();
    let ncc = both * norm;
    if 1.0 - ncc >= UNLIKE {
        return None;
    }
    let (mut out_normal, mut out_depth) = (Vec3::ZERO, 0.0);
    for k in 0..COUNT {
        let by = -share * ((here[k] - mean_here) * norm - ncc * (found[k] - mean_found) / b);
        out_normal += by * by_normal[k];
        out_depth += by * by_depth[k];
    }
    Some((1.0 - ncc, out_normal, out_depth))
}

/// Adds the term: the mean over the pixels that are looked at in this step.
pub fn add(
    image: &Image,
    grey: &[f32],
    camera: &Camera,
    other: &Other,
    weight: f32,
    [seed, step]: [u32; 2],
    by: &mut Image,
) -> f32 {
    let word = words(seed, step, 1, Purpose::Pair);
    let (from_x, from_y) = (word[0] % STRIDE, word[1] % STRIDE);
    let pixels: Vec<usize> = (from_y..camera.height)
        .step_by(STRIDE as usize)
        .flat_map(|y| (from_x..camera.width).step_by(STRIDE as usize).map(move |x| (y * camera.width + x) as usize))
        .collect();
    let share = weight / pixels.len().max(1) as f32;
    let one = |&pixel: &usize| {
        let normal = Vec3::from_slice(&image.normal[3 * pixel..]);
        patch(grey, camera, other, pixel, normal, image.plane_depth[pixel])
    };
    let found: Vec<Option<(f32, Vec3, f32)>> = pixels.par_iter().map(one).collect();
    let mut sum = 0.0f64;
    for (&pixel, found) in pixels.iter().zip(found) {
        let Some((loss, by_normal, by_depth)) = found else { continue };
        sum += loss as f64;
        (0..3).for_each(|k| by.normal[3 * pixel + k] += share * by_normal[k]);
        by.plane_depth[pixel] += share * by_depth;
    }
    share * sum as f32
}

/// Grey values of a photograph, 0 to 1.
pub fn grey(photograph: &Photograph) -> Vec<f32> {
    let mean = |p: &[u8; 4]| (p[0] as u32 + p[1] as u32 + p[2] as u32) as f32 * (1.0 / 765.0);
    photograph.pixels.rgba.iter().map(mean).collect()
}

/// For each camera up to four others that look the same way from nearby, the nearest first; none when none does.
pub(crate) fn partners(cameras: &[Camera], extent: f32) -> Vec<Vec<usize>> {
    let look = |camera: &Camera| camera.camera_from_world.inverse().transform_vector(DVec3::Z);
    let place = |camera: &Camera| camera.camera_from_world.inverse().position;
    let of = |(i, a): (usize, &Camera)| {
        let mut near: Vec<(f64, usize)> = cameras
            .iter()
            .enumerate()
            .filter(|(j, b)| i != *j && look(a).dot(look(b)) > 0.5)
            .map(|(j, b)| (place(a).distance(place(b)), j))
            .filter(|(distance, _)| *distance > 0.005 * extent as f64)
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        near.into_iter().take(4).map(|(_, j)| j).collect()
    };
    cameras.iter().enumerate().map(of).collect()
}
