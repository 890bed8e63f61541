//! The whole of it: from recordings and a policy to a policy that follows its commands better on the robot, or the word that nothing is
//! to be gained.
//!
//! Stretches of the recordings are dealt out: four of five are for fits, the fifth is held out. A candidate stays when its error on held-out
//! windows is less than that of the one before by two standard errors over stretches. Policies are trained on under what stayed; they are
//! compared in a simulator that is fitted to the held-out stretches alone, which no training has seen.

use crate::ResidualError;
use crate::compensation::Compensation;
use crate::identify::{Coordinate, Fit, FitSettings, Fitter, coordinates, tops};
use crate::log::Log;
use crate::paths::{Path, PathScore, commands, walk};
use crate::tune::{SECONDS, TuneSettings, judge_of, train_on};
use crate::windows::{Errors, Replayer, Window, windows};
use qv_policy::policy::Policy;
use qv_policy::score::mean_with_error;
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
    /// Standard errors by which a candidate must be better.
    pub errors: f64,
    /// Walks by which policies are compared.
    pub walks: usize,
    /// Fits.
    pub fit: FitSettings,
    /// Training.
    pub tune: TuneSettings,
}

impl Default for LoopSettings {
    fn default() -> Self {
        Self {
            held_every: 5,
            window: 1.0,
            errors: 2.0,
            walks: 96,
            fit: FitSettings::default(),
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
        within("errors", self.errors, 0.0, 100.0)?;
        within("walks", self.walks as f64, 6.0, 1e5)?;
        within("fit.windows", fit.windows as f64, 10.0, 1e5)?;
        within("fit.length", fit.length as f64, 2.0, 100.0)?;
        within("fit.steps", fit.steps as f64, 1.0, 100.0)?;
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
    /// The ground that it walks on.
    pub ground: &'a Ground,
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
        let words = [text, format!("{:?}", self.start.identity), format!("{:?} {:?}", self.start.settings, self.given)];
        let bytes = words.iter().flat_map(|w| w.bytes().collect::<Vec<_>>());
        let numbers = self.log.stretches.iter().flat_map(|s| s.states.iter().chain(&s.targets));
        let numbers = numbers.chain(&self.start.parameters).flat_map(|x| x.to_bits().to_le_bytes());
        let grounds = self.ground.places.iter().flatten().flatten().flat_map(|x| x.to_bits().to_le_bytes());
        let all =
            bytes.chain(numbers).chain(grounds).chain((self.ground.terrain.triangle_count() as u64).to_le_bytes());
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
    /// Paths of the policy as it was, in the simulator that no training has seen.
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

/// Mean over stretches, one entry each.
fn by_stretch(errors: &Errors, held: &[Window]) -> Vec<f64> {
    let lanes = errors.by_lane();
    let mut stretches: Vec<usize> = held.iter().map(|w| w.stretch).collect();
    stretches.dedup();
    let of = |stretch: usize| {
        let own: Vec<f64> = held.iter().zip(&lanes).filter(|(w, _)| w.stretch == stretch).map(|(_, e)| *e).collect();
        own.iter().sum::<f64>() / own.len() as f64
    };
    stretches.into_iter().map(of).collect()
}

/// What the stages share.
struct Loop<'a, 'b> {
    inputs: &'a Inputs<'a>,
    replayer: Replayer<'a>,
    held: Vec<Window>,
    tops: Vec<f64>,
    keep: &'a dyn Keep,
    tell: &'b mut dyn FnMut(Event),
}

/// Names of the stages.
const STAGES: [&str; 7] = [
    "held-out error of the simulator as it is",
    "fitting parameters",
    "fitting parameters and torques",
    "fitting to held-out recordings alone",
    "training on in the simulator as it is",
    "training on with parameters",
    "training on with parameters and torques",
];

/// Closes the loop.
///
/// # Errors
/// When there is too little to fit or to hold out, or a number is not finite.
pub fn close(inputs: &Inputs, keep: &dyn Keep, tell: &mut dyn FnMut(Event)) -> Result<Outcome, ResidualError> {
    let settings = inputs.settings;
    let replayer = Replayer::new(inputs.log, inputs.robot, &inputs.ground.terrain, &inputs.start.settings.task);
    let length = (settings.window * inputs.log.rate).round().max(1.0) as usize;
    let is_held = |k: usize| k % settings.held_every == settings.held_every - 1;
    let held = windows(inputs.log, length, is_held);
    let mut stretches: Vec<usize> = held.iter().map(|w| w.stretch).collect();
    stretches.dedup();
    if stretches.len() < 3 {
        let found = format!("{:.0} s in {} stretches", inputs.log.seconds(), inputs.log.stretches.len());
        return Err(ResidualError::input("recordings", "at least 15 stretches of 2 to 10 s of walking", found));
    }
    let tops = tops(&replayer);
    let mut all = Loop { inputs, replayer, held, tops, keep, tell };
    all.run(length, &is_held)
}

impl Loop<'_, '_> {
    fn begin(&mut self, stage: usize) {
        (self.tell)(Event::Stage(STAGES[stage], stage + 1, STAGES.len()));
    }

    fn run(&mut self, length: usize, is_held: &dyn Fn(usize) -> bool) -> Result<Outcome, ResidualError> {
        let Inputs { robot, start, settings, .. } = *self.inputs;
        self.begin(0);
        let mut candidates: Vec<Candidate> = Vec::new();
        let (nominal, mut best) = self.candidate(Compensation::nominal(robot), length, None)?;
        candidates.push(nominal);
        if let Some(given) = self.inputs.given {
            self.add(&mut candidates, &mut best, Compensation::given(robot, given), length)?;
        }
        self.begin(1);
        let parameters = self.fit("parameters", false, None, &|k| !is_held(k))?;
        self.add(&mut candidates, &mut best, self.compensation("parameters", &parameters)?, length)?;
        self.begin(2);
        let torques = self.fit("torques", true, Some(&parameters), &|k| !is_held(k))?;
        self.add(&mut candidates, &mut best, self.compensation("parameters and torques", &torques)?, length)?;
        let policy = start.best_policy(robot)?;
        let staying: Vec<usize> = (1..candidates.len()).filter(|&k| candidates[k].held_out.stays).collect();
        let judging = match staying.last() {
            None => Compensation::nominal(robot),
            Some(&last) => self.judging(&parameters, !candidates[last].compensation.shapes.is_empty(), is_held)?,
        };
        let mut scored = Scored::new(self.inputs, &judging)?;
        let before = scored.score(&policy)?;
        let mut report = Report {
            robot: robot.name.clone(),
            seconds: self.inputs.log.seconds(),
            told: self.inputs.log.told.clone(),
            candidates,
            chosen: None,
            why: String::new(),
            before,
            after: before,
            control: None,
            paths: Vec::new(),
            settings: settings.clone(),
        };
        if staying.is_empty() {
            report.why = format!(
                "Nothing in these recordings differs from the simulator by more than {} standard errors: the policy is as it was.",
                settings.errors
            );
            return Ok(Outcome { policy, report });
        }
        self.begin(4);
        let control = self.train("control", &Compensation::nominal(robot))?;
        report.control = Some(scored.score(&control)?);
        let mut chosen = (before.cost(), policy.clone());
        // Of the given and the fitted parameters the better is trained under, and what is beyond them beside.
        let mut trained: Vec<usize> = staying.iter().rev().take(2).copied().collect();
        trained.reverse();
        for (step, &k) in trained.iter().enumerate() {
            self.begin(5 + step.min(1));
            let tuned = self.train(&format!("policy {k}"), &report.candidates[k].compensation)?;
            let found = scored.score(&tuned)?;
            report.candidates[k].paths = Some(found);
            if found.cost() < chosen.0 {
                chosen = (found.cost(), tuned);
                report.chosen = Some(k);
                report.after = found;
            }
        }
        let apart = (report.before.position_se.powi(2) + report.after.position_se.powi(2)).sqrt();
        if report.before.cost() - report.after.cost() < settings.errors as f32 * apart {
            report.why = "No policy that was trained on follows its commands better than the one that was given, by more than chance: \
                          the policy is as it was."
                .into();
            report.chosen = None;
            report.after = before;
            chosen.1 = policy.clone();
        } else if let Some(k) = report.chosen {
            report.why = format!(
                "The policy trained on with {} strays least where no training has been: {:.3} m from the commanded path over 8 s, \
                 {:.3} m before.",
                report.candidates[k].compensation.kind, report.after.position, before.position
            );
        }
        report.paths = scored.pairs(&policy, &chosen.1)?;
        Ok(Outcome { policy: chosen.1, report })
    }

    /// A simulator fitted to the held-out stretches alone, as rich as the richest candidate that stays.
    fn judging(
        &mut self,
        parameters: &Fit,
        with_torques: bool,
        is_held: &dyn Fn(usize) -> bool,
    ) -> Result<Compensation, ResidualError> {
        self.begin(3);
        let fit = match with_torques {
            true => self.fit("judge torques", true, Some(parameters), is_held)?,
            false => self.fit("judge", false, None, is_held)?,
        };
        self.compensation("judge", &fit)
    }

    /// A candidate on held-out windows, with its error on each stretch.
    fn candidate(
        &self,
        compensation: Compensation,
        length: usize,
        beat: Option<&[f64]>,
    ) -> Result<(Candidate, Vec<f64>), ResidualError> {
        let errors = compensation.replay(&self.replayer, &self.held, length)?;
        let own = by_stretch(&errors, &self.held);
        let [error, error_se] = mean_with_error(&own);
        let gains: Vec<f64> = beat.map_or_else(Vec::new, |beat| beat.iter().zip(&own).map(|(b, o)| b - o).collect());
        let gain = mean_with_error(&gains);
        let stays = beat.is_none() || gain[0] > self.inputs.settings.errors * gain[1];
        let held_out = HeldOut { error, error_se, joints: errors.by_joint(), gain, stays };
        Ok((Candidate { compensation, held_out, paths: None }, own))
    }

    /// Tries a candidate against the best so far.
    fn add(
        &self,
        candidates: &mut Vec<Candidate>,
        best: &mut Vec<f64>,
        compensation: Compensation,
        length: usize,
    ) -> Result<(), ResidualError> {
        let (candidate, own) = self.candidate(compensation, length, Some(best))?;
        if candidate.held_out.stays {
            *best = own;
        }
        candidates.push(candidate);
        Ok(())
    }

    fn compensation(&self, kind: &str, fit: &Fit) -> Result<Compensation, ResidualError> {
        let spread = self.inputs.settings.tune.spread;
        Compensation::of_fit(kind, &self.replayer, &fit.coordinates, &fit.point, &fit.deviations, spread)
    }

    fn fit(
        &mut self,
        name: &str,
        with_shapes: bool,
        from: Option<&Fit>,
        wanted: &dyn Fn(usize) -> bool,
    ) -> Result<Fit, ResidualError> {
        let settings = &self.inputs.settings.fit;
        let coordinates = coordinates(&self.replayer, &settings.prior, &self.tops, with_shapes)?;
        if let Some(kept) = self.keep.get(name).and_then(|text| kept_fit(&text, &coordinates)) {
            return Ok(kept);
        }
        let all = windows(self.inputs.log, settings.length, wanted);
        let every = (all.len() / settings.windows).max(1);
        let chosen: Vec<Window> = all.into_iter().step_by(every).take(settings.windows).collect();
        let mut start: Vec<f64> = coordinates.iter().map(|c| c.neutral).collect();
        if let Some(from) = from {
            // The shapes come after all others.
            start[..from.point.len()].copy_from_slice(&from.point);
        }
        let fitter = Fitter { replayer: &self.replayer, coordinates, windows: chosen, settings };
        let (tell, steps) = (&mut self.tell, settings.steps as f64);
        let fit = fitter.fit(&start, |step, cost| {
            tell(Event::Progress((step as f64 + 1.0) / steps, format!("cost {cost:.0}")));
        })?;
        let text = serde_json::to_string(&(&fit.point, &fit.deviations, &fit.costs)).unwrap_or_default();
        self.keep.put(name, &text)?;
        Ok(fit)
    }

    fn train(&mut self, name: &str, compensation: &Compensation) -> Result<Policy, ResidualError> {
        let Inputs { robot, ground, start, settings, .. } = *self.inputs;
        let mut policy = start.best_policy(robot)?;
        let kept: Option<Vec<f32>> = self.keep.get(name).and_then(|text| serde_json::from_str(&text).ok());
        if let Some(kept) = kept.filter(|kept| kept.len() == policy.parameters.len()) {
            policy.parameters = kept;
            return Ok(policy);
        }
        let (tell, all) = (&mut self.tell, settings.tune.iterations as f64);
        let tuned = train_on(robot, ground, start, &compensation.corrected(robot), &settings.tune, |line, score| {
            if let Some(score) = score {
                let share = (line.iteration.index as f64 + 1.0) / all;
                tell(Event::Progress(share, format!("{:.3} m off the commanded path", score.position)));
            }
        })?;
        self.keep.put(name, &serde_json::to_string(&tuned.parameters).unwrap_or_default())?;
        Ok(tuned)
    }
}

/// A fit that was kept, if it is of these coordinates.
fn kept_fit(text: &str, coordinates: &[Coordinate]) -> Option<Fit> {
    let (point, deviations, costs): (Vec<f64>, Vec<f64>, Vec<f64>) = serde_json::from_str(text).ok()?;
    let fits = point.len() == coordinates.len() && deviations.len() == point.len();
    fits.then(|| Fit { coordinates: coordinates.to_vec(), point, deviations, costs })
}

/// Walks in the simulator that no training has seen.
struct Scored {
    task: qv_policy::velocity::VelocityTask,
    nominal: qv_policy::velocity::VelocityTask,
    commands: Vec<[f32; 3]>,
    seed: u64,
}

/// Makes the commands of scores others than those of the choice of iterations.
const SCORING: u64 = 0x5c0e;

impl Scored {
    fn new(inputs: &Inputs, judging: &Compensation) -> Result<Self, ResidualError> {
        let (robot, task, walks) = (inputs.robot, &inputs.start.settings.task, inputs.settings.walks);
        let seed = inputs.settings.tune.seed ^ SCORING;
        Ok(Self {
            task: judge_of(robot, inputs.ground, task, &judging.corrected(robot), walks)?,
            nominal: judge_of(robot, inputs.ground, task, &Compensation::nominal(robot).corrected(robot), walks)?,
            commands: commands(&task.commands, walks, seed),
            seed,
        })
    }

    fn score(&mut self, policy: &Policy) -> Result<PathScore, ResidualError> {
        crate::tune::score(policy, &mut self.task, &self.commands, self.seed)
    }

    /// One walk of each kind of command.
    fn pairs(&mut self, before: &Policy, after: &Policy) -> Result<Vec<PathPair>, ResidualError> {
        let old = walk(before, &mut self.task, &self.commands, SECONDS, self.seed)?;
        let new = walk(after, &mut self.task, &self.commands, SECONDS, self.seed)?;
        let promised = walk(before, &mut self.nominal, &self.commands, SECONDS, self.seed)?;
        let kinds = crate::paths::KINDS.len();
        let pair = |k: usize| PathPair {
            command: self.commands[k],
            before: old[k].0.clone(),
            after: new[k].0.clone(),
            promised: promised[k].0.clone(),
        };
        Ok((0..kinds.min(self.commands.len())).map(pair).collect())
    }
}
