//! How a student learns, from a teacher or from its own trials.

use crate::NavError;
use crate::augment::Changes;
use crate::pilots::Mixture;
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

/// How the student learns.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrainSettings {
    /// Rounds of driving and learning.
    pub rounds: usize,
    /// Decisions that a round gathers, at least.
    pub frames: usize,
    /// Times that a round learns from all that was gathered.
    pub epochs: usize,
    /// The same in the last round.
    pub last_epochs: usize,
    /// Decisions that an epoch learns from at most: beyond them, it takes a part of the episodes, another one each time.
    pub epoch_frames: usize,
    /// Decisions that are kept to be learnt from again; beyond them the oldest are forgotten. One takes 18 kB.
    pub kept: usize,
    /// How pictures are changed each time that they are learnt from.
    pub changes: Changes,
    /// Episodes in a step of the optimiser.
    pub batch: usize,
    /// Decisions through which gradients go back.
    pub truncated: usize,
    /// Learning rate at the beginning and at the end; between them it falls as a half wave of the cosine.
    pub rate: [f32; 2],
    /// Who drives in the first round.
    pub first: Mixture,
    /// Who drives in later rounds.
    pub later: Mixture,
    /// Where the loss of a command becomes linear, in shares of its limits.
    pub huber: f32,
    /// Weight of the cone's bearing and distance beside the command.
    pub cone_weight: f32,
    /// Weight of whether it is in view.
    pub visible_weight: f32,
    /// Weight of what else is known ([`crate::net::KNOWN`]), and of the place and heading of a picture.
    pub known_weight: f32,
    /// Weight of the distances along the rays of a picture.
    pub ray_weight: f32,
    /// A gradient longer than this is shortened.
    pub longest: f32,
    /// Robots at once.
    pub robots: usize,
    /// Of everything.
    pub seed: u64,
    /// With it the student learns by PPO from its own trials instead of from the teacher, see [`crate::tune`]; nobody else drives then.
    pub policy: Option<PolicySettings>,
}

impl Default for TrainSettings {
    fn default() -> Self {
        Self {
            rounds: 18,
            frames: 15_000,
            epochs: 2,
            last_epochs: 3,
            epoch_frames: 150_000,
            kept: 100_000_000,
            changes: Changes::default(),
            batch: 16,
            truncated: 25,
            rate: [1e-3, 2e-5],
            first: Mixture { alone: 0.0, taught: 0.85, stray: 0.15, stretch: 10.0, goal_given: 1.0 },
            later: Mixture { alone: 0.6, taught: 0.35, stray: 0.05, stretch: 10.0, goal_given: 0.15 },
            huber: 0.3,
            cone_weight: 0.5,
            visible_weight: 0.15,
            known_weight: 0.15,
            ray_weight: 0.2,
            longest: 1.0,
            robots: 192,
            seed: 0,
            policy: None,
        }
    }
}

impl TrainSettings {
    /// Epochs of a round, from 0.
    pub(crate) fn epochs_of(&self, round: usize) -> usize {
        if round + 1 == self.rounds { self.last_epochs } else { self.epochs }
    }

    /// Learning rate when a share of the whole training is done.
    pub(crate) fn rate_at(&self, share: f32) -> f32 {
        let [from, to] = self.rate;
        to + 0.5 * (from - to) * (1.0 + (share.clamp(0.0, 1.0) * std::f32::consts::PI).cos())
    }

    pub(crate) fn check(&self) -> Result<(), NavError> {
        for (what, found, least) in [
            ("rounds", self.rounds, 1),
            ("frames", self.frames, 1),
            ("epochs", self.epochs, 1),
            ("last_epochs", self.last_epochs, 1),
            ("epoch_frames", self.epoch_frames, 1),
            ("kept", self.kept, 1),
            ("batch", self.batch, 1),
            ("truncated", self.truncated, 1),
            ("robots", self.robots, 1),
        ] {
            // Each robot has room for pictures; all else are counts.
            let most = if what == "robots" { 100_000 } else { 100_000_000 };
            if found < least || found > most {
                return Err(NavError::value(what, &format!("{least} to {most}"), found));
            }
        }
        self.changes.check()?;
        self.policy.map_or(Ok(()), |policy| policy.check())?;
        for (what, mixture) in [("first", self.first), ("later", self.later)] {
            let Mixture { alone, taught, stray, stretch, goal_given } = mixture;
            let shares = [alone, taught, stray, taught + stray, goal_given].iter().all(|x| (0.0..=1.0001).contains(x));
            if !(shares && (1.0..=1e6).contains(&stretch)) {
                let expected = "shares of 0 to 1, `taught` and `stray` together at most 1, a stretch of at least 1";
                return Err(NavError::value(what, expected, format!("{mixture:?}")));
            }
        }
        let weights = [
            ("rate", self.rate[0], 1e-7, 1.0),
            ("rate", self.rate[1], 1e-7, 1.0),
            ("huber", self.huber, 1e-3, 10.0),
            ("cone_weight", self.cone_weight, 0.0, 10.0),
            ("visible_weight", self.visible_weight, 0.0, 10.0),
            ("known_weight", self.known_weight, 0.0, 10.0),
            ("ray_weight", self.ray_weight, 0.0, 10.0),
            ("longest", self.longest, 1e-3, 1e6),
        ];
        match weights.into_iter().find(|(_, x, low, high)| !(low..=high).contains(&x)) {
            Some((what, x, low, high)) => Err(NavError::value(what, &format!("{low} to {high}"), x)),
            None => Ok(()),
        }
    }
}

impl TrainSettings {
    /// For a student that learns in many places. Fewer robots are in one place at once, so that a round sees more places, and no more decisions are
    /// kept than fit into 4 GB.
    pub fn of_many_places() -> Self {
        Self { robots: 24, kept: 180_000, ..Self::default() }
    }

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
