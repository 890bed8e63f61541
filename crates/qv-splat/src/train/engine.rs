//! Training as a loop, whatever does the steps.

use super::dataset::{Dataset, Photograph};
use super::drawn::{DEPTH, drawn, drawn_with};
use super::exposure::{Exposure, exposed_image};
use super::ground::Ground;
use super::model::Model;
use super::order::round;
use super::score::{GroundScore, Score, score, score_of};
use super::vignetting::vignetted;
use crate::SplatError;
use crate::error::off;
use qv_core::GaussianCloud;
use qv_raster::Image;

/// What does the steps.
pub trait Engine {
    /// Learns from a photograph, given by its index among those to learn from; then Gaussians come and go when it is time.
    ///
    /// # Errors
    /// Drawing fails.
    fn step(&mut self, photograph: usize) -> Result<(), SplatError>;
    /// Steps that were taken.
    fn iteration(&self) -> u32;
    /// How many Gaussians there are.
    fn splats(&self) -> usize;
    /// Mean loss since this was last asked.
    ///
    /// # Errors
    /// The device fails.
    fn loss(&mut self) -> Result<f32, SplatError>;
    /// All that was learned.
    ///
    /// # Errors
    /// The device fails.
    fn model(&mut self) -> Result<Model, SplatError>;
    /// Takes time stamps in the next step, where the device has them.
    fn time_next(&mut self) {}
    /// Milliseconds of each stage of the last step for which they were asked; none on the CPU.
    ///
    /// # Errors
    /// The device fails.
    fn times(&mut self) -> Result<Vec<(&'static str, f64)>, SplatError> {
        Ok(vec![])
    }
}

/// What is reported while training runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Steps that were taken.
    pub iteration: u32,
    /// How many Gaussians there are.
    pub splats: usize,
    /// Mean loss since the last report; with every report, every so many steps.
    pub loss: Option<f32>,
}

/// Takes steps until there are `iterations`, or `watch`, which is asked after each step and reported the loss every `report_every` steps,
/// gives false. Photographs come in a random order, all of them before the first comes again. Returns whether all steps were taken.
///
/// # Errors
/// A step fails, or the loss is no longer finite.
pub fn train(
    engine: &mut dyn Engine,
    photographs: usize,
    iterations: u32,
    seed: u32,
    report_every: u32,
    watch: &mut dyn FnMut(&mut dyn Engine, &Progress) -> Result<bool, SplatError>,
) -> Result<bool, SplatError> {
    train_in_proportion(engine, &vec![1.0; photographs.max(1)], iterations, seed, report_every, watch)
}

