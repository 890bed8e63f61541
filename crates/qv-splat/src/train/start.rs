//! Where training begins: at triangulated points, or anywhere around the cameras.

use super::dataset::Dataset;
use super::neighbours::Tree;
use super::options::{Strategy, TrainOptions};
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

/// Gaussians at points: as large as the mean distance to the 3 nearest others, of constant colour. Opacity and size are those of the
/// strategy's program: 0.1 and the distance itself for the classic one, 0.5 and a tenth for MCMC.
///
/// # Errors
/// There are more points than the cap, or a coordinate is not finite.
pub fn of_points(points: &Points, options: &TrainOptions) -> Result<GaussianCloud, SplatError> {
    if points.places.len() > options.cap {
        return Err(off("points to begin with", format!("at most the cap, {}", options.cap), points.places.len()));
    }
    if let Some(bad) = points.places.iter().find(|place| place.iter().any(|x| !x.is_finite())) {
        return Err(off("points to begin with", "finite coordinates", format!("{bad:?}")));
    }
    let (opacity, share): (f32, f32) = match options.strategy {
        Strategy::Mcmc => (0.5, 0.1),
        Strategy::Classic => (0.1, 1.0),
    };
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
    let mut points = Points::default();
    for index in 0..count.min(options.cap) as u32 {
        let word = words(options.seed, 0, index, Purpose::Start);
        let photograph = &dataset.training[index as usize % dataset.training.len()];
        let camera = &photograph.camera;
        let (u, v) = (unit(word[0]) as f64 * camera.width as f64, unit(word[1]) as f64 * camera.height as f64);
        let depth = 0.3 * dataset.extent as f64 * 30f64.powf(unit(word[2]) as f64);
        let ray = DVec3::new((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0);
        let place = camera.camera_from_world.inverse().transform_point(ray * depth);
        points.places.push(place.as_vec3().to_array());
        let pixel = photograph.pixels.rgba[v as usize * photograph.pixels.width + u as usize];
        points.colours.push(Vec3::new(pixel[0] as f32, pixel[1] as f32, pixel[2] as f32).to_array().map(|c| c / 255.0));
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_become_gaussians() {
        let places = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [9.0, 0.0, 0.0]];
        let points = Points { places, colours: vec![[0.5, 1.0, 0.0]; 5] };
        let mut options = TrainOptions { strategy: Strategy::Classic, ..Default::default() };
        let cloud = of_points(&points, &options).unwrap();
        assert_eq!(cloud.check(), Ok(()));
        assert!(cloud.log_scales[0][0].abs() < 1e-6, "{:?}", cloud.log_scales[0]);
        let opacity = 1.0 / (1.0 + (-cloud.opacity_logits[0]).exp());
        assert!((opacity - 0.1).abs() < 1e-6 && (0.5 + C0 * cloud.sh[0][1] - 1.0).abs() < 1e-6);
        options.cap = 4;
        assert!(of_points(&points, &options).unwrap_err().to_string().contains("at most the cap, 4, found 5"));
    }
}
