//! Motions of cameras by derivatives: steps, and the place of a photograph that was held out.

use super::dataset::{Dataset, Photograph};
use super::loss::photometric;
use super::moments::bias;
use super::twist::{turned, twist};
use crate::SplatError;
use qv_core::{Camera, GaussianCloud};
use qv_raster::{Frame, Outputs, Scene, View};

/// The camera of a photograph that was held out, moved to where a scene shows the left half of the photograph best, by `steps` steps of Adam
/// in the twist. Where the poses of the others were refined, the frame of the scene has moved with them, and a held-out pose as it came
/// is no longer right. The right half takes no part.
///
/// # Errors
/// Drawing fails.
pub fn aligned(
    cloud: &GaussianCloud,
    photograph: &Photograph,
    dataset: &Dataset,
    steps: u32,
) -> Result<Camera, SplatError> {
    let (wanted, mut valid) = (photograph.colour(), photograph.valid());
    let width = photograph.pixels.width;
    (0..valid.len()).filter(|pixel| pixel % width >= width / 2).for_each(|pixel| valid[pixel] = false);
    let mut camera = photograph.camera;
    let (mut first, mut second) = ([0.0f32; 6], [0.0f32; 6]);
    let filtered = dataset.filtered(cloud);
    let scene = Scene::still(&filtered);
    let settings = dataset.settings(Outputs::default());
    for iteration in 0..steps {
        let frame = Frame::new(&scene, &[View::of(camera)], &settings)?;
        let mut by = frame.blank_images();
        let drawn = frame.images().remove(0).colour;
        by[0].colour = photometric(&drawn, &wanted, &valid, width, 0.2).1;
        let by_pose = frame.gradients(&scene, &by)?.poses[0];
        let rate = ALIGNING * 0.1f32.powf(iteration as f32 / steps as f32);
        let twist = twist(&mut first, &mut second, &by_pose, rate, dataset.extent, bias(iteration + 1));
        camera.camera_from_world = turned(&camera.camera_from_world, &twist);
    }
    Ok(camera)
}

/// Rate of [`aligned`], in units of the extent and in radians.
const ALIGNING: f32 = 1e-3;

#[cfg(test)]
mod tests {
    use super::super::tiny;
    use super::*;
    use qv_core::Pose;

    #[test]
    fn a_camera_is_found_again_from_half_of_its_photograph() {
        let scene = tiny::scene(60, 6, 64);
        let mut photograph = scene.dataset.training[2].clone();
        let right = photograph.camera.camera_from_world;
        photograph.camera.camera_from_world = turned(&right, &[0.01, -0.01, 0.02, 0.004, -0.003, 0.006]);
        let apart =
            |pose: &Pose| pose.position.distance(right.position) + 3.0 * pose.rotation.angle_between(right.rotation);
        let before = apart(&photograph.camera.camera_from_world);
        let found = aligned(&scene.cloud, &photograph, &scene.dataset, 80).unwrap();
        assert!(apart(&found.camera_from_world) < 0.3 * before, "{} {before}", apart(&found.camera_from_world));
    }
}
