//! Proximal policy optimisation (Schulman et al. 2017) with an asymmetric critic: all of it, in one file, but its numbers.
//!
//! One iteration: roll the policy out for some steps, estimate advantages (Schulman et al. 2015, GAE), then several epochs of minibatches
//! on the clipped objective (eq. 7 of the first paper). The learning rate follows the divergence of the policy (Schulman et al. 2017,
//! section 4, as in rsl_rl, Schwarke et al. 2025).
//!
//! Minibatches are cut into a fixed number of shards whose gradients are summed in order: the bits do not depend on threads.

mod settings;

pub use settings::PpoSettings;

use crate::PolicyError;
use crate::adam::Adam;
use crate::distribution::Spread;
use crate::env::{End, VectorEnv};
use crate::net::{Mlp, Tape, TransposedWeights, padded};
use crate::symmetry::{MirrorMap, Symmetry};
use qv_core::random::Xoshiro256PlusPlus;
use rayon::prelude::*;
use serde::Serialize;

/// Rows that pass through a network together, so that their numbers stay in the cache.
const ROWS: usize = 192;
/// Parts that a minibatch is always cut into.
const SHARDS: usize = 8;

/// What an iteration did.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Iteration {
    /// Iterations before this one.
    pub index: u64,
    /// Mean reward of a step.
    pub reward: f32,
    /// Mean loss of the clipped objective.
    pub surrogate: f32,
    /// Mean squared error of the value.
    pub value: f32,
    /// Entropy of the policy in nats.
    pub entropy: f32,
    /// Mean divergence of the new policy from the old.
    pub divergence: f32,
    /// Mean standard deviation of the actions.
    pub std: f32,
    /// Learning rate at the end.
    pub rate: f32,
    /// Length of the gradient, mean of the updates.
    pub gradient: f32,
    /// Share of the value's variance over the samples that the critic explains.
    pub explained: f32,
    /// Episodes that failed, and that ran out of time.
    pub ends: [usize; 2],
}

/// Samples of one iteration, all `[steps][environments]` and padded rows.
#[derive(Debug, Default)]
struct Samples {
    observations: Vec<f32>,
    privileged: Vec<f32>,
    actions: Vec<f32>,
    means: Vec<f32>,
    densities: Vec<f32>,
    values: Vec<f32>,
    rewards: Vec<f32>,
    over: Vec<bool>,
    advantages: Vec<f32>,
    returns: Vec<f32>,
}

/// Work space of one shard.
#[derive(Debug, Clone)]
struct Shard {
    gradient: Vec<f32>,
    tapes: [Tape; 2],
    rows: [Vec<f32>; 2],
    of_output: [Vec<f32>; 2],
    actions: Vec<f32>,
    /// A row whose image is being made.
    row: Vec<f32>,
    /// Sums of surrogate, value error, divergence.
    sums: [f64; 3],
}

/// The learner: networks, optimiser, samples.
pub struct Ppo {
    settings: PpoSettings,
    /// The policy: observations to means of actions.
    pub actor: Mlp,
    /// Privileged observations to the value.
    pub critic: Mlp,
    /// Actor, critic, log standard deviations.
    pub parameters: Vec<f32>,
    /// The optimiser.
    pub adam: Adam,
    /// Learning rate in force.
    pub rate: f32,
    /// Share of the entropy's weight that is in force.
    pub entropy_share: f32,
    /// Iterations done.
    pub iterations: u64,
    actions: usize,
    scaling: [(Vec<f32>, Vec<f32>); 2],
    symmetry: Option<Symmetry>,
    /// Whether updates read mirror images, where the environment has them.
    pub mirrors: bool,
    samples: Samples,
    turned: [TransposedWeights; 2],
    shards: Vec<Shard>,
    tapes: Vec<[Tape; 2]>,
    seen: [Vec<f32>; 2],
    noise: Vec<Xoshiro256PlusPlus>,
    shuffle: Xoshiro256PlusPlus,
}

