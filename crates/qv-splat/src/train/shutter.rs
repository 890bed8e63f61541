//! Motion blur and rolling shutter: each photograph has, beside its pose, how its camera moved while the shutter was open.
//!
//! The motion is a twist m (camera axes, translation \[m\] first, then rotation \[rad\]) over the whole span from the first row's beginning to the
//! last row's end: `pose(t) = exp(t m) pose`, t from -1/2 to 1/2 of readout and exposure together. It is a spline of one linear piece, as in
//! Zhao et al., *BAD-Gaussians* (ECCV 2024), and a constant velocity as in Seiskari et al., *Gaussian Splatting on the Move* (ECCV 2024). A row
//! is the mean, in linear light, over its exposure; where the shutter rolls, that window moves down the image. The scene is drawn from a few
//! poses, between which colours are taken as linear in time, so that each has a weight in each row (`weights`).
//!
//! A motion that is 0 has no derivative where all rows are exposed together: the blur of m is that of -m. So motions begin at random, half a pixel long.

use super::dataset::{Dataset, Photograph};
use super::drawn::{DEPTH, drawn_with};
use super::loss::photometric;
use super::model::Model;
use super::moments::bias;
use super::motion::{Motion, Shutter};
use super::pose::ALIGNING;
use super::random::{Purpose, normals, words};
use super::score::{Score, score};
use super::twist::{turned, twist};
use super::vignetting::{self, vignetted};
use crate::SplatError;
use glam::{DVec2, DVec3};
use qv_core::{Camera, GaussianCloud};
use qv_raster::{Frame, Outputs, Scene, View, render};

/// Length of a motion to begin with \[px\].
const BEGIN: f32 = 0.5;
/// Rate of [`fitted`] \[px\].
const FITTING: f32 = 1.0;

/// Motions of photographs that have none yet: a turn of half a pixel, in a direction by chance.
pub fn begin(model: &mut Model, dataset: &Dataset, seed: u32) {
    for (k, (motion, one)) in model.motions.iter_mut().zip(&dataset.training).enumerate() {
        if *motion == [0.0; 6] {
            *motion = beginning(&one.camera, seed, k as u32);
        }
    }
}

fn beginning(camera: &Camera, seed: u32, index: u32) -> Motion {
    let random = normals(words(seed, 0, index, Purpose::Shutter));
    let length = random.iter().map(|x| x * x).sum::<f32>().sqrt().max(1e-6);
    let turn = random.map(|x| BEGIN / camera.fx as f32 * x / length);
    [0.0, 0.0, 0.0, turn[0], turn[1], turn[2]]
}

/// One step of Adam for the motion of a photograph that has been seen `seen` times, this one counted; `rate` in pixels.
pub fn step(model: &mut Model, photograph: usize, by: &Motion, rate: f32, dataset: &Dataset, seen: u32) {
    let rate = rate / dataset.training[photograph].camera.fx as f32;
    let (first, second) = (&mut model.motions_first[photograph], &mut model.motions_second[photograph]);
    let shift = twist(first, second, by, rate, dataset.extent, bias(seen));
    (0..6).for_each(|k| model.motions[photograph][k] += shift[k]);
}

/// How the camera of a photograph that was held out moved, and where it was, by `steps` steps of Adam on the left half of the photograph. With
/// `poses` its pose moves, too, as in [`super::pose::aligned`]. The right half takes no part.
///
/// # Errors
/// Drawing fails.
pub fn fitted(
    cloud: &GaussianCloud,
    photograph: &Photograph,
    dataset: &Dataset,
    shutter: &Shutter,
    poses: bool,
    steps: u32,
) -> Result<(Camera, Motion), SplatError> {
    let (wanted, mut valid) = (photograph.colour(), photograph.valid());
    let width = photograph.pixels.width;
    (0..valid.len()).filter(|pixel| pixel % width >= width / 2).for_each(|pixel| valid[pixel] = false);
    let (mut camera, mut motion) = (photograph.camera, beginning(&photograph.camera, 0, 0));
    let mut moments = [[0.0f32; 6]; 4];
    let filtered = dataset.filtered(cloud);
    let (scene, settings) = (Scene::still(&filtered), dataset.settings(Outputs::default()));
    for iteration in 0..steps {
        let views: Vec<View> = shutter.cameras(&camera, &motion).into_iter().map(View::of).collect();
        let frame = Frame::new(&scene, &views, &settings)?;
        let (images, mut by_images) = (frame.images(), frame.blank_images());
        let colour = shutter.exposed(&images);
        let seen = vignetted(photograph.vignetting, &photograph.camera, &colour);
        let mut by = photometric(&seen, &wanted, &valid, width, 0.2).1;
        vignetting::back(photograph.vignetting, &photograph.camera, &colour, &mut by);
        shutter.back(&images, &colour, &by, &mut by_images);
        let [by_pose, by_motion] = shutter.by_pose_and_motion(&motion, &frame.gradients(&scene, &by_images)?.poses);
        let fall = 0.1f32.powf(iteration as f32 / steps as f32);
        let [a, b, c, d] = &mut moments;
        let rate = FITTING * fall / camera.fx as f32;
        let shift = twist(a, b, &by_motion, rate, dataset.extent, bias(iteration + 1));
        (0..6).for_each(|k| motion[k] += shift[k]);
        if poses {
            let shift = twist(c, d, &by_pose, ALIGNING * fall, dataset.extent, bias(iteration + 1));
            camera.camera_from_world = turned(&camera.camera_from_world, &shift);
        }
    }
    Ok((camera, motion))
}

