//! Recordings of a camera with something hidden: images along a path, and what is claimed of camera, clock and poses.
//!
//! The images stay what they are and the claims are changed: what is hidden is the difference between the two. Images of the
//! yard are cast by rays and share nothing with the rasteriser.

#![allow(dead_code)]

use glam::{DQuat, DVec3};
use qv_camera::path::{pose_of, twist_of};
use qv_camera::{Footage, Intrinsics, Photograph, Rig};
use qv_core::{Camera, GaussianCloud, JointSeries, Pose};
use std::f64::consts::TAU;
use yard::noise::Random;
use yard::{Photo, Yard};

/// Images with the true time, mounting and path.
pub struct Truth {
    pub intrinsics: Intrinsics,
    pub base_from_camera: Pose,
    /// `world_from_base`.
    pub path: Box<dyn Fn(f64) -> Pose + Send + Sync>,
    /// First and last time at which the path is known.
    pub span: [f64; 2],
    /// True times and images.
    pub images: Vec<(f64, Vec<[u8; 4]>)>,
    pub cloud: GaussianCloud,
}

/// What is hidden in a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum HiddenError {
    Nothing,
    /// Stops.
    Exposure(f64),
    /// Seconds that stamps are late.
    Delay(f64),
    /// True mounting from the claimed one, in camera axes: translation, rotation.
    Extrinsics([f64; 6]),
    /// True focal length over the claimed one.
    Focal(f64),
    /// Deviation in pixels.
    Blur(f64),
}

impl HiddenError {
    pub fn name(&self) -> &'static str {
        match self {
            Self::Nothing => "none",
            Self::Exposure(_) => "camera_exposure",
            Self::Delay(_) => "camera_delay",
            Self::Extrinsics(_) => "camera_extrinsics",
            Self::Focal(_) => "camera_focal",
            Self::Blur(_) => "camera_blur",
        }
    }

    /// One of a kind, of a size worth naming, by a seed.
    pub fn draw(kind: usize, random: &mut Random) -> Self {
        let sign = if random.uniform() < 0.5 { -1.0 } else { 1.0 };
        match kind {
            0 => Self::Nothing,
            1 => Self::Exposure(sign * random.between(0.5, 1.3)),
            2 => Self::Delay(random.between(0.02, 0.1)),
            3 => {
                let axis = random.normals().normalize() * random.between(0.7, 3.0f64).to_radians();
                let shift = random.normals().normalize() * random.between(0.0, 0.03);
                Self::Extrinsics([shift.x, shift.y, shift.z, axis.x, axis.y, axis.z])
            }
            4 => Self::Focal(1.0 + sign * random.between(0.025, 0.08)),
            _ => Self::Blur(random.between(1.2, 2.5)),
        }
    }
}

/// A recording.
pub struct Recording {
    pub rig: Rig,
    pub poses: JointSeries,
    pub photographs: Vec<Photograph>,
}

impl Recording {
    pub fn footage<'a>(&'a self, cloud: &'a GaussianCloud) -> Footage<'a> {
        Footage { cloud, background: [0.0; 3], rig: self.rig, poses: Some(&self.poses), photographs: &self.photographs }
    }
}

/// The recording of a truth with something hidden. Poses come at 50 Hz with noise of 2 mm and 1 mrad.
pub fn recording(truth: &Truth, hidden: HiddenError, seed: u64) -> Recording {
    recording_of_all(truth, &[hidden], seed)
}

/// The same with several things hidden at once.
pub fn recording_of_all(truth: &Truth, hidden: &[HiddenError], seed: u64) -> Recording {
    let mut random = Random::new(seed, 77);
    let mut rig = Rig {
        intrinsics: truth.intrinsics,
        base_from_camera: truth.base_from_camera,
        delay: 0.0,
        gain: 1.0,
        blur: 0.0,
    };
    let mut late = 0.0;
    for one in hidden {
        match one {
            HiddenError::Delay(delay) => late = *delay,
            HiddenError::Extrinsics(twist) => rig.base_from_camera = rig.base_from_camera * pose_of(twist),
            HiddenError::Focal(scale) => {
                rig.intrinsics.fx /= scale;
                rig.intrinsics.fy /= scale;
            }
            _ => {}
        }
    }
    let (mut time, mut values) = (Vec::new(), Vec::new());
    for k in 0..=((truth.span[1] - truth.span[0]) * 50.0) as usize {
        let t = truth.span[0] + k as f64 / 50.0;
        let noise =
            Pose { position: 0.002 * random.normals(), rotation: DQuat::from_scaled_axis(0.001 * random.normals()) };
        let pose = (truth.path)(t) * noise;
        time.push(t);
        values.extend(pose.position.to_array());
        values.extend(pose.wxyz());
    }
    let size = [truth.intrinsics.width as usize, truth.intrinsics.height as usize];
    let shown = |rgba: &Vec<[u8; 4]>| hidden.iter().fold(rgba.clone(), |rgba, one| developed(&rgba, size, *one));
    let photographs = truth.images.iter().map(|(t, rgba)| Photograph { time: t + late, rgba: shown(rgba) });
    Recording { rig, poses: JointSeries::new(time, values, 7).unwrap(), photographs: photographs.collect() }
}

