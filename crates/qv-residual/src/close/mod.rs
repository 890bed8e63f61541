//! The whole of it: from recordings and a policy to a policy that follows its commands better on the robot, or the word that nothing is
//! to be gained.
//!
//! Stretches of the recordings are dealt out: four of five are for fits, the fifth is held out. A candidate stays when its error on held-out
//! windows is less than that of the one before by two standard errors over stretches. Policies are trained on under what stayed; they are
//! compared in a simulator that is fitted to the held-out stretches alone, which no training has seen.

mod scored;
mod stages;

use crate::ResidualError;
use crate::compensation::Compensation;
use crate::footing::Footing;
use crate::identify::{FitSettings, tops};
use crate::log::Log;
use crate::paths::{Path, PathScore};
use crate::residual::SupervisedSettings;
use crate::residual::reinforce::ReinforceSettings;
use crate::tune::TuneSettings;
use crate::windows::{Replayer, Window, windows};
use qv_policy::policy::Policy;
use qv_policy::train::Checkpoint;
use qv_policy::velocity::{Ground, TaskRobot};
use serde::{Deserialize, Serialize};

/// How the loop is closed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LoopSettings {
    /// Of so many stretches one is held out.
    pub held_every: usize,
    /// Length of the windows by which candidates are compared \[s\].
    pub window: f32,
    /// Most by which feet and a ground that is no plane may contradict each other in a window, see [`crate::footing`] \[m\]: about what a
    /// reconstruction is off by where it is good.
    pub footing: f64,
    /// Standard errors by which a candidate must be better.
    pub errors: f64,
    /// Walks by which policies are compared.
    pub walks: usize,
    /// Fits.
    pub fit: FitSettings,
    /// Nets that are taught on replays.
    pub nets: NetsSettings,
    /// Training.
    pub tune: TuneSettings,
}

/// Which nets are taught on replays, and how.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NetsSettings {
    /// Whether they are tried at all.
    pub tried: bool,
    /// Decisions of the windows on which they are taught.
    pub length: usize,
    /// A net of torques on the fitted parameters.
    pub torque: SupervisedSettings,
    /// A net of targets on the simulator as it is.
    pub position: SupervisedSettings,
    /// A net of targets on the simulator as it is, taught by reward.
    pub reinforced: ReinforceSettings,
}

impl Default for NetsSettings {
    fn default() -> Self {
        Self {
            tried: true,
            length: 25,
            torque: SupervisedSettings::torque(),
            position: SupervisedSettings::default(),
            reinforced: ReinforceSettings { iterations: 120, ..Default::default() },
        }
    }
}

impl Default for LoopSettings {
    fn default() -> Self {
        Self {
            held_every: 5,
            window: 1.0,
            footing: 0.01,
            errors: 2.0,
            walks: 96,
            fit: FitSettings::default(),
            nets: NetsSettings::default(),
            tune: TuneSettings::default(),
        }
    }
}

/// Joint errors of a candidate on held-out windows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeldOut {
    /// Mean size of joint errors \[rad\].
    pub error: f64,
    /// Its standard error over stretches.
    pub error_se: f64,
    /// Mean size of each joint's error \[rad\].
    pub joints: Vec<f64>,
    /// How much less than the candidate that it must beat, and the standard error of the difference over stretches \[rad\].
    pub gain: [f64; 2],
    /// Whether it stays.
    pub stays: bool,
}

/// A candidate and what became of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// The corrections.
    pub compensation: Compensation,
    /// On held-out recordings.
    pub held_out: HeldOut,
    /// Paths of the policy that was trained on under it, in the simulator that no training has seen.
    pub paths: Option<PathScore>,
}

/// A stage's result that can be kept, so that a run that was stopped goes on.
pub trait Keep {
    /// What was kept under a name.
    fn get(&self, name: &str) -> Option<String>;
    /// Keeps a text.
    ///
    /// # Errors
    /// When it cannot be written.
    fn put(&self, name: &str, text: &str) -> Result<(), ResidualError>;
}

/// Keeps nothing.
pub struct Forget;

impl Keep for Forget {
    fn get(&self, _name: &str) -> Option<String> {
        None
    }
    fn put(&self, _name: &str, _text: &str) -> Result<(), ResidualError> {
        Ok(())
    }
}

