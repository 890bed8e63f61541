//! The ground of a scene as a plane, so that it can be scored apart: for a robot that walks it counts most, and few photographs look at it.

use super::dataset::Dataset;
use super::drawn::{DEPTH, drawn_with};
use super::random::{Purpose, unit, words};
use crate::SplatError;
use glam::{DMat3, DQuat, DVec3};
use qv_core::statistics::median;
use qv_core::{Camera, GaussianCloud};
use qv_raster::Image;

/// What is asked of a plane to be called the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundOptions {
    /// Photographs whose depth is looked at, evenly picked.
    pub photographs: usize,
    /// Points taken of each, evenly over the picture.
    pub points: usize,
    /// Planes that are tried, each through three points.
    pub tries: u32,
    /// How far from the plane the ground may be, as a share of the median depth.
    pub within: f64,
    /// Largest angle between the plane's normal and the cameras' mean upward axis \[rad\].
    pub tilt: f64,
    /// Least share of the points that lie on it.
    pub least: f64,
}

impl Default for GroundOptions {
    fn default() -> Self {
        Self { photographs: 24, points: 400, tries: 2000, within: 0.02, tilt: 0.6, least: 0.03 }
    }
}

/// A plane `normal · x = height` in the world, and how far from it a point still is ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ground {
    /// Unit vector upwards.
    pub normal: DVec3,
    /// Where the plane is along it \[m, or the capture's unit\].
    pub height: f64,
    /// Distance within which a point is ground \[the same unit\].
    pub within: f64,
}

impl Ground {
    /// The plane below the cameras on which most of what they see lies (random sample consensus: Fischler and Bolles, 1981). None where
    /// the cameras have no common upward direction, or no plane below them holds enough.
    ///
    /// # Errors
    /// Drawing fails.
    pub fn of(cloud: &GaussianCloud, dataset: &Dataset, how: &GroundOptions) -> Result<Option<Self>, SplatError> {
        let cameras: Vec<Camera> = dataset.training.iter().map(|one| one.camera).collect();
        let Some(upward) = upward(&cameras) else { return Ok(None) };
        let (points, depths) = seen(cloud, dataset, &cameras, how)?;
        Ok(Self::below(&points, depths, &cameras, upward, how))
    }

    /// The plane that most points lie on, if most cameras are above it.
    fn below(
        points: &[DVec3],
        mut depths: Vec<f64>,
        cameras: &[Camera],
        upward: DVec3,
        how: &GroundOptions,
    ) -> Option<Self> {
        let within = how.within * median(&mut depths);
        largest(points, upward, within, how).filter(|found| {
            let above = |camera: &&Camera| found.distance(camera.camera_from_world.inverse().position) > 0.0;
            2 * cameras.iter().filter(above).count() > cameras.len()
        })
    }

    /// Height of a point above the plane.
    pub fn distance(&self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.height
    }

    /// Which pixels of an image with depth show the ground, shape `[height, width]`.
    pub fn pixels(&self, image: &Image, camera: &Camera) -> Vec<bool> {
        let is_ground = |pixel: usize| {
            point_of(image, camera, pixel).is_some_and(|(point, _)| self.distance(point).abs() <= self.within)
        };
        (0..image.alpha.len()).map(is_ground).collect()
    }
}

/// The cameras' mean upward axis; none where they have nothing in common.
fn upward(cameras: &[Camera]) -> Option<DVec3> {
    let upward: DVec3 = cameras.iter().map(up).sum::<DVec3>() / cameras.len().max(1) as f64;
    // Directions that are all alike have a mean of length one, those that are even over the sphere of none.
    (upward.length() >= 0.5).then(|| upward.normalize())
}

fn up(camera: &Camera) -> DVec3 {
    camera.camera_from_world.rotation.inverse() * DVec3::NEG_Y
}

/// The point in the world that a pixel shows, and its depth; none where little was drawn.
pub(super) fn point_of(image: &Image, camera: &Camera, pixel: usize) -> Option<(DVec3, f64)> {
    let depth = f64::from(image.depth[pixel]);
    if image.alpha[pixel] < 0.5 || !(depth > 0.0 && depth.is_finite()) {
        return None;
    }
    let (column, row) = ((pixel % image.width) as f64 + 0.5, (pixel / image.width) as f64 + 0.5);
    let ray = DVec3::new((column - camera.cx) / camera.fx, (row - camera.cy) / camera.fy, 1.0);
    Some((camera.camera_from_world.inverse().transform_point(depth * ray), depth))
}

/// Points that the cameras see, and their depths.
fn seen(
    cloud: &GaussianCloud,
    dataset: &Dataset,
    cameras: &[Camera],
    how: &GroundOptions,
) -> Result<(Vec<DVec3>, Vec<f64>), SplatError> {
    let (mut points, mut depths) = (Vec::new(), Vec::new());
    for camera in cameras.iter().step_by(cameras.len().div_ceil(how.photographs.max(1)).max(1)) {
        let image = drawn_with(cloud, camera, dataset, DEPTH)?;
        // Steps along both sides, not along rows alone: else the points would lie on few columns.
        let step = ((image.alpha.len() as f64 / how.points.max(1) as f64).sqrt() as usize).max(1);
        for row in (0..image.height).step_by(step) {
            for column in (0..image.width).step_by(step) {
                if let Some((point, depth)) = point_of(&image, camera, row * image.width + column) {
                    points.push(point);
                    depths.push(depth);
                }
            }
        }
    }
    Ok((points, depths))
}

