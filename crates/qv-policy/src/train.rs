//! A whole training: iterations, scores, the best policy so far, checkpoints.
//!
//! Time is cut into epochs. At the end of each all episodes begin anew, with random numbers that depend on the seed and the number of the
//! epoch alone; a checkpoint taken there holds networks, optimiser and curriculum, and no state of a simulator. So a training that
//! is taken up again has the bits of one that was never stopped.

use crate::PolicyError;
use crate::env::VectorEnv;
use crate::policy::{Policy, hash_of, model_hash};
use crate::ppo::{Iteration, Ppo, PpoSettings};
use crate::score::{GAIT_ROBOTS, Score, judge_gait, score};
use crate::velocity::{Ground, TaskRobot, TaskSettings, VelocityTask};
use qv_core::Mismatch;
use serde::{Deserialize, Serialize};

/// What a training is reported.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainSettings {
    /// Seed of everything.
    pub seed: u64,
    /// Robots at once.
    pub robots: usize,
    /// Iterations of an epoch.
    pub epoch: u64,
    /// Iterations from score to score.
    pub score_every: u64,
    /// Robots and seconds of a score.
    pub score_robots: usize,
    /// See `score_robots` \[s\].
    pub score_seconds: f32,
    /// The task.
    pub task: TaskSettings,
    /// The learner.
    pub ppo: PpoSettings,
}

impl Default for TrainSettings {
    fn default() -> Self {
        Self {
            seed: 0,
            robots: 256,
            epoch: 100,
            score_every: 20,
            score_robots: 64,
            score_seconds: 6.0,
            task: TaskSettings::default(),
            ppo: PpoSettings::default(),
        }
    }
}

/// Keys of the reward that earlier versions had: the bounds of swings and stances and the terms of landings have taken their place.
const REMOVED: [&str; 6] = ["air", "air_last", "air_epochs", "air_least", "air_most", "least"];

impl TrainSettings {
    /// Reads a `settings.toml`; keys that earlier versions had are left out and named. A whole file of a version without a clock has none.
    ///
    /// # Errors
    /// When the text is no such file; a key that is unknown is named with those that are known.
    pub fn parse(text: &str) -> Result<(Self, Vec<&'static str>), PolicyError> {
        let wrong = |e: toml::de::Error| PolicyError::Text { what: "settings".into(), reason: e.to_string() };
        let mut table: toml::Table = toml::from_str(text).map_err(wrong)?;
        let mut task = table.get_mut("task").and_then(toml::Value::as_table_mut);
        // A whole file names every setting, so one without a clock was written before there was one.
        if let Some(task) = task.as_mut().filter(|task| task.contains_key("rate") && !task.contains_key("clock")) {
            task.insert("clock".into(), 0.0.into());
        }
        let reward = task.and_then(|task| task.get_mut("reward")).and_then(toml::Value::as_table_mut);
        let removed = reward.map_or_else(Vec::new, |reward| {
            REMOVED.into_iter().filter(|key| reward.remove(*key).is_some()).collect::<Vec<_>>()
        });
        Ok((table.try_into().map_err(wrong)?, removed))
    }

    /// # Errors
    /// Names the first setting that means nothing.
    pub fn check(&self) -> Result<(), PolicyError> {
        for (what, count) in [("robots", self.robots), ("score_robots", self.score_robots)] {
            if count == 0 || count > 1 << 20 {
                return Err(PolicyError::setting(what, "1 to 1048576", count));
            }
        }
        if self.epoch == 0 || self.score_every == 0 {
            return Err(PolicyError::setting("epoch and score_every", "at least 1", self.epoch.min(self.score_every)));
        }
        // The first second does not count.
        if !(2.0..=1e4).contains(&self.score_seconds) {
            return Err(PolicyError::setting("score_seconds", "2 to 10000", self.score_seconds));
        }
        finite(self)?;
        self.task.check()?;
        self.ppo.check()
    }
}