fn developed(rgba: &[[u8; 4]], [width, height]: [usize; 2], hidden: HiddenError) -> Vec<[u8; 4]> {
    match hidden {
        // In light, by the curve of sRGB, and cut off where the sensor is full.
        HiddenError::Exposure(stops) => {
            let one = |c: u8| {
                let v = f64::from(c) / 255.0;
                let light = if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
                let light = (light * stops.exp2()).min(1.0);
                let v = if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 };
                (255.0 * v).round() as u8
            };
            rgba.iter().map(|p| [one(p[0]), one(p[1]), one(p[2]), p[3]]).collect()
        }
        HiddenError::Blur(deviation) => blurred(rgba, width, height, deviation),
        _ => rgba.to_vec(),
    }
}

fn blurred(rgba: &[[u8; 4]], width: usize, height: usize, deviation: f64) -> Vec<[u8; 4]> {
    let reach = (3.0 * deviation).ceil() as isize;
    let kernel: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / deviation).powi(2)).exp()).collect();
    let total: f64 = kernel.iter().sum();
    let pass = |from: &[[f64; 3]], horizontal: bool| -> Vec<[f64; 3]> {
        (0..width * height)
            .map(|i| {
                let (x, y) = ((i % width) as isize, (i / width) as isize);
                let mut sum = [0.0; 3];
                for (k, weight) in (-reach..=reach).zip(&kernel) {
                    let (u, v) = if horizontal { (x + k, y) } else { (x, y + k) };
                    let at = v.clamp(0, height as isize - 1) as usize * width + u.clamp(0, width as isize - 1) as usize;
                    (0..3).for_each(|c| sum[c] += weight / total * from[at][c]);
                }
                sum
            })
            .collect()
    };
    let start: Vec<[f64; 3]> = rgba.iter().map(|p| [0, 1, 2].map(|c| f64::from(p[c]))).collect();
    let end = pass(&pass(&start, true), false);
    end.iter().zip(rgba).map(|(c, p)| [c[0].round() as u8, c[1].round() as u8, c[2].round() as u8, p[3]]).collect()
}

/// A walk through the yard in the shape of an eight, with the sway of a trot; 0.4 m/s, turning by 0.7 rad/s at most.
pub fn walk(t: f64) -> Pose {
    let period = 22.0;
    let a = TAU * t / period;
    let (x, y) = (0.4 + 1.3 * a.sin(), 1.1 * (2.0 * a).sin());
    let heading = (2.2 * (2.0 * a).cos()).atan2(1.3 * a.cos());
    let step = TAU * 1.8 * t;
    let turn = DQuat::from_rotation_z(heading + 0.02 * step.sin())
        * DQuat::from_rotation_y(0.02 * (2.0 * step + 1.0).sin())
        * DQuat::from_rotation_x(0.03 * step.sin());
    Pose { position: DVec3::new(x, y + 0.01 * step.cos(), 0.36 + 0.01 * (2.0 * step).sin()), rotation: turn }
}

/// The camera at the robot's head, looking ahead and 20 degrees down.
pub fn mounting() -> Pose {
    let forward = glam::DMat3::from_cols(DVec3::NEG_Y, DVec3::NEG_Z, DVec3::X);
    let rotation = DQuat::from_mat3(&forward) * DQuat::from_rotation_x(-20f64.to_radians());
    Pose { position: DVec3::new(0.28, 0.0, 0.06), rotation }
}

/// The yard of a seed: `images` images along the walk, and a cloud with a Gaussian on the surface for every few pixels of photographs
/// from elsewhere (placed by true depth, nothing is trained), one for each cube of `cell` metres.
pub fn yard(images: usize, width: u32, height: u32, cell: f64, seed: u64) -> Truth {
    let focal = 0.6 * f64::from(width);
    let (cx, cy) = (0.5 * f64::from(width), 0.5 * f64::from(height));
    let intrinsics = Intrinsics { fx: focal, fy: focal, cx, cy, width, height };
    let span = [0.0, 20.0];
    let times: Vec<f64> = (0..images).map(|k| 0.8 + 18.4 * k as f64 / images as f64).collect();
    let mut yard = Yard::new(48, 96, 72, seed).unwrap();
    let others: Vec<Photo> = (0..yard.cameras.len()).map(|view| yard.photo(view)).collect();
    let cloud = on_surfaces(&yard.cameras, &others, cell);
    let rig = Rig { intrinsics, base_from_camera: mounting(), delay: 0.0, gain: 1.0, blur: 0.0 };
    yard.cameras = times.iter().map(|t| rig.camera((walk(*t) * mounting()).inverse())).collect();
    let images = times.into_iter().enumerate().map(|(k, t)| (t, unexposed(&yard.photo(k)))).collect();
    Truth { intrinsics, base_from_camera: mounting(), path: Box::new(walk), span, images, cloud }
}

