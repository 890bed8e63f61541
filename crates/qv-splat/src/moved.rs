//! A cloud in another frame.

use crate::harmonics::{FUNCTIONS, mixed, rotation};
use glam::{DMat3, DQuat, DVec3};
use qv_core::{GaussianCloud, Pose};

/// The cloud in a frame `new` whose lengths are `scale` times those of its own frame `old`: a point p goes to `new_from_old` (`scale` p).
/// It looks from a camera that is moved alike as it did before: Gaussians grow and turn, and so does what their colours have of directions.
pub fn moved(cloud: &GaussianCloud, scale: f64, new_from_old: &Pose) -> GaussianCloud {
    let turn = new_from_old.rotation.normalize();
    let matrix = rotation(DMat3::from_quat(turn));
    let (bands, longer) = (cloud.sh_count(), scale.ln() as f32);
    let mut out = cloud.clone();
    for mean in &mut out.means {
        let place = new_from_old.transform_point(scale * DVec3::from(mean.map(f64::from)));
        *mean = place.as_vec3().to_array();
    }
    out.log_scales.iter_mut().flatten().for_each(|length| *length += longer);
    for rotation in &mut out.rotations {
        let [w, x, y, z] = rotation.map(f64::from);
        let axes = turn * DQuat::from_xyzw(x, y, z, w);
        *rotation = [axes.w, axes.x, axes.y, axes.z].map(|q| q as f32);
    }
    // A matrix of an integral is exact to the last digit only.
    if bands > 1 && turn != DQuat::IDENTITY {
        for colours in out.sh.chunks_exact_mut(bands) {
            let mut all = [[0.0; 3]; FUNCTIONS];
            all[..bands].copy_from_slice(colours);
            colours.copy_from_slice(&mixed(&matrix, &all)[..bands]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_core::Camera;
    use qv_raster::{Scene, Settings, View, render};

    fn some() -> GaussianCloud {
        let wave = |k: usize, rate: f64| (rate * k as f64).sin() as f32;
        let n = 40;
        GaussianCloud {
            means: (0..n).map(|k| [wave(k, 1.1), wave(k, 2.3), 4.0 + wave(k, 3.7)]).collect(),
            log_scales: (0..n).map(|k| [-1.5 + 0.5 * wave(k, 0.7), -2.0, -3.0 + wave(k, 1.9)]).collect(),
            rotations: (0..n).map(|k| [1.0, wave(k, 0.3), wave(k, 0.9), wave(k, 1.3)]).collect(),
            opacity_logits: (0..n).map(|k| wave(k, 0.5)).collect(),
            sh_degree: 3,
            sh: (0..16 * n).map(|k| [0.4 * wave(k, 1.7), 0.4 * wave(k, 0.6), 0.4 * wave(k, 2.9)]).collect(),
            ..Default::default()
        }
    }

    fn picture(cloud: &GaussianCloud, camera_from_world: Pose) -> Vec<f32> {
        let camera = Camera { fx: 50.0, fy: 50.0, cx: 32.0, cy: 24.0, width: 64, height: 48, camera_from_world };
        render(&Scene::still(cloud), &[View::of(camera)], &Settings::default()).unwrap().0.remove(0).colour
    }

    #[test]
    fn from_a_camera_that_is_moved_alike_it_looks_as_before() {
        let (scale, new_from_old) = (1.7, Pose::from_xyz_rpy([3.0, -1.0, 2.0], [0.4, -0.7, 1.9]));
        let camera_from_old = Pose::from_xyz_rpy([0.1, -0.2, 0.3], [0.05, 0.1, 0.2]);
        let turned = camera_from_old.rotation * new_from_old.rotation.conjugate();
        let shift = scale * camera_from_old.position - turned * new_from_old.position;
        let before = picture(&some(), camera_from_old);
        let after = picture(&moved(&some(), scale, &new_from_old), Pose { position: shift, rotation: turned });
        let worst = before.iter().zip(&after).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 2e-4 && before.iter().any(|c| *c > 0.2), "{worst}");
        assert_eq!(moved(&some(), 1.0, &Pose::IDENTITY).sh, some().sh);
        // Turned without its harmonics it would not.
        let plain = GaussianCloud { sh: some().sh, ..moved(&some(), scale, &new_from_old) };
        let other = picture(&plain, Pose { position: shift, rotation: turned });
        assert!(before.iter().zip(&other).any(|(a, b)| (a - b).abs() > 0.05));
    }
}
