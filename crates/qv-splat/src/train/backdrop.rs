//! A shell of Gaussians round the scene, far behind everything, for the directions that no photograph shows.
//!
//! Nothing is learned where no photograph looks, and what is drawn there is black: a robot that looks aside sees holes. The
//! shell continues the photographs beyond their borders instead: each of its Gaussians has the colour of the nearest places of
//! photographs, by angle (inverse distance weighting, Shepard 1968), and is hidden wherever the scene is solid.

use super::dataset::Photograph;
use super::random::{Purpose, unit, words};
use super::start::C0;
use crate::SplatError;
use glam::{DVec2, DVec3};
use qv_core::{Camera, GaussianCloud};
use qv_raster::{Outputs, Scene, Settings, View, render};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Radius of the shell in units of the distance of the farthest of most Gaussians.
const FARTHER: f64 = 3.0;
/// Share of Gaussians that the shell is meant to lie behind; the others are strays.
const MOST: f64 = 0.98;
/// Standard deviation of a Gaussian of the shell in units of the mean distance to the next.
const OVERLAP: f64 = 0.8;
/// Opacity of a Gaussian of the shell.
const OPACITY: f64 = 0.995;
/// Places of a photograph that are averaged round the one that is nearest.
const SAMPLES: u32 = 48;
/// Angle at which a photograph's weight has begun to fall \[rad\].
const NEAR: f64 = 0.02;
/// Share of light from behind, from which on a photograph tells what is there.
const CLEAR: f32 = 0.05;

/// Gaussians of a shell round the cameras and most of the cloud, of the cloud's degree and with as many features (zeros), so that both can be
/// joined. `count` is their number, `seed` settles which pixels are averaged.
///
/// # Errors
/// The cloud cannot be drawn.
pub fn backdrop(
    cloud: &GaussianCloud,
    photographs: &[Photograph],
    count: usize,
    seed: u32,
) -> Result<GaussianCloud, SplatError> {
    let centres: Vec<DVec3> = photographs.iter().map(|one| place(&one.camera)).collect();
    let centre = centres.iter().sum::<DVec3>() / centres.len().max(1) as f64;
    let radius = radius(cloud, &centres, centre);
    let drawn: Vec<Drawn> = photographs.par_iter().map(|one| Drawn::new(cloud, one)).collect::<Result<_, _>>()?;
    let directions: Vec<DVec3> = (0..count).map(|k| spiral(k, count)).collect();
    let colours: Vec<DVec3> = directions
        .par_iter()
        .enumerate()
        .map(|(k, direction)| colour(centre + *direction * radius, photographs, &drawn, seed, k as u32))
        .collect();
    let spacing = radius * (4.0 * PI / count.max(1) as f64).sqrt();
    let mut sh = vec![[0.0; 3]; count * cloud.sh_count()];
    for (k, colour) in colours.iter().enumerate() {
        sh[k * cloud.sh_count()] = ((*colour - 0.5) / f64::from(C0)).as_vec3().to_array();
    }
    Ok(GaussianCloud {
        means: directions.iter().map(|d| (centre + *d * radius).as_vec3().to_array()).collect(),
        log_scales: vec![[(spacing * OVERLAP).ln() as f32; 3]; count],
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; count],
        opacity_logits: vec![(OPACITY / (1.0 - OPACITY)).ln() as f32; count],
        sh_degree: cloud.sh_degree,
        sh,
        feature_count: cloud.feature_count,
        features: vec![0.0; count * cloud.feature_count],
    })
}

/// A cloud and behind it another of the same degree and features.
pub fn joined(front: &GaussianCloud, back: &GaussianCloud) -> GaussianCloud {
    let mut out = front.clone();
    out.means.extend_from_slice(&back.means);
    out.log_scales.extend_from_slice(&back.log_scales);
    out.rotations.extend_from_slice(&back.rotations);
    out.opacity_logits.extend_from_slice(&back.opacity_logits);
    out.sh.extend_from_slice(&back.sh);
    out.features.extend_from_slice(&back.features);
    out
}

fn place(camera: &Camera) -> DVec3 {
    camera.camera_from_world.inverse().position
}

fn radius(cloud: &GaussianCloud, cameras: &[DVec3], centre: DVec3) -> f64 {
    let mut far: Vec<f64> = cloud.means.iter().map(|m| centre.distance(glam::Vec3::from(*m).as_dvec3())).collect();
    far.retain(|distance| distance.is_finite());
    far.sort_by(f64::total_cmp);
    let most = far.get((MOST * far.len() as f64) as usize).copied().unwrap_or(0.0);
    let cameras = cameras.iter().map(|camera| camera.distance(centre)).fold(0.0, f64::max);
    FARTHER * most.max(cameras).max(1e-3)
}