/// One line of the metrics.
#[derive(Debug, Clone, Serialize)]
pub struct Line {
    /// What the learner did.
    #[serde(flatten)]
    pub iteration: Iteration,
    /// Samples so far.
    pub samples: u64,
    /// Figures of the task, by name.
    pub figures: Vec<(&'static str, f32)>,
    /// Score, in iterations that were scored.
    pub score: Option<Score>,
}

/// Iterations over which the mean of the actor's numbers runs, which is what is scored and kept: it follows commands more exactly than any of
/// them (Polyak and Juditsky 1992).
const AVERAGED: f32 = 20.0;

/// A training that goes on as long as it is asked to.
pub struct Training {
    settings: TrainSettings,
    env: VelocityTask,
    judge: VelocityTask,
    gait_judge: VelocityTask,
    ppo: Ppo,
    best: Option<(Score, Policy)>,
    epoch: u64,
    /// Mean of the actor's numbers over the last iterations of the epoch, see [`AVERAGED`].
    mean: Vec<f32>,
    /// Networks, optimiser and curriculum when the epoch began.
    kept: Checkpoint,
}

/// All that a training needs to go on from the beginning of an epoch.
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpoint {
    /// Settings of the training.
    pub settings: TrainSettings,
    /// Robot and ground, see [`identity`].
    pub identity: [String; 2],
    /// Epoch that begins.
    pub epoch: u64,
    /// Iterations done.
    pub iterations: u64,
    /// Steps of the optimiser.
    pub steps: u64,
    /// Learning rate.
    pub rate: f32,
    /// Networks and spreads.
    pub parameters: Vec<f32>,
    /// The optimiser's means.
    pub first: Vec<f32>,
    /// See `first`.
    pub second: Vec<f32>,
    /// Curriculum of the task.
    pub curriculum: Vec<f32>,
    /// Best policy so far and its score.
    pub best: Option<(Score, Vec<f32>)>,
}

impl Checkpoint {
    /// The best policy so far, else the last, for a robot.
    ///
    /// # Errors
    /// When the checkpoint is another robot's.
    pub fn best_policy(&self, robot: &TaskRobot) -> Result<Policy, PolicyError> {
        let ground = Ground::plane();
        let settings = TrainSettings { robots: 1, score_robots: 1, ..self.settings.clone() };
        let own = identity(robot, &ground)[0].clone();
        if own != self.identity[0] {
            let (expected, found) = (format!("one of {own}"), format!("one of {}", self.identity[0]));
            return Err(PolicyError::Mismatch(Mismatch::new("checkpoint", expected, found)));
        }
        let training = Training::new(robot, &ground, &settings)?;
        training.fits(self)?;
        let mut policy = training.policy();
        let actor = self.best.as_ref().map_or(&self.parameters, |(_, actor)| actor);
        let count = policy.parameters.len();
        policy.parameters.copy_from_slice(&actor[..count]);
        Ok(policy)
    }
}

/// Names of robot and ground that a training belongs to, with a hash of what they are made of.
pub fn identity(robot: &TaskRobot, ground: &Ground) -> [String; 2] {
    let numbers = format!("{:?} {:?} {:?} {:?}", robot.stand, robot.kp, robot.kd, robot.action_scale);
    let robot = format!("the robot {} ({} {})", robot.name, model_hash(robot), hash_of(&numbers));
    let places = hash_of(&format!("{:?} {}", ground.places, ground.terrain.triangle_count()));
    [robot, format!("the ground {} ({places})", ground.kinds.join(", "))]
}

impl Training {
    /// Begins a training.
    ///
    /// # Errors
    /// When a setting means nothing or the simulator refuses the robot.
    pub fn new(robot: &TaskRobot, ground: &Ground, settings: &TrainSettings) -> Result<Self, PolicyError> {
        settings.check()?;
        let env = VelocityTask::new(robot.clone(), ground.clone(), settings.task.clone(), settings.robots)?;
        let judge = VelocityTask::new(robot.clone(), ground.clone(), settings.task.clone(), settings.score_robots)?;
        let gait_judge = VelocityTask::new(robot.clone(), ground.clone(), settings.task.clone(), GAIT_ROBOTS)?;
        let ppo = Ppo::new(&settings.ppo, &env, settings.seed)?;
        let kept = Checkpoint {
            settings: settings.clone(),
            identity: identity(robot, ground),
            epoch: 0,
            iterations: 0,
            steps: 0,
            rate: 0.0,
            parameters: Vec::new(),
            first: Vec::new(),
            second: Vec::new(),
            curriculum: Vec::new(),
            best: None,
        };
        let mut training = Self {
            settings: settings.clone(),
            env,
            judge,
            gait_judge,
            ppo,
            best: None,
            epoch: 0,
            mean: Vec::new(),
            kept,
        };
        training.begin_epoch()?;
        Ok(training)
    }

