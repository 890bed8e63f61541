//! `qv navigate train`: a student learns from the teacher, and then, if that is asked for, from its own trials.

use super::card::CardArguments;
use super::legs::LegsArguments;
use super::many::{Many, TRAINED};
use super::place::Task;
use super::weights_file::network_at;
use crate::outcome::about;
use crate::output::{self, make_folder, write_whole};
use crate::progress::Stages;
use crate::terminal::print_message;
use crate::{Failure, Outcome, say};
use qv_nav::dagger::{Progress, TrainSettings};
use qv_nav::eye::{Eye, Paints, Several, Shot};
use qv_nav::goals::GoalKind;
use qv_nav::legs::Legs;
use qv_nav::lens::LensSpread;
use qv_nav::net::Net;
use qv_nav::places::{ManySites, SiteSettings, Sites, TrainingPlaces, Visit};
use qv_nav::roll::Stage;
use qv_nav::task::Limits;
use qv_nav::weights::GoalInput;
use qv_nav::{NavError, onnx, weights};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

/// Weights of a training that has not ended. The files of one that has stay until another one has.
const UNFINISHED: &str = "unfinished.bin";
/// What belongs to those weights, see [`State`].
const STATE: &str = "unfinished.json";

/// The places of those weights.
const UNFINISHED_PLACES: &str = "unfinished_places.json";
/// Share of the episodes of a training in many places in which the goal is not there.
const ABSENT: f32 = 0.25;

/// Where a training stands beside its weights.
#[derive(Serialize, Deserialize)]
struct State {
    /// Options that it was begun with, by name.
    begun_with: serde_json::Map<String, serde_json::Value>,
    /// Its rounds so far.
    metrics: Vec<Progress>,
}

#[derive(clap::Args)]
pub struct Train {
    #[command(flatten)]
    task: Task,
    #[command(flatten)]
    many: Many,
    #[command(flatten)]
    legs: LegsArguments,
    /// Add scenes of the same place in the same frame
    #[arg(long, value_name = "FILE", num_args = 1.., help_heading = "Input", hide_short_help = true)]
    also: Vec<PathBuf>,
    /// Run N rounds of imitation learning (DAgger)
    ///
    /// 0, with --from and without --ppo-rounds, exports policy.onnx of those weights.
    #[arg(long, default_value_t = TrainSettings::default().rounds, value_parser = count, value_name = "N", help_heading = "Training")]
    rounds: usize,
    /// Run N rounds of RL fine-tuning (PPO) after imitation
    #[arg(long = "ppo-rounds", default_value_t = 0, value_parser = count, alias = "trials", value_name = "N", help_heading = "Training")]
    trials: usize,
    /// Start from the weights of an earlier training
    #[arg(long, value_name = "WEIGHTS.bin", help_heading = "Training")]
    from: Option<PathBuf>,
    /// Resume the training in --out after its last round
    ///
    /// The optimizer and the replay data start anew.
    #[arg(long, conflicts_with = "from", help_heading = "Training")]
    resume: bool,
    /// Collect N decisions per round
    #[arg(long, default_value_t = TrainSettings::default().frames, value_name = "N", help_heading = "Advanced", hide_short_help = true)]
    frames: usize,
    /// Simulate N robots at once [default: 192; with --places 24 a place]
    #[arg(long, value_parser = robots, value_name = "N", help_heading = "Advanced", hide_short_help = true)]
    robots: Option<usize>,
    /// Train N epochs per round (twice as many with PPO)
    #[arg(long, default_value_t = TrainSettings::default().epochs, value_name = "N", help_heading = "Advanced", hide_short_help = true)]
    epochs: usize,
    /// Set the batch size in episodes
    #[arg(long, default_value_t = TrainSettings::default().batch, value_name = "N", help_heading = "Advanced", hide_short_help = true)]
    batch: usize,
    /// Write the results into this directory [created if missing]
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    out: PathBuf,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
    #[command(flatten)]
    card: CardArguments,
}

/// Robots at once, from the command line.
fn robots(text: &str) -> Result<usize, String> {
    crate::numbers::count(text, 1, 100_000)
}

/// Rounds of a training, from the command line.
fn count(text: &str) -> Result<usize, String> {
    crate::numbers::count(text, 0, 1_000_000)
}

