//! Depths that other frames confirm. Depth drawn from Gaussians has floaters: what one camera sees before its lens, others see through.
//!
//! The check is that of multi-view stereo (Merrell et al., *Real-Time Visibility-Based Fusion of Depth Maps*, 2007): a pixel's point is carried
//! over to other frames; there it is confirmed by a depth of nearly the same size, contradicted by a larger one, and hidden behind a
//! smaller one, which says nothing.

use crate::depth::DepthFrame;
use glam::DVec3;
use rayon::prelude::*;

/// How depths are checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AgreeOptions {
    /// Frames that must confirm a depth; 0 keeps all.
    pub least: usize,
    /// Depths agree when they differ by at most this \[m\],
    pub absolute: f64,
    /// or by this share of the depth.
    pub relative: f64,
    /// Frames that are asked: the nearest ones that look the same way.
    pub neighbours: usize,
}

/// Cosine of the largest angle between the axes of two frames that are compared.
const ALONG: f64 = 0.5;

/// Sets depths to 0 that too few other frames confirm, or more contradict than confirm. Returns the share that is kept.
pub fn keep_agreeing(frames: &mut [DepthFrame], options: &AgreeOptions) -> f64 {
    if options.least == 0 {
        return 1.0;
    }
    let kept: Vec<Vec<bool>> = (0..frames.len())
        .map(|index| {
            let others = neighbours(frames, index, options.neighbours);
            agreeing(&frames[index], &others, options)
        })
        .collect();
    let (mut before, mut after) = (0usize, 0usize);
    for (frame, kept) in frames.iter_mut().zip(kept) {
        for (depth, keep) in frame.depth.iter_mut().zip(kept) {
            before += usize::from(*depth > 0.0);
            after += usize::from(*depth > 0.0 && keep);
            if !keep {
                *depth = 0.0;
            }
        }
    }
    if before == 0 { 1.0 } else { after as f64 / before as f64 }
}

fn neighbours(frames: &[DepthFrame], index: usize, count: usize) -> Vec<&DepthFrame> {
    let place = |frame: &DepthFrame| frame.camera.camera_from_world.inverse().position;
    let axis = |frame: &DepthFrame| frame.camera.camera_from_world.inverse().transform_vector(DVec3::Z);
    let (here, ahead) = (place(&frames[index]), axis(&frames[index]));
    let mut near: Vec<(f64, usize)> = (0..frames.len())
        .filter(|other| *other != index && axis(&frames[*other]).dot(ahead) > ALONG)
        .map(|other| (place(&frames[other]).distance(here), other))
        .collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    near.into_iter().take(count).map(|(_, other)| &frames[other]).collect()
}

fn agreeing(frame: &DepthFrame, others: &[&DepthFrame], options: &AgreeOptions) -> Vec<bool> {
    let camera = &frame.camera;
    let world_from_camera = camera.camera_from_world.inverse();
    let width = camera.width as usize;
    (0..frame.depth.len())
        .into_par_iter()
        .map(|pixel| {
            let Some(depth) = frame.at(pixel, f32::INFINITY) else { return false };
            let (column, row) = ((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
            let ray = DVec3::new((column - camera.cx) / camera.fx, (row - camera.cy) / camera.fy, 1.0);
            let point = world_from_camera.transform_point(f64::from(depth) * ray);
            let (mut confirmed, mut contradicted) = (0, 0);
            for other in others {
                let Some((expected, seen)) = seen(other, point) else { continue };
                let tolerance = options.absolute.max(options.relative * expected);
                confirmed += usize::from((seen - expected).abs() <= tolerance);
                contradicted += usize::from(seen > expected + tolerance);
            }
            confirmed >= options.least && confirmed >= contradicted
        })
        .collect()
}

/// Depth of a point in a frame, and the depth that the frame has there; `None` where it has none.
pub(crate) fn seen(frame: &DepthFrame, point: DVec3) -> Option<(f64, f64)> {
    let camera = &frame.camera;
    let p = camera.camera_from_world.transform_point(point);
    if p.z <= 0.0 {
        return None;
    }
    let (u, v) = (camera.fx * p.x / p.z + camera.cx, camera.fy * p.y / p.z + camera.cy);
    if !(u >= 0.0 && v >= 0.0 && u < f64::from(camera.width) && v < f64::from(camera.height)) {
        return None;
    }
    let seen = frame.at(v as usize * camera.width as usize + u as usize, f32::INFINITY)?;
    Some((p.z, f64::from(seen)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_core::{Camera, Pose};

    /// Cameras in a row that look along z at a wall 2 m ahead.
    fn frames(count: usize) -> Vec<DepthFrame> {
        let one = |k: usize| {
            let camera_from_world = Pose { position: DVec3::new(-0.1 * k as f64, 0.0, 0.0), ..Pose::IDENTITY };
            let camera = Camera { fx: 20.0, fy: 20.0, cx: 10.0, cy: 8.0, width: 20, height: 16, camera_from_world };
            DepthFrame { camera, depth: vec![2.0; 320], weight: vec![] }
        };
        (0..count).map(one).collect()
    }

    const OPTIONS: AgreeOptions = AgreeOptions { least: 2, absolute: 0.04, relative: 0.01, neighbours: 8 };

    #[test]
    fn a_floater_of_one_frame_goes_and_the_wall_stays() {
        let mut all = frames(5);
        let middle = 8 * 20 + 10;
        all[2].depth[middle] = 0.7;
        let share = keep_agreeing(&mut all, &OPTIONS);
        assert_eq!(all[2].depth[middle], 0.0);
        // The frame in the middle sees nothing that others do not.
        let kept = all[2].depth.iter().filter(|depth| **depth == 2.0).count();
        assert!(kept == 319 && share > 0.9, "{kept} {share}");
    }

    #[test]
    fn what_is_hidden_is_not_contradicted_and_what_nobody_confirms_goes() {
        let mut all = frames(3);
        // A box that frames 1 and 2 see in front of the wall hides it, but frame 0 is confirmed by nobody then.
        all[1].depth.fill(1.0);
        all[2].depth.fill(1.0);
        keep_agreeing(&mut all, &OPTIONS);
        assert!(all[0].depth.iter().all(|depth| *depth == 0.0));
        let mut all = frames(1);
        assert_eq!(keep_agreeing(&mut all, &OPTIONS), 0.0);
        let mut all = frames(1);
        assert_eq!(keep_agreeing(&mut all, &AgreeOptions { least: 0, ..OPTIONS }), 1.0);
        assert_eq!(all[0].depth[0], 2.0);
    }
}
