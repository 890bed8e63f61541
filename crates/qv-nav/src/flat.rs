//! Flat Gaussians, of which objects are made.

use glam::{DMat3, DQuat, DVec3};
use qv_core::GaussianCloud;

/// The first harmonic: 1 / (2 sqrt(pi)).
pub(crate) const FIRST: f32 = 0.282_094_79;

/// Adds a flat Gaussian at a place \[m\], lit from one side: the way across and the outward normal of its surface, logarithms of its scales, and its
/// linear colour.
pub(crate) fn add_flat(
    cloud: &mut GaussianCloud,
    place: DVec3,
    [across, normal]: [DVec3; 2],
    log_scales: [f32; 3],
    linear: [f64; 3],
) {
    let turn = DQuat::from_mat3(&DMat3::from_cols(across, normal.cross(across), normal));
    let light = 0.4 + 0.2 * normal.z + 0.7 * normal.dot(DVec3::new(0.57, 0.0, 0.82)).max(0.0);
    let shown = linear.map(|c| (c * light).clamp(0.0, 1.0).powf(1.0 / 2.2));
    cloud.means.push(place.as_vec3().to_array());
    cloud.log_scales.push(log_scales);
    cloud.rotations.push([turn.w, turn.x, turn.y, turn.z].map(|q| q as f32));
    cloud.opacity_logits.push(4.0);
    cloud.sh.push(shown.map(|c| (c as f32 - 0.5) / FIRST));
    cloud.sh.extend(std::iter::repeat_n([0.0; 3], cloud.sh_count() - 1));
    cloud.features.extend(std::iter::repeat_n(0.0, cloud.feature_count));
}
