//! `qv navigate train`: a student learns from the teacher, and then, if that is asked for, from its own trials.

use super::card::CardArguments;
use super::legs::LegsArguments;
use super::{Task, weights_at};
use crate::progress::Stages;
use crate::scene::about;
use crate::terminal::print_message;
use crate::whole::{refuse_inputs, write_whole};
use crate::{Failure, Outcome, say};
use qv_nav::dagger::{Progress, TrainSettings};
use qv_nav::eye::{Eye, Paints, Several, Shot};
use qv_nav::legs::Legs;
use qv_nav::net::Net;
use qv_nav::roll::Stage;
use qv_nav::{NavError, onnx, weights};
use std::fs;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

#[derive(clap::Args)]
pub struct Train {
    #[command(flatten)]
    task: Task,
    #[command(flatten)]
    legs: LegsArguments,
    /// More scenes of the same place, in the same frame, such as a finer one. Each episode is drawn in one of all scenes, evenly
    #[arg(long, value_name = "FILE", num_args = 1..)]
    also: Vec<PathBuf>,
    /// Rounds of driving and learning from the teacher; 0, with --from and without --trials, writes policy.onnx of those weights
    #[arg(long, default_value_t = TrainSettings::default().rounds, value_parser = count)]
    rounds: usize,
    /// Rounds of learning from its own trials (PPO), after those of the teacher
    #[arg(long, default_value_t = 0, value_parser = count)]
    trials: usize,
    /// Begins with the weights.bin of an earlier training; with --rounds 0 --trials N it learns from trials alone
    #[arg(long, value_name = "WEIGHTS.bin")]
    from: Option<PathBuf>,
    /// Decisions that a round gathers
    #[arg(long, default_value_t = TrainSettings::default().frames)]
    frames: usize,
    /// Robots that drive at once: a round has at least one episode of each
    #[arg(long, default_value_t = TrainSettings::default().robots)]
    robots: usize,
    /// Times that a round learns from what was gathered; from trials it is twice
    #[arg(long, default_value_t = TrainSettings::default().epochs)]
    epochs: usize,
    /// Episodes in a step of the optimiser
    #[arg(long, default_value_t = TrainSettings::default().batch)]
    batch: usize,
    /// Directory for the results; made if need be
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// One line of JSON at the end instead of the summary
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    card: CardArguments,
}

/// Rounds of a training, from the command line.
fn count(text: &str) -> Result<usize, String> {
    crate::numbers::count(text, 0, 1_000_000)
}

impl Train {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        if self.rounds == 0 && self.from.is_none() {
            return Err("expected --rounds of at least 1, or --from WEIGHTS.bin to begin with".into());
        }
        let outputs = ["weights.bin", "policy.onnx", "metrics.json"].map(|name| self.out.join(name));
        // The weights to begin with may stand where the new ones go: they are read before the first round.
        let read: Vec<&PathBuf> =
            self.task.place.files().into_iter().chain(self.legs.files()).chain(&self.also).collect();
        outputs.iter().try_for_each(|out| refuse_inputs(out, read.iter().copied()))?;
        refuse_inputs(&outputs[1], &self.from)?;
        let start = self.from.as_ref().map(|file| weights_at(file, &Net::default())).transpose()?;
        // Now, and not once the first scene was opened and painted.
        let missing = self.also.iter().find(|scene| !scene.exists());
        missing.map_or(Ok(()), |scene| Err(about(scene, "expected a scene of Gaussians, found no such file")))?;
        let stop = crate::stop::asked();
        let paints = Paints::default();
        let (world, eye, camera) = self.task.open(&paints)?;
        let mut eyes = vec![self.card.eye(eye)?];
        for scene in &self.also {
            eyes.push(self.card.eye(self.task.place.eye(scene, &world.map, &paints)?)?);
        }
        let stable = self.legs.open(&self.task.place)?;
        fs::create_dir_all(&self.out).map_err(|e| about(&self.out, e))?;
        let eye = Watched { eye: Several(eyes), stop: stop.clone() };
        let mut work = Work {
            train: self,
            stage: Stage::new(&world, &eye, camera),
            legs: stable.legs(&world, self.robots)?,
            stages: Stages::new(),
            metrics: Vec::new(),
            stop,
        };
        let mut parameters = start;
        for settings in [self.taught(), self.tried()].into_iter().filter(|settings| settings.rounds > 0) {
            parameters = Some(work.learn(&settings, parameters)?);
        }
        let (metrics, parameters) = (work.finish(), parameters.unwrap_or_default());
        let (rounds, all) = (metrics.len(), self.rounds + self.trials);
        if rounds == 0 && all > 0 {
            print_message!("stopped in the first of {all} rounds; nothing was written");
            return Ok(Outcome::Stopped);
        }
        if rounds == 0 {
            // Nothing was learnt: the files of the weights that were given.
            write_whole(&self.out.join("weights.bin"), &weights::to_bytes(&parameters))?;
        }
        let [low, high] = world.map.bounds();
        let half_sides = (0.5 * (high - low)).to_array();
        let file = onnx::to_bytes(&Net::default(), &parameters, &world.limits, half_sides)?;
        write_whole(&self.out.join("policy.onnx"), &file)?;
        if rounds < all {
            print_message!("{}", self.how_to_go_on(rounds));
            return Ok(Outcome::Stopped);
        }
        let decisions = metrics.last().map_or(0, |told| told.frames);
        if self.json {
            let line = serde_json::json!({
                "format": "qv-navigate-train/1", "decisions": decisions, "rounds": rounds, "out": self.out,
            });
            say(&format!("{line}\n"))?;
            return Ok(Outcome::Done);
        }
        say(&format!("{decisions} decisions in {rounds} rounds; written to {}\n", self.out.display()))?;
        Ok(Outcome::Done)
    }

    /// What to type after so many rounds: the same from the weights of the last one, for the rounds that are left.
    fn how_to_go_on(&self, rounds: usize) -> String {
        let taught = self.rounds.saturating_sub(rounds);
        let tried = self.rounds + self.trials - rounds - taught;
        let from = self.out.join("weights.bin").display().to_string();
        let mut words = crate::config::without(crate::config::arguments(), &["from", "rounds", "trials"]);
        words.extend(["--from".into(), from, "--rounds".into(), taught.to_string()]);
        words.extend(["--trials".into(), tried.to_string()]);
        format!(
            "stopped after {rounds} of {} rounds, whose weights and policy are written; to go on, with the learning rate of a beginning: qv {}",
            self.rounds + self.trials,
            crate::config::typed(&words)
        )
    }

    /// Learning from the teacher.
    fn taught(&self) -> TrainSettings {
        let usual = TrainSettings::default();
        TrainSettings {
            rounds: self.rounds,
            epochs: self.epochs,
            // The last round learns once more, as usual.
            last_epochs: self.epochs.saturating_add(usual.last_epochs - usual.epochs),
            batch: self.batch,
            ..self.driven(usual)
        }
    }

    /// Learning from its own trials.
    fn tried(&self) -> TrainSettings {
        TrainSettings { rounds: self.trials, ..self.driven(TrainSettings::tuning()) }
    }

    fn driven(&self, usual: TrainSettings) -> TrainSettings {
        TrainSettings { frames: self.frames, robots: self.robots, seed: self.task.place.seed, ..usual }
    }
}

