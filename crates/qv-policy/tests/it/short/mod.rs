//! A short training of the Go2, and what is compared of it with `fixtures/walk/golden/short.json`. Shared by the tests that train and by
//! the example that writes the golden.

// Each test and example that shares this needs a part of it.
#![allow(dead_code)]

use qv_policy::policy::Policy;
use qv_policy::score::Score;
use qv_policy::train::{TrainSettings, Training};
use qv_policy::velocity::{Commands, Ground, Reward};
use serde::{Deserialize, Serialize};

/// Iterations: enough to walk and to turn, in about fifteen seconds of one core.
pub const ITERATIONS: u64 = 240;
/// Iterations at the end whose rewards are averaged: one alone depends on who was just commanded to do what.
const LAST: usize = 20;

/// The Go2 on the plane, forwards and turning. The weights of two terms are fixed here: a golden should not change with
/// every taste of gait.
pub fn settings() -> TrainSettings {
    let mut settings = TrainSettings { seed: 2, ..Default::default() };
    settings.task.commands = Commands { vx: [0.0, 1.0], vy: [0.0; 2], wz: [-1.0, 1.0], ..Default::default() };
    settings.task.reward = Reward { pairs: 0.3, action_jerk: 0.0, ..Default::default() };
    settings
}

/// What a training is judged by.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Figures {
    /// Length of the difference from the commanded velocity \[m/s\].
    pub velocity_error: f32,
    /// Size of the difference from the commanded turning rate \[rad/s\].
    pub turning_error: f32,
    /// Robots that fell, of those that were scored.
    pub fell: f32,
    /// Mean time of a swing \[s\].
    pub swing_time: f32,
    /// Mean highest point of a swing \[m\].
    pub swing_height: f32,
    /// Mean reward of a step in the last iterations.
    pub reward: f32,
}

/// A training that is over.
pub struct TrainingRun {
    /// The best policy of it.
    pub policy: Policy,
    /// Score of that policy.
    pub score: Score,
    /// Score before the first iteration.
    pub untrained: Score,
    /// What is compared.
    pub figures: Figures,
}

/// The training that several tests look at, done once.
pub fn trained() -> &'static TrainingRun {
    static TRAINED: std::sync::OnceLock<TrainingRun> = std::sync::OnceLock::new();
    TRAINED.get_or_init(|| train(&settings(), ITERATIONS))
}

/// Trains from nothing, on all threads there are.
pub fn train(settings: &TrainSettings, iterations: u64) -> TrainingRun {
    let robot = qv_go2::walk::robot().expect("the Go2 is a robot");
    let mut training = Training::new(&robot, &Ground::plane(), settings).expect("the settings mean something");
    let untrained = training.judge_now().expect("a score of finite numbers");
    let rewards: Vec<f32> =
        (0..iterations).map(|_| training.advance().expect("finite numbers").iteration.reward).collect();
    let (score, policy) = training.best().expect("it was scored").clone();
    let last = &rewards[rewards.len().saturating_sub(LAST)..];
    let figures = Figures {
        velocity_error: score.velocity_error,
        turning_error: score.turning_error,
        fell: score.fell as f32,
        swing_time: score.swing_time,
        swing_height: score.swing_height,
        reward: last.iter().sum::<f32>() / last.len() as f32,
    };
    TrainingRun { policy, score, untrained, figures }
}

/// How far each figure may be off. Five more trainings, whose standard deviation of actions began 1e-6 to 5e-6 higher, differed by up to 0.121,
/// 0.120, 0, 0.031, 0.013 and 0.008: a training doubles a rounding until it is another training, and another libm rounds otherwise. Without
/// the term `velocity`, `turning` or `air`, with one pass over the samples, a discount of 0.8 or four times the entropy (one training each),
/// at least one figure is off by more than this.
pub const TOLERANCE: Figures = Figures {
    velocity_error: 0.02,
    turning_error: 0.02,
    fell: 0.0,
    swing_time: 0.035,
    swing_height: 0.015,
    reward: 0.005,
};

impl Figures {
    /// Names with values.
    fn named(&self) -> [(&'static str, f32); 6] {
        [
            ("velocity_error", self.velocity_error),
            ("turning_error", self.turning_error),
            ("fell", self.fell),
            ("swing_time", self.swing_time),
            ("swing_height", self.swing_height),
            ("reward", self.reward),
        ]
    }
}

/// `fixtures/walk/golden/short.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Golden {
    /// Who writes it.
    pub generator: String,
    /// What it is called.
    pub name: String,
    /// Seed of the training.
    pub seed: u64,
    /// Iterations and all settings.
    pub options: Options,
    /// How far each figure may be off.
    pub tolerance: Figures,
    /// The figures.
    pub figures: Figures,
}

/// What a golden was trained with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Options {
    /// Iterations.
    pub iterations: u64,
    /// Settings.
    pub training: TrainSettings,
}

impl Golden {
    /// What the short training gives now.
    pub fn new(figures: Figures) -> Self {
        Self {
            generator: "cargo xtask golden bless short".into(),
            name: "short".into(),
            seed: settings().seed,
            options: Options { iterations: ITERATIONS, training: settings() },
            tolerance: TOLERANCE,
            figures,
        }
    }

    /// The stored one.
    pub fn read() -> Self {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/walk/golden/short.json");
        let text = std::fs::read_to_string(file).unwrap_or_else(|e| panic!("reading {file}: {e}"));
        serde_json::from_str(&text).unwrap_or_else(|e| panic!("{file}: {e}"))
    }

    /// What is off by more than the tolerance, in words.
    pub fn differences(&self, found: &Figures) -> Vec<String> {
        let pairs = self.figures.named().into_iter().zip(found.named()).zip(self.tolerance.named());
        pairs
            .filter(|(((_, golden), (_, found)), (_, allowed))| found.is_nan() || (found - golden).abs() > *allowed)
            .map(|(((name, golden), (_, found)), (_, allowed))| {
                format!("{name}: expected {golden}, found {found}, {:+} (allowed {allowed})", found - golden)
            })
            .collect()
    }
}
