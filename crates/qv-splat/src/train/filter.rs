//! The 3D smoothing filter of *Mip-Splatting* (Yu et al., CVPR 2024, eq. 7 to 9): no Gaussian is finer than what the photographs sample,
//! so that nothing is learned which none of them shows, and which is seen once a camera comes nearer.
//!
//! A Gaussian at depth z of a camera of focal length f is sampled every z / f metres. The finest of these over the cameras that see it, times
//! the root of 0.2, is the deviation of a Gaussian that it is convolved with; its opacity shrinks as its volume grows. The filter is reported
//! anew in each step from where Gaussians are, and no derivative goes through it.

use super::moments::logistic;
use qv_core::{Camera, GaussianCloud};
use qv_raster::{Gradients, Scene, View};
use rayon::prelude::*;

/// Variance of the filter in units of the squared distance of samples.
const VARIANCE: f32 = 0.2;
/// Most that an opacity is, so that it has a logit.
const MOST: f32 = 1.0 - 1e-6;

/// Cameras that photographs were taken with, as the rasteriser has them.
#[derive(Debug, Clone)]
pub struct Sampling {
    batches: Vec<qv_raster::lens::Batch>,
}

impl Sampling {
    /// Of these cameras; those that the rasteriser refuses sample nothing.
    pub fn of(cameras: &[Camera]) -> Self {
        let nothing = GaussianCloud::default();
        let batch = |camera: &Camera| qv_raster::lens::Batch::new(&Scene::still(&nothing), &[View::of(*camera)]).ok();
        Self { batches: cameras.iter().filter_map(batch).collect() }
    }

    /// Deviation of the filter at each place \[m\]: of the cameras that see it, or else of those that it is in front of; 0 behind all.
    pub fn deviations(&self, means: &[[f32; 3]]) -> Vec<f32> {
        means.par_iter().with_min_len(512).map(|mean| self.deviation(*mean)).collect()
    }

    fn deviation(&self, mean: [f32; 3]) -> f32 {
        let (mut seen, mut before) = (f32::INFINITY, f32::INFINITY);
        for batch in &self.batches {
            let (lens, p) = (&batch.lenses[0], batch.motions[0].transform(mean));
            if p.z <= qv_raster::constants::NEAR {
                continue;
            }
            let apart = p.z / lens.focal[0].max(lens.focal[1]);
            before = before.min(apart);
            let inside = (0..2).all(|k| (lens.lowest[k]..=lens.highest[k]).contains(&(p[k] / p.z)));
            if inside {
                seen = seen.min(apart);
            }
        }
        let apart = if seen.is_finite() { seen } else { before };
        if apart.is_finite() { VARIANCE.sqrt() * apart } else { 0.0 }
    }
}

/// The cloud as it is drawn.
pub fn seen(cloud: &GaussianCloud, deviations: &[f32]) -> GaussianCloud {
    let mut out = cloud.clone();
    let lists = (&mut out.log_scales, &mut out.opacity_logits, deviations).into_par_iter();
    lists.with_min_len(1024).for_each(|(log_scales, logit, deviation)| {
        let (wide, share) = widened(log_scales, *deviation);
        *log_scales = wide;
        *logit = logit_of(logistic(*logit) * share);
    });
    out
}

/// Log scales after the filter, and the share of the opacity that is left.
fn widened(log_scales: &[f32; 3], deviation: f32) -> ([f32; 3], f32) {
    let square = deviation * deviation;
    let mut share = 1.0;
    let wide = log_scales.map(|log| {
        let own = (2.0 * log).exp();
        let sum = own + square;
        share *= if sum > 0.0 { own / sum } else { 1.0 };
        // As it came where nothing is added: the logarithm of a root loses bits.
        if square > 0.0 { 0.5 * sum.ln() } else { log }
    });
    (wide, share.sqrt())
}