/// A photograph with the yard's automatic exposure taken away: a robot's camera has one of its own.
pub fn unexposed(photo: &Photo) -> Vec<[u8; 4]> {
    let one = |c: u8, exposure: f64| {
        let light = (f64::from(c) / 255.0).powf(2.2) / exposure;
        (255.0 * light.min(1.0).powf(1.0 / 2.2)).round() as u8
    };
    let e = photo.exposure;
    photo.colour.chunks_exact(3).map(|c| [one(c[0], e[0]), one(c[1], e[1]), one(c[2], e[2]), 255]).collect()
}

/// A flat Gaussian at each pixel that has a depth, along the surface. Places that were seen before are left out.
pub fn on_surfaces(cameras: &[Camera], photos: &[Photo], cell: f64) -> GaussianCloud {
    let mut cloud = GaussianCloud::default();
    let mut taken = std::collections::BTreeSet::new();
    for (camera, photo) in cameras.iter().zip(photos) {
        let world_from_camera = camera.camera_from_world.inverse();
        let width = camera.width as usize;
        let place = |i: usize| {
            let depth = f64::from(*photo.depth.get(i)?);
            let (u, v) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let ray = DVec3::new((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0);
            (depth > 0.0).then(|| world_from_camera.transform_point(depth * ray))
        };
        for (i, rgba) in unexposed(photo).iter().enumerate() {
            let (Some(place), Some(right), Some(below)) = (place(i), place(i + 1), place(i + width)) else { continue };
            let normal = (right - place).cross(below - place).normalize_or(DVec3::Z);
            let turn = DQuat::from_rotation_arc(DVec3::Z, normal);
            if !taken.insert((place / cell).floor().to_array().map(|x| x as i64)) {
                continue;
            }
            cloud.means.push(place.as_vec3().to_array());
            let wide = (0.62 * cell).ln() as f32;
            cloud.log_scales.push([wide, wide, wide - 2.5]);
            cloud.rotations.push([turn.w, turn.x, turn.y, turn.z].map(|x| x as f32));
            cloud.opacity_logits.push(3.0);
            // The constant harmonic's factor is 0.28209479.
            cloud.sh.push([0, 1, 2].map(|c| (f32::from(rgba[c]) / 255.0 - 0.5) / 0.282_094_79));
        }
    }
    cloud
}

/// The path through poses at times: cubic in position and turn between neighbours (Catmull and Rom).
pub fn through(times: Vec<f64>, poses: Vec<Pose>) -> Box<dyn Fn(f64) -> Pose + Send + Sync> {
    Box::new(move |t| {
        let n = times.len();
        let k = times.partition_point(|x| *x <= t).clamp(1, n - 1) - 1;
        let s = (t - times[k]) / (times[k + 1] - times[k]);
        let seen = |i: usize| twist_of(&(poses[k].inverse() * poses[i.min(n - 1)]));
        let (next, before, after) = (seen(k + 1), if k == 0 { [0.0; 6] } else { seen(k - 1) }, seen(k + 2));
        let twist: [f64; 6] = std::array::from_fn(|i| {
            let first = if k == 0 { next[i] } else { 0.5 * (next[i] - before[i]) };
            let second = if k + 2 >= n { next[i] } else { 0.5 * after[i] };
            let (h10, h01, h11) = (s * (1.0 - s).powi(2), s * s * (3.0 - 2.0 * s), s * s * (s - 1.0));
            h10 * first + h01 * next[i] + h11 * second
        });
        poses[k] * pose_of(&twist)
    })
}

/// How far a diagnosis is from what was hidden: delay \[s\], angle \[rad\], stops, focal length (share), blur (px).
pub fn error(hidden: HiddenError, cause: &qv_gap::report::Cause) -> f64 {
    let value = |name: &str| cause.parameters.iter().find(|p| p.name == name).map_or(f64::NAN, |p| p.value);
    match hidden {
        HiddenError::Nothing => 0.0,
        HiddenError::Exposure(stops) => (value("stops") - stops).abs(),
        HiddenError::Delay(delay) => (value("delay") - delay).abs(),
        HiddenError::Extrinsics(twist) => {
            let found =
                DQuat::from_scaled_axis(DVec3::new(value("rotation_x"), value("rotation_y"), value("rotation_z")));
            let truth = pose_of(&twist).rotation;
            found.angle_between(truth)
        }
        HiddenError::Focal(scale) => (value("focal_scale") / scale - 1.0).abs(),
        HiddenError::Blur(deviation) => (value("blur") - deviation).abs(),
    }
}
