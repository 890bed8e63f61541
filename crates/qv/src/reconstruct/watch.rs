//! What goes on beside training: progress, checkpoints, previews, the best scene so far, and when to stop.

use super::arguments::Reconstruct;
use crate::Failure;
use crate::outcome::about;
use crate::output::make_folder;
use crate::progress::{Level, Stages, reports};
use crate::render::png;
use qv_raster::Image;
use qv_splat::train::{Best, Dataset, Engine, Model, Photograph, Progress, drawn};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Time from one checkpoint to the next.
pub(super) const SAVE_EVERY: Duration = Duration::from_secs(30);
/// Steps from one scene to the next that is judged, where it is fetched from the card.
#[cfg(feature = "gpu")]
pub(super) const FETCH_EVERY: u32 = 5000;
/// Steps from one preview to the next.
const PREVIEW_EVERY: u32 = 1000;

/// Shares of the work between which training lies: photographs are read before, scores are taken after it.
pub(super) const TRAINING: [f64; 2] = [0.02, 0.95];

/// What was reported at a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct CurvePoint {
    pub step: u32,
    pub loss: f64,
    /// Of the images that the scene was judged by last \[dB\]; NaN where it was not judged since the point before.
    pub psnr: f64,
}

/// What goes on while training runs.
pub(super) struct Run<'a> {
    command: &'a Reconstruct,
    dataset: &'a Dataset,
    /// Steps that are taken.
    pub iterations: u32,
    clock: Instant,
    /// When the last checkpoint was written.
    saved: Instant,
    bar: &'a Stages,
    stop: Arc<AtomicBool>,
    /// The last that was reported, every hundred steps.
    pub loss: Option<f32>,
    /// All that was reported, every hundred steps.
    pub curve: Vec<CurvePoint>,
    /// PSNR of the last preview's photograph, or of those that the last scene was judged by.
    pub psnr: Option<f64>,
    /// What is kept if training is stopped.
    pub best: Best,
    /// Sums of milliseconds by stage, and of how many steps.
    times: (Vec<(&'static str, f64)>, u32),
}

impl<'a> Run<'a> {
    pub fn new(command: &'a Reconstruct, dataset: &'a Dataset, bar: &'a Stages) -> Self {
        Self {
            command,
            dataset,
            iterations: command.iterations,
            clock: Instant::now(),
            saved: Instant::now(),
            bar,
            stop: crate::stop::asked(),
            loss: None,
            curve: vec![],
            psnr: None,
            best: Best::default(),
            times: (vec![], 0),
        }
    }

    /// After each step; false to stop.
    pub fn watch(&mut self, engine: &mut dyn Engine, progress: &Progress) -> Result<bool, Failure> {
        if let Some(loss) = progress.loss {
            self.loss = Some(loss);
            self.curve.push(CurvePoint { step: progress.iteration, loss: f64::from(loss), psnr: f64::NAN });
            let psnr = self.psnr.map_or(String::new(), |psnr| format!(" PSNR {psnr:.2}"));
            let share = f64::from(progress.iteration) / f64::from(self.iterations);
            let figure = format!(
                "step {} of {}, loss {loss:.4}{psnr} {} Gaussians",
                progress.iteration, self.iterations, progress.splats
            );
            let from = self.command.training_from();
            self.bar.at(from + share * (TRAINING[1] - from), &figure);
            if reports(Level::Verbose) {
                self.add_times(engine.times()?);
                engine.time_next();
            }
        }
        let is_time = |every: u32| progress.iteration.is_multiple_of(every);
        let saves = self.saved.elapsed() >= SAVE_EVERY;
        let judges = is_time(self.command.judge_every()) && progress.iteration < self.iterations;
        let previews = self.command.preview && is_time(PREVIEW_EVERY);
        // All of it is fetched from the card at once, for whatever it is wanted.
        if saves || judges || previews {
            let model = engine.model()?;
            if saves {
                self.command.save(&model)?;
                self.saved = Instant::now();
            }
            if judges {
                let psnr = self.best.see(&model, self.dataset)?;
                self.psnr = Some(psnr);
                if let Some(point) = self.curve.last_mut() {
                    point.psnr = psnr;
                }
            }
            previews.then(|| self.preview(&model)).transpose()?;
        }
        let late = self.command.max_seconds.is_some_and(|most| self.clock.elapsed().as_secs_f64() > most);
        Ok(!(late || self.stop.load(Ordering::Relaxed)))
    }

    /// Reports how far the search for the number of steps is; false to stop.
    pub fn searches(&self, progress: &Progress) -> bool {
        if progress.loss.is_some() {
            let figure = format!("how many steps help: step {}, {} Gaussians", progress.iteration, progress.splats);
            self.bar.at(self.command.training_from(), &figure);
        }
        !self.is_stopped()
    }

    /// Whether somebody asked for a stop, by Ctrl-C or SIGTERM.
    pub fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    fn add_times(&mut self, times: Vec<(&'static str, f64)>) {
        self.times.1 += u32::from(!times.is_empty());
        for (name, ms) in times {
            match self.times.0.iter_mut().find(|(known, _)| *known == name) {
                Some((_, sum)) => *sum += ms,
                None => self.times.0.push((name, ms)),
            }
        }
    }

    pub fn mean_times(&self) -> Vec<(&'static str, f64)> {
        self.times.0.iter().map(|(name, sum)| (*name, sum / f64::from(self.times.1.max(1)))).collect()
    }

    /// A photograph, held out if there is one, and beside it what is drawn.
    fn preview(&mut self, model: &Model) -> Result<(), Failure> {
        let Some(photograph) = self.dataset.held_out.first().or(self.dataset.training.first()) else { return Ok(()) };
        let image = drawn(&model.cloud, &photograph.camera, self.dataset)?;
        self.psnr = Some(qv_splat::train::score(&image.colour, photograph).psnr);
        let name = format!("{}_{:06}", photograph.name, model.iteration);
        let folder = self.command.out.join("previews");
        beside(photograph, &image, &folder, &name)?;
        // One looks at it while training runs.
        crate::output::commit().map_err(|e| about(&folder, e))
    }
}

/// Writes a photograph and, to the right of it, what is drawn there, as `folder/name.png`.
pub(super) fn beside(photograph: &Photograph, image: &Image, folder: &Path, name: &str) -> Result<(), Failure> {
    make_folder(folder).map_err(|e| about(folder, format!("expected a folder, found {e}")))?;
    let (width, height) = (image.width, image.height);
    let (bytes, wanted) = (image.colour_u8(), &photograph.pixels.rgba);
    let mut both = Vec::with_capacity(6 * width * height);
    for y in 0..height {
        both.extend(wanted[y * width..(y + 1) * width].iter().flat_map(|p| [p[0], p[1], p[2]]));
        both.extend(&bytes[3 * y * width..3 * (y + 1) * width]);
    }
    // A name may hold the folders of the capture.
    let path = folder.join(format!("{}.png", name.replace(['/', '\\'], "_")));
    png(&path, &both, [2 * width as u32, height as u32], image::ExtendedColorType::Rgb8)
}

/// Writes a photograph in which what `masked` leaves out is red, as `folder/name.png`.
pub(super) fn show_mask(photograph: &Photograph, masked: &Photograph, folder: &Path) -> Result<(), Failure> {
    make_folder(folder).map_err(|e| about(folder, format!("expected a folder, found {e}")))?;
    let pixels = photograph.pixels.rgba.iter().zip(&masked.pixels.rgba);
    let shown = pixels.flat_map(|(was, is)| match was[3] > 0 && is[3] == 0 {
        true => [255, was[1] / 2, was[2] / 2],
        false => [was[0], was[1], was[2]],
    });
    let path = folder.join(format!("{}.png", photograph.name.replace(['/', '\\'], "_")));
    let size = [photograph.pixels.width as u32, photograph.pixels.height as u32];
    png(&path, &shown.collect::<Vec<u8>>(), size, image::ExtendedColorType::Rgb8)
}