impl Train {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        if self.rounds == 0 && self.from.is_none() && !self.resume {
            return Err("expected --rounds of at least 1, or --from WEIGHTS.bin to begin with".into());
        }
        let kept = if self.resume { Some(self.kept()?) } else { None };
        let start = match &kept {
            Some((weights, _)) => Some(weights.clone()),
            None => self.from.as_ref().map(|file| network_at(file, &Net::default())).transpose()?.map(|(w, _)| w),
        };
        let metrics = kept.map_or(vec![], |(_, metrics)| metrics);
        match self.many.is_asked() {
            true => self.in_many_places(start, metrics),
            false => self.in_one_place(start, metrics),
        }
    }

    /// Learning in drawn places, and in scenes beside them.
    fn in_many_places(&self, start: Option<Vec<f32>>, metrics: Vec<Progress>) -> Result<Outcome, Failure> {
        let others = [
            ("--scene", self.task.place.scene.is_some()),
            ("--also", !self.also.is_empty()),
            ("--walk", self.legs.is_walking()),
            ("--ppo-rounds", self.trials > 0),
        ];
        if let Some((option, _)) = others.iter().find(|(_, is_there)| *is_there) {
            return Err(format!("{option}: expected none with --places and --with-scene, which name the places").into());
        }
        let place = &self.task.place;
        let given = self.many.scenes(place, Some(GoalKind::Trained), &Paints::default())?;
        let stop = crate::stop::asked();
        make_folder(&self.out).map_err(|e| about(&self.out, e))?;
        let count = self.many.places.unwrap_or(0);
        // What it goes on from was somewhere, too.
        let before = match (self.resume, &self.from) {
            (true, _) => Some(self.out.join(UNFINISHED_PLACES)),
            (false, Some(from)) => Some(from.with_file_name(TRAINED)).filter(|file| file.exists()),
            (false, None) => None,
        };
        let visited = before.map_or(Ok(BTreeMap::new()), |file| trained_at(&file).map(|t| t.visited()))?;
        let sites = ManySites {
            settings: SiteSettings { rig: place.rig()?, ..SiteSettings::default() },
            seed: place.seed,
            count,
            // As often as a quarter of the drawn places, or always where there are none.
            share_given: if count == 0 { 1.0 } else { 0.25 },
            given,
            spread: if self.task.camera == "none" { LensSpread::none() } else { LensSpread::of_many_places() },
            eyes: self.card.place_eyes()?,
            robots: self.driven(TrainSettings::of_many_places()).robots,
            absent: ABSENT,
            visited: Mutex::new(visited),
        };
        let stoppable = StoppableSites { sites: &sites, stop: stop.clone() };
        let mut work =
            Work { train: self, ground: TrainingGround::Many(&stoppable), stages: Stages::new(), metrics, stop };
        let settings = self.taught(TrainSettings::of_many_places());
        let mut parameters = start;
        if work.metrics.len() < settings.rounds && !work.is_stopped() {
            parameters = Some(work.learn(&settings, parameters, 0)?);
        }
        let metrics = work.finish();
        let trained = sites.trained();
        // Nobody knows where it is among many places: sides of a place are those of none.
        let written =
            PolicyFiles { parameters: parameters.unwrap_or_default(), limits: Limits::default(), half_sides: [4.0; 2] };
        write_whole(&self.out.join(TRAINED), &serde_json::to_vec(&trained)?)?;
        self.write(&written, &metrics)
    }

    /// Learning in one place.
    fn in_one_place(&self, start: Option<Vec<f32>>, metrics: Vec<Progress>) -> Result<Outcome, Failure> {
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
        make_folder(&self.out).map_err(|e| about(&self.out, e))?;
        let eye = StoppableEye { eye: Several(eyes), stop: stop.clone() };
        let legs = stable.legs(&world, self.driven(TrainSettings::default()).robots)?;
        let stage = Stage::new(&world, &eye, camera);
        let mut work = Work {
            train: self,
            ground: TrainingGround::One { stage: &stage, legs },
            stages: Stages::new(),
            metrics,
            stop,
        };
        let mut parameters = start;
        let mut first = 0;
        for settings in [self.taught(TrainSettings::default()), self.tried()] {
            let end = first + settings.rounds;
            if settings.rounds > 0 && work.metrics.len() < end && !work.is_stopped() {
                parameters = Some(work.learn(&settings, parameters, first)?);
            }
            first = end;
        }
        let metrics = work.finish();
        let [low, high] = world.map.bounds();
        let half_sides = (0.5 * (high - low)).to_array();
        self.write(
            &PolicyFiles { parameters: parameters.unwrap_or_default(), limits: world.limits, half_sides },
            &metrics,
        )
    }

    /// The results.
    fn write(&self, written: &PolicyFiles, metrics: &[Progress]) -> Result<Outcome, Failure> {
        let PolicyFiles { parameters, limits, half_sides } = written;
        let (rounds, all) = (metrics.len(), self.rounds + self.trials);
        if rounds == 0 && all > 0 {
            print_message!("stopped in the first of {all} rounds; nothing was written");
            return Ok(Outcome::Stopped);
        }
        let is_stopped = rounds < all;
        if is_stopped && self.out.join("policy.onnx").exists() {
            print_message!("the policy in '{}' stays", self.out.display());
            print_message!("{}", self.how_to_go_on(rounds));
            return Ok(Outcome::Stopped);
        }
        let file = onnx::to_bytes_for(&Net::default(), parameters, limits, *half_sides, self.input())?;
        write_whole(&self.out.join("policy.onnx"), &file)?;
        write_whole(&self.out.join("weights.bin"), &self.file_of(parameters))?;
        if all > 0 {
            write_whole(&self.out.join("metrics.json"), &serde_json::to_vec_pretty(metrics)?)?;
        }
        if is_stopped {
            print_message!("{}", self.how_to_go_on(rounds));
            return Ok(Outcome::Stopped);
        }
        [UNFINISHED, STATE, UNFINISHED_PLACES].iter().for_each(|name| output::remove(&self.out.join(name)));
        let decisions = metrics.last().map_or(0, |result| result.frames);
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

    /// How the network is commanded.
    fn input(&self) -> GoalInput {
        if self.many.is_asked() { GoalInput::Colour } else { GoalInput::Name }
    }

    /// The file of a network's numbers.
    fn file_of(&self, parameters: &[f32]) -> Vec<u8> {
        weights::to_bytes_for(parameters, self.input())
    }

    /// What to type after so many rounds.
    fn how_to_go_on(&self, rounds: usize) -> String {
        let mut words = crate::config::without(crate::config::arguments(), &["from"]);
        if !self.resume {
            words.push("--resume".into());
        }
        let all = self.rounds + self.trials;
        format!("stopped after {rounds} of {all} rounds; to go on: qv {}", crate::config::typed(&words))
    }

    /// Options with which a training goes on as it was begun, by name.
    fn begun_with(&self) -> serde_json::Map<String, serde_json::Value> {
        let numbers = [
            ("--rounds", self.rounds as u64),
            ("--trials", self.trials as u64),
            ("--frames", self.frames as u64),
            ("--robots", self.robots.unwrap_or(0) as u64),
            ("--places", self.many.places.unwrap_or(0)),
            ("--epochs", self.epochs as u64),
            ("--batch", self.batch as u64),
            ("--seed", self.task.place.seed),
        ];
        numbers.into_iter().map(|(name, value)| (name.to_owned(), value.into())).collect()
    }

    /// Weights and rounds of the training in the results that has not ended.
    fn kept(&self) -> Result<(Vec<f32>, Vec<Progress>), Failure> {
        let path = self.out.join(STATE);
        let bytes =
            fs::read(&path).map_err(|e| about(&path, format!("expected a training that was stopped, found {e}")))?;
        let state: State = serde_json::from_slice(&bytes).map_err(|e| about(&path, e))?;
        let now = self.begun_with();
        if let Some((option, value)) = now.iter().find(|(option, value)| state.begun_with.get(*option) != Some(*value))
        {
            let begun = state.begun_with.get(option).map_or("none".into(), ToString::to_string);
            let expected = format!("--resume: expected {option} {begun}, with which it was begun");
            return Err(about(&path, format!("{expected}, found {value}")));
        }
        Ok((network_at(&self.out.join(UNFINISHED), &Net::default())?.0, state.metrics))
    }

    /// Learning from the teacher.
    fn taught(&self, usual: TrainSettings) -> TrainSettings {
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
        let robots = self.robots.unwrap_or(usual.robots);
        TrainSettings { frames: self.frames, robots, seed: self.task.place.seed, ..usual }
    }
}