/// Scores of photographs that were held out as moving cameras take them, each with the motion that [`fitted`] finds on its left half: only
/// right halves are honest. None where cameras are taken to be at rest.
///
/// # Errors
/// Drawing fails.
pub fn fitted_scores(
    cloud: &GaussianCloud,
    held_out: &[Photograph],
    dataset: &Dataset,
    poses: bool,
    steps: u32,
) -> Result<Vec<Score>, SplatError> {
    let Some(shutter) = &dataset.shutter else { return Ok(vec![]) };
    let filtered = dataset.filtered(cloud);
    let one = |photograph: &Photograph| {
        let (camera, motion) = fitted(cloud, photograph, dataset, shutter, poses, steps)?;
        let colour = shutter.drawn(&filtered, &camera, &motion, dataset)?;
        Ok(score(&vignetted(photograph.vignetting, &photograph.camera, &colour), photograph))
    };
    held_out.iter().map(one).collect()
}

/// Mean length \[px\] of the way that what a photograph shows goes in it during a motion; none where little is drawn.
///
/// # Errors
/// Drawing fails.
pub fn length(
    cloud: &GaussianCloud,
    camera: &Camera,
    motion: &Motion,
    dataset: &Dataset,
) -> Result<Option<f64>, SplatError> {
    let image = drawn_with(cloud, camera, dataset, DEPTH)?;
    let from = Camera { camera_from_world: turned(&camera.camera_from_world, &motion.map(|x| -0.5 * x)), ..*camera };
    let to = Camera { camera_from_world: turned(&camera.camera_from_world, &motion.map(|x| 0.5 * x)), ..*camera };
    let in_image = |camera: &Camera, point: DVec3| {
        let p = camera.camera_from_world.transform_point(point);
        (p.z > 0.0).then(|| DVec2::new(camera.fx * p.x / p.z, camera.fy * p.y / p.z))
    };
    let way = |pixel: usize| {
        let (point, _) = super::ground::point_of(&image, camera, pixel)?;
        Some(in_image(&from, point)?.distance(in_image(&to, point)?))
    };
    let ways: Vec<f64> = (0..image.alpha.len()).step_by(7).filter_map(way).collect();
    Ok((!ways.is_empty()).then(|| ways.iter().sum::<f64>() / ways.len() as f64))
}

impl Shutter {
    /// A photograph as a moving camera takes it, shape `[height, width, 3]`. The cloud is filtered already.
    pub(super) fn drawn(
        &self,
        filtered: &GaussianCloud,
        camera: &Camera,
        motion: &Motion,
        dataset: &Dataset,
    ) -> Result<Vec<f32>, SplatError> {
        let views: Vec<View> = self.cameras(camera, motion).into_iter().map(View::of).collect();
        let (images, _) = render(&Scene::still(filtered), &views, &dataset.settings(Outputs::default()))?;
        Ok(self.exposed(&images))
    }
}

#[cfg(test)]
mod tests {
    use super::super::undistort::Pixels;
    use super::super::{CpuEngine, Strategy, TrainOptions, scores, tiny, train};
    use super::*;
    use crate::facts::States;

