//! Training as a loop, whatever does the steps.

use super::dataset::{Dataset, Photograph};
use super::drawn::{DEPTH, drawn, drawn_with};
use super::ground::Ground;
use super::model::Model;
use super::random::shuffled;
use super::score::{GroundScore, Score, score, score_of};
use crate::SplatError;
use crate::error::off;
use qv_core::GaussianCloud;
use rayon::prelude::*;

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
    let count = photographs.max(1) as u32;
    let mut order: (u32, Vec<usize>) = (u32::MAX, vec![]);
    while engine.iteration() < iterations {
        let iteration = engine.iteration();
        if order.0 != iteration / count {
            order = (iteration / count, shuffled(photographs.max(1), seed, iteration / count));
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
    photographs.par_iter().map(|one| Ok(score(&drawn(cloud, &one.camera, dataset)?.colour, one))).collect()
}

/// Scores of what shows the ground alone, of the photographs in which it can be seen: pixels whose drawn depth lies on it.
///
/// # Errors
/// Drawing fails.
pub fn ground_scores(
    cloud: &GaussianCloud,
    dataset: &Dataset,
    held_out: &[Photograph],
    ground: &Ground,
) -> Result<Vec<GroundScore>, SplatError> {
    let one = |photograph: &Photograph| {
        let image = drawn_with(cloud, &photograph.camera, dataset, DEPTH)?;
        Ok(score_of(&image.colour, photograph, &ground.pixels(&image, &photograph.camera)))
    };
    held_out.par_iter().filter_map(|photograph| one(photograph).transpose()).collect()
}
