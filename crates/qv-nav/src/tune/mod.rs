//! Learning from its own trials (PPO, Schulman et al. 2017), for a student that a teacher has taught: it drives with noise on its commands, a critic
//! that knows the map says what was better than expected, and the network moves towards that. What it says of pictures goes on being learnt from
//! the truth, as in [`crate::dagger`].
//!
//! Rewards are those of [`crate::env`]: metres of the shortest way that were gained, and what the end is worth. The task has a fixed time,
//! which the critic knows, so an episode that runs out of it is worth nothing beyond.

mod critic;
mod explore;

pub(crate) use critic::Critic;

use crate::NavError;
use crate::augment::Changes;
use crate::dagger::{Driven, Student, TrainSettings};
use crate::legs::Legs;
use crate::net::COMMAND;
use crate::roll::{Stage, roll};
use crate::task::Episode;
use crate::teacher::World;
use critic::Journey;
use explore::Explorer;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// How a student learns from its own trials.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PolicySettings {
    /// Standard deviation of commands about what the network says in the first round and in the last, in shares of their limits. From one round to
    /// the next it changes by the same factor, where the number of rounds is known from the start. What is learnt is the best for commands with
    /// noise; whether less of it in the last rounds helps was not measured, so it stays unless asked for.
    pub deviation: [f32; 2],
    /// How far the ratio of densities may leave one before the objective is flat.
    pub clip: f32,
    /// Discount of a decision.
    pub gamma: f32,
    /// Share of a longer look ahead in the advantage (generalised advantage estimation, Schulman et al. 2015).
    pub lambda: f32,
    /// Weight of the objective beside what is learnt from the truth.
    pub weight: f32,
    /// Weight of the teacher's commands.
    pub imitation: f32,
}

impl Default for PolicySettings {
    fn default() -> Self {
        Self { deviation: [0.2, 0.2], clip: 0.2, gamma: 0.99, lambda: 0.95, weight: 0.1, imitation: 0.0 }
    }
}

impl PolicySettings {
    /// Standard deviation of commands, in shares of their limits, in a round (from 0) of so many; after the last it stays.
    pub(crate) fn deviation_at(&self, round: usize, rounds: usize) -> f32 {
        let [first, last] = self.deviation;
        let share = round as f32 / rounds.saturating_sub(1).max(1) as f32;
        first * (last / first).powf(share.min(1.0))
    }

    /// # Errors
    /// Names the first number that means nothing.
    pub(crate) fn check(&self) -> Result<(), NavError> {
        let all = [
            ("first deviation", self.deviation[0], 0.01, 1.0),
            ("last deviation", self.deviation[1], 0.01, 1.0),
            ("clip", self.clip, 0.01, 1.0),
            ("gamma", self.gamma, 0.0, 1.0),
            ("lambda", self.lambda, 0.0, 1.0),
            ("weight", self.weight, 1e-6, 100.0),
            ("imitation", self.imitation, 0.0, 100.0),
        ];
        match all.into_iter().find(|(_, x, low, high)| !(low..=high).contains(&x)) {
            Some((what, x, low, high)) => {
                Err(NavError::value(&format!("policy, {what}"), &format!("{low} to {high}"), x))
            }
            None => Ok(()),
        }
    }
}

impl TrainSettings {
    /// For a student that was taught and is to learn from its own trials. Pictures are learnt from as they were seen, since with others the network
    /// would not have said what it said.
    pub fn tuning() -> Self {
        Self {
            rounds: 40,
            epochs: 2,
            last_epochs: 2,
            epoch_frames: 100_000_000,
            changes: Changes::none(),
            batch: 32,
            rate: [1e-4, 1e-5],
            policy: Some(PolicySettings::default()),
            ..Self::default()
        }
    }
}

/// What a student did at a decision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Acted {
    /// The command that it drew, in shares of its limits; beyond -1 to 1 it is cut off only by who carries it out.
    pub action: [f32; COMMAND],
    /// What the network said: the mean of the draw.
    pub mean: [f32; COMMAND],
    /// The standard deviation of the draw.
    pub deviation: f32,
    /// How much better it went on than the critic expected, over all decisions of a round with mean 0 and deviation 1.
    pub advantage: f32,
}