    #[test]
    fn rows_sum_up_to_one_around_their_own_time() {
        let all_together = Shutter::default().weights(4);
        assert!(all_together.iter().all(|row| *row == [0.125, 0.25, 0.25, 0.25, 0.125]), "{all_together:?}");
        for readout in [0.0, 0.3, 0.999, 1.0] {
            let shutter = Shutter { samples: 7, readout, gamma: 1.0 };
            for (y, row) in shutter.weights(10).iter().enumerate() {
                let centre = f64::from(readout) * ((y as f64 + 0.5) / 10.0 - 0.5);
                let mean: f64 = row.iter().zip(shutter.times()).map(|(w, t)| f64::from(*w) * t).sum();
                assert!((row.iter().sum::<f32>() - 1.0).abs() < 1e-5, "{readout} {y}: {row:?}");
                assert!((mean - centre).abs() < 1e-5 && row.iter().all(|w| *w > -1e-6), "{readout} {y}: {row:?}");
            }
        }
        let off = |shutter: Shutter| shutter.check().unwrap_err().to_string();
        assert!(off(Shutter { samples: 4, ..Default::default() }).states("samples 3 31"));
        assert!(off(Shutter { readout: f32::NAN, ..Default::default() }).contains("readout"));
        assert!(off(Shutter { gamma: 0.5, ..Default::default() }).contains("gamma"));
    }

    #[test]
    fn derivatives_are_differences_of_the_loss() {
        let scene = tiny::scene(60, 4, 48);
        let one = &scene.dataset.training[1];
        // Brighter than all that is drawn: where colours are equal the loss has a bend.
        let wanted: Vec<f32> = one.colour().iter().map(|c| c + 1.0).collect();
        let valid = one.valid();
        let settings = scene.dataset.settings(Outputs::default());
        for (readout, gamma) in [(0.0, 1.0), (0.4, 2.2), (1.0, 2.2)] {
            let shutter = Shutter { readout, gamma, ..Default::default() };
            let motion: Motion = [0.02, -0.03, 0.05, 0.04, -0.05, 0.06];
            let look = |camera: &Camera, motion: &Motion| {
                let views: Vec<View> = shutter.cameras(camera, motion).into_iter().map(View::of).collect();
                let still = Scene::still(&scene.cloud);
                let frame = Frame::new(&still, &views, &settings).unwrap();
                let (images, mut by_images) = (frame.images(), frame.blank_images());
                let colour = shutter.exposed(&images);
                let (loss, by) = photometric(&colour, &wanted, &valid, 48, 0.2);
                shutter.back(&images, &colour, &by, &mut by_images);
                let poses = frame.gradients(&still, &by_images).unwrap().poses;
                (f64::from(loss), shutter.by_pose_and_motion(motion, &poses))
            };
            let [by_pose, by_motion] = look(&one.camera, &motion).1;
            let h = 2e-3;
            for k in 0..6 {
                let by_step = |of: &dyn Fn(f32) -> (Camera, Motion)| {
                    let [plus, minus] = [h, -h].map(of).map(|(camera, motion)| look(&camera, &motion).0);
                    ((plus - minus) / f64::from(2.0 * h)) as f32
                };
                let moved = |h: f32| {
                    let mut moved = motion;
                    moved[k] += h;
                    (one.camera, moved)
                };
                let turning = |h: f32| {
                    let mut step = [0.0; 6];
                    step[k] = h;
                    (Camera { camera_from_world: turned(&one.camera.camera_from_world, &step), ..one.camera }, motion)
                };
                for (by, expected) in [(&by_motion, by_step(&moved)), (&by_pose, by_step(&turning))] {
                    let largest = by.iter().fold(0.0f32, |most, x| most.max(x.abs()));
                    let apart = (by[k] - expected).abs();
                    assert!(apart < 0.06 * expected.abs() + 0.03 * largest, "{readout} {k}: {by:?} {expected}");
                }
            }
        }
    }

    /// Photographs of a scene, of which every third is held out, as cameras that move take them; those held out are sharp. With the true motions.
    fn shaken(readout: f32, pixels: f32) -> (tiny::Tiny, Vec<Motion>) {
        let sharp = tiny::scene(60, 12, 56);
        let many = Shutter { samples: 31, readout, gamma: 2.2 };
        let (mut motions, mut all) = (vec![], sharp.dataset.training.clone());
        for (k, one) in all.iter_mut().enumerate().filter(|(k, _)| k % 3 != 0) {
            let random = normals(words(5, 0, k as u32, Purpose::Noise));
            let length = random.iter().map(|x| x * x).sum::<f32>().sqrt();
            let turn = random.map(|x| pixels / one.camera.fx as f32 * x / length);
            let motion = [0.02 * random[1], 0.02 * random[2], 0.02 * random[0], turn[0], turn[1], turn[2]];
            let colour = many.drawn(&sharp.cloud, &one.camera, &motion, &sharp.dataset).unwrap();
            one.pixels = photograph_of(&colour, 56);
            motions.push(motion);
        }
        let dataset = Dataset { background: [0.0; 3], ..Dataset::of_photographs(all, 3).unwrap() };
        (tiny::Tiny { cloud: sharp.cloud, dataset }, motions)
    }