/// An eye that sees nothing more once a stop was asked for, so that driving ends at the next picture.
struct StoppableEye {
    eye: Several<'static>,
    stop: Arc<AtomicBool>,
}

impl Eye for StoppableEye {
    fn look(&self, shots: &[Shot]) -> Result<Vec<Vec<f32>>, NavError> {
        match self.stop.load(Ordering::Relaxed) {
            true => Err(NavError::value("eye", "one that is not stopped", "one that is")),
            false => self.eye.look(shots),
        }
    }
}

/// The same for places.
struct StoppableSites<'a> {
    sites: &'a ManySites,
    stop: Arc<AtomicBool>,
}

impl Sites for StoppableSites<'_> {
    fn visit(&self, number: u64, visit: &mut Visit) -> Result<(), NavError> {
        match self.stop.load(Ordering::Relaxed) {
            true => Err(NavError::value("place", "one before the stop", "one after it")),
            false => self.sites.visit(number, visit),
        }
    }
}

/// What a training leaves.
struct PolicyFiles {
    parameters: Vec<f32>,
    limits: Limits,
    half_sides: [f64; 2],
}

/// Where a training takes place.
enum TrainingGround<'a> {
    One { stage: &'a Stage<'a>, legs: Box<dyn Legs + 'a> },
    Many(&'a StoppableSites<'a>),
}

