//! Hyper-parameters of the learner.

use crate::PolicyError;
use serde::{Deserialize, Serialize};

/// Hyper-parameters. Steps, epochs, clip, discounts, value, rate, gradient and std are those that rsl_rl's configurations of quadrupeds share.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PpoSettings {
    /// Steps of each environment in an iteration.
    pub steps: usize,
    /// Passes over the samples of an iteration.
    pub epochs: usize,
    /// Minibatches of a pass. Eight for rsl_rl's four: mirror images double the samples (docs/experiments/2026-11-30-gait-clock.md).
    pub minibatches: usize,
    /// How far the ratio of probabilities may leave one before the objective is flat.
    pub clip: f32,
    /// Discount per step.
    pub gamma: f32,
    /// Share of a longer look ahead in the advantage (GAE's lambda).
    pub lambda: f32,
    /// Weight of the entropy. A fifth of rsl_rl's 0.01, which keeps exploring where landings must be soft.
    pub entropy: f32,
    /// Weight of the value's squared error.
    pub value: f32,
    /// Learning rate at the start.
    pub rate: f32,
    /// Least and greatest learning rate.
    pub rate_range: [f32; 2],
    /// Divergence per update that the learning rate is steered to, twice rsl_rl's; 0 keeps the rate.
    pub divergence: f32,
    /// Longest gradient.
    pub gradient: f32,
    /// Standard deviation of the actions at the start.
    pub std: f32,
    /// Least standard deviation: exploration that never ends.
    pub least_std: f32,
    /// Epochs of a training in which updates read the mirror image of each sample, too (rsl_rl's `symmetry_cfg.use_data_augmentation`); without
    /// effect for robots that are not their own mirror images. Without a clock the last ones must break the tie between left and right: a policy
    /// that is exactly its own mirror image cannot start a trot from a stand that is.
    pub symmetry_epochs: u64,
    /// Sizes of the hidden layers of the actor.
    pub actor: Vec<usize>,
    /// Sizes of the hidden layers of the critic.
    pub critic: Vec<usize>,
}

impl Default for PpoSettings {
    fn default() -> Self {
        Self {
            steps: 24,
            epochs: 4,
            minibatches: 8,
            clip: 0.2,
            gamma: 0.99,
            lambda: 0.95,
            entropy: 0.002,
            value: 1.0,
            rate: 1e-3,
            rate_range: [1e-5, 1e-2],
            divergence: 0.02,
            gradient: 1.0,
            std: 1.0,
            least_std: 0.05,
            symmetry_epochs: 1000,
            actor: vec![64, 64],
            critic: vec![64, 64],
        }
    }
}

impl PpoSettings {
    /// # Errors
    /// Names the first setting that means nothing.
    pub fn check(&self) -> Result<(), PolicyError> {
        let counts = [("steps", self.steps), ("epochs", self.epochs), ("minibatches", self.minibatches)];
        for (what, count) in counts {
            if count == 0 {
                return Err(PolicyError::setting(what, "at least 1", count));
            }
        }
        let within = |what: &str, x: f32, low: f32, high: f32| {
            let expected = format!("{low} to {high}");
            if x >= low && x <= high { Ok(()) } else { Err(PolicyError::setting(what, &expected, x)) }
        };
        within("clip", self.clip, 0.01, 1.0)?;
        within("gamma", self.gamma, 0.0, 0.9999)?;
        within("lambda", self.lambda, 0.0, 1.0)?;
        within("entropy", self.entropy, 0.0, 1.0)?;
        within("value", self.value, 0.0, 100.0)?;
        within("rate", self.rate, 1e-8, 1.0)?;
        within("rate_range", self.rate_range[0], 1e-8, self.rate_range[1])?;
        within("divergence", self.divergence, 0.0, 10.0)?;
        within("gradient", self.gradient, 1e-6, 1e6)?;
        within("std", self.std, 1e-3, 10.0)?;
        within("least_std", self.least_std, 1e-4, self.std)?;
        match self.actor.iter().chain(&self.critic).find(|&&size| size == 0 || size > 4096) {
            Some(size) => Err(PolicyError::setting("size of a layer", "1 to 4096", size)),
            None => Ok(()),
        }
    }
}
