//! The policy trained on under what was learnt of the robot.

use crate::ResidualError;
use crate::calibrate::{calibrated, response};
use crate::paths::{PathScore, SECONDS, commands, walk};
use qv_policy::policy::Policy;
use qv_policy::shape_torques::ShapeTorques;
use qv_policy::train::{Checkpoint, Line, TrainSettings, Training};
use qv_policy::velocity::{Ground, TaskRobot, TaskSettings, VelocityTask};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// How a policy is trained on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TuneSettings {
    /// Iterations.
    pub iterations: u64,
    /// Robots at once.
    pub robots: usize,
    /// Learning rate at the start.
    pub rate: f32,
    /// Standard deviation of the actions at the start.
    pub std: f32,
    /// Weight of the entropy.
    pub entropy: f32,
    /// Posterior standard deviations within which robots differ.
    pub spread: f64,
    /// Iterations over which weights are averaged.
    pub averaged: f32,
    /// Weight of the reward for the mean of the velocity, see [`qv_policy::velocity::Reward::steady`].
    pub steady: f32,
    /// Drift at which that reward has fallen to a half \[m/s, rad/s\], see [`qv_policy::velocity::Reward::steady_width`].
    pub steady_width: f32,
    /// Walks by which commands are calibrated in the end, see [`crate::calibrate`]; 0 = they are not.
    pub calibration: usize,
    /// Walks by which the best iteration is chosen, in the corrected simulator.
    pub walks: usize,
    /// Seed.
    pub seed: u64,
}

impl Default for TuneSettings {
    fn default() -> Self {
        Self {
            iterations: 100,
            robots: 512,
            rate: 3e-4,
            std: 0.25,
            entropy: 0.001,
            spread: 1.645,
            averaged: 20.0,
            steady: 2.0,
            steady_width: 0.02,
            calibration: 192,
            walks: 48,
            seed: 0,
        }
    }
}

/// A simulator made like the robot.
pub struct CorrectedSimulator {
    /// Parameters of the simulator.
    pub parameters: BTreeMap<String, f64>,
    /// Ranges within which robots differ in training.
    pub ranges: BTreeMap<String, [f64; 2]>,
    /// Torques that it lacks beside them.
    pub torques: Option<ShapeTorques>,
}

impl CorrectedSimulator {
    /// The simulator as it is.
    pub fn nominal() -> Self {
        Self { parameters: BTreeMap::new(), ranges: BTreeMap::new(), torques: None }
    }

    /// The task of a training, with these corrections. What is drawn for several joints together would be drawn last, over what was identified:
    /// it is left out.
    pub fn task(&self, task: &TaskSettings) -> TaskSettings {
        let mut task = task.clone();
        let is_identified = |(before, after): (&str, &str)| {
            let mut names = self.parameters.keys().chain(self.ranges.keys());
            names.any(|name| name.starts_with(before) && name.ends_with(after))
        };
        let together = &mut task.randomise.together;
        together.retain(|pattern, _| !is_identified(pattern.split_once('*').unwrap_or((pattern, ""))));
        task.parameters.extend(self.parameters.clone());
        task.randomise.parameters.extend(self.ranges.clone());
        task
    }
}

