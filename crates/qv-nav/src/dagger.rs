//! Learning from the teacher (DAgger, Ross et al. 2011): the student drives, the teacher says what it would have done, the student learns from
//! all that was ever said.

use crate::NavError;
use crate::legs::Legs;
use crate::net::{COMMAND, HIDDEN, Net, OUTPUTS, STATE, Stretch, Turned};
use crate::pilots::{MixedPilot, NetPilot, is_taught};
use crate::roll::{Record, Stage, roll};
use crate::task::{EpisodeSettings, Trial};
use qv_core::random::Xoshiro256PlusPlus;
use qv_policy::adam::Adam;
use qv_policy::net::padded;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

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
    /// Episodes in a step of the optimiser.
    pub batch: usize,
    /// Learning rate at the beginning and at the end.
    pub rate: [f32; 2],
    /// Share of the episodes that the teacher drives after the first round, which it drives alone.
    pub taught: f32,
    /// Weight of what is said of the cone beside the command.
    pub cone_weight: f32,
    /// Robots at once.
    pub robots: usize,
    /// Of everything.
    pub seed: u64,
}

impl Default for TrainSettings {
    fn default() -> Self {
        Self {
            rounds: 6,
            frames: 20_000,
            epochs: 6,
            batch: 8,
            rate: [1e-3, 2e-4],
            taught: 0.2,
            cone_weight: 0.3,
            robots: 48,
            seed: 0,
        }
    }
}

/// Steps through which gradients go back.
pub const TRUNCATED: usize = 25;
/// Parts of a batch whose gradients are summed in order: so many, on any number of threads.
const SHARDS: usize = 8;
/// Where the loss of a command becomes linear, in shares of its limits.
const HUBER: f32 = 0.3;
/// A gradient longer than this is shortened.
const LONGEST: f32 = 1.0;

/// How far a training is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// Round, from 1.
    pub round: usize,
    /// Share of the whole that is done.
    pub share: f64,
    /// Mean loss of the last epoch.
    pub loss: f64,
    /// Decisions gathered.
    pub frames: usize,
    /// Share of the student's own episodes of this round that reached the cone, before it learnt from them; none in the first round.
    pub success: Option<f64>,
}

/// A student that learns.
pub struct Student {
    /// The network.
    pub net: Net,
    /// Its numbers.
    pub parameters: Vec<f32>,
    adam: Adam,
    settings: TrainSettings,
    records: Vec<Record>,
    /// Rounds that are behind it.
    pub rounds: usize,
}

impl Student {
    /// One that knows nothing.
    ///
    /// # Errors
    /// When a setting means nothing.
    pub fn new(settings: &TrainSettings) -> Result<Self, NavError> {
        for (what, found, least) in [
            ("rounds", settings.rounds, 1),
            ("frames", settings.frames, 1),
            ("epochs", settings.epochs, 1),
            ("batch", settings.batch, 1),
            ("robots", settings.robots, 1),
        ] {
            if found < least || found > 100_000_000 {
                return Err(NavError::value(what, "1 to 100 million", found));
            }
        }
        let rates = settings.rate.iter().all(|r| (1e-7..=1.0).contains(r));
        if !(rates && (0.0..=1.0).contains(&settings.taught) && (0.0..=10.0).contains(&settings.cone_weight)) {
            let found = format!("{:?}, {}, {}", settings.rate, settings.taught, settings.cone_weight);
            return Err(NavError::value("rate, taught, cone_weight", "rates of 1e-7 to 1, 0 to 1, 0 to 10", found));
        }
        let net = Net::default();
        let parameters = net.draw(&mut Xoshiro256PlusPlus::of(settings.seed, 91, 0));
        let adam = Adam::new(net.len());
        Ok(Self { net, parameters, adam, settings: settings.clone(), records: Vec::new(), rounds: 0 })
    }

    /// Decisions gathered.
    pub fn frames(&self) -> usize {
        self.records.iter().map(Record::len).sum()
    }

    /// One round: drives until enough is gathered, then learns. `tell` hears how far it is.
    ///
    /// # Errors
    /// When an eye or legs fail, or a number of the network is not finite.
    pub fn round(
        &mut self,
        stage: &Stage,
        legs: &mut dyn Legs,
        episodes: &EpisodeSettings,
        tell: &mut dyn FnMut(&Progress),
    ) -> Result<Progress, NavError> {
        let settings = self.settings.clone();
        let before = self.frames();
        let share = if self.rounds == 0 { 1.0 } else { settings.taught };
        let rounds = self.rounds as f64;
        let part = |within: f64| (rounds + within) / settings.rounds as f64;
        let mut progress =
            Progress { round: self.rounds + 1, share: part(0.0), loss: f64::NAN, frames: before, success: None };
        let (mut own, mut batch) = (Vec::<Trial>::new(), 0u64);
        let mut gathered = Vec::new();
        while gathered.iter().map(Record::len).sum::<usize>() < settings.frames {
            let seed = Xoshiro256PlusPlus::of(settings.seed, 92 + self.rounds as u64 * 1000, batch).bits();
            let drawn = episodes.draw(stage.world, legs.count(), seed)?;
            let student = NetPilot::new(&self.net, &self.parameters, legs.count());
            let taught = vec![false; legs.count()];
            let mut pilot = MixedPilot { student, limits: stage.world.limits, share, taught };
            for (episode, (trial, record)) in
                drawn.iter().zip(roll(stage, legs, &drawn, &mut pilot, |_| true, &mut |_| {})?)
            {
                if !is_taught(episode, share) {
                    own.push(trial);
                }
                gathered.push(record);
            }
            batch += 1;
            let now = gathered.iter().map(Record::len).sum::<usize>();
            progress.frames = before + now;
            progress.share = part(0.5 * (now as f64 / settings.frames as f64).min(1.0));
            tell(&progress);
        }
        self.add(gathered);
        if !own.is_empty() {
            progress.success = Some(own.iter().filter(|t| t.reached()).count() as f64 / own.len() as f64);
        }
        for epoch in 0..settings.epochs {
            progress.loss = self.epoch(epoch)?;
            progress.share = part(0.5 + 0.5 * (epoch + 1) as f64 / settings.epochs as f64);
            tell(&progress);
        }
        self.rounds += 1;
        Ok(progress)
    }

