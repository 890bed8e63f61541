//! What is learned of cameras: a motion of each photograph, and one that all photographs of one camera share.
//!
//! A shared motion is the way from where poses were measured (a depth camera, a marker, a body) to the lens; held-out photographs, whose own
//! motions nobody knows, follow it. The photographs' own motions have a mean of zero in the world, or else the scene would
//! drift with them from the frame in which poses were given.

use super::dataset::{Dataset, Photograph};
use super::model::Model;
use super::moments::bias;
use super::options::TrainOptions;
pub use super::shared::{SharedAppearance, same_lens};
use super::twist::{turned, twist};
use glam::{DQuat, DVec3};
use qv_core::{Camera, Pose};

/// A held-out photograph with the motion that its camera was found to have.
pub fn as_learned(model: &Model, dataset: &Dataset, held_out: &Photograph) -> Photograph {
    let photograph = dataset.training.iter().position(|one| same_lens(&one.camera, &held_out.camera));
    let shared = photograph.map_or(&SharedAppearance::NONE, |index| &model.shared[model.groups[index]]);
    let camera_from_world = shared.motion * held_out.camera.camera_from_world;
    Photograph { camera: Camera { camera_from_world, ..held_out.camera }, ..held_out.clone() }
}

/// One step of Adam for the camera of a photograph, by the derivative by a twist on the left of its pose; it has been seen `seen` times, this one counted.
pub fn step(model: &mut Model, options: &TrainOptions, photograph: usize, by: &[f32; 6], extent: f32, seen: u32) {
    let rates = options.rates(model.iteration, extent);
    let group = model.groups[photograph];
    let shared = &mut model.shared[group];
    shared.seen += 1;
    let shared_bias = bias(shared.seen);
    let both = twist(&mut shared.first, &mut shared.second, by, rates.poses, extent, shared_bias);
    shared.motion = turned(&shared.motion, &both);
    let (first, second) = (&mut model.first.poses[photograph], &mut model.second.poses[photograph]);
    let own = twist(first, second, by, rates.poses, extent, bias(seen));
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
    use super::super::{CpuEngine, Engine, tiny, train};
    use super::*;

    /// Learns 8 photographs of a scene whose cameras `disturb` put wrong, and gives the model with the PSNR of a ninth as given and as learned.
    fn learned(options: &TrainOptions, disturb: &dyn Fn(&mut Camera)) -> (Model, [f64; 2]) {
        let mut scene = tiny::scene(120, 9, 56);
        scene.dataset.training.iter_mut().for_each(|one| disturb(&mut one.camera));
        let held_out = scene.dataset.training.remove(4);
        let mut options = TrainOptions { iterations: 900, noise: 0.0, refine_from: 10_000, ..*options };
        (options.weights.opacity, options.weights.scale) = (0.0, 0.0);
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