impl Ppo {
    /// A new learner for an environment.
    ///
    /// # Errors
    /// When a setting means nothing.
    pub fn new(settings: &PpoSettings, env: &dyn VectorEnv, seed: u64) -> Result<Self, PolicyError> {
        settings.check()?;
        let sizes = |inputs: usize, hidden: &[usize], outputs: usize| -> Vec<usize> {
            std::iter::once(inputs).chain(hidden.iter().copied()).chain([outputs]).collect()
        };
        let actor = Mlp::new(&sizes(env.observations(), &settings.actor, env.actions()));
        let critic = Mlp::new(&sizes(env.privileged(), &settings.critic, 1));
        let mut random = Xoshiro256PlusPlus::of(seed, 1, 0);
        // A policy that begins near its mean action and a critic that begins near zero.
        let mut parameters = actor.draw(0.1, &mut random);
        parameters.extend(critic.draw(1.0, &mut random));
        parameters.extend(vec![settings.std.ln(); env.actions()]);
        let shard = Shard {
            gradient: vec![0.0; parameters.len()],
            tapes: [actor.tape(ROWS), critic.tape(ROWS)],
            rows: [vec![0.0; ROWS * padded(env.observations())], vec![0.0; ROWS * padded(env.privileged())]],
            of_output: [vec![0.0; ROWS * padded(env.actions())], vec![0.0; ROWS * padded(1)]],
            actions: vec![0.0; ROWS * padded(env.actions())],
            row: vec![0.0; padded(env.observations()).max(padded(env.privileged())).max(padded(env.actions()))],
            sums: [0.0; 3],
        };
        let count = env.count();
        Ok(Self {
            settings: settings.clone(),
            adam: Adam::new(parameters.len()),
            rate: settings.rate,
            entropy_share: 1.0,
            iterations: 0,
            actions: env.actions(),
            scaling: [env.observation_scaling(), env.privileged_scaling()],
            symmetry: env.symmetry(),
            mirrors: true,
            samples: Samples::default(),
            turned: [actor.turned(), critic.turned()],
            shards: vec![shard; SHARDS],
            tapes: vec![[actor.tape(ROWS), critic.tape(ROWS)]; count.div_ceil(ROWS)],
            seen: [vec![0.0; count * env.observations()], vec![0.0; count * env.privileged()]],
            noise: Vec::new(),
            shuffle: Xoshiro256PlusPlus::new(0),
            actor,
            critic,
            parameters,
        })
    }

    /// Sets the standard deviation of all actions.
    pub fn set_std(&mut self, std: f32) {
        let at = self.actor.len() + self.critic.len();
        self.parameters[at..].fill(std.ln());
    }

    /// Log standard deviations of the actions.
    pub(crate) fn log_std(&self) -> &[f32] {
        &self.parameters[self.actor.len() + self.critic.len()..]
    }

    /// Offset and scale of the observations, as the networks read them.
    pub fn observation_scaling(&self) -> (&[f32], &[f32]) {
        (&self.scaling[0].0, &self.scaling[0].1)
    }

    /// Draws all random numbers from here on from `seed` and `epoch`.
    pub fn reseed(&mut self, seed: u64, epoch: u64, environments: usize) {
        self.noise =
            (0..environments).map(|env| Xoshiro256PlusPlus::of(seed ^ epoch.rotate_left(40), 2, env as u64)).collect();
        self.shuffle = Xoshiro256PlusPlus::of(seed ^ epoch.rotate_left(40), 3, 0);
    }

    /// One iteration: samples and updates.
    ///
    /// # Errors
    /// When a number is not finite: which, and where.
    pub fn iterate(&mut self, env: &mut dyn VectorEnv) -> Result<Iteration, PolicyError> {
        if self.noise.len() != env.count() {
            self.reseed(0, 0, env.count());
        }
        let mut done = Iteration { index: self.iterations, ..Default::default() };
        self.roll_out(env, &mut done)?;
        self.estimate(env.count(), &mut done);
        self.update(&mut done)?;
        self.iterations += 1;
        Ok(done)
    }

    fn not_finite(&self, term: &str, found: f32) -> PolicyError {
        PolicyError::NotFinite { iteration: self.iterations, term: term.into(), found }
    }