/// Points spread evenly over the unit sphere (Fibonacci's spiral, Vogel 1979).
fn spiral(k: usize, count: usize) -> DVec3 {
    let z = 1.0 - (2.0 * k as f64 + 1.0) / count as f64;
    let turn = k as f64 * PI * (3.0 - 5f64.sqrt());
    let r = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(r * turn.cos(), r * turn.sin(), z)
}

/// What is drawn of a photograph so far.
struct Drawn {
    colour: Vec<f32>,
    alpha: Vec<f32>,
}

impl Drawn {
    fn new(cloud: &GaussianCloud, photograph: &Photograph) -> Result<Self, SplatError> {
        let (views, scene) = ([View::of(photograph.camera)], Scene::still(cloud));
        let (mut images, _) = render(&scene, &views, &Settings { outputs: Outputs::default(), ..Default::default() })?;
        let image = images.swap_remove(0);
        Ok(Self { colour: image.colour, alpha: image.alpha })
    }

    /// Colour behind a pixel: what the photograph has and the cloud has not, as far as light comes through.
    fn behind(&self, photograph: &Photograph, pixel: usize) -> DVec3 {
        let through = 1.0 - self.alpha[pixel];
        let rgba = photograph.pixels.rgba[pixel];
        let part = |c: usize| {
            let seen = f32::from(rgba[c]) / 255.0;
            let behind = if through > CLEAR { (seen - self.colour[3 * pixel + c]) / through } else { seen };
            f64::from(behind.clamp(0.0, 1.0))
        };
        DVec3::new(part(0), part(1), part(2))
    }
}

/// Colour of a place of the shell, by all photographs.
fn colour(point: DVec3, photographs: &[Photograph], drawn: &[Drawn], seed: u32, index: u32) -> DVec3 {
    let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
    for (one, drawn) in photographs.iter().zip(drawn) {
        let Some((pixel, angle)) = nearest(&one.camera, point) else { continue };
        let Some(colour) = around(one, drawn, pixel, seed, index) else { continue };
        let weight = (NEAR / (NEAR + angle)).powi(4);
        sum += weight * colour;
        weights += weight;
    }
    if weights > 0.0 { sum / weights } else { DVec3::splat(0.5) }
}

/// The pixel whose ray is nearest to a point, roughly, and the angle between the two \[rad\].
fn nearest(camera: &Camera, point: DVec3) -> Option<(DVec2, f64)> {
    let p = camera.camera_from_world.transform_point(point);
    let ray = p.try_normalize()?;
    // Behind the camera the direction to the side is kept, so that each side continues its own border.
    let flat = DVec2::new(ray.x, ray.y);
    let slope = if ray.z > 0.1 { flat / ray.z } else { flat.normalize_or_zero() * 10.0 };
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let pixel = DVec2::new(camera.fx * slope.x + camera.cx, camera.fy * slope.y + camera.cy);
    let pixel = pixel.clamp(DVec2::ZERO, DVec2::new(width - 1.0, height - 1.0));
    let back = DVec3::new((pixel.x - camera.cx) / camera.fx, (pixel.y - camera.cy) / camera.fy, 1.0).normalize();
    Some((pixel, back.angle_between(ray)))
}

/// Mean of what is behind some valid pixels around one; `None` when none of them is valid.
fn around(one: &Photograph, drawn: &Drawn, pixel: DVec2, seed: u32, index: u32) -> Option<DVec3> {
    let (width, height) = (one.pixels.width as i64, (one.pixels.rgba.len() / one.pixels.width) as i64);
    let reach = 0.03 * width.max(height) as f64;
    let (mut sum, mut count) = (DVec3::ZERO, 0.0);
    for sample in 0..SAMPLES {
        let word = words(seed, sample, index, Purpose::Backdrop);
        let offset = |word: u32| reach * (2.0 * f64::from(unit(word)) - 1.0);
        let x = ((pixel.x + offset(word[0])) as i64).clamp(0, width - 1);
        let y = ((pixel.y + offset(word[1])) as i64).clamp(0, height - 1);
        let at = (y * width + x) as usize;
        if one.pixels.rgba[at][3] != 0 {
            sum += drawn.behind(one, at);
            count += 1.0;
        }
    }
    (count > 0.0).then(|| sum / count)
}