/// The places of a training that was stopped.
fn trained_at(path: &Path) -> Result<TrainingPlaces, Failure> {
    let bytes = fs::read(path).map_err(|e| about(path, format!("expected the places of a training, found {e}")))?;
    serde_json::from_slice(&bytes).map_err(|e| about(path, e))
}

/// A training under way.
struct Work<'a> {
    train: &'a Train,
    ground: TrainingGround<'a>,
    stages: Stages,
    metrics: Vec<Progress>,
    stop: Arc<AtomicBool>,
}

impl Work<'_> {
    /// The rounds of one way of learning that are left, from some weights or from nothing; gives the weights. `first` are the rounds of other ways
    /// before it.
    fn learn(&mut self, settings: &TrainSettings, start: Option<Vec<f32>>, first: usize) -> Result<Vec<f32>, Failure> {
        let mut student = self.train.card.student(settings)?;
        start.map_or(Ok(()), |parameters| student.start_from(parameters))?;
        // The learning rate falls with them.
        student.rounds = self.metrics.len() - first;
        let episodes = self.train.task.episodes();
        let all = self.train.rounds + self.train.trials;
        let (before, gathered) = (self.metrics.len(), self.metrics.last().map_or(0, |result| result.frames));
        let end = first + settings.rounds;
        let name = if settings.policy.is_some() { "drive and learn from trials" } else { "drive and learn" };
        for round in before..end {
            if self.is_stopped() {
                break;
            }
            self.stages.begin(round + 1, all, name, Some(round as f64 / all as f64));
            let stages = &self.stages;
            let mut notify = |p: &Progress| {
                let share = (first as f64 + p.share * settings.rounds as f64) / all as f64;
                stages.at(share, &format!("{} decisions, loss {:.4}", gathered + p.frames, p.loss));
            };
            let learnt = match &mut self.ground {
                TrainingGround::One { stage, legs } => student.round(stage, &mut **legs, &episodes, &mut notify),
                TrainingGround::Many(sites) => student.round_over(*sites, &mut notify),
            };
            // Driving ends with an error of the eye; a round that is learning comes to its end.
            let mut result = match learnt {
                Err(_) if self.is_stopped() => break,
                learnt => learnt?,
            };
            (result.round, result.frames) = (round + 1, gathered + result.frames);
            result.share = (round + 1) as f64 / all as f64;
            self.metrics.push(result);
            // After each round, so that a training that is cut off leaves its last round.
            self.save(&student.parameters)?;
        }
        Ok(student.parameters)
    }

    /// Writes where training stands, at once.
    fn save(&self, parameters: &[f32]) -> Result<(), Failure> {
        let out = &self.train.out;
        let state = State { begun_with: self.train.begun_with(), metrics: self.metrics.clone() };
        write_whole(&out.join(UNFINISHED), &self.train.file_of(parameters))?;
        if let TrainingGround::Many(many) = &self.ground {
            write_whole(&out.join(UNFINISHED_PLACES), &serde_json::to_vec(&many.sites.trained())?)?;
        }
        write_whole(&out.join(STATE), &serde_json::to_vec_pretty(&state)?)?;
        output::commit().map_err(|e| about(out, e))
    }

    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    fn finish(self) -> Vec<Progress> {
        self.stages.finish();
        self.metrics
    }
}
