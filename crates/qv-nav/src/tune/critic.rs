//! What a state is worth: a network that knows the map, which the student does not (asymmetric actor and critic, Pinto et al. 2018).

use crate::NavError;
use crate::env::worth;
use crate::roll::EpisodeTrace;
use crate::settings::PolicySettings;
use crate::task::{DECISIONS, NEAR, PERIOD};
use crate::teacher::World;
use glam::DVec2;
use qv_core::random::Xoshiro256PlusPlus;
use qv_policy::adam::Adam;
use qv_policy::net::{Mlp, Tape, padded};
use serde::{Deserialize, Serialize};

/// Numbers that a value is determined from.
const FEATURES: usize = 12;
const HIDDEN: usize = 64;
/// Decisions in a step of the critic's optimiser, times that it learns from a round, its rate, and the longest gradient.
const ROWS: usize = 512;
const EPOCHS: usize = 5;
const RATE: f32 = 1e-3;
const LONGEST: f32 = 1.0;
/// Metres by which ways and distances are divided.
const FAR: f64 = 7.0;

/// A driven episode as the critic sees it.
pub(super) struct Journey {
    /// `[decisions]`, in padded rows.
    features: Vec<f32>,
    pub(super) rewards: Vec<f32>,
}

impl Journey {
    /// Of an episode that was driven.
    pub(super) fn of(world: &World, driven: &EpisodeTrace) -> Self {
        let (goal, track) = (driven.episode.goal.axis(), &driven.trial.track);
        let to_goal = world.map.lengths(goal);
        let place = |at: usize| DVec2::new(f64::from(track[at][0]), f64::from(track[at][1]));
        let mut left = driven.episode.geodesic;
        // Where there is too little room, no way is known: what is gained there counts once there is one again.
        let ways: Vec<f64> = (0..track.len())
            .map(|at| {
                let way = world.map.at(&to_goal, place(at));
                left = if way.is_finite() { way } else { left };
                left
            })
            .collect();
        let decisions = driven.record.len();
        let (mut features, mut rewards) = (vec![0.0; decisions * padded(FEATURES)], Vec::with_capacity(decisions));
        let mut near = 0;
        for (at, row) in features.chunks_exact_mut(padded(FEATURES)).enumerate() {
            let yaw = f64::from(track[at][2]);
            let to = DVec2::from_angle(-yaw).rotate(goal - place(at));
            let before = at.saturating_sub(1);
            let speed = place(at).distance(place(before)) / PERIOD;
            let turned = (yaw - f64::from(track[before][2]) + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU);
            let head = place(at) + world.rig.head * DVec2::from_angle(yaw);
            near = if head.distance(goal) <= NEAR { near + 1 } else { 0 };
            let all = [
                ways[at] / FAR,
                to.length() / FAR,
                to.x / FAR,
                to.y / FAR,
                head.distance(goal).min(1.0),
                world.map.room(head).clamp(0.0, 1.0),
                if driven.record.found[at] { 1.0 } else { 0.0 },
                f64::from(driven.record.cones[at][3]),
                1.0 - at as f64 / DECISIONS as f64,
                speed,
                (turned - std::f64::consts::PI) / PERIOD,
                f64::from(near.min(5)) / 5.0,
            ];
            row.iter_mut().zip(all).for_each(|(out, x)| *out = x as f32);
            let end = if at + 1 == decisions { worth(driven.trial.end) } else { 0.0 };
            rewards.push((ways[at] - ways[(at + 1).min(track.len() - 1)]) as f32 + end);
        }
        Self { features, rewards }
    }

    /// Sum of what is still to come, discounted, for each decision.
    pub(super) fn returns(&self, gamma: f32) -> Vec<f32> {
        let mut out = self.rewards.clone();
        for at in (1..out.len()).rev() {
            out[at - 1] += gamma * out[at];
        }
        out
    }

