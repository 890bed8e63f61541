//! Adam (Kingma and Ba, 2015) with the constants of the 3DGS authors, and what else moves parameters in a step: regularisers and noise.

use super::exposure::Exposure;
use super::model::Model;
use super::moments::{bias, logistic, moved};
use super::options::{Rates, Strategy, TrainOptions};
use super::random::{Purpose, normals, words};
use glam::{Mat3, Quat, Vec3};
use qv_raster::Gradients;
use rayon::prelude::*;

fn all(values: &mut [f32], first: &mut [f32], second: &mut [f32], by: &[f32], rate: f32, bias: [f32; 2]) {
    let lists = (values, first, second, by).into_par_iter();
    lists.with_min_len(4096).for_each(|(value, first, second, by)| moved(value, first, second, *by, rate, bias));
}

/// Adds the derivatives of the regularisers of opacity, scale and flatness.
pub(crate) fn regularise(model: &Model, options: &TrainOptions, extent: f32, by: &mut Gradients) {
    let weights = &options.weights;
    let n = model.cloud.len().max(1) as f32;
    let mcmc = options.strategy == Strategy::Mcmc;
    let opacity = if mcmc { weights.opacity / n } else { 0.0 };
    let scale = if mcmc { weights.scale / (3.0 * n * extent) } else { 0.0 };
    let geometry = model.iteration >= options.geometry_from;
    let flat = if geometry { weights.flattening / (extent * n) } else { 0.0 };
    let harmonics = harmonics_weight(model.cloud.len(), model.poses.len(), options);
    let count = model.cloud.sh_count();
    for (at, (sh, by)) in model.cloud.sh.iter().zip(&mut by.sh).enumerate().filter(|_| harmonics > 0.0) {
        if at % count > 0 {
            (0..3).for_each(|c| by[c] += harmonics * sh[c]);
        }
    }
    for i in 0..model.cloud.len() {
        let o = logistic(model.cloud.opacity_logits[i]);
        by.opacity_logits[i] += opacity * o * (1.0 - o);
        let scales = model.cloud.log_scales[i].map(f32::exp);
        let shortest = (0..3).min_by(|&a, &b| scales[a].total_cmp(&scales[b])).unwrap_or(0);
        (0..3).for_each(|k| by.log_scales[i][k] += scale * scales[k]);
        by.log_scales[i][shortest] += flat * scales[shortest];
    }
}

/// What a harmonic but the constant one is multiplied by to be pulled to 0 in a step. All steps in which each of `photographs` is seen once add
/// up to the weight that was asked for, so that few photographs, which show little of how colours change with the direction, count less beside it.
pub fn harmonics_weight(splats: usize, photographs: usize, options: &TrainOptions) -> f32 {
    options.weights.harmonics / (splats.max(1) * photographs.max(1)) as f32
}

/// Moves all Gaussians; `model.iteration` is that of the step.
pub fn step(model: &mut Model, by: &Gradients, rates: &Rates) {
    let bias = bias(model.iteration + 1);
    let (cloud, first, second) = (&mut model.cloud, &mut model.first, &mut model.second);
    macro_rules! group {
        ($field:ident, $rate:expr) => {
            all(
                cloud.$field.as_flattened_mut(),
                first.$field.as_flattened_mut(),
                second.$field.as_flattened_mut(),
                by.$field.as_flattened(),
                $rate,
                bias,
            )
        };
    }
    group!(means, rates.means);
    group!(log_scales, rates.log_scales);
    group!(rotations, rates.rotations);
    let (logits, m, v) = (&mut cloud.opacity_logits, &mut first.opacity_logits, &mut second.opacity_logits);
    all(logits, m, v, &by.opacity_logits, rates.opacities, bias);
    all(&mut cloud.features, &mut first.features, &mut second.features, &by.features, rates.features, bias);
    let count = cloud.sh_count();
    let lists = (&mut cloud.sh, &mut first.sh, &mut second.sh, &by.sh).into_par_iter().enumerate();
    lists.with_min_len(4096).for_each(|(at, (sh, m, v, by))| {
        let rate = if at % count == 0 { rates.colours } else { rates.harmonics };
        (0..3).for_each(|c| moved(&mut sh[c], &mut m[c], &mut v[c], by[c], rate, bias));
    });
}

/// Moves the exposure of a photograph that has been seen so many times, this one counted. All exposures then move back together so
/// that their mean stays what it was: else a common factor could wander between them and the colours of the Gaussians.
pub(crate) fn step_exposure(model: &mut Model, photograph: usize, by: &Exposure, rate: f32, seen: u32) {
    let bias = bias(seen);
    for k in 0..12 {
        let (first, second) = (&mut model.exposures_first[photograph][k], &mut model.exposures_second[photograph][k]);
        let mut shift = 0.0;
        moved(&mut shift, first, second, by[k], rate, bias);
        model.exposures[photograph][k] += shift;
        let back = shift / model.exposures.len() as f32;
        model.exposures.iter_mut().for_each(|exposure| exposure[k] -= back);
    }
}

/// Noise on the means, large where opacity is small (Kheradmand et al., 2024, eq. 9): Σ η with a factor that is one half at opacity 0.005.
/// `rate` is in 1/m: Σ has the square of a length, of which one is taken away by the extent of the cameras, so that a scene in other units
/// is learned alike.
pub fn shake(model: &mut Model, rate: f32, seed: u32) {
    let iteration = model.iteration;
    let cloud = &mut model.cloud;
    let lists = (&mut cloud.means, &cloud.log_scales, &cloud.rotations, &cloud.opacity_logits).into_par_iter();
    lists.enumerate().with_min_len(1024).for_each(|(i, (mean, log_scales, rotation, logit))| {
        let share = logistic(100.0 * (1.0 - logistic(*logit) - 0.995)) * rate;
        let random = Vec3::from_array(normals(words(seed, iteration, i as u32, Purpose::Noise)));
        let [w, x, y, z] = *rotation;
        let axes = Mat3::from_quat(Quat::from_xyzw(x, y, z, w).normalize());
        let scales = Vec3::from_array(log_scales.map(f32::exp));
        let shift = axes * (scales * scales * (axes.transpose() * random)) * share;
        if shift.is_finite() {
            (0..3).for_each(|k| mean[k] += shift[k]);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_step_is_the_rate_and_a_valley_is_found() {
        let (mut value, mut m, mut v) = (3.0f32, 0.0, 0.0);
        moved(&mut value, &mut m, &mut v, 1e-6, 0.1, bias(1));
        assert!((value - 2.9).abs() < 1e-5, "{value}");
        for t in 2..400 {
            let by = 2.0 * (value - 1.0);
            moved(&mut value, &mut m, &mut v, by, 0.05, bias(t));
        }
        assert!((value - 1.0).abs() < 0.05, "{value}");
    }
}