    /// Begins from the networks of another training, with fresh optimiser, such as one on easier ground.
    ///
    /// # Errors
    /// When its networks have other sizes.
    pub fn start_from(&mut self, other: &Checkpoint) -> Result<(), PolicyError> {
        self.fits(other)?;
        if other.iterations == 0 {
            let (expected, found) = ("a checkpoint after iteration 0", "iteration 0");
            return Err(PolicyError::Mismatch(Mismatch::new("checkpoint", expected, found)));
        }
        self.ppo.parameters.clone_from(&other.parameters);
        self.ppo.rate = other.rate.min(self.settings.ppo.rate);
        self.begin_epoch()
    }

    /// Goes on from a checkpoint of the same settings.
    ///
    /// # Errors
    /// When it is of other settings or another robot.
    pub fn resume(robot: &TaskRobot, ground: &Ground, kept: &Checkpoint) -> Result<Self, PolicyError> {
        for (own, other) in identity(robot, ground).into_iter().zip(&kept.identity) {
            if own != *other {
                let (expected, found) = (format!("one of {own}"), format!("one of {other}"));
                return Err(PolicyError::Mismatch(Mismatch::new("checkpoint", expected, found)));
            }
        }
        let mut training = Self::new(robot, ground, &kept.settings)?;
        training.fits(kept)?;
        let ppo = &mut training.ppo;
        ppo.parameters.clone_from(&kept.parameters);
        ppo.adam.first.clone_from(&kept.first);
        ppo.adam.second.clone_from(&kept.second);
        ppo.adam.steps = kept.steps;
        ppo.rate = kept.rate;
        ppo.iterations = kept.iterations;
        training.epoch = kept.epoch;
        training.env.set_curriculum(&kept.curriculum);
        if let Some((score, parameters)) = &kept.best {
            let policy = Policy { parameters: parameters.clone(), ..Policy::of(&training.ppo) };
            training.best = Some((score.clone(), policy));
        }
        training.begin_epoch()?;
        Ok(training)
    }

    fn fits(&self, kept: &Checkpoint) -> Result<(), PolicyError> {
        let expected = self.ppo.parameters.len();
        let sizes = [kept.parameters.len(), kept.first.len(), kept.second.len()];
        if sizes.iter().all(|&size| size == expected) {
            return Ok(());
        }
        let expected = format!("networks of {expected} numbers (`clock` = {})", self.settings.task.clock);
        let found = format!("{sizes:?} (`clock` = {})", kept.settings.task.clock);
        Err(PolicyError::Mismatch(Mismatch::new("checkpoint", expected, found)))
    }

    fn begin_epoch(&mut self) -> Result<(), PolicyError> {
        self.kept = self.state(self.epoch);
        self.mean = Policy::of(&self.ppo).parameters;
        self.env.restart(self.settings.seed, self.epoch)?;
        self.ppo.mirrors = self.epoch < self.settings.ppo.symmetry_epochs;
        // Exploration gives way to exactness: noise starts a robot that would stand still without it, and hides that.
        self.ppo.entropy_share = 1.0 - self.settings.task.reward.narrowed(self.epoch);
        self.ppo.reseed(self.settings.seed, self.epoch, self.settings.robots);
        Ok(())
    }

    /// Networks, optimiser and curriculum as they are, with an epoch to begin.
    fn state(&self, epoch: u64) -> Checkpoint {
        Checkpoint {
            settings: self.settings.clone(),
            identity: self.kept.identity.clone(),
            epoch,
            iterations: self.ppo.iterations,
            steps: self.ppo.adam.steps,
            rate: self.ppo.rate,
            parameters: self.ppo.parameters.clone(),
            first: self.ppo.adam.first.clone(),
            second: self.ppo.adam.second.clone(),
            curriculum: self.env.curriculum(),
            best: self.best.as_ref().map(|(score, policy)| (score.clone(), policy.parameters.clone())),
        }
    }