impl Default for Acted {
    /// Nothing, of which nothing can be learnt.
    fn default() -> Self {
        Self { action: [0.0; COMMAND], mean: [0.0; COMMAND], deviation: 1.0, advantage: 0.0 }
    }
}

#[cfg(feature = "gpu")]
impl Acted {
    /// How many numbers it is.
    pub(crate) const NUMBERS: usize = 2 * COMMAND + 2;

    /// One after the other.
    pub(crate) fn numbers(&self) -> [f32; Self::NUMBERS] {
        let mut all = [self.advantage; Self::NUMBERS];
        all[..COMMAND].copy_from_slice(&self.action);
        all[COMMAND..2 * COMMAND].copy_from_slice(&self.mean);
        all[2 * COMMAND] = self.deviation;
        all
    }
}

/// What the episodes of a round gained.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Gains {
    /// Sum of the rewards of an episode, mean over episodes.
    pub reward: f64,
    /// Share of the variance of the returns that the critic explained before it learnt from them.
    pub explained: f64,
}

impl Student {
    /// Episodes that the student drives with noise.
    pub(crate) fn explore(
        &self,
        policy: &PolicySettings,
        stage: &Stage,
        legs: &mut dyn Legs,
        (drawn, seed): (Vec<Episode>, u64),
    ) -> Result<Vec<Driven>, NavError> {
        let deviation = policy.deviation_at(self.rounds, self.settings.rounds);
        let mut pilot = Explorer::new(&self.net, &self.parameters, deviation, (legs.count(), seed));
        let rolled = roll(stage, legs, &drawn, &mut pilot, |_| true, &mut |_| {})?;
        let all = drawn.into_iter().zip(rolled).zip(pilot.into_acted());
        let driven = all.map(|((episode, (trial, mut record)), acted)| {
            record.acted = acted;
            Driven { episode, alone: true, trial, record }
        });
        Ok(driven.collect())
    }

    /// Gives each decision its advantage, and lets the critic learn.
    pub(crate) fn weigh(
        &mut self,
        policy: &PolicySettings,
        world: &World,
        driven: &mut [Driven],
    ) -> Result<Gains, NavError> {
        let critic = self.critic.get_or_insert_with(|| Critic::new(self.settings.seed));
        let journeys: Vec<Journey> = driven.par_iter().map(|d| Journey::of(world, d)).collect();
        if critic.is_new() {
            // One that knows nothing yet would make noise of all advantages.
            critic.learn(&journeys, &journeys.iter().map(|j| j.returns(policy.gamma)).collect::<Vec<_>>())?;
        }
        let estimates = journeys.iter().map(|j| j.estimate(&critic.values(j), policy));
        let (advantages, returns): (Vec<Vec<f32>>, Vec<Vec<f32>>) = estimates.unzip();
        critic.learn(&journeys, &returns)?;
        let (mean, deviation) = moments(advantages.iter().flatten());
        let (_, spread) = moments(returns.iter().flatten());
        for (driven, advantages) in driven.iter_mut().zip(&advantages) {
            for (acted, advantage) in driven.record.acted.iter_mut().zip(advantages) {
                acted.advantage = ((f64::from(*advantage) - mean) / deviation.max(1e-6)) as f32;
            }
        }
        let gained: f64 = journeys.iter().flat_map(|j| &j.rewards).map(|&r| f64::from(r)).sum();
        // What is not in the advantages.
        let explained = 1.0 - (deviation / spread.max(1e-9)).powi(2);
        Ok(Gains { reward: gained / journeys.len().max(1) as f64, explained })
    }
}

/// Mean and standard deviation.
fn moments<'a>(all: impl Iterator<Item = &'a f32> + Clone) -> (f64, f64) {
    let count = all.clone().count().max(1) as f64;
    let mean = all.clone().map(|&x| f64::from(x)).sum::<f64>() / count;
    let variance = all.map(|&x| (f64::from(x) - mean).powi(2)).sum::<f64>() / count;
    (mean, variance.sqrt())
}

#[cfg(test)]
mod tests;
