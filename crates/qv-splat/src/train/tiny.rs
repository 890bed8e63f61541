//! A scene of known Gaussians, drawn by the rasteriser, for tests.

use super::dataset::{Dataset, Photograph};
use super::random::{Purpose, unit, words};
use super::undistort::Pixels;
use glam::{DMat3, DQuat, DVec3};
use qv_core::{Camera, GaussianCloud, Pose};
use qv_raster::{Image, Outputs, Scene, Settings, View, render};

/// The Gaussians and photographs of them.
pub(crate) struct Tiny {
    pub cloud: GaussianCloud,
    pub dataset: Dataset,
}

/// A camera at a place that looks at a point, y down.
pub(crate) fn looking(place: DVec3, at: DVec3, side: u32) -> Camera {
    let forward = (at - place).normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let rotation = DMat3::from_cols(right, forward.cross(right), forward);
    let world_from_camera = Pose { position: place, rotation: DQuat::from_mat3(&rotation) };
    let (f, c) = (1.1 * side as f64, 0.5 * side as f64);
    Camera { fx: f, fy: f, cx: c, cy: c, width: side, height: side, camera_from_world: world_from_camera.inverse() }
}

/// So many cameras on a ring around the origin.
pub(crate) fn ring(count: usize, side: u32) -> Vec<Camera> {
    let place = |k: usize| {
        let turn = k as f64 / count as f64 * std::f64::consts::TAU;
        DVec3::new(3.0 * turn.cos(), 3.0 * turn.sin(), 0.6 + 0.5 * (3.0 * turn).sin())
    };
    (0..count).map(|k| looking(place(k), DVec3::ZERO, side)).collect()
}

/// What a camera sees as a photograph, with depth, without exposure.
pub(crate) fn photograph(cloud: &GaussianCloud, camera: &Camera, name: &str) -> Photograph {
    let settings = Settings { outputs: Outputs { depth: true, ..Default::default() }, ..Default::default() };
    let (mut images, _) = render(&Scene::still(cloud), &[View::of(*camera)], &settings).unwrap();
    of_image(&images.remove(0), camera, name)
}

pub(crate) fn of_image(image: &Image, camera: &Camera, name: &str) -> Photograph {
    let bytes = image.colour_u8();
    let rgba = bytes.chunks_exact(3).map(|c| [c[0], c[1], c[2], 255]).collect();
    Photograph {
        name: name.into(),
        camera: *camera,
        pixels: Pixels { width: image.width, height: image.height, rgba },
        depth: image.depth.clone(),
        labels: vec![],
    }
}

/// Gaussians within a metre of the origin.
pub(crate) fn cloud(count: usize) -> GaussianCloud {
    let mut cloud = GaussianCloud::default();
    for i in 0..count as u32 {
        let (a, b) = (words(9, 0, i, Purpose::Start).map(unit), words(9, 1, i, Purpose::Start).map(unit));
        cloud.means.push([a[0], a[1], a[2]].map(|x| 1.6 * x - 0.8));
        cloud.log_scales.push([a[3], b[0], b[1]].map(|x| -2.6 + 0.9 * x));
        cloud.rotations.push(b.map(|x| x - 0.45));
        cloud.opacity_logits.push(1.0 + 2.0 * b[2]);
        cloud.sh.push([a[1], b[2], a[3]].map(|x| 3.0 * x - 1.5));
    }
    cloud
}

/// `count` Gaussians in photographs of `side` x `side` pixels, none held out.
pub(crate) fn scene(count: usize, views: usize, side: u32) -> Tiny {
    let cloud = cloud(count);
    let cameras = ring(views, side);
    let all = cameras.iter().enumerate().map(|(k, camera)| photograph(&cloud, camera, &format!("v{k:02}")));
    let dataset = Dataset::of_photographs(all.collect(), 0).unwrap();
    // The photographs are drawn over black.
    Tiny { cloud, dataset: Dataset { background: [0.0; 3], ..dataset } }
}

/// A patterned wall, the plane y = 0, of flat Gaussians.
pub(crate) fn wall() -> GaussianCloud {
    let mut cloud = GaussianCloud::default();
    for i in 0..26 * 26u32 {
        let word = words(4, 0, i, Purpose::Start).map(unit);
        let place = |k: u32| (k as f32 - 12.5) * 0.09;
        cloud.means.push([place(i % 26), 0.0, place(i / 26)]);
        cloud.log_scales.push([-2.9, -7.0, -2.9]);
        cloud.rotations.push([1.0, 0.0, 0.0, 0.0]);
        cloud.opacity_logits.push(4.0);
        cloud.sh.push([word[0], word[1], word[2]].map(|x| 3.0 * x - 1.5));
    }
    cloud
}

/// Cameras in front of the wall.
pub(crate) fn before_the_wall(side: u32) -> Vec<Camera> {
    let at = |k: usize| DVec3::new([-0.8, 0.0, 0.8][k % 3], -2.4, [-0.35, 0.35][k / 3]);
    (0..6).map(|k| looking(at(k), DVec3::ZERO, side)).collect()
}