/// As [`train`], with photographs in proportion to weights, one for each: as many steps as there are photographs make a round, in which each
/// comes as often as its weight says ([`super::order::round`]).
///
/// # Errors
/// A weight is negative or no number, or all are 0; else as [`train`].
pub fn train_in_proportion(
    engine: &mut dyn Engine,
    weights: &[f32],
    iterations: u32,
    seed: u32,
    report_every: u32,
    watch: &mut dyn FnMut(&mut dyn Engine, &Progress) -> Result<bool, SplatError>,
) -> Result<bool, SplatError> {
    if let Some(weight) = weights.iter().find(|weight| !(weight.is_finite() && **weight >= 0.0)) {
        return Err(off("training, weight of a photograph", "a number of at least 0", weight));
    }
    if weights.iter().all(|weight| *weight == 0.0) {
        return Err(off("training, weights of photographs", "one above 0", format!("{} of 0", weights.len())));
    }
    let count = weights.len() as u32;
    let mut order: (u32, Vec<usize>) = (u32::MAX, vec![]);
    while engine.iteration() < iterations {
        let iteration = engine.iteration();
        if order.0 != iteration / count {
            order = (iteration / count, round(weights, seed, iteration / count));
        }
        engine.step(order.1[(iteration % count) as usize])?;
        let iteration = engine.iteration();
        let reports = iteration.is_multiple_of(report_every.max(1)) || iteration == iterations;
        let loss = if reports { Some(engine.loss()?) } else { None };
        if let Some(loss) = loss.filter(|loss| !loss.is_finite()) {
            return Err(off(format!("training, loss before step {iteration}"), "a finite number", loss));
        }
        let progress = Progress { iteration, splats: engine.splats(), loss };
        if !watch(engine, &progress)? {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Draws and scores photographs with the poses that they came with.
///
/// # Errors
/// Drawing fails.
pub fn scores(cloud: &GaussianCloud, photographs: &[Photograph], dataset: &Dataset) -> Result<Vec<Score>, SplatError> {
    photographs.iter().map(|one| Ok(score(&through_lens(one, &drawn(cloud, &one.camera, dataset)?), one))).collect()
}

/// As [`scores`] of photographs that were held out, with the exposure that the photographs before and after it by name have on average: nothing of the
/// held-out photograph itself is used.
///
/// # Errors
/// Drawing fails.
pub fn neighbours_scores(model: &Model, dataset: &Dataset, held_out: &[Photograph]) -> Result<Vec<Score>, SplatError> {
    let one = |photograph: &Photograph| {
        let image = drawn(&model.cloud, &photograph.camera, dataset)?;
        let exposure = neighbours(&dataset.training, &model.exposures, &photograph.name);
        Ok(score(&exposed_image(&exposure, &through_lens(photograph, &image)), photograph))
    };
    held_out.iter().map(one).collect()
}

/// Scores of what shows the ground alone, of the photographs in which it can be seen: pixels whose drawn depth lies on it. With `exposed` as
/// [`neighbours_scores`], else as [`scores`].
///
/// # Errors
/// Drawing fails.
pub fn ground_scores(
    model: &Model,
    dataset: &Dataset,
    held_out: &[Photograph],
    ground: &Ground,
    exposed: bool,
) -> Result<Vec<GroundScore>, SplatError> {
    let one = |photograph: &Photograph| {
        let image = drawn_with(&model.cloud, &photograph.camera, dataset, DEPTH)?;
        let shown = ground.pixels(&image, &photograph.camera);
        let colour = through_lens(photograph, &image);
        let colour = match exposed {
            true => exposed_image(&neighbours(&dataset.training, &model.exposures, &photograph.name), &colour),
            false => colour,
        };
        Ok(score_of(&colour, photograph, &shown))
    };
    held_out.iter().filter_map(|photograph| one(photograph).transpose()).collect()
}

fn neighbours(training: &[Photograph], exposures: &[Exposure], name: &str) -> Exposure {
    let after = training.partition_point(|one| one.name.as_str() < name);
    let both = exposures[after.saturating_sub(1)..(after + 1).min(exposures.len())].iter();
    let count = both.len().max(1) as f32;
    let mut out = [0.0; 12];
    both.for_each(|exposure| (0..12).for_each(|k| out[k] += exposure[k] / count));
    out
}

/// A photograph to learn from as its camera took it, before its exposure: with its learned motion where motions are learned. Shape `[height,
/// width, 3]`.
pub(super) fn taken(model: &Model, dataset: &Dataset, photograph: usize) -> Result<Vec<f32>, SplatError> {
    let camera = model.camera(dataset, photograph);
    let colour = match &dataset.shutter {
        None => drawn(&model.cloud, &camera, dataset)?.colour,
        Some(shutter) => {
            shutter.drawn(&dataset.filtered(&model.cloud), &camera, &model.motions[photograph], dataset)?
        }
    };
    let given = &dataset.training[photograph].camera;
    Ok(vignetted(model.shared[model.groups[photograph]].vignetting, given, &colour))
}

/// What the lens of a photograph makes of what is drawn of it.
fn through_lens(photograph: &Photograph, image: &Image) -> Vec<f32> {
    vignetted(photograph.vignetting, &photograph.camera, &image.colour)
}

#[cfg(test)]
mod tests {
    use super::super::tiny;
    use super::*;
    use crate::facts::States;

    #[test]
    fn weights_of_photographs_that_are_no_numbers_are_named() {
        let scene = tiny::scene(5, 3, 16);
        let options = super::super::TrainOptions::default();
        let model = Model::new(scene.cloud.clone(), &scene.dataset);
        let mut engine = super::super::CpuEngine::new(&scene.dataset, &options, model).unwrap();
        let mut run = |weights: &[f32]| {
            train_in_proportion(&mut engine, weights, 3, 0, 1, &mut |_, _| Ok(true)).map_err(|error| error.to_string())
        };
        assert!(run(&[1.0, f32::NAN, 1.0]).unwrap_err().states("photograph"));
        assert!(run(&[0.0; 3]).unwrap_err().states("above 0 3 0"));
        assert_eq!(run(&[0.0, 2.0, 0.0]), Ok(true));
    }

    #[test]
    fn a_held_out_exposure_is_that_of_its_neighbours() {
        let scene = tiny::scene(5, 3, 16);
        let exposures: Vec<Exposure> = (0..3).map(|k| [k as f32; 12]).collect();
        let of = |name: &str| neighbours(&scene.dataset.training, &exposures, name)[5];
        // The photographs are v00, v01 and v02.
        assert_eq!([of("a"), of("v005"), of("v015"), of("z")], [0.0, 0.5, 1.5, 2.0]);
    }
}
