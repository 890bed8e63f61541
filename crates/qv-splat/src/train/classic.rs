//! Gaussians that come and go as in Kerbl et al., *3D Gaussian Splatting* (2023), section 5.2, with the constants of gsplat 1.5.3.

use super::model::Model;
use super::moments::logistic;
use super::random::{Purpose, normals, words};
use glam::{Mat3, Quat, Vec3};

/// Mean length of the derivative by the projected mean, in units of half the image, from which on a Gaussian is cloned or split.
const PULL: f32 = 2e-4;
/// Largest scale of one that is cloned, in units of the extent.
const SMALL: f32 = 0.01;
/// Largest scale that stays, in units of the extent, once opacities have been reset.
const LARGE: f32 = 0.1;
/// Opacity below which a Gaussian goes.
const FAINT: f32 = 0.005;
/// Scales of the halves of a split Gaussian are divided by this.
const SHRINK: f32 = 1.6;
/// Opacity that a reset leaves at most.
const RESET: f32 = 0.01;

/// Clones, splits and prunes.
pub fn refine(model: &mut Model, extent: f32, cap: usize, seed: u32) {
    let n = model.cloud.len();
    let pull = |i: usize| model.pulls[i][0] / model.pulls[i][1].max(1.0);
    let mut pulled: Vec<usize> = (0..n).filter(|&i| pull(i) > PULL).collect();
    // The strongest first when there is no room for all.
    pulled.sort_by(|&a, &b| pull(b).total_cmp(&pull(a)).then(a.cmp(&b)));
    pulled.truncate(cap.saturating_sub(n));
    pulled.sort_unstable();
    for source in pulled {
        let target = model.cloud.len();
        model.copy(target, source);
        if largest(model, source) > SMALL * extent {
            [source, target].into_iter().for_each(|half| split(model, half, seed));
        }
    }
    let grown = model.iteration > 3000;
    let stay: Vec<bool> = (0..model.cloud.len())
        .map(|i| logistic(model.cloud.opacity_logits[i]) >= FAINT && !(grown && largest(model, i) > LARGE * extent))
        .collect();
    // One that is left is still a scene.
    if stay.iter().any(|stays| *stays) {
        model.retain(&stay);
    }
    model.pulls.iter_mut().for_each(|pull| *pull = [0.0; 2]);
}

fn largest(model: &Model, index: usize) -> f32 {
    model.cloud.log_scales[index].iter().fold(f32::MIN, |most, scale| most.max(*scale)).exp()
}

/// Moves a Gaussian to a random place within itself and makes it smaller.
fn split(model: &mut Model, index: usize, seed: u32) {
    let random = Vec3::from_array(normals(words(seed, model.iteration, index as u32, Purpose::Split)));
    let [w, x, y, z] = model.cloud.rotations[index];
    let axes = Mat3::from_quat(Quat::from_xyzw(x, y, z, w).normalize());
    let scales = Vec3::from_array(model.cloud.log_scales[index].map(f32::exp));
    let shift = axes * (scales * random);
    (0..3).for_each(|k| model.cloud.means[index][k] += shift[k]);
    model.cloud.log_scales[index].iter_mut().for_each(|scale| *scale -= SHRINK.ln());
    model.forget(index);
}

/// Cuts opacities down, so that those that are not needed stay low.
pub fn reset(model: &mut Model) {
    let most = (RESET / (1.0 - RESET)).ln();
    model.cloud.opacity_logits.iter_mut().for_each(|logit| *logit = logit.min(most));
    model.first.opacity_logits.fill(0.0);
    model.second.opacity_logits.fill(0.0);
}

#[cfg(test)]
mod tests {
    use super::super::tiny;
    use super::*;

    #[test]
    fn the_pulled_come_twice_and_the_faint_go() {
        let scene = tiny::scene(6, 3, 16);
        let mut model = Model::new(scene.cloud, &scene.dataset);
        model.cloud.log_scales = vec![[-3.0; 3]; 6];
        model.cloud.log_scales[0] = [-9.0; 3];
        model.pulls = vec![[1.0, 1.0], [0.5, 1.0], [0.0, 1.0], [0.0, 9.0], [0.0, 0.0], [0.0, 1.0]];
        model.cloud.opacity_logits[5] = -9.0;
        let before = model.clone();
        refine(&mut model, 1.0, 100, 3);
        assert_eq!((model.cloud.len(), model.cloud.check()), (7, Ok(())));
        assert_eq!(model.cloud.means[0], before.cloud.means[0], "cloned");
        assert_ne!(model.cloud.means[1], before.cloud.means[1], "split");
        assert!((model.cloud.log_scales[1][0] + 3.0 + 1.6f32.ln()).abs() < 1e-6);
        assert_eq!(model.first.means.len(), 7);
        let mut full = before;
        refine(&mut full, 1.0, 6, 3);
        assert_eq!(full.cloud.len(), 5, "no room but for one that went");
        reset(&mut model);
        assert!(model.cloud.opacity_logits.iter().all(|logit| logistic(*logit) < 0.0101));
    }
}