impl LoopSettings {
    /// # Errors
    /// Names the first setting that means nothing.
    pub fn check(&self) -> Result<(), ResidualError> {
        let (fit, tune) = (&self.fit, &self.tune);
        let within = |what: &str, x: f64, low: f64, high: f64| {
            let expected = format!("{low} to {high}");
            if (low..=high).contains(&x) { Ok(()) } else { Err(ResidualError::input(what, expected, x)) }
        };
        within("held_every", self.held_every as f64, 2.0, 100.0)?;
        within("window", f64::from(self.window), 0.1, 4.0)?;
        within("footing", self.footing, 1e-4, 1.0)?;
        within("errors", self.errors, 0.0, 100.0)?;
        within("walks", self.walks as f64, 6.0, 1e5)?;
        within("fit.windows", fit.windows as f64, 10.0, 1e5)?;
        within("fit.length", fit.length as f64, 2.0, 100.0)?;
        within("fit.steps", fit.steps as f64, 1.0, 100.0)?;
        within("nets.length", self.nets.length as f64, 2.0, 1000.0)?;
        self.nets.torque.check()?;
        self.nets.position.check()?;
        within("nets.reinforced.iterations", self.nets.reinforced.iterations as f64, 1.0, 1e6)?;
        within("nets.reinforced.robots", self.nets.reinforced.robots as f64, 1.0, 1048576.0)?;
        within("nets.reinforced.std", f64::from(self.nets.reinforced.std), 1e-4, 1.0)?;
        within("nets.reinforced.clip", f64::from(self.nets.reinforced.clip), 1e-3, 10.0)?;
        within("tune.iterations", tune.iterations as f64, 1.0, 1e6)?;
        within("tune.robots", tune.robots as f64, 1.0, 1048576.0)?;
        within("tune.rate", f64::from(tune.rate), 1e-8, 1.0)?;
        within("tune.std", f64::from(tune.std), 1e-3, 10.0)?;
        within("tune.entropy", f64::from(tune.entropy), 0.0, 1.0)?;
        within("tune.spread", tune.spread, 0.0, 10.0)?;
        within("tune.averaged", f64::from(tune.averaged), 1.0, 1e6)?;
        within("tune.steady", f64::from(tune.steady), 0.0, 1e3)?;
        within("tune.steady_width", f64::from(tune.steady_width), 1e-4, 10.0)?;
        within("tune.calibration", tune.calibration as f64, 0.0, 1e5)?;
        within("tune.walks", tune.walks as f64, 6.0, 1e5)?;
        let p = &fit.prior;
        let spreads = [
            p.latency, p.lag, p.strength, p.kd_scale, p.coulomb, p.viscous, p.bias, p.backlash, p.limit, p.mass, p.com,
            p.friction,
        ];
        spreads.iter().chain(&p.shapes).try_for_each(|&x| within("fit.prior", x, 1e-9, 1e3))
    }
}

/// What goes in.
pub struct Inputs<'a> {
    /// The robot.
    pub robot: &'a TaskRobot,
    /// The ground of its recordings.
    pub ground: &'a Ground,
    /// The ground that policies are trained on and compared on; often the same.
    pub train_on: &'a Ground,
    /// Its recordings.
    pub log: &'a Log,
    /// Training of its policy.
    pub start: &'a Checkpoint,
    /// Parameters that are known already, such as those of a diagnosis.
    pub given: Option<&'a [(String, f64)]>,
    /// Settings.
    pub settings: &'a LoopSettings,
}

impl Inputs<'_> {
    /// A hash of all of it (FNV-1a, 64 bits): what was kept under another is of other inputs.
    pub fn key(&self) -> String {
        let text = serde_json::to_string(self.settings).unwrap_or_default();
        let best = self.start.best.as_ref().map(|(_, actor)| actor.iter().map(|x| x.to_bits()).collect::<Vec<_>>());
        let words = [
            env!("CARGO_PKG_VERSION").to_owned(),
            text,
            format!("{:?}", self.start.identity),
            format!("{:?} {:?} {best:?}", self.start.settings, self.given),
            format!("{:?}", self.ground.terrain),
            format!("{:?}", self.train_on.terrain),
        ];
        let bytes = words.iter().flat_map(|w| w.bytes().collect::<Vec<_>>());
        let numbers = self.log.stretches.iter().flat_map(|s| s.states.iter().chain(&s.targets));
        let numbers = numbers.chain(&self.start.parameters).flat_map(|x| x.to_bits().to_le_bytes());
        let grounds = [self.ground, self.train_on];
        let places = grounds.into_iter().flat_map(|g| g.places.iter().flatten().flatten());
        let places = places.flat_map(|x| x.to_bits().to_le_bytes());
        let all = bytes.chain(numbers).chain(places);
        let hash = all.fold(0xcbf2_9ce4_8422_2325u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3));
        format!("{hash:016x}")
    }
}