/// An eye that sees nothing more once a stop was asked for, so that driving ends at the next picture.
struct Watched {
    eye: Several<'static>,
    stop: Arc<AtomicBool>,
}

impl Eye for Watched {
    fn look(&self, shots: &[Shot]) -> Result<Vec<Vec<f32>>, NavError> {
        match self.stop.load(Ordering::Relaxed) {
            true => Err(NavError::value("eye", "one that is not stopped", "one that is")),
            false => self.eye.look(shots),
        }
    }
}

/// A training under way.
struct Work<'a> {
    train: &'a Train,
    stage: Stage<'a>,
    legs: Box<dyn Legs + 'a>,
    stages: Stages,
    metrics: Vec<Progress>,
    stop: Arc<AtomicBool>,
}

impl Work<'_> {
    /// All rounds of one way of learning, from some weights or from nothing; gives the weights.
    fn learn(&mut self, settings: &TrainSettings, start: Option<Vec<f32>>) -> Result<Vec<f32>, Failure> {
        let mut student = self.train.card.student(settings)?;
        start.map_or(Ok(()), |parameters| student.start_from(parameters))?;
        let episodes = self.train.task.episodes();
        let all = self.train.rounds + self.train.trials;
        let (before, gathered) = (self.metrics.len(), self.metrics.last().map_or(0, |told| told.frames));
        let name = if settings.policy.is_some() { "drive and learn from trials" } else { "drive and learn" };
        for round in before..before + settings.rounds {
            if self.is_stopped() {
                break;
            }
            self.stages.begin(round + 1, all, name, Some(round as f64 / all as f64));
            let stages = &self.stages;
            let learnt = student.round(&self.stage, &mut *self.legs, &episodes, &mut |p| {
                let share = (before as f64 + p.share * settings.rounds as f64) / all as f64;
                stages.at(share, &format!("{} decisions, loss {:.4}", gathered + p.frames, p.loss));
            });
            // Driving ends with an error of the eye; a round that is learning comes to its end.
            let mut told = match learnt {
                Err(_) if self.is_stopped() => break,
                learnt => learnt?,
            };
            (told.round, told.frames) = (round + 1, gathered + told.frames);
            told.share = (round + 1) as f64 / all as f64;
            self.metrics.push(told);
            // After each round, so that a training that is cut off leaves its last round.
            let out = &self.train.out;
            write_whole(&out.join("weights.bin"), &weights::to_bytes(&student.parameters))?;
            write_whole(&out.join("metrics.json"), &serde_json::to_vec_pretty(&self.metrics)?)?;
        }
        Ok(student.parameters)
    }

    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    fn finish(self) -> Vec<Progress> {
        self.stages.finish();
        self.metrics
    }
}