fn logit_of(opacity: f32) -> f32 {
    let opacity = opacity.clamp(1e-12, MOST);
    (opacity / (1.0 - opacity)).ln()
}

/// Derivatives by the cloud, from those by what is drawn.
pub fn back(cloud: &GaussianCloud, deviations: &[f32], by: &mut Gradients) {
    let lists = (&cloud.log_scales, &cloud.opacity_logits, deviations, &mut by.log_scales, &mut by.opacity_logits);
    lists.into_par_iter().with_min_len(1024).for_each(|(log_scales, logit, deviation, by_scales, by_logit)| {
        let opacity = logistic(*logit);
        let left = 1.0 - (opacity * widened(log_scales, *deviation).1).min(MOST);
        for (by, log) in by_scales.iter_mut().zip(log_scales) {
            let own = (2.0 * log).exp();
            let sum = own + deviation * deviation;
            let kept = if sum > 0.0 { own / sum } else { 1.0 };
            *by = *by * kept + *by_logit / left * (1.0 - kept);
        }
        *by_logit *= (1.0 - opacity) / left;
    });
}

#[cfg(test)]
mod tests {
    use super::super::tiny;
    use super::*;

    #[test]
    fn the_filter_is_as_wide_as_what_the_nearest_camera_samples() {
        let cameras = tiny::ring(6, 32);
        let sampling = Sampling::of(&cameras);
        let depth = |camera: &Camera| camera.camera_from_world.transform_point(glam::DVec3::ZERO).z / camera.fx;
        let nearest = cameras.iter().map(depth).fold(f64::INFINITY, f64::min);
        let found = sampling.deviations(&[[0.0; 3], [0.0, 0.0, 50.0]]);
        assert!((f64::from(found[0]) - 0.2f64.sqrt() * nearest).abs() < 1e-6, "{found:?} {nearest}");
        assert!(found[1].is_finite());
        assert_eq!(Sampling::of(&cameras[..1]).deviations(&[[30.0, 0.0, 0.6]]), [0.0], "behind the only camera");
    }

    #[test]
    fn derivatives_are_those_of_differences_and_no_filter_changes_nothing() {
        let cloud = tiny::cloud(40);
        let same = seen(&cloud, &[0.0; 40]);
        assert_eq!(same.log_scales, cloud.log_scales);
        let apart = same.opacity_logits.iter().zip(&cloud.opacity_logits).map(|(a, b)| (a - b).abs());
        assert!(apart.fold(0.0, f32::max) < 1e-4);
        let deviations: Vec<f32> = (0..40).map(|i| 0.01 * i as f32).collect();
        let weight = |i: usize, k: usize| ((7 * i + 3 * k) as f32).sin();
        let value = |cloud: &GaussianCloud, i: usize| {
            let out = seen(cloud, &deviations);
            let scales: f32 = (0..3).map(|k| weight(i, k) * out.log_scales[i][k]).sum();
            f64::from(scales + weight(i, 3) * out.opacity_logits[i])
        };
        let mut by = Gradients::zeros(&cloud, 0);
        for i in 0..40 {
            by.log_scales[i] = [0, 1, 2].map(|k| weight(i, k));
            by.opacity_logits[i] = weight(i, 3);
        }
        back(&cloud, &deviations, &mut by);
        let h = 1e-2;
        for i in 0..40 {
            for k in 0..4 {
                let moved = |h: f32| {
                    let mut cloud = cloud.clone();
                    let slot = if k < 3 { &mut cloud.log_scales[i][k] } else { &mut cloud.opacity_logits[i] };
                    *slot += h;
                    value(&cloud, i)
                };
                let expected = (moved(h) - moved(-h)) / f64::from(2.0 * h);
                let found = f64::from(if k < 3 { by.log_scales[i][k] } else { by.opacity_logits[i] });
                assert!((expected - found).abs() < 2e-3 * (1.0 + expected.abs()), "{i} {k}: {expected} {found}");
            }
        }
    }
}