    /// Fills the samples by acting.
    fn roll_out(&mut self, env: &mut dyn VectorEnv, done: &mut Iteration) -> Result<(), PolicyError> {
        let (count, steps) = (env.count(), self.settings.steps);
        let (seen, known, acts) = (padded(env.observations()), padded(env.privileged()), padded(self.actions));
        let total = count * steps;
        let samples = &mut self.samples;
        samples.observations.resize(total * seen, 0.0);
        samples.privileged.resize(total * known, 0.0);
        for list in [&mut samples.actions, &mut samples.means] {
            list.resize(total * acts, 0.0);
        }
        for list in [
            &mut samples.densities,
            &mut samples.values,
            &mut samples.rewards,
            &mut samples.advantages,
            &mut samples.returns,
        ] {
            list.resize(total, 0.0);
        }
        samples.values.resize(total + count, 0.0);
        samples.over.resize(total, false);
        let mut chosen = vec![0.0; count * self.actions];
        let (mut ends, mut mask) = (vec![End::No; count], vec![false; count]);
        let [mut observations, mut privileged] = std::mem::take(&mut self.seen);
        for step in 0..steps {
            let at = step * count;
            env.observe(&mut observations, &mut privileged);
            self.act(at, &observations, &privileged, &mut chosen);
            let rewards = &mut self.samples.rewards[at..at + count];
            env.step(&chosen, rewards, &mut ends).map_err(|e| stamp(e, self.iterations))?;
            if ends.iter().any(|&end| end != End::No) {
                for (mask, &end) in mask.iter_mut().zip(&ends) {
                    *mask = end != End::No;
                }
                if ends.contains(&End::TimeOut) {
                    // What it would have gained after: the value of where it is.
                    env.observe(&mut observations, &mut privileged);
                    self.value(at + count, &privileged);
                    for (i, _) in ends.iter().enumerate().filter(|(_, end)| **end == End::TimeOut) {
                        self.samples.rewards[at + i] += self.settings.gamma * self.samples.values[at + count + i];
                    }
                }
                env.reset(&mask)?;
            }
            for (i, &end) in ends.iter().enumerate() {
                self.samples.over[at + i] = end != End::No;
                done.ends[0] += usize::from(end == End::Failed);
                done.ends[1] += usize::from(end == End::TimeOut);
            }
        }
        env.observe(&mut observations, &mut privileged);
        self.value(total, &privileged);
        self.seen = [observations, privileged];
        let sum: f64 = self.samples.rewards[..total].iter().map(|&r| f64::from(r)).sum();
        done.reward = (sum / total as f64) as f32;
        Ok(())
    }

    /// Actions, means, densities and values of the samples that begin at `at`.
    fn act(&mut self, at: usize, observations: &[f32], privileged: &[f32], chosen: &mut [f32]) {
        self.value(at, privileged);
        let (count, actions, acts) = (self.noise.len(), self.actions, padded(self.actions));
        let (inputs, width) = (self.actor.inputs(), padded(self.actor.inputs()));
        let (parameters, spread) = (&self.parameters, Spread::new(self.log_std()));
        let (actor, (offset, scale)) = (&self.actor, &self.scaling[0]);
        let samples = &mut self.samples;
        let rows = samples.observations[at * width..(at + count) * width].par_chunks_mut(ROWS * width);
        let means = samples.means[at * acts..(at + count) * acts].par_chunks_mut(ROWS * acts);
        let taken = samples.actions[at * acts..(at + count) * acts].par_chunks_mut(ROWS * acts);
        let densities = samples.densities[at..at + count].par_chunks_mut(ROWS);
        let parts = rows.zip(means).zip(taken).zip(densities).zip(self.noise.par_chunks_mut(ROWS));
        let parts = parts.zip(chosen.par_chunks_mut(ROWS * actions)).zip(observations.par_chunks(ROWS * inputs));
        parts.zip(&mut self.tapes).for_each(
            |(((((((rows, means), taken), densities), noise), chosen), observations), tapes)| {
                scale_rows(observations, offset, scale, rows);
                let count = noise.len();
                means.copy_from_slice(actor.forward(parameters, count, rows, &mut tapes[0]));
                for (i, noise) in noise.iter_mut().enumerate() {
                    let (mean, taken) = (&means[i * acts..][..actions], &mut taken[i * acts..][..actions]);
                    for k in 0..actions {
                        taken[k] = mean[k] + spread.std[k] * noise.normal();
                    }
                    densities[i] = spread.log_density(taken, mean);
                    chosen[i * actions..][..actions].copy_from_slice(taken);
                }
            },
        );
    }