    /// The state after the last iteration. Within an epoch all episodes begin anew when a training goes on from it, so that its bits are other ones
    /// than those of a training that was not stopped; [`Training::checkpoint`] has the same bits.
    pub fn checkpoint_now(&self) -> Checkpoint {
        let is_between = self.ppo.iterations == self.kept.iterations;
        self.state(if is_between { self.epoch } else { self.epoch + 1 })
    }

    /// The learner.
    pub fn ppo(&self) -> &Ppo {
        &self.ppo
    }

    /// The learner, to change its spread or rate before the first iteration.
    pub fn ppo_mut(&mut self) -> &mut Ppo {
        &mut self.ppo
    }

    /// The task that is trained on, to add torques of shapes.
    pub fn task_mut(&mut self) -> &mut VelocityTask {
        &mut self.env
    }

    /// The state at the beginning of the present epoch.
    pub fn checkpoint(&self) -> &Checkpoint {
        &self.kept
    }

    /// Best policy so far, by [`Score::cost`].
    pub fn best(&self) -> Option<&(Score, Policy)> {
        self.best.as_ref()
    }

    /// The present policy, with the mean of the last iterations' numbers.
    pub fn policy(&self) -> Policy {
        Policy { parameters: self.mean.clone(), ..Policy::of(&self.ppo) }
    }

    /// One iteration, and a score where one is due.
    ///
    /// # Errors
    /// When a number is not finite: which, and where.
    pub fn advance(&mut self) -> Result<Line, PolicyError> {
        let iteration = self.ppo.iterate(&mut self.env)?;
        let done = self.ppo.iterations;
        // Of an epoch, so that a training that is taken up again has the same.
        let share = 1.0 / ((done - self.kept.iterations) as f32).clamp(1.0, AVERAGED);
        self.mean.iter_mut().zip(&self.ppo.parameters).for_each(|(mean, x)| *mean += share * (x - *mean));
        let samples = done * (self.settings.robots * self.settings.ppo.steps) as u64;
        let mut line = Line { iteration, samples, figures: self.env.figures(), score: None };
        if done.is_multiple_of(self.settings.score_every) {
            line.score = Some(self.judge_now()?);
        }
        if done.is_multiple_of(self.settings.epoch) {
            self.epoch += 1;
            self.begin_epoch()?;
        }
        Ok(line)
    }

    /// Scores the present policy, and keeps it if it is the best.
    ///
    /// # Errors
    /// When a number is not finite.
    pub fn judge_now(&mut self) -> Result<Score, PolicyError> {
        let policy = self.policy();
        let commands = self.settings.task.commands.clone();
        let (seconds, seed) = (self.settings.score_seconds, self.settings.seed);
        let mut found = score(&policy, &mut self.judge, &commands, seconds, seed)?;
        found.gait = Some(judge_gait(&policy, &mut self.gait_judge, &commands, seconds, seed)?);
        if self.best.as_ref().is_none_or(|(best, _)| found.cost() < best.cost()) {
            self.best = Some((found.clone(), policy));
        }
        Ok(found)
    }
}

/// Looks at every number of the settings.
fn finite(settings: &TrainSettings) -> Result<(), PolicyError> {
    let text = |e: toml::ser::Error| PolicyError::Text { what: "settings".into(), reason: e.to_string() };
    match odd("", &toml::Value::try_from(settings).map_err(text)?) {
        Some((key, found)) => Err(PolicyError::setting(&key, "a finite number", found)),
        None => Ok(()),
    }
}

/// The first number that is not finite, with its key.
fn odd(key: &str, value: &toml::Value) -> Option<(String, f64)> {
    let below = |name: &str| if key.is_empty() { name.to_owned() } else { format!("{key}.{name}") };
    match value {
        toml::Value::Float(x) if !x.is_finite() => Some((key.to_owned(), *x)),
        toml::Value::Array(list) => list.iter().find_map(|x| odd(key, x)),
        toml::Value::Table(table) => table.iter().find_map(|(name, x)| odd(&below(name), x)),
        _ => None,
    }
}
