//! Refinement of the photographs' poses.

use super::adam::{bias, moved};
use super::model::Model;
use glam::{DQuat, DVec3};
use qv_core::Pose;

/// Moves a pose by Adam in the twist (v, w) on the left of `camera_from_world`; metres are in units of the extent.
pub fn step(model: &mut Model, photograph: usize, by: &[f32; 6], rate: f32, extent: f32, seen: u32) {
    let bias = bias(seen);
    let (first, second) = (&mut model.first.poses[photograph], &mut model.second.poses[photograph]);
    let mut twist = [0.0f32; 6];
    for k in 0..6 {
        let unit = if k < 3 { extent } else { 1.0 };
        moved(&mut twist[k], &mut first[k], &mut second[k], by[k] * unit, rate, bias);
        twist[k] *= unit;
    }
    model.poses[photograph] = turned(&model.poses[photograph], &twist);
}

/// A pose after a small twist, to first order in the coupling of translation and rotation.
fn turned(camera_from_world: &Pose, twist: &[f32; 6]) -> Pose {
    let [x, y, z, a, b, c] = twist.map(f64::from);
    let shift = Pose { position: DVec3::new(x, y, z), rotation: DQuat::from_scaled_axis(DVec3::new(a, b, c)) };
    shift * *camera_from_world
}