    /// Values of the samples that begin at `at`; beyond the last sample only values are kept.
    fn value(&mut self, at: usize, privileged: &[f32]) {
        let count = self.noise.len();
        let (inputs, width) = (self.critic.inputs(), padded(self.critic.inputs()));
        let total = self.samples.over.len();
        let (critic, (offset, scale)) = (&self.critic, &self.scaling[1]);
        let parameters = &self.parameters[self.actor.len()..];
        let mut apart = Vec::new();
        let rows = if at < total && at + count <= total {
            &mut self.samples.privileged[at * width..(at + count) * width]
        } else {
            apart.resize(count * width, 0.0);
            &mut apart[..]
        };
        let parts = rows.par_chunks_mut(ROWS * width).zip(self.samples.values[at..at + count].par_chunks_mut(ROWS));
        parts.zip(privileged.par_chunks(ROWS * inputs)).zip(&mut self.tapes).for_each(
            |(((rows, values), privileged), tapes)| {
                scale_rows(privileged, offset, scale, rows);
                let out = critic.forward(parameters, values.len(), rows, &mut tapes[1]);
                values.iter_mut().zip(out.chunks_exact(padded(1))).for_each(|(value, row)| *value = row[0]);
            },
        );
    }

    /// Advantages (GAE), returns, and how well the critic knew them.
    fn estimate(&mut self, count: usize, done: &mut Iteration) {
        let PpoSettings { gamma, lambda, .. } = self.settings;
        let samples = &mut self.samples;
        for env in 0..count {
            let mut advantage = 0.0;
            for step in (0..self.settings.steps).rev() {
                let at = step * count + env;
                let on = if samples.over[at] { 0.0 } else { 1.0 };
                let surprise = samples.rewards[at] + gamma * on * samples.values[at + count] - samples.values[at];
                advantage = surprise + gamma * lambda * on * advantage;
                samples.advantages[at] = advantage;
                samples.returns[at] = advantage + samples.values[at];
            }
        }
        let (_, unexplained) = moments(&samples.advantages);
        let (_, spread) = moments(&samples.returns);
        done.explained = (1.0 - unexplained / spread.max(1e-12)) as f32;
        let (mean, variance) = moments(&samples.advantages);
        let scale = 1.0 / (variance.sqrt() + 1e-8);
        samples.advantages.iter_mut().for_each(|a| *a = ((f64::from(*a) - mean) * scale) as f32);
    }

    /// Epochs of minibatches.
    fn update(&mut self, done: &mut Iteration) -> Result<(), PolicyError> {
        let total = self.samples.over.len();
        let mut order: Vec<u32> = (0..total as u32).collect();
        let size = total.div_ceil(self.settings.minibatches);
        let mut updates = 0.0f32;
        let old = Spread::new(self.log_std());
        for _ in 0..self.settings.epochs {
            for i in (1..total).rev() {
                order.swap(i, self.shuffle.below(i + 1));
            }
            for batch in order.chunks(size) {
                let [surrogate, value, divergence] = self.gradient(batch, &old);
                for (term, found) in
                    [("surrogate loss", surrogate), ("value loss", value), ("divergence of the policy", divergence)]
                {
                    if !found.is_finite() {
                        return Err(self.not_finite(term, found));
                    }
                }
                self.steer(divergence);
                let (mut parameters, gradient) = (std::mem::take(&mut self.parameters), &self.shards[0].gradient);
                let length = self.adam.step(&mut parameters, gradient, self.rate, self.settings.gradient);
                self.parameters = parameters;
                if !length.is_finite() {
                    return Err(self.not_finite("gradient", length));
                }
                self.bound_std();
                updates += 1.0;
                done.surrogate += surrogate;
                done.value += value;
                done.divergence += divergence;
                done.gradient += length;
            }
        }
        for mean in [&mut done.surrogate, &mut done.value, &mut done.divergence, &mut done.gradient] {
            *mean /= updates;
        }
        done.entropy = Spread::new(self.log_std()).entropy();
        done.std = self.log_std().iter().map(|s| s.exp()).sum::<f32>() / self.actions as f32;
        done.rate = self.rate;
        Ok(())
    }

    fn bound_std(&mut self) {
        let (at, least) = (self.actor.len() + self.critic.len(), self.settings.least_std.ln());
        // No upper bound but one that keeps its exponential finite.
        self.parameters[at..].iter_mut().for_each(|s| *s = s.clamp(least, 3.0));
    }

