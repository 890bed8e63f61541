//! How a net is taught.

use crate::ResidualError;
use serde::{Deserialize, Serialize};

/// Largest correction that is searched \[rad\].
pub(super) const MOST: f32 = 0.4;

/// How a net is taught.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SupervisedSettings {
    /// Rounds at states that the net reached, after the one along the recording.
    pub rounds: usize,
    /// Decisions of a window.
    pub length: usize,
    /// Most windows of a round, spread evenly over those that are given.
    pub windows: usize,
    /// Passes over all samples in each round.
    pub passes: usize,
    /// Learning rate at the start of each round.
    pub rate: f32,
    /// Sizes of the hidden layers.
    pub hidden: Vec<usize>,
    /// Largest correction that the net may make \[rad\].
    pub clip: f32,
    /// Error of measured states over one decision, standard deviation \[rad\].
    pub error: f64,
    /// Size of corrections that is expected, standard deviation \[rad\].
    pub spread: f64,
    /// Share of its distance from the recording that a correction makes up for in one decision: 1 = all.
    pub pull: f32,
    /// Decisions for which a correction is held before it is judged: behind latency, one decision sees little of it.
    pub ahead: usize,
    /// Seed.
    pub seed: u64,
}

impl Default for SupervisedSettings {
    fn default() -> Self {
        Self {
            rounds: 3,
            length: 25,
            windows: 480,
            passes: 12,
            rate: 2e-3,
            hidden: vec![128, 128],
            clip: 0.3,
            error: 0.005,
            spread: 0.05,
            pull: 1.0,
            ahead: 1,
            seed: 0,
        }
    }
}

impl SupervisedSettings {
    /// For a net of torques: it is small, and has a sample for each joint.
    pub fn torque() -> Self {
        Self { hidden: vec![32, 32], passes: 4, ..Self::default() }
    }

    /// # Errors
    /// Names the first setting that means nothing.
    pub fn check(&self) -> Result<(), ResidualError> {
        let within = |what: &str, x: f64, low: f64, high: f64| {
            let is_fine = x >= low && x <= high;
            is_fine.then_some(()).ok_or_else(|| ResidualError::input(what, format!("{low} to {high}"), x))
        };
        within("rounds", self.rounds as f64, 0.0, 100.0)?;
        within("length", self.length as f64, 1.0, 1000.0)?;
        within("windows", self.windows as f64, 1.0, 1e6)?;
        within("passes", self.passes as f64, 1.0, 1e4)?;
        within("rate", f64::from(self.rate), 1e-6, 1.0)?;
        within("clip", f64::from(self.clip), 1e-3, f64::from(MOST))?;
        within("error", self.error, 1e-6, 1.0)?;
        within("spread", self.spread, 1e-6, 10.0)?;
        within("ahead", self.ahead as f64, 1.0, 20.0)?;
        within("pull", f64::from(self.pull), 0.0, 1.0)?;
        self.hidden.iter().try_for_each(|&size| within("size of a hidden layer", size as f64, 1.0, 4096.0))
    }
}