fn largest(points: &[DVec3], upward: DVec3, within: f64, how: &GroundOptions) -> Option<Ground> {
    if points.len() < 3 {
        return None;
    }
    let count = |plane: &Ground| points.iter().filter(|p| plane.distance(**p).abs() <= within).count();
    let pick = |word: u32| ((f64::from(unit(word)) * points.len() as f64) as usize).min(points.len() - 1);
    let tried = (0..how.tries).filter_map(|k| {
        let [a, b, c, _] = words(0, 0, k, Purpose::Start).map(|word| points[pick(word)]);
        let normal = (b - a).cross(c - a).try_normalize()?;
        let normal = if normal.dot(upward) < 0.0 { -normal } else { normal };
        let plane = Ground { normal, height: normal.dot(a), within };
        (normal.dot(upward) >= how.tilt.cos()).then_some(plane)
    });
    let mut best = tried.map(|plane| (count(&plane), plane)).max_by_key(|(count, _)| *count)?.1;
    for _ in 0..3 {
        best = refined(points, &best)?;
    }
    (best.normal.dot(upward) >= how.tilt.cos() && count(&best) as f64 >= how.least * points.len() as f64)
        .then_some(best)
}

/// The plane that fits the points near a plane best by least squares of heights.
fn refined(points: &[DVec3], plane: &Ground) -> Option<Ground> {
    let turn = DQuat::from_rotation_arc(DVec3::Z, plane.normal);
    let near: Vec<DVec3> = points.iter().filter(|p| plane.distance(**p).abs() <= plane.within).copied().collect();
    let middle = near.iter().sum::<DVec3>() / near.len().max(1) as f64;
    let (mut normal_matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for point in &near {
        let local = turn.inverse() * (*point - middle);
        let row = DVec3::new(local.x, local.y, 1.0);
        normal_matrix += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
        right += row * local.z;
    }
    // Points on a line fix no plane.
    let size = normal_matrix.determinant().abs();
    if !(size.is_finite() && size > 0.0) {
        return None;
    }
    let slope = normal_matrix.inverse() * right;
    let normal = (turn * DVec3::new(-slope.x, -slope.y, 1.0)).try_normalize()?;
    let height = normal.dot(middle + turn * DVec3::new(0.0, 0.0, slope.z));
    Some(Ground { normal, height, within: plane.within })
}

#[cfg(test)]
mod tests {
    use super::super::tiny;
    use super::*;
    use qv_core::Pose;

    /// A tilted sheet of Gaussians with a wall beside it, photographed from above it in pixels that are small beside them.
    fn sheet(tilt: f64) -> (GaussianCloud, Dataset) {
        let mut scene = tiny::scene(1, 6, 32);
        let rotation = DQuat::from_rotation_x(tilt);
        let mut cloud = tiny::cloud(40 * 40 + 20 * 20);
        for i in 0..40 * 40 {
            let place = rotation * DVec3::new(0.1 * (i % 40) as f64 - 2.0, 0.1 * (i / 40) as f64 - 2.0, -0.5);
            cloud.means[i] = place.as_vec3().to_array();
        }
        for i in 0..20 * 20 {
            let place = DVec3::new(-2.0, 0.1 * (i % 20) as f64 - 1.0, 0.1 * (i / 20) as f64 - 0.5);
            cloud.means[40 * 40 + i] = place.as_vec3().to_array();
        }
        // Flat, so that their drawn depth is where they are.
        cloud.log_scales.fill([0.06f32.ln(), 0.06f32.ln(), 0.004f32.ln()]);
        cloud.rotations.fill([1.0, 0.0, 0.0, 0.0]);
        cloud.opacity_logits.fill(4.0);
        let cameras = tiny::ring(6, 96);
        scene.dataset.training = cameras.iter().map(|c| tiny::photograph(&cloud, c, "v")).collect();
        (cloud, scene.dataset)
    }

    #[test]
    fn the_ground_is_found_where_it_lies_and_the_wall_is_none() {
        for tilt in [0.0, 0.1] {
            let (cloud, dataset) = sheet(tilt);
            let found = Ground::of(&cloud, &dataset, &GroundOptions::default()).unwrap().unwrap();
            let normal = DQuat::from_rotation_x(tilt) * DVec3::Z;
            assert!(found.normal.angle_between(normal) < 0.02, "{found:?}");
            assert!((found.height + 0.5).abs() < 0.03, "{found:?}");
            let camera = dataset.training[0].camera;
            let image = drawn_with(&cloud, &camera, &dataset, DEPTH).unwrap();
            let pixels = found.pixels(&image, &camera);
            let shown = pixels.iter().filter(|is| **is).count();
            assert!(shown > 100 && shown < pixels.len(), "{shown}");
        }
    }

    #[test]
    fn cameras_without_an_upward_direction_have_no_ground() {
        let (cloud, mut dataset) = sheet(0.0);
        for (k, photograph) in dataset.training.iter_mut().enumerate() {
            let roll =
                Pose { rotation: DQuat::from_rotation_z(std::f64::consts::PI * (k % 2) as f64), position: DVec3::ZERO };
            photograph.camera.camera_from_world = roll * photograph.camera.camera_from_world;
        }
        assert_eq!(Ground::of(&cloud, &dataset, &GroundOptions::default()).unwrap(), None);
    }
}