/// What comes out.
pub struct Outcome {
    /// The policy: trained on, or as it was.
    pub policy: Policy,
    /// What was found.
    pub report: Report,
}

/// Paths of one kind of command, before and after, in the simulator that no training has seen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PathPair {
    /// Command: forwards, to the left \[m/s\], turning \[rad/s\].
    pub command: [f32; 3],
    /// x, y \[m\] and heading \[rad\] of the policy as it was, at each decision.
    pub before: Path,
    /// Of the policy trained on.
    pub after: Path,
    /// What the simulator as it was promised of the policy as it was.
    pub promised: Path,
}

/// What was found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Robot.
    pub robot: String,
    /// Seconds of recordings that were used.
    pub seconds: f64,
    /// What was left out of them.
    pub told: Vec<String>,
    /// Candidates in the order in which they were tried.
    pub candidates: Vec<Candidate>,
    /// Index of the candidate whose policy was chosen; `None` = the policy is as it was.
    pub chosen: Option<usize>,
    /// Why.
    pub why: String,
    /// Paths of the policy as it was, in the simulator that no training has seen; walks that chose no policy, as those of `after` and `control`.
    pub before: PathScore,
    /// Paths of the policy that was chosen, there.
    pub after: PathScore,
    /// Paths of the policy trained on as long in the simulator as it was.
    pub control: Option<PathScore>,
    /// Some paths.
    pub paths: Vec<PathPair>,
    /// Settings in force.
    pub settings: LoopSettings,
}

/// What a caller hears while it goes.
pub enum Event<'a> {
    /// A stage begins: its name, number and how many there are at most.
    Stage(&'a str, usize, usize),
    /// Share of a stage that is done, and a figure.
    Progress(f64, String),
}

/// Closes the loop.
///
/// # Errors
/// When there is too little to fit or to hold out, or a number is not finite.
pub fn close(inputs: &Inputs, keep: &dyn Keep, tell: &mut dyn FnMut(Event)) -> Result<Outcome, ResidualError> {
    let settings = inputs.settings;
    let replayer = Replayer::new(inputs.log, inputs.robot, &inputs.ground.terrain, &inputs.start.settings.task);
    let length = (settings.window * inputs.log.rate).round().max(1.0) as usize;
    let footing = (!inputs.ground.terrain.is_plane()).then(|| Footing::new(&replayer));
    let picked = |wanted: &dyn Fn(usize) -> bool| picked(inputs, footing.as_ref(), length, wanted);
    let held = picked(&|k| stages::is_held(settings, k));
    let mut stretches: Vec<usize> = held.iter().map(|w| w.stretch).collect();
    stretches.dedup();
    let (all, kept) = (windows(inputs.log, length, |_| true).len(), picked(&|_| true).len());
    if stretches.len() < 3 || kept * 5 < all {
        let found = format!(
            "{:.0} s in {} stretches, and ground that agrees with the feet in {kept} of {all} windows",
            inputs.log.seconds(),
            inputs.log.stretches.len()
        );
        let expected = "at least 15 stretches of 2 to 10 s of walking on ground that is known to `footing`";
        return Err(ResidualError::input("recordings", expected, found));
    }
    let mut told = inputs.log.told.clone();
    if kept < all {
        told.push(format!(
            "{} of {all} windows of {} s are left out: feet and ground contradict each other by more than {} m in them",
            all - kept,
            settings.window,
            settings.footing
        ));
    }
    let tops = tops(&replayer);
    stages::Loop { inputs, replayer, footing, told, held, length, tops, keep, tell }.run()
}

/// Windows in which feet and ground agree.
fn picked(inputs: &Inputs, footing: Option<&Footing>, length: usize, wanted: &dyn Fn(usize) -> bool) -> Vec<Window> {
    let mut all = windows(inputs.log, length, wanted);
    if let Some(footing) = footing {
        all.retain(|w| footing.contradiction(*w, length) <= inputs.settings.footing);
    }
    all
}