    /// Adds episodes to what is learnt from.
    pub fn add(&mut self, records: impl IntoIterator<Item = Record>) {
        self.records.extend(records.into_iter().filter(|r| !r.is_empty()));
    }

    /// Learns once from all records; gives the mean loss of a decision.
    ///
    /// # Errors
    /// When a number of the network is not finite.
    pub fn epoch(&mut self, epoch: usize) -> Result<f64, NavError> {
        let settings = &self.settings;
        let index = (self.rounds * settings.epochs + epoch) as u64;
        let mut random = Xoshiro256PlusPlus::of(settings.seed, 93, index);
        let mut order: Vec<usize> = (0..self.records.len()).collect();
        for k in (1..order.len()).rev() {
            order.swap(k, random.below(k + 1));
        }
        let whole = (settings.rounds * settings.epochs) as f32;
        let (mut sum, mut count) = (0.0, 0usize);
        let batches: Vec<Vec<usize>> = order.chunks(settings.batch).map(<[usize]>::to_vec).collect();
        for (k, batch) in batches.iter().enumerate() {
            let done = (index as f32 + k as f32 / batches.len() as f32) / whole;
            let [from, to] = self.settings.rate;
            let rate = from * (to / from).powf(done.min(1.0));
            let (loss, samples) = self.learn(batch, rate)?;
            (sum, count) = (sum + loss, count + samples);
        }
        Ok(sum / count.max(1) as f64)
    }

    /// Learns from some episodes, stretch by stretch; gives the summed loss and the number of decisions.
    fn learn(&mut self, batch: &[usize], rate: f32) -> Result<(f64, usize), NavError> {
        let mut shards: Vec<Shard> = (0..SHARDS.min(batch.len()))
            .map(|s| Shard::new(&self.net, batch.iter().skip(s).step_by(SHARDS).map(|&r| &self.records[r]).collect()))
            .collect();
        let longest = batch.iter().map(|&r| self.records[r].len()).max().unwrap_or(0);
        let least = 0.25 * (self.settings.batch * TRUNCATED) as f32;
        let (mut sum, mut count) = (0.0, 0);
        for first in (0..longest).step_by(TRUNCATED) {
            let turned = self.net.turned(&self.parameters);
            let (net, parameters, weight) = (&self.net, &self.parameters, self.settings.cone_weight);
            shards.par_iter_mut().for_each(|shard| shard.stretch(net, parameters, &turned, first, weight));
            let samples: usize = shards.iter().map(|s| s.samples).sum();
            let mut gradient = vec![0.0; self.net.len()];
            for shard in &shards {
                gradient.iter_mut().zip(&shard.gradient).for_each(|(sum, x)| *sum += x);
                sum += shard.loss;
            }
            let scale = 1.0 / (samples as f32).max(least);
            gradient.iter_mut().for_each(|g| *g *= scale);
            let length = self.adam.step(&mut self.parameters, &gradient, rate, LONGEST);
            if !length.is_finite() {
                return Err(NavError::value("length of the gradient", "a finite number", length));
            }
            count += samples;
        }
        Ok((sum, count))
    }
}

/// Some episodes of a batch, the longest first.
struct Shard<'a> {
    records: Vec<&'a Record>,
    memory: Vec<f32>,
    scratch: crate::net::Scratch,
    gradient: Vec<f32>,
    loss: f64,
    samples: usize,
}

impl<'a> Shard<'a> {
    fn new(net: &Net, mut records: Vec<&'a Record>) -> Self {
        records.sort_by_key(|r| std::cmp::Reverse(r.len()));
        let memory = vec![0.0; records.len() * HIDDEN];
        Self { records, memory, scratch: net.scratch(), gradient: vec![0.0; net.len()], loss: 0.0, samples: 0 }
    }

