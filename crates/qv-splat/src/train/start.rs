//! Where training begins: at triangulated points, or anywhere around the cameras.

use super::dataset::Dataset;
use super::neighbours::Tree;
use super::options::TrainOptions;
use super::random::{Purpose, unit, words};
use crate::SplatError;
use crate::error::off;
use crate::files::Points;
use glam::{DVec3, Vec3};
use qv_core::GaussianCloud;

/// Value of the constant harmonic.
pub const C0: f32 = 0.282_094_8;
/// Gaussians that begin at random when there are no points.
pub const AT_RANDOM: usize = 20_000;
/// Gaussians that begin at measured depths when depth takes part.
pub const AT_DEPTHS: usize = 100_000;

/// Gaussians at points: as large as the mean distance to the 3 nearest others, of constant colour. Opacity and size are those of the
/// strategy's program: 0.1 and the distance itself for the classic one, 0.5 and a tenth for MCMC.
///
/// # Errors
/// There are more points than the cap, or a coordinate or a colour is not finite.
pub fn of_points(points: &Points, options: &TrainOptions) -> Result<GaussianCloud, SplatError> {
    if points.places.len() > options.cap {
        return Err(off("points to begin with", format!("at most the cap, {}", options.cap), points.places.len()));
    }
    if let Some(bad) = points.places.iter().find(|place| place.iter().any(|x| !x.is_finite())) {
        return Err(off("points to begin with", "finite coordinates", format!("{bad:?}")));
    }
    if let Some(at) = points.colours.iter().position(|colour| colour.iter().any(|c| !c.is_finite())) {
        let (place, found) = (points.places[at], points.colours[at]);
        return Err(off("points to begin with", format!("a finite colour at {place:?}"), format!("{found:?}")));
    }
    let (opacity, share) = (0.5f32, 0.1);
    let tree = Tree::new(&points.places);
    let scale = |distances: &Vec<f32>| {
        let mean = (distances.iter().map(|d| d * d).sum::<f32>() / distances.len().max(1) as f32).sqrt();
        [(mean.max(1e-6) * share).ln(); 3]
    };
    let n = points.places.len();
    Ok(GaussianCloud {
        means: points.places.clone(),
        log_scales: tree.nearest(3).iter().map(scale).collect(),
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; n],
        opacity_logits: vec![(opacity / (1.0 - opacity)).ln(); n],
        sh: points.colours.iter().map(|colour| colour.map(|c| (c - 0.5) / C0)).collect(),
        ..Default::default()
    })
}

/// Points in front of the cameras, on rays through random pixels and of their colours, from 0.3 to 9 times the extent away.
pub fn at_random(dataset: &Dataset, count: usize, options: &TrainOptions) -> Points {
    on_rays(dataset, count, options, 0, |word| 0.3 * dataset.extent as f64 * 30f64.powf(unit(word) as f64))
}

fn on_rays(dataset: &Dataset, count: usize, options: &TrainOptions, round: u32, depth: impl Fn(u32) -> f64) -> Points {
    let mut points = Points::default();
    for index in 0..count.min(options.cap) as u32 {
        let word = words(options.seed, round, index, Purpose::Start);
        let photograph = &dataset.training[index as usize % dataset.training.len()];
        let camera = &photograph.camera;
        let (u, v) = (unit(word[0]) as f64 * camera.width as f64, unit(word[1]) as f64 * camera.height as f64);
        let ray = DVec3::new((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0);
        let place = camera.camera_from_world.inverse().transform_point(ray * depth(word[2]));
        points.places.push(place.as_vec3().to_array());
        let pixel = photograph.pixels.rgba[v as usize * photograph.pixels.width + u as usize];
        points.colours.push(Vec3::new(pixel[0] as f32, pixel[1] as f32, pixel[2] as f32).to_array().map(|c| c / 255.0));
    }
    points
}

/// Points where random pixels of the photographs have a measured depth, of their colours; at most `count`, fewer where depth has holes, none
/// without depth.
pub fn at_depths(dataset: &Dataset, count: usize, options: &TrainOptions) -> Points {
    let mut points = Points::default();
    let measured: Vec<_> = dataset.training.iter().filter(|one| !one.depth.is_empty()).collect();
    if measured.is_empty() {
        return points;
    }
    for index in 0..count.min(options.cap) as u32 {
        let word = words(options.seed, 1, index, Purpose::Start);
        let photograph = measured[index as usize % measured.len()];
        let camera = &photograph.camera;
        let pixel = (unit(word[0]) * photograph.depth.len() as f32) as usize;
        let (depth, rgba) = (photograph.depth[pixel], photograph.pixels.rgba[pixel]);
        if depth <= 0.0 || rgba[3] == 0 {
            continue;
        }
        let (u, v) = ((pixel % photograph.pixels.width) as f64, (pixel / photograph.pixels.width) as f64);
        let ray = DVec3::new((u + 0.5 - camera.cx) / camera.fx, (v + 0.5 - camera.cy) / camera.fy, 1.0);
        let place = camera.camera_from_world.inverse().transform_point(ray * f64::from(depth));
        points.places.push(place.as_vec3().to_array());
        points.colours.push([rgba[0], rgba[1], rgba[2]].map(|c| f32::from(c) / 255.0));
    }
    points
}

#[cfg(test)]
mod tests {
    use super::super::{Photograph, tiny};
    use super::*;
    use crate::facts::States;

    #[test]
    fn points_become_gaussians() {
        let places = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [9.0, 0.0, 0.0]];
        let points = Points { places, colours: vec![[0.5, 1.0, 0.0]; 5], ..Default::default() };
        let mut options = TrainOptions::default();
        let cloud = of_points(&points, &options).unwrap();
        assert_eq!(cloud.check(), Ok(()));
        assert!((cloud.log_scales[0][0] - 0.1f32.ln()).abs() < 1e-6, "{:?}", cloud.log_scales[0]);
        let opacity = 1.0 / (1.0 + (-cloud.opacity_logits[0]).exp());
        assert!((opacity - 0.5).abs() < 1e-6 && (0.5 + C0 * cloud.sh[0][1] - 1.0).abs() < 1e-6);
        options.cap = 4;
        assert!(of_points(&points, &options).unwrap_err().to_string().states("found 4 5"));
    }

    #[test]
    fn points_at_depths_lie_on_what_was_photographed() {
        let scene = tiny::scene(60, 4, 24);
        let options = TrainOptions::default();
        let points = at_depths(&scene.dataset, 500, &options);
        assert!(points.places.len() > 100 && points.places.len() < 500, "{}", points.places.len());
        // Each point is where one of the photographs has its depth.
        let lies_in = |one: &Photograph, place: &[f32; 3]| {
            let p = one.camera.camera_from_world.transform_point(Vec3::from(*place).as_dvec3());
            let (u, v) = (one.camera.fx * p.x / p.z + one.camera.cx, one.camera.fy * p.y / p.z + one.camera.cy);
            let at = v as usize * one.pixels.width + u as usize;
            p.z > 0.0 && u < 24.0 && one.depth.get(at).is_some_and(|depth| (f64::from(*depth) - p.z).abs() < 1e-4)
        };
        assert!(points.places.iter().all(|place| scene.dataset.training.iter().any(|one| lies_in(one, place))));
        let mut without = scene.dataset.clone();
        without.training.iter_mut().for_each(|one| one.depth.clear());
        assert!(at_depths(&without, 500, &options).places.is_empty());
    }
}