    /// The learning rate follows the divergence (rsl_rl's adaptive schedule).
    fn steer(&mut self, divergence: f32) {
        let wanted = self.settings.divergence;
        let [least, most] = self.settings.rate_range;
        if wanted > 0.0 && divergence > 2.0 * wanted {
            self.rate = (self.rate / 1.5).max(least);
        } else if wanted > 0.0 && divergence > 0.0 && divergence < 0.5 * wanted {
            self.rate = (self.rate * 1.5).min(most);
        }
    }

    /// The gradient of a minibatch into the first shard; mean surrogate, value error and divergence.
    fn gradient(&mut self, batch: &[u32], old: &Spread) -> [f32; 3] {
        let [turned_actor, turned_critic] = &mut self.turned;
        self.actor.turn(&self.parameters, turned_actor);
        self.critic.turn(&self.parameters[self.actor.len()..], turned_critic);
        let mut shards = std::mem::take(&mut self.shards);
        let share = batch.len().div_ceil(SHARDS).max(1);
        let (this, spread) = (&*self, Spread::new(self.log_std()));
        shards.par_iter_mut().enumerate().for_each(|(k, shard)| {
            shard.gradient.fill(0.0);
            shard.sums = [0.0; 3];
            let part = batch.get(k * share..((k + 1) * share).min(batch.len())).unwrap_or(&[]);
            for rows in part.chunks(ROWS) {
                this.rows(rows, batch.len(), (&spread, old), shard);
            }
        });
        let (first, others) = shards.split_at_mut(1);
        let first = &mut first[0];
        for shard in others {
            first.gradient.iter_mut().zip(&shard.gradient).for_each(|(sum, &x)| *sum += x);
            first.sums.iter_mut().zip(shard.sums).for_each(|(sum, x)| *sum += x);
        }
        let at = self.actor.len() + self.critic.len();
        let entropy = self.settings.entropy * self.entropy_share;
        first.gradient[at..].iter_mut().for_each(|g| *g -= entropy);
        let means = first.sums.map(|sum| (sum / batch.len() as f64) as f32);
        self.shards = shards;
        means
    }

    /// How samples are mirrored, where they are.
    fn mirror(&self) -> Option<&Symmetry> {
        self.symmetry.as_ref().filter(|_| self.mirrors)
    }

    /// Adds the gradient of some samples, and of their mirror images, to a shard.
    fn rows(&self, chosen: &[u32], batch: usize, (spread, old): (&Spread, &Spread), shard: &mut Shard) {
        let samples = &self.samples;
        gather(&samples.observations, chosen, padded(self.actor.inputs()), &mut shard.rows[0]);
        gather(&samples.privileged, chosen, padded(self.critic.inputs()), &mut shard.rows[1]);
        gather(&samples.actions, chosen, padded(self.actions), &mut shard.actions);
        let images = if self.mirror().is_some() { 2 } else { 1 };
        let each = 1.0 / (images * batch) as f32;
        self.actor_rows(chosen, each, (spread, Some(old)), shard);
        self.critic_rows(chosen, each, shard);
        let Some(symmetry) = self.mirror() else { return };
        let [rows, privileged] = &mut shard.rows;
        mirror_rows(&symmetry.observation, padded(self.actor.inputs()), chosen.len(), rows, &mut shard.row);
        mirror_rows(&symmetry.privileged, padded(self.critic.inputs()), chosen.len(), privileged, &mut shard.row);
        mirror_rows(&symmetry.action, padded(self.actions), chosen.len(), &mut shard.actions, &mut shard.row);
        self.actor_rows(chosen, each, (spread, None), shard);
        self.critic_rows(chosen, each, shard);
    }

