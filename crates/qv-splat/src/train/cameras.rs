//! What is learned of cameras: a motion of each photograph, and a lens and a motion that all photographs of one camera share.
//!
//! A shared motion is the way from where poses were measured (a depth camera, a marker, a body) to the lens; held-out photographs, whose own
//! motions nobody knows, follow it and the lens. The photographs' own motions have a mean of zero in the world, or else the scene would
//! drift with them from the frame in which poses were given.

use super::dataset::{Dataset, Photograph};
use super::model::Model;
use super::moments::{bias, moved};
use super::options::TrainOptions;
pub use super::shared::{SharedAppearance, same_lens};
use super::twist::{turned, twist};
use super::vignetting::Vignetting;
use glam::{DQuat, DVec3};
use qv_core::{Camera, Pose};

/// A held-out photograph with the lens, its vignetting and the motion that its camera was found to have.
pub fn as_learned(model: &Model, dataset: &Dataset, held_out: &Photograph) -> Photograph {
    let photograph = dataset.training.iter().position(|one| same_lens(&one.camera, &held_out.camera));
    let shared = photograph.map_or(&SharedAppearance::NONE, |index| &model.shared[model.groups[index]]);
    let camera_from_world = shared.motion * held_out.camera.camera_from_world;
    let camera = Camera { camera_from_world, ..shared.camera(&held_out.camera) };
    Photograph { camera, vignetting: shared.vignetting, ..held_out.clone() }
}

/// Derivatives of the loss by the lens, from those by the drawn colours, both of shape `[height, width, 3]`: another focal length or
/// principal point is another place of each pixel in the same image, so that they follow from the slopes of the image.
pub fn by_lens(colour: &[f32], by_colour: &[f32], camera: &Camera) -> [f32; 3] {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let mut sum = [0.0f64; 3];
    for y in 0..height {
        let (above, below) = (y.saturating_sub(1), (y + 1).min(height - 1));
        for x in 0..width {
            let (left, right) = (x.saturating_sub(1), (x + 1).min(width - 1));
            let slope = |from: usize, to: usize, steps: usize| -> f64 {
                let of = |c: usize| by_colour[3 * (y * width + x) + c] * (colour[3 * to + c] - colour[3 * from + c]);
                (0..3).map(of).sum::<f32>() as f64 / steps.max(1) as f64
            };
            let along_x = slope(y * width + left, y * width + right, right - left);
            let along_y = slope(above * width + x, below * width + x, below - above);
            sum[0] -= along_x * (x as f64 + 0.5 - camera.cx) + along_y * (y as f64 + 0.5 - camera.cy);
            sum[1] -= along_x * camera.fx;
            sum[2] -= along_y * camera.fy;
        }
    }
    sum.map(|x| x as f32)
}

/// Derivatives of the loss by the camera of a photograph.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ByCamera {
    /// By a twist on the left of its pose.
    pub pose: [f32; 6],
    /// By the lens, as [`by_lens`] gives them.
    pub lens: [f32; 3],
    /// By the lens's vignetting.
    pub vignetting: Vignetting,
}

/// One step of Adam for the camera of a photograph, that has been seen `seen` times, this one counted.
pub fn step(model: &mut Model, options: &TrainOptions, photograph: usize, by: &ByCamera, extent: f32, seen: u32) {
    let rates = options.rates(model.iteration, extent);
    let group = model.groups[photograph];
    let shared = &mut model.shared[group];
    shared.seen += 1;
    let shared_bias = bias(shared.seen);
    if options.lens {
        let (first, second) = (&mut shared.first, &mut shared.second);
        for (k, value) in shared.lens.iter_mut().enumerate() {
            moved(value, &mut first[6 + k], &mut second[6 + k], by.lens[k], rates.lens, shared_bias);
        }
    }
    if options.vignetting {
        let (first, second) = (&mut shared.first, &mut shared.second);
        for (k, value) in shared.vignetting.iter_mut().enumerate() {
            let pull = 2.0 * options.weights.vignetting * *value;
            let by = by.vignetting[k] + pull;
            moved(value, &mut first[9 + k], &mut second[9 + k], by, rates.vignetting, shared_bias);
        }
    }
    if !options.poses {
        return;
    }
    let both = twist(&mut shared.first[..6], &mut shared.second[..6], &by.pose, rates.poses, extent, shared_bias);
    shared.motion = turned(&shared.motion, &both);
    let (first, second) = (&mut model.first.poses[photograph], &mut model.second.poses[photograph]);
    let own = twist(first, second, &by.pose, rates.poses, extent, bias(seen));
    let back = in_world(&model.poses[photograph], &own).map(|x| -x / model.poses.len() as f64);
    model.poses[photograph] = turned(&model.poses[photograph], &own);
    for (pose, of) in model.poses.iter_mut().zip(&model.groups) {
        if *of == group {
            *pose = turned(pose, &both);
        }
        *pose = *pose * small(&back);
    }
}

/// A small twist of a camera as one of the world before it.
fn in_world(camera_from_world: &Pose, twist: &[f32; 6]) -> [f64; 6] {
    let [x, y, z, a, b, c] = twist.map(f64::from);
    let (v, w) = (DVec3::new(x, y, z), DVec3::new(a, b, c));
    let back = camera_from_world.rotation.inverse();
    let (v, w) = (back * (v + w.cross(camera_from_world.position)), back * w);
    [v.x, v.y, v.z, w.x, w.y, w.z]
}