    /// Gradient and loss of the decisions from `first` on.
    fn stretch(&mut self, net: &Net, parameters: &[f32], turned: &Turned, first: usize, cone_weight: f32) {
        self.gradient.fill(0.0);
        (self.loss, self.samples) = (0.0, 0);
        let (mut stretch, mut samples) = (Stretch::default(), Vec::new());
        let size = net.picture_len();
        for step in first..first + TRUNCATED {
            let running: Vec<&Record> = self.records.iter().copied().filter(|r| r.len() > step).collect();
            if running.is_empty() {
                break;
            }
            stretch.rows.push(running.len());
            for record in running {
                stretch.pictures.extend_from_slice(&record.pictures[step * size..][..size]);
                stretch.states.extend_from_slice(&record.states[step * STATE..][..STATE]);
                samples.push((record, step));
            }
        }
        if samples.is_empty() {
            return;
        }
        let mut pass = net.forward(parameters, &stretch, &mut self.memory, &mut self.scratch);
        let mut of_raw = vec![0.0; samples.len() * padded(OUTPUTS)];
        for (k, (record, step)) in samples.iter().enumerate() {
            let at = k * padded(OUTPUTS);
            let row = &pass.raw[at..][..OUTPUTS];
            self.loss += f64::from(loss(row, record, *step, cone_weight, &mut of_raw[at..][..OUTPUTS]));
        }
        self.samples = samples.len();
        net.backward(turned, &stretch, &mut pass, &of_raw, &mut self.scratch, &mut self.gradient);
    }
}

/// Loss of one decision, and its gradient by what came out before tanh and the logistic function.
fn loss(raw: &[f32], record: &Record, step: usize, cone_weight: f32, of_raw: &mut [f32]) -> f32 {
    let mut sum = 0.0;
    for k in 0..COMMAND {
        let y = raw[k].tanh();
        let off = y - record.commands[step][k];
        let near = off.abs() <= HUBER;
        sum += if near { 0.5 * off * off } else { HUBER * (off.abs() - 0.5 * HUBER) };
        of_raw[k] = off.clamp(-HUBER, HUBER) * (1.0 - y * y);
    }
    let cone = &record.cones[step];
    if record.found[step] {
        for k in 0..3 {
            let off = raw[COMMAND + k] - cone[k];
            sum += cone_weight * 0.5 * off * off;
            of_raw[COMMAND + k] = cone_weight * off;
        }
    }
    let logit = raw[OUTPUTS - 1];
    // Cross entropy, written so that no logarithm of 0 occurs.
    sum += 0.3 * cone_weight * (logit.max(0.0) - logit * cone[3] + (-logit.abs()).exp().ln_1p());
    of_raw[OUTPUTS - 1] = 0.3 * cone_weight * (1.0 / (1.0 + (-logit).exp()) - cone[3]);
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::net::{HEIGHT, WIDTH};

    fn made_up(seed: u64, length: usize) -> Record {
        let mut random = Xoshiro256PlusPlus::new(seed);
        let mut record = Record::default();
        for step in 0..length {
            // The brightness of the picture is the turning that is wanted.
            let level = random.below(256) as u8;
            record.pictures.extend(std::iter::repeat_n(level, WIDTH * HEIGHT * 3));
            record.states.extend([0.0; STATE]);
            record.commands.push([0.5, 0.0, f32::from(level) / 128.0 - 1.0]);
            record.cones.push([0.0, 1.0, 0.5, (step % 2) as f32]);
            record.found.push(true);
        }
        record
    }

    #[test]
    fn the_gradient_is_the_slope_of_the_loss() {
        let record = made_up(1, 3);
        let raw = [0.3, -0.9, 1.2, 0.2, 0.7, 0.1, -0.4];
        let mut gradient = [0.0; OUTPUTS];
        loss(&raw, &record, 1, 0.3, &mut gradient);
        for k in 0..OUTPUTS {
            let at = |by: f32| {
                let mut moved = raw;
                moved[k] += by;
                loss(&moved, &record, 1, 0.3, &mut [0.0; OUTPUTS])
            };
            let slope = (at(5e-3) - at(-5e-3)) / 1e-2;
            assert!((slope - gradient[k]).abs() < 1e-3, "{k}: {slope} {}", gradient[k]);
        }
    }

    #[test]
    fn the_loss_falls_and_threads_do_not_matter() {
        let settings = TrainSettings { rounds: 1, epochs: 12, batch: 10, ..Default::default() };
        let train = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut student = Student::new(&settings).unwrap();
                student.records = (0..10).map(|k| made_up(k, 5 + 3 * k as usize)).collect();
                let losses: Vec<f64> = (0..3).map(|epoch| student.epoch(epoch).unwrap()).collect();
                (losses, student.parameters)
            })
        };
        let (losses, parameters) = train(1);
        assert!(losses[2] < 0.7 * losses[0], "{losses:?}");
        assert!(train(3).1 == parameters, "the same bits on three threads");
    }

    #[test]
    fn settings_that_mean_nothing_are_named() {
        let bad = TrainSettings { rounds: 0, ..Default::default() };
        assert!(Student::new(&bad).err().unwrap().to_string().contains("rounds"));
        let bad = TrainSettings { taught: f32::NAN, ..Default::default() };
        assert!(Student::new(&bad).err().unwrap().to_string().contains("taught"));
    }
}
