//! Learning from its own trials (PPO, Schulman et al. 2017), for a student that a teacher has taught: it drives with noise on its commands, a critic
//! that knows the map says what was better than expected, and the network moves towards that. What it says of pictures goes on being learnt from
//! the truth, as in [`crate::dagger`].
//!
//! Rewards are those of [`crate::env`]: metres of the shortest way that were gained, and what the end is worth. The task has a fixed time,
//! which the critic knows, so an episode that runs out of it is worth nothing beyond.

mod critic;
mod explore;

pub use crate::roll::StudentAction;
pub use crate::settings::PolicySettings;
pub(crate) use critic::Critic;
pub use critic::Gains;

use crate::NavError;
use crate::dagger::Student;
use crate::legs::Legs;
use crate::roll::{EpisodeTrace, Stage, roll};
use crate::task::Episode;
use crate::teacher::World;
use critic::Journey;
use explore::Explorer;
use rayon::prelude::*;

impl Student {
    /// Episodes that the student drives with noise.
    pub(crate) fn explore(
        &self,
        policy: &PolicySettings,
        stage: &Stage,
        legs: &mut dyn Legs,
        (drawn, seed): (Vec<Episode>, u64),
    ) -> Result<Vec<EpisodeTrace>, NavError> {
        let deviation = policy.deviation_at(self.rounds, self.settings.rounds);
        let mut pilot = Explorer::new(&self.net, &self.parameters, deviation, (legs.count(), seed));
        let rolled = roll(stage, legs, &drawn, &mut pilot, |_| true, &mut |_| {})?;
        let all = drawn.into_iter().zip(rolled).zip(pilot.into_acted());
        let driven = all.map(|((episode, (trial, mut record)), acted)| {
            record.acted = acted;
            EpisodeTrace { episode, alone: true, trial, record }
        });
        Ok(driven.collect())
    }

    /// Gives each decision its advantage, and lets the critic learn.
    pub(crate) fn weigh(
        &mut self,
        policy: &PolicySettings,
        world: &World,
        driven: &mut [EpisodeTrace],
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