/// The pose of a small twist.
fn small(twist: &[f64; 6]) -> Pose {
    let [x, y, z, a, b, c] = *twist;
    Pose { position: DVec3::new(x, y, z), rotation: DQuat::from_scaled_axis(DVec3::new(a, b, c)) }
}

#[cfg(test)]
mod tests {
    use super::super::loss::photometric;
    use super::super::{CpuEngine, Engine, Strategy, drawn, tiny, train};
    use super::*;

    #[test]
    fn derivatives_by_the_lens_are_differences_of_the_loss() {
        let scene = tiny::scene(60, 4, 64);
        let wanted = &scene.dataset.training[1];
        let (colour, valid) = (wanted.colour(), wanted.valid());
        let off = SharedAppearance { lens: [0.02, 0.006, -0.004], ..SharedAppearance::NONE };
        let loss = |shared: &SharedAppearance| {
            let camera = shared.camera(&wanted.camera);
            let image = drawn(&scene.cloud, &camera, &scene.dataset).unwrap();
            let (loss, by) = photometric(&image.colour, &colour, &valid, 64, 0.2);
            (loss, by_lens(&image.colour, &by, &camera))
        };
        let found = loss(&off).1;
        for k in 0..3 {
            let at = |step: f32| {
                let mut moved = off;
                moved.lens[k] += step;
                loss(&moved).0
            };
            let expected = (at(2e-3) - at(-2e-3)) / 4e-3;
            assert!((found[k] - expected).abs() < 0.1 * expected.abs() + 0.02, "{k}: {} {expected}", found[k]);
        }
    }

    /// Learns 8 photographs of a scene whose cameras `disturb` put wrong, and gives the model with the PSNR of a ninth as given and as learned.
    fn learned(options: &TrainOptions, disturb: &dyn Fn(&mut Camera)) -> (Model, [f64; 2]) {
        let mut scene = tiny::scene(120, 9, 56);
        scene.dataset.training.iter_mut().for_each(|one| disturb(&mut one.camera));
        let held_out = scene.dataset.training.remove(4);
        let strategy = Strategy::Classic;
        let options = TrainOptions { iterations: 900, strategy, refine_from: 10_000, ..*options };
        let model = Model::new(scene.cloud.clone(), &scene.dataset);
        let mut engine = CpuEngine::new(&scene.dataset, &options, model).unwrap();
        assert_eq!(train(&mut engine, 8, 900, 1, 100, &mut |_, _| Ok(true)), Ok(true));
        let model = engine.model().unwrap();
        assert_eq!((model.shared.len(), model.shared[0].seen), (1, 900));
        let psnr = |one: &Photograph| {
            crate::train::scores(&model.cloud, std::slice::from_ref(one), &scene.dataset).unwrap()[0].psnr
        };
        let both = [psnr(&held_out), psnr(&as_learned(&model, &scene.dataset, &held_out))];
        (model, both)
    }

    #[test]
    fn a_lens_that_is_off_is_found() {
        let options = TrainOptions { lens: true, ..Default::default() };
        let (model, [given, found]) = learned(&options, &|camera| {
            camera.fx *= 0.96;
            camera.fy *= 0.96;
            camera.cx += 1.0;
        });
        let [zoom, x, _] = model.shared[0].lens;
        // Gaussians that move in depth do nearly the same in 900 steps: most of it is found.
        assert!((zoom.exp() * 0.96 - 1.0).abs() < 0.02, "{zoom}");
        assert!((x * 0.96 * 1.1 * 56.0 + 1.0).abs() < 0.3, "{x}");
        assert!(found > given + 3.0, "{given} {found}");
    }

    #[test]
    fn a_mounting_that_is_off_is_found() {
        let mounting = small(&[0.03, -0.02, 0.0, 0.0, 0.0, 0.02]);
        let options = TrainOptions { poses: true, ..Default::default() };
        let (model, [given, found]) =
            learned(&options, &|camera| camera.camera_from_world = mounting.inverse() * camera.camera_from_world);
        let left = model.shared[0].motion * mounting.inverse();
        // A turn about an axis across the view does nearly what a shift does; about the view it does not.
        assert!(left.position.length() < 0.7 * mounting.position.length(), "{left:?}");
        assert!(left.rotation.to_scaled_axis().z.abs() < 0.2 * 0.02, "{left:?}");
        assert!(found > given + 3.0, "{given} {found}");
    }

    #[test]
    fn own_motions_have_no_mean_and_groups_are_of_lenses() {
        let mut scene = tiny::scene(30, 5, 24);
        scene.dataset.training[3].camera.fx *= 1.1;
        let mut model = Model::new(scene.cloud.clone(), &scene.dataset);
        assert_eq!((&model.groups[..], model.shared.len()), (&[0, 0, 0, 1, 0][..], 2));
        let options = TrainOptions { poses: true, ..Default::default() };
        let given = model.poses.clone();
        for k in 0..40 {
            let by = [1.0, -2.0, 0.5, 0.3, 0.1, -0.7].map(|x: f32| x * ((k * k) as f32 + x).sin());
            let by = ByCamera { pose: by, ..Default::default() };
            step(&mut model, &options, k % 5, &by, 3.0, k as u32 / 5 + 1);
        }
        let mut mean = DVec3::ZERO;
        for ((pose, given), group) in model.poses.iter().zip(&given).zip(&model.groups) {
            let own = (model.shared[*group].motion * *given).inverse() * *pose;
            assert!(own.position.length() > 1e-4);
            mean += own.position / 5.0;
        }
        assert!(mean.length() < 2e-5, "{mean}");
    }
}