    fn photograph_of(colour: &[f32], width: usize) -> Pixels {
        let byte = |c: f32| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
        let rgba = colour.chunks_exact(3).map(|c| [byte(c[0]), byte(c[1]), byte(c[2]), 255]).collect();
        Pixels { width, height: colour.len() / 3 / width, rgba }
    }

    fn learned(scene: &tiny::Tiny) -> Model {
        let strategy = Strategy::Classic;
        let options =
            TrainOptions { iterations: 400, strategy, refine_from: 10_000, sh_degree: 0, ..Default::default() };
        // As a start from triangulated points is: nearly in place, too wide, grey.
        let mut cloud = scene.cloud.clone();
        for (i, mean) in cloud.means.iter_mut().enumerate() {
            *mean = mean.map(|x| x + 0.03 * (i as f32 + 7.0 * x).sin());
        }
        cloud.log_scales.iter_mut().for_each(|scales| *scales = scales.map(|x| x + 0.4));
        cloud.sh.iter_mut().for_each(|sh| *sh = sh.map(|x| 0.5 * x));
        let model = Model::new(cloud, &scene.dataset);
        let mut engine = CpuEngine::new(&scene.dataset, &options, model).unwrap();
        let count = scene.dataset.training.len();
        assert_eq!(train(&mut engine, count, 400, 1, 100, &mut |_, _| Ok(true)), Ok(true));
        super::super::Engine::model(&mut engine).unwrap()
    }

    fn psnr(model: &Model, dataset: &Dataset) -> f64 {
        Score::mean(&scores(&model.cloud, &dataset.held_out, dataset).unwrap()).unwrap().psnr
    }

    /// How far a motion is from the true one, in the image at its end, as a share of the way that the true one goes there. Where all rows
    /// are exposed together the way back looks the same.
    fn apart(found: &Motion, there: &Motion, camera: &Camera, scene: &tiny::Tiny, either_way: bool) -> f64 {
        let ends = |motion: &Motion, by: f32| -> Vec<DVec2> {
            let pose = turned(&camera.camera_from_world, &motion.map(|x| by * x));
            let points = scene.cloud.means.iter().map(|mean| pose.transform_point(DVec3::from(mean.map(f64::from))));
            points.map(|p| DVec2::new(p.x / p.z, p.y / p.z)).collect()
        };
        let far =
            |a: Vec<DVec2>, b: Vec<DVec2>| a.iter().zip(&b).map(|(a, b)| a.distance_squared(*b)).sum::<f64>().sqrt();
        let way = far(ends(there, 0.5), ends(there, 0.0));
        let forth = far(ends(found, 0.5), ends(there, 0.5));
        let back = if either_way { far(ends(found, -0.5), ends(there, 0.5)) } else { f64::INFINITY };
        forth.min(back) / way
    }

    #[test]
    fn a_scene_is_sharper_than_the_photographs_that_it_is_learned_from() {
        for (readout, gain) in [(0.0, 4.0), (0.6, 2.5)] {
            let (mut scene, motions) = shaken(readout, 7.0);
            let without = psnr(&learned(&scene), &scene.dataset);
            scene.dataset.shutter = Some(Shutter { readout, ..Default::default() });
            let model = learned(&scene);
            let with = psnr(&model, &scene.dataset);
            let near = (model.motions.iter().zip(&motions).zip(&scene.dataset.training))
                .filter(|((found, there), one)| apart(found, there, &one.camera, &scene, readout == 0.0) < 0.35)
                .count();
            println!(
                "readout {readout}: {without:.2} dB without, {with:.2} dB with; {near} of {} found",
                motions.len()
            );
            assert!(with > without + gain, "{readout}: {without} {with}");
            assert!(2 * near > motions.len(), "{readout}: {near}");
        }
    }

    #[test]
    fn a_held_out_photograph_that_moved_is_scored_by_its_other_half() {
        let (scene, _) = shaken(0.0, 7.0);
        let shutter = Shutter::default();
        let dataset = Dataset { shutter: Some(shutter), ..scene.dataset.clone() };
        let one = &dataset.training[2];
        let still = scores(&scene.cloud, std::slice::from_ref(one), &dataset).unwrap()[0];
        let (camera, motion) = fitted(&scene.cloud, one, &dataset, &shutter, true, 60).unwrap();
        let found = fitted_scores(&scene.cloud, std::slice::from_ref(one), &dataset, true, 60).unwrap()[0];
        assert!(found.psnr_right > still.psnr_right + 5.0, "{still:?} {found:?}");
        let pixels = length(&scene.cloud, &camera, &motion, &dataset).unwrap().unwrap();
        assert!((4.0..9.0).contains(&pixels), "{pixels}");
    }
}
