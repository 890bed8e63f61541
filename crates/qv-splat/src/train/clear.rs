//! Free space before the cameras: nothing of the scene stands between a camera and the nearest points that were triangulated in its image.
//!
//! Floaters gather there, where only one photograph sees them, and hide the scene from every other place. With the clear space on, a
//! Gaussian in it counts as dead and moves to a living one.

use super::dataset::{Dataset, Photograph};
use super::mcmc::DEAD;
use glam::DVec3;
use rayon::prelude::*;

/// Share of the points in an image that may be nearer than what counts as the nearest: triangulated points have outliers.
const OUTLIERS: f64 = 0.01;
/// Fewest points in an image that say how near things are.
const FEWEST: usize = 50;

/// Depth \[m\] of the nearest of `points` in each training photograph; 0 where too few lie in it.
pub fn nearest(dataset: &Dataset, points: &[[f32; 3]]) -> Vec<f32> {
    let of = |photograph: &Photograph| {
        let depths = points.iter().filter_map(|p| depth_in(photograph, *p, 0.0));
        let mut depths: Vec<f32> = depths.collect();
        if depths.len() < FEWEST {
            return 0.0;
        }
        let at = (OUTLIERS * depths.len() as f64) as usize;
        *depths.select_nth_unstable_by(at, f32::total_cmp).1
    };
    dataset.training.par_iter().map(of).collect()
}

/// Opacity logits with those of Gaussians in the clear space below death: nearer to a camera that sees them than `share` of the nearest point
/// in its image. As they are when the share is 0 or nothing is known.
pub fn cleared(dataset: &Dataset, means: &[[f32; 3]], logits: &[f32], share: f32) -> Vec<f32> {
    let limits: Vec<(&Photograph, f32)> =
        dataset.training.iter().zip(&dataset.nearest).map(|(p, near)| (p, share * near)).collect();
    let stands_in = |mean: &[f32; 3]| {
        limits.iter().any(|(photograph, limit)| {
            *limit > 0.0 && depth_in(photograph, *mean, 0.1).is_some_and(|depth| depth < *limit)
        })
    };
    // A logit well below that of an opacity of 0.005.
    let dead = (DEAD / (1.0 - DEAD)).ln() - 5.0;
    let one = |(mean, logit): (&[f32; 3], &f32)| if stands_in(mean) { dead } else { *logit };
    means.par_iter().zip(logits).map(one).collect()
}

/// Depth of a point that lies in an image, or beside it by at most `margin` of its sides.
fn depth_in(photograph: &Photograph, point: [f32; 3], margin: f64) -> Option<f32> {
    let camera = &photograph.camera;
    let p = camera.camera_from_world.transform_point(DVec3::from(point.map(f64::from)));
    if p.z <= 0.0 {
        return None;
    }
    let (u, v) = (camera.fx * p.x / p.z + camera.cx, camera.fy * p.y / p.z + camera.cy);
    let within = |x: f64, side: u32| (-margin * f64::from(side)..(1.0 + margin) * f64::from(side)).contains(&x);
    (within(u, camera.width) && within(v, camera.height)).then_some(p.z as f32)
}

#[cfg(test)]
mod tests {
    use super::super::tiny;
    use super::*;

    #[test]
    fn what_stands_before_a_camera_is_dead_and_what_it_looks_at_is_not() {
        let mut dataset = tiny::scene(20, 4, 32).dataset;
        let photograph = &dataset.training[0];
        let at = |depth: f64| {
            let p = photograph.camera.camera_from_world.inverse().transform_point(DVec3::new(0.0, 0.0, depth));
            p.to_array().map(|x| x as f32)
        };
        let points: Vec<[f32; 3]> =
            (0..200).map(|k| at(if k == 0 { 0.01 } else { 2.0 + 0.01 * f64::from(k) })).collect();
        let (near, far, behind) = (at(0.5), at(1.5), at(-0.5));
        dataset.nearest = nearest(&dataset, &points);
        let first = dataset.nearest[0];
        assert!((2.0..2.1).contains(&first), "one outlier does not count: {first}");
        // Others may see these, too: only the first camera counts here.
        dataset.nearest[1..].fill(0.0);
        let found = cleared(&dataset, &[near, far, behind], &[1.0; 3], 0.5);
        assert!(found[0] < -9.0 && found[1..] == [1.0, 1.0], "{found:?}");
        assert_eq!(cleared(&dataset, &[near], &[1.0], 0.0), [1.0]);
        dataset.nearest.clear();
        assert_eq!(cleared(&dataset, &[near], &[1.0], 0.5), [1.0]);
        assert_eq!(nearest(&dataset, &points[..10])[0], 0.0);
    }
}
