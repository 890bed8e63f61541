//! Small motions of cameras.

use super::moments::moved;
use glam::{DQuat, DVec3};
use qv_core::Pose;

/// A step of Adam in the twist (v, w) on the left of `camera_from_world`; metres are in units of the extent. The running means are six each.
pub fn twist(first: &mut [f32], second: &mut [f32], by: &[f32; 6], rate: f32, extent: f32, bias: [f32; 2]) -> [f32; 6] {
    std::array::from_fn(|k| {
        let unit = if k < 3 { extent } else { 1.0 };
        let mut shift = 0.0;
        moved(&mut shift, &mut first[k], &mut second[k], by[k] * unit, rate, bias);
        shift * unit
    })
}

/// A pose after a small twist, to first order in the coupling of translation and rotation.
pub fn turned(camera_from_world: &Pose, twist: &[f32; 6]) -> Pose {
    let [x, y, z, a, b, c] = twist.map(f64::from);
    let shift = Pose { position: DVec3::new(x, y, z), rotation: DQuat::from_scaled_axis(DVec3::new(a, b, c)) };
    shift * *camera_from_world
}