    /// The clipped objective of rows. Old densities and advantages are those of the samples, for their images, too; the divergence from the
    /// old policy is measured where that is given.
    fn actor_rows(&self, chosen: &[u32], each: f32, (spread, old): (&Spread, Option<&Spread>), shard: &mut Shard) {
        let samples = &self.samples;
        let (actions, acts) = (self.actions, padded(self.actions));
        let (of_means, networks) = (&mut shard.of_output[0], self.actor.len() + self.critic.len());
        let (networks_gradient, of_log_std) = shard.gradient.split_at_mut(networks);
        let actor = &self.parameters[..self.actor.len()];
        let share = if self.mirror().is_some() { 0.5 } else { 1.0 };
        let means = self.actor.forward(actor, chosen.len(), &shard.rows[0], &mut shard.tapes[0]);
        for (i, &sample) in chosen.iter().enumerate() {
            let sample = sample as usize;
            let (mean, action) = (&means[i * acts..][..actions], &shard.actions[i * acts..][..actions]);
            let density = spread.log_density(action, mean);
            let (ratio, advantage) = ((density - samples.densities[sample]).exp(), samples.advantages[sample]);
            let limited = ratio.clamp(1.0 - self.settings.clip, 1.0 + self.settings.clip);
            let (free, held) = (ratio * advantage, limited * advantage);
            // The lesser of the two; where that is the limited one, no gradient flows.
            let slope = if free <= held { -free * each } else { 0.0 };
            shard.sums[0] -= share * f64::from(free.min(held));
            if let Some(old) = old {
                let old_mean = &samples.means[sample * acts..][..actions];
                shard.sums[2] += f64::from(spread.divergence(mean, old, old_mean));
            }
            let of_mean = &mut of_means[i * acts..][..actions];
            for k in 0..actions {
                let z = (action[k] - mean[k]) * spread.inverse[k];
                of_mean[k] = slope * z * spread.inverse[k];
                of_log_std[k] += slope * (z * z - 1.0);
            }
        }
        let of_actor = &mut networks_gradient[..self.actor.len()];
        self.actor.backward(&self.turned[0], chosen.len(), &shard.rows[0], of_means, &mut shard.tapes[0], of_actor);
    }

    /// The squared error of the value of rows, which the samples' returns are the targets of.
    fn critic_rows(&self, chosen: &[u32], each: f32, shard: &mut Shard) {
        let of_values = &mut shard.of_output[1];
        let critic = &self.parameters[self.actor.len()..];
        let values = self.critic.forward(critic, chosen.len(), &shard.rows[1], &mut shard.tapes[1]);
        let share = if self.mirror().is_some() { 0.5 } else { 1.0 };
        for (i, &sample) in chosen.iter().enumerate() {
            let error = values[i * padded(1)] - self.samples.returns[sample as usize];
            shard.sums[1] += share * f64::from(error * error);
            of_values[i * padded(1)] = 2.0 * self.settings.value * error * each;
        }
        let of_critic = &mut shard.gradient[self.actor.len()..self.actor.len() + self.critic.len()];
        self.critic.backward(&self.turned[1], chosen.len(), &shard.rows[1], of_values, &mut shard.tapes[1], of_critic);
    }
}

/// The rows of chosen samples, one after another.
fn gather(from: &[f32], chosen: &[u32], width: usize, to: &mut [f32]) {
    for (row, &sample) in to.chunks_exact_mut(width).zip(chosen) {
        row.copy_from_slice(&from[sample as usize * width..][..width]);
    }
}

/// Puts the mirror images of rows in their places.
fn mirror_rows(map: &MirrorMap, width: usize, count: usize, rows: &mut [f32], scratch: &mut [f32]) {
    for row in rows.chunks_exact_mut(width).take(count) {
        scratch[..width].copy_from_slice(row);
        map.apply(scratch, row);
    }
}

/// Reports an error of the environment in which iteration it came.
fn stamp(error: PolicyError, iteration: u64) -> PolicyError {
    match error {
        PolicyError::NotFinite { term, found, .. } => PolicyError::NotFinite { iteration, term, found },
        other => other,
    }
}

/// `(x - offset) * scale` of each row into a padded row.
pub(crate) fn scale_rows(from: &[f32], offset: &[f32], scale: &[f32], to: &mut [f32]) {
    let (count, width) = (offset.len(), padded(offset.len()));
    for (row, from) in to.chunks_exact_mut(width).zip(from.chunks_exact(count)) {
        for k in 0..count {
            row[k] = (from[k] - offset[k]) * scale[k];
        }
    }
}

/// Mean and variance.
fn moments(values: &[f32]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().map(|&x| f64::from(x)).sum::<f64>() / count;
    let variance = values.iter().map(|&x| (f64::from(x) - mean).powi(2)).sum::<f64>() / count;
    (mean, variance)
}