    /// Advantages and returns of each decision (generalised advantage estimation), given its values.
    pub(super) fn estimate(&self, values: &[f32], policy: &PolicySettings) -> (Vec<f32>, Vec<f32>) {
        let mut advantages = vec![0.0; values.len()];
        let (mut next, mut later) = (0.0, 0.0);
        for at in (0..values.len()).rev() {
            let surprise = self.rewards[at] + policy.gamma * next - values[at];
            later = surprise + policy.gamma * policy.lambda * later;
            (advantages[at], next) = (later, values[at]);
        }
        let returns = advantages.iter().zip(values).map(|(a, v)| a + v).collect();
        (advantages, returns)
    }
}

/// The critic.
pub(crate) struct Critic {
    net: Mlp,
    parameters: Vec<f32>,
    adam: Adam,
    random: Xoshiro256PlusPlus,
}

impl Critic {
    /// One that knows nothing.
    pub(crate) fn new(seed: u64) -> Self {
        let net = Mlp::new(&[FEATURES, HIDDEN, HIDDEN, 1]);
        let mut random = Xoshiro256PlusPlus::of(seed, 95, 0);
        let parameters = net.draw(1.0, &mut random);
        Self { adam: Adam::new(net.len()), net, parameters, random }
    }

    pub(super) fn is_new(&self) -> bool {
        self.adam.steps == 0
    }

    /// Value of each decision.
    pub(super) fn values(&self, journey: &Journey) -> Vec<f32> {
        let count = journey.rewards.len();
        let mut tape = self.net.tape(count.max(1));
        let out = self.net.forward(&self.parameters, count, &journey.features, &mut tape);
        out.chunks_exact(padded(1)).map(|row| row[0]).collect()
    }

    /// Learns what returns were.
    ///
    /// # Errors
    /// When a number is not finite.
    pub(super) fn learn(&mut self, journeys: &[Journey], returns: &[Vec<f32>]) -> Result<(), NavError> {
        let width = padded(FEATURES);
        let rows = |j: usize| (0..returns[j].len()).map(move |at| (j, at));
        let mut order: Vec<(usize, usize)> = (0..journeys.len()).flat_map(rows).collect();
        let (mut tape, mut turned) = (self.net.tape(ROWS), self.net.turned());
        let mut input = vec![0.0; ROWS * width];
        for _ in 0..EPOCHS {
            for k in (1..order.len()).rev() {
                order.swap(k, self.random.below(k + 1));
            }
            for part in order.chunks(ROWS) {
                for (row, (j, at)) in input.chunks_exact_mut(width).zip(part) {
                    row.copy_from_slice(&journeys[*j].features[at * width..][..width]);
                }
                self.step(&input, part.iter().map(|(j, at)| returns[*j][*at]), (&mut tape, &mut turned))?;
            }
        }
        Ok(())
    }

    /// One step of its optimiser: half the squared error.
    fn step(
        &mut self,
        input: &[f32],
        wanted: impl ExactSizeIterator<Item = f32>,
        (tape, turned): (&mut Tape, &mut qv_policy::net::TransposedWeights),
    ) -> Result<(), NavError> {
        let count = wanted.len();
        let said = self.net.forward(&self.parameters, count, input, tape);
        let mut of_output = vec![0.0; count * padded(1)];
        for ((of_row, row), wanted) in
            of_output.chunks_exact_mut(padded(1)).zip(said.chunks_exact(padded(1))).zip(wanted)
        {
            of_row[0] = (row[0] - wanted) / count as f32;
        }
        let mut gradient = vec![0.0; self.net.len()];
        self.net.turn(&self.parameters, turned);
        self.net.backward(turned, count, input, &of_output, tape, &mut gradient);
        let length = self.adam.step(&mut self.parameters, &gradient, RATE, LONGEST);
        if length.is_finite() {
            Ok(())
        } else {
            Err(NavError::value("gradient of the critic", "a finite number", length))
        }
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