/// Trains a policy on from a checkpoint's best networks, under corrections. `notify` hears of each iteration.
///
/// # Errors
/// When the checkpoint is another robot's, or a number is not finite.
pub fn train_on(
    robot: &TaskRobot,
    ground: &Ground,
    start: &Checkpoint,
    corrected: &CorrectedSimulator,
    settings: &TuneSettings,
    mut notify: impl FnMut(&Line, Option<&PathScore>),
) -> Result<Policy, ResidualError> {
    let mut train = TrainSettings { seed: settings.seed, robots: settings.robots, ..start.settings.clone() };
    train.task = corrected.task(&train.task);
    // Weights that grow over a training are those of its end.
    train.task.reward = train.task.reward.risen();
    train.task.commands.single_axis_from = 0;
    train.task.reward.steady = settings.steady;
    train.task.reward.steady_width = settings.steady_width;
    train.ppo.rate = settings.rate;
    train.ppo.entropy = settings.entropy;
    train.ppo.least_std = train.ppo.least_std.min(settings.std);
    train.epoch = settings.iterations.max(1);
    // The best is chosen by paths, below.
    train.score_every = 1 << 40;
    let mut training = Training::new(robot, ground, &train)?;
    training.task_mut().set_shape_torques(corrected.torques.clone());
    training.start_from(&with_best(start))?;
    training.ppo_mut().set_std(settings.std);
    let mut judge = judge_of(robot, ground, &start.settings.task, corrected, settings.walks)?;
    let commands = commands(&start.settings.task.commands, settings.walks, settings.seed ^ CHOOSING);
    let mut mean = training.policy();
    let mut best = (f32::INFINITY, training.policy());
    let every = (settings.iterations / 10).max(1);
    while training.ppo().iterations < settings.iterations {
        let line = training.advance()?;
        // The mean of the last iterations' weights (Polyak and Juditsky 1992) strays less than any of them.
        let now = training.policy();
        let share = 1.0 / (training.ppo().iterations as f32).min(settings.averaged);
        mean.parameters.iter_mut().zip(&now.parameters).for_each(|(mean, x)| *mean += share * (x - *mean));
        let mut found = None;
        if training.ppo().iterations.is_multiple_of(every) {
            let policy = mean.clone();
            let score = score(&policy, &mut judge, &commands, settings.seed)?;
            if score.cost() < best.0 {
                best = (score.cost(), policy);
            }
            found = Some(score);
        }
        notify(&line, found.as_ref());
    }
    if let Some(policy) = with_calibrated_commands(&best.1, robot, ground, start, corrected, settings)? {
        let score = score(&policy, &mut judge, &commands, settings.seed)?;
        if score.cost() < best.0 {
            best.1 = policy;
        }
    }
    Ok(best.1)
}

/// The policy with its commands calibrated under corrections, see [`crate::calibrate`]. `None` when `settings` ask for no walks, when most of
/// the walks fall, or when the response has no inverse.
///
/// # Errors
/// When a number is not finite.
pub fn with_calibrated_commands(
    policy: &Policy,
    robot: &TaskRobot,
    ground: &Ground,
    start: &Checkpoint,
    corrected: &CorrectedSimulator,
    settings: &TuneSettings,
) -> Result<Option<Policy>, ResidualError> {
    if settings.calibration == 0 {
        return Ok(None);
    }
    let task = &start.settings.task;
    let mut many = judge_of(robot, ground, task, corrected, settings.calibration)?;
    let response = response(policy, &mut many, &task.commands, settings.seed)?;
    Ok(response.and_then(|response| calibrated(policy, &response)))
}

/// Makes the commands by which an iteration is chosen others than those of scores.
const CHOOSING: u64 = 0x7a11;

/// Robots that walk in the corrected simulator for scores.
///
/// # Errors
/// When the simulator refuses a correction.
pub fn judge_of(
    robot: &TaskRobot,
    ground: &Ground,
    task: &TaskSettings,
    corrected: &CorrectedSimulator,
    walks: usize,
) -> Result<VelocityTask, ResidualError> {
    let mut judge = VelocityTask::new(robot.clone(), ground.clone(), corrected.task(task), walks)?;
    judge.set_shape_torques(corrected.torques.clone());
    Ok(judge)
}

/// Paths of a policy under commands.
///
/// # Errors
/// When a number is not finite.
pub fn score(
    policy: &Policy,
    judge: &mut VelocityTask,
    commands: &[[f32; 3]],
    seed: u64,
) -> Result<PathScore, ResidualError> {
    let walks = walk(policy, judge, commands, SECONDS, seed)?;
    Ok(PathScore::of(&walks.iter().map(|(_, error)| *error).collect::<Vec<_>>()))
}

/// The checkpoint with its best actor in the place of its last.
fn with_best(start: &Checkpoint) -> Checkpoint {
    let mut start = start.clone();
    if let Some((_, actor)) = &start.best {
        start.parameters[..actor.len()].copy_from_slice(actor);
    }
    start
}
