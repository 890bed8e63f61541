//! Which Gaussians may be seen by which view: a cheap test that never loses one.

use crate::Scene;
use crate::constants::{LOW_PASS, MIN_ALPHA, NEAR};
use crate::lens::Batch;
use rayon::prelude::*;

/// A Gaussian that a view may see.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "gpu", derive(bytemuck::Pod, bytemuck::Zeroable))]
pub struct Candidate {
    /// Index of the view.
    pub view: u32,
    /// Index of the Gaussian.
    pub splat: u32,
}

/// Gaussians that one task tests.
const BLOCK: usize = 8192;

/// The candidates, by view, then by Gaussian.
///
/// The projected variances are bounded by those of a sphere with the largest scale as its radius. A Gaussian with numbers that
/// are not finite fails no comparison and stays; the next stage counts it.
pub fn cull(scene: &Scene, batch: &Batch) -> Vec<Candidate> {
    let blocks = scene.cloud.len().div_ceil(BLOCK);
    let found: Vec<Vec<Candidate>> = (0..batch.lenses.len() * blocks)
        .into_par_iter()
        .map(|task| {
            let (view, first) = (task / blocks, task % blocks * BLOCK);
            let splats = first..(first + BLOCK).min(scene.cloud.len());
            let seen = splats.filter(|&splat| may_be_seen(scene, batch, view, splat));
            seen.map(|splat| Candidate { view: view as u32, splat: splat as u32 }).collect()
        })
        .collect();
    found.concat()
}

fn may_be_seen(scene: &Scene, batch: &Batch, view: usize, splat: usize) -> bool {
    let lens = &batch.lenses[view];
    let p = batch.motion(view, scene.group(splat)).transform(scene.cloud.means[splat]);
    if !scene.cloud.means[splat].iter().sum::<f32>().is_finite() {
        return true;
    }
    if p.z <= NEAR {
        return false;
    }
    let opacity = logistic(scene.cloud.opacity_logits[splat]);
    if opacity < MIN_ALPHA {
        return false;
    }
    let [a, b, c] = scene.cloud.log_scales[splat];
    let largest = a.max(b).max(c).exp();
    let square = (2.0 * (opacity / MIN_ALPHA).ln() + 0.01) * 1.01;
    for axis in 0..2 {
        let ratio = p[axis] / p.z;
        let slope = ratio.clamp(lens.lowest[axis], lens.highest[axis]);
        let stretch = lens.focal[axis] / p.z * largest;
        let reach = (square * (stretch * stretch * (1.0 + slope * slope) + LOW_PASS)).sqrt();
        let at = lens.focal[axis] * ratio + lens.centre[axis];
        if at + reach < 0.0 || at - reach > lens.size[axis] as f32 {
            return false;
        }
    }
    true
}

/// The logistic function.
pub(crate) fn logistic(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}
