//! Learning from the teacher (DAgger, Ross et al. 2011): the student drives, the teacher says what it would have done, the student learns from
//! all that was ever said.

use crate::NavError;
use crate::augment::Change;
use crate::legs::Legs;
use crate::loss::{loss, sight_loss};
use crate::net::{HIDDEN, KNOWN, Net, OUTPUTS, RAW, RAW_SIGHT, SIGHT, STATE, Stretch, TransposedWeights};
use crate::pilots::{MixedPilot, Mixture, NetPilot};
use crate::places::Sites;
use crate::recall::RECALL;
use crate::roll::{EpisodeTrace, Record, Stage, driven_frames, roll};
pub use crate::settings::TrainSettings;
use crate::task::{Episode, EpisodeSettings};
use crate::tune::Critic;
use qv_core::random::Xoshiro256PlusPlus;
use qv_policy::adam::Adam;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Parts of a batch whose gradients are summed in order: so many, on any number of threads.
const SHARDS: usize = 16;

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
    /// With PPO: what the round's episodes gained, and what the critic knew of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gains: Option<crate::tune::Gains>,
}

/// A student that learns.
pub struct Student {
    /// The network.
    pub net: Net,
    /// Its numbers.
    pub parameters: Vec<f32>,
    adam: Adam,
    pub(crate) settings: TrainSettings,
    records: Vec<Record>,
    /// Decisions of all records that there ever were.
    gathered: usize,
    /// What values states, once PPO has asked for it.
    pub(crate) critic: Option<Critic>,
    #[cfg(feature = "gpu")]
    card: Option<crate::card::GpuLearner>,
    /// Rounds that are behind it.
    pub rounds: usize,
}

impl Student {
    /// One that knows nothing.
    ///
    /// # Errors
    /// When a setting means nothing.
    pub fn new(settings: &TrainSettings) -> Result<Self, NavError> {
        settings.check()?;
        let net = Net::default();
        let parameters = net.draw(&mut Xoshiro256PlusPlus::of(settings.seed, 91, 0));
        let adam = Adam::new(net.len());
        Ok(Self {
            net,
            parameters,
            adam,
            settings: settings.clone(),
            records: Vec::new(),
            gathered: 0,
            critic: None,
            #[cfg(feature = "gpu")]
            card: None,
            rounds: 0,
        })
    }

    /// The same, learning on a graphics card. It drives on the CPU.
    ///
    /// # Errors
    /// When the card has no room, or refuses a shader.
    #[cfg(feature = "gpu")]
    pub fn on_card(self, gpu: crate::card::Gpu) -> Result<Self, NavError> {
        let card = Some(crate::card::GpuLearner::new(gpu, &self.net, &self.settings)?);
        Ok(Self { card, ..self })
    }

    /// Goes on from the numbers of an earlier training, of which nothing else is kept.
    ///
    /// # Errors
    /// When there are not as many as the network has.
    pub fn start_from(&mut self, parameters: Vec<f32>) -> Result<(), NavError> {
        if parameters.len() != self.net.len() {
            return Err(NavError::value("numbers of the network", &self.net.len().to_string(), parameters.len()));
        }
        self.parameters = parameters;
        Ok(())
    }

    /// Decisions gathered.
    pub fn frames(&self) -> usize {
        self.gathered
    }

    /// Rounds that the training has in all.
    pub fn rounds_in_all(&self) -> usize {
        self.settings.rounds
    }

    /// Ends the training after another number of rounds, for one that has a time; the learning rate, and the noise of trials if it shrinks, fall
    /// accordingly. It is at least as many as are behind it.
    pub fn end_after(&mut self, rounds: usize) {
        self.settings.rounds = rounds.max(self.rounds);
    }

    /// One round: drives until enough is gathered, then learns. `notify` hears how far it is.
    ///
    /// # Errors
    /// When an eye or legs fail, or a number of the network is not finite.
    pub fn round(
        &mut self,
        stage: &Stage,
        legs: &mut dyn Legs,
        episodes: &EpisodeSettings,
        notify: &mut dyn FnMut(&Progress),
    ) -> Result<Progress, NavError> {
        let settings = self.settings.clone();
        let mut gather = |student: &mut Self, batch: u64| {
            let seed = student.seed_of(batch);
            let drawn = episodes.draw(stage.world, legs.count(), seed)?;
            match &settings.policy {
                None => student.driver().drive(stage, legs, drawn),
                Some(policy) => student.explore(policy, stage, legs, (drawn, seed)),
            }
        };
        let (mut progress, mut gathered) = self.gather(&mut gather, notify)?;
        if let Some(policy) = &settings.policy {
            progress.gains = Some(self.weigh(policy, stage.world, &mut gathered)?);
            self.records.clear();
        }
        self.learn(gathered, progress, notify)
    }

    /// The same in many places, of which [`SITES`] are driven in at once. A student learns by PPO in one place alone.
    ///
    /// # Errors
    /// When a place cannot be drawn, and as [`Student::round`].
    pub fn round_over(&mut self, sites: &dyn Sites, notify: &mut dyn FnMut(&Progress)) -> Result<Progress, NavError> {
        if self.settings.policy.is_some() {
            return Err(NavError::value("policy", "none: PPO learns in one place", "one"));
        }
        let mut gather = |student: &mut Self, batch: u64| {
            let driver = student.driver();
            let seeds: Vec<u64> = (0..SITES as u64).map(|k| student.seed_of(batch * SITES as u64 + k)).collect();
            let of_sites: Vec<Result<Vec<EpisodeTrace>, NavError>> = seeds
                .into_par_iter()
                .map(|seed| {
                    let mut driven = Vec::new();
                    sites.visit(seed, &mut |stage, legs, episodes| {
                        let drawn = episodes.draw(stage.world, legs.count(), seed)?;
                        driven = driver.drive(stage, legs, drawn)?;
                        Ok(())
                    })?;
                    Ok(driven)
                })
                .collect();
            let mut all = Vec::new();
            for driven in of_sites {
                all.extend(driven?);
            }
            Ok(all)
        };
        let (progress, gathered) = self.gather(&mut gather, notify)?;
        self.learn(gathered, progress, notify)
    }

    /// The seed of a batch of this round.
    fn seed_of(&self, batch: u64) -> u64 {
        Xoshiro256PlusPlus::of(self.settings.seed, 92 + self.rounds as u64 * 1000, batch).bits()
    }

    fn driver(&self) -> Driver<'_> {
        let mixture = if self.rounds == 0 { self.settings.first } else { self.settings.later };
        Driver { net: &self.net, parameters: &self.parameters, mixture }
    }

    /// Drives batch after batch until enough is gathered.
    fn gather(
        &mut self,
        batch: &mut Gather,
        notify: &mut dyn FnMut(&Progress),
    ) -> Result<(Progress, Vec<EpisodeTrace>), NavError> {
        let before = self.frames();
        let (round, share) = (self.rounds + 1, self.share_of(0.0));
        let mut progress = Progress { round, share, loss: f64::NAN, frames: before, success: None, gains: None };
        let (mut gathered, mut batches) = (Vec::<EpisodeTrace>::new(), 0u64);
        let frames = self.settings.frames;
        while driven_frames(&gathered) < frames {
            gathered.extend(batch(self, batches)?);
            batches += 1;
            let now = driven_frames(&gathered);
            progress.frames = before + now;
            progress.share = self.share_of(0.5 * (now as f64 / frames as f64).min(1.0));
            notify(&progress);
        }
        let own: Vec<&EpisodeTrace> = gathered.iter().filter(|d| d.alone && !d.episode.is_absent).collect();
        if !own.is_empty() {
            progress.success = Some(own.iter().filter(|d| d.trial.reached()).count() as f64 / own.len() as f64);
        }
        Ok((progress, gathered))
    }

    /// Learns from what was gathered, and from all before.
    fn learn(
        &mut self,
        gathered: Vec<EpisodeTrace>,
        mut progress: Progress,
        notify: &mut dyn FnMut(&Progress),
    ) -> Result<Progress, NavError> {
        self.add(gathered.into_iter().map(|driven| driven.record));
        let epochs = self.settings.epochs_of(self.rounds);
        for epoch in 0..epochs {
            progress.loss = self.epoch(epoch)?;
            progress.share = self.share_of(0.5 + 0.5 * (epoch + 1) as f64 / epochs as f64);
            notify(&progress);
        }
        self.rounds += 1;
        Ok(progress)
    }

    /// Share of the training that is done once a share of this round is.
    fn share_of(&self, within: f64) -> f64 {
        (self.rounds as f64 + within) / self.settings.rounds as f64
    }

    /// Adds episodes to what is learnt from.
    pub fn add(&mut self, records: impl IntoIterator<Item = Record>) {
        let before = self.records.len();
        self.records.extend(records.into_iter().filter(|r| !r.is_empty()));
        self.gathered += self.records[before..].iter().map(Record::len).sum::<usize>();
        // The oldest go: a student that has become better no longer comes where it was then.
        let mut kept: usize = self.records.iter().map(Record::len).sum();
        let old = self.records.iter().take_while(|record| {
            let is_old = kept > self.settings.kept;
            kept -= if is_old { record.len() } else { 0 };
            is_old
        });
        let old = old.count();
        self.records.drain(..old);
    }

    /// Learns once from all records; gives the mean loss of a decision.
    ///
    /// # Errors
    /// When a number of the network is not finite.
    pub fn epoch(&mut self, epoch: usize) -> Result<f64, NavError> {
        let settings = self.settings.clone();
        let mut random = Xoshiro256PlusPlus::of(settings.seed, 93, (self.rounds * 1000 + epoch) as u64);
        let mut order: Vec<usize> = (0..self.records.len()).collect();
        for k in (1..order.len()).rev() {
            order.swap(k, random.below(k + 1));
        }
        let mut decisions = 0;
        order.retain(|&k| {
            let within = decisions < settings.epoch_frames;
            decisions += if within { self.records[k].len() } else { 0 };
            within
        });
        let (rounds, epochs) = (self.rounds as f32, settings.epochs_of(self.rounds) as f32);
        let rate = |count: usize| {
            let within = (epoch as f32 + count as f32 / decisions.max(1) as f32) / epochs;
            settings.rate_at((rounds + within) / settings.rounds as f32)
        };
        let mut queue = order.into_iter().map(|record| (record, settings.changes.draw(&mut random)));
        #[cfg(feature = "gpu")]
        if let Some(card) = &mut self.card {
            let (sum, count) = card.epoch(&self.records, &mut queue, &settings, rate, &mut self.parameters)?;
            return Ok(sum / count.max(1) as f64);
        }
        let mut shards: Vec<Shard> = (0..SHARDS.min(settings.batch))
            .map(|s| Shard::new(&self.net, (s..settings.batch).step_by(SHARDS).count()))
            .collect();
        let (mut sum, mut count) = (0.0, 0);
        loop {
            // Lane by lane over all shards, so that the last episodes are spread over them.
            for lane in 0..settings.batch {
                let shard = &mut shards[lane % SHARDS];
                shard.refill(lane / SHARDS, &self.records, &mut queue);
            }
            if shards.iter().all(Shard::is_idle) {
                break;
            }
            let (loss, samples) = self.step(&mut shards, rate(count))?;
            (sum, count) = (sum + loss, count + samples);
        }
        Ok(sum / count.max(1) as f64)
    }

    /// One step of the optimiser over the next stretch of all lanes; gives the summed loss and the number of decisions.
    fn step(&mut self, shards: &mut [Shard], rate: f32) -> Result<(f64, usize), NavError> {
        let turned = self.net.turned(&self.parameters);
        let (net, parameters, records, settings) = (&self.net, &self.parameters, &self.records, &self.settings);
        shards.par_iter_mut().for_each(|shard| shard.stretch(net, parameters, &turned, records, settings));
        let samples: usize = shards.iter().map(|s| s.samples).sum();
        let least = 0.25 * (settings.batch * settings.truncated) as f32;
        let scale = 1.0 / (samples as f32).max(least);
        let mut gradient = vec![0.0; net.len()];
        const PART: usize = 8192;
        gradient.par_chunks_mut(PART).enumerate().for_each(|(k, part)| {
            for shard in shards.iter().filter(|s| s.samples > 0) {
                part.iter_mut().zip(&shard.gradient[k * PART..]).for_each(|(sum, x)| *sum += x);
            }
            part.iter_mut().for_each(|g| *g *= scale);
        });
        let length = self.adam.step(&mut self.parameters, &gradient, rate, settings.longest);
        if !length.is_finite() {
            return Err(NavError::value("length of the gradient", "a finite number", length));
        }
        Ok((shards.iter().map(|s| s.loss).sum(), samples))
    }
}

/// Places that are driven in at once: so many, on any number of threads.
pub const SITES: usize = 8;

/// Drives the batch of a number.
type Gather<'a> = dyn FnMut(&mut Student, u64) -> Result<Vec<EpisodeTrace>, NavError> + 'a;

/// Who drives the episodes of a round.
struct Driver<'a> {
    net: &'a Net,
    parameters: &'a [f32],
    mixture: Mixture,
}

impl Driver<'_> {
    /// Episodes that student, teacher and drawn commands drive in turn.
    fn drive(&self, stage: &Stage, legs: &mut dyn Legs, drawn: Vec<Episode>) -> Result<Vec<EpisodeTrace>, NavError> {
        let student = NetPilot::new(self.net, self.parameters, legs.count());
        let mut pilot = MixedPilot::new(student, stage.world.limits, self.mixture, legs.count());
        let rolled = roll(stage, legs, &drawn, &mut pilot, |_| true, &mut |_| {})?;
        let all = drawn.into_iter().zip(rolled);
        Ok(all
            .map(|(episode, (trial, record))| EpisodeTrace {
                alone: self.mixture.is_alone(&episode),
                episode,
                trial,
                record,
            })
            .collect())
    }
}

/// An episode that is learnt from: its record, and the decision that comes next.
#[derive(Debug, Clone)]
struct Lane {
    record: usize,
    next: usize,
    change: Change,
}

/// Some lanes of a batch. In each, one episode after the other is gone through, so that all are busy until the last episodes.
struct Shard {
    lanes: Vec<Option<Lane>>,
    /// A row for each lane.
    memory: Vec<f32>,
    scratch: crate::net::Scratch,
    gradient: Vec<f32>,
    loss: f64,
    samples: usize,
}

impl Shard {
    fn new(net: &Net, lanes: usize) -> Self {
        let memory = vec![0.0; lanes * HIDDEN];
        let (scratch, gradient) = (net.scratch(), vec![0.0; net.len()]);
        Self { lanes: vec![None; lanes], memory, scratch, gradient, loss: 0.0, samples: 0 }
    }

    /// Gives a lane the next episode if it has none left.
    fn refill(&mut self, lane: usize, records: &[Record], queue: &mut impl Iterator<Item = (usize, Change)>) {
        if self.lanes[lane].as_ref().is_none_or(|l| l.next >= records[l.record].len()) {
            self.lanes[lane] = queue.next().map(|(record, change)| Lane { record, next: 0, change });
            self.memory[lane * HIDDEN..][..HIDDEN].fill(0.0);
        }
    }

    fn is_idle(&self) -> bool {
        self.lanes.iter().all(Option::is_none)
    }

    /// Gradient and loss of the next decisions of all lanes.
    fn stretch(
        &mut self,
        net: &Net,
        parameters: &[f32],
        turned: &TransposedWeights,
        records: &[Record],
        settings: &TrainSettings,
    ) {
        (self.loss, self.samples) = (0.0, 0);
        let left = |l: &Lane| (records[l.record].len() - l.next).min(settings.truncated);
        let mut order: Vec<(usize, &mut Lane)> =
            self.lanes.iter_mut().enumerate().filter_map(|(k, l)| l.as_mut().map(|l| (k, l))).collect();
        order.sort_by_key(|(_, l)| std::cmp::Reverse(left(l)));
        if order.is_empty() {
            return;
        }
        self.gradient.fill(0.0);
        let (mut stretch, mut samples) = (Stretch::default(), Vec::new());
        let size = net.picture_len();
        for step in 0..left(order[0].1) {
            let running = order.iter().take_while(|(_, l)| left(l) > step).count();
            stretch.rows.push(running);
            for (_, lane) in &mut order[..running] {
                let (record, at) = (&records[lane.record], lane.next + step);
                lane.change.add(&record.pictures[at * size..][..size], &mut stretch.pictures);
                stretch.states.extend_from_slice(&record.states[at * STATE..][..STATE]);
                stretch.recalls.extend_from_slice(&record.recalls[at * RECALL..][..RECALL]);
                samples.push((record, at));
            }
        }
        let rows = order.iter().flat_map(|(k, _)| &self.memory[k * HIDDEN..][..HIDDEN]);
        let mut memory: Vec<f32> = rows.copied().collect();
        let mut pass = net.forward(parameters, &stretch, &mut memory, &mut self.scratch);
        let mut of_raw = vec![0.0; samples.len() * RAW];
        let mut of_sight = vec![0.0; samples.len() * RAW_SIGHT];
        for (k, (record, at)) in samples.iter().enumerate() {
            let row = &pass.raw[k * RAW..][..OUTPUTS + KNOWN];
            self.loss += f64::from(loss(row, record, *at, settings, &mut of_raw[k * RAW..][..OUTPUTS + KNOWN]));
            let (row, of_row) = (&pass.sight[k * RAW_SIGHT..][..SIGHT], &mut of_sight[k * RAW_SIGHT..][..SIGHT]);
            self.loss += f64::from(sight_loss(row, &record.sights[*at], settings, of_row));
        }
        self.samples = samples.len();
        net.backward(turned, &stretch, &mut pass, [&of_raw, &of_sight], &mut self.scratch, &mut self.gradient);
        for ((k, _), row) in order.iter().zip(memory.chunks_exact(HIDDEN)) {
            self.memory[k * HIDDEN..][..HIDDEN].copy_from_slice(row);
        }
        for lane in self.lanes.iter_mut().flatten() {
            lane.next += left(lane);
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::augment::Changes;
    use crate::net::{HEIGHT, WIDTH};
    use crate::pilots::Mixture;

    pub(crate) fn made_up(seed: u64, length: usize) -> Record {
        let mut random = Xoshiro256PlusPlus::new(seed);
        let mut record = Record::default();
        for step in 0..length {
            // The brightness of the picture is the turning that is wanted.
            let level = random.below(256) as u8;
            record.pictures.extend(std::iter::repeat_n(level, WIDTH * HEIGHT * 3));
            record.states.extend([0.0; STATE]);
            record.recalls.extend([0.0; RECALL]);
            record.sights.push([0.2; SIGHT]);
            record.commands.push([0.5, 0.0, f32::from(level) / 128.0 - 1.0]);
            record.cones.push([0.0, 1.0, 0.5, (step % 2) as f32]);
            record.found.push(step % 3 != 0);
            record.known.push([0.1; KNOWN]);
        }
        record
    }

    #[test]
    fn the_loss_falls_and_threads_do_not_matter() {
        let settings =
            TrainSettings { rounds: 1, epochs: 12, batch: 10, changes: Changes::none(), ..Default::default() };
        let train = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut student = Student::new(&settings).unwrap();
                student.add((0..10).map(|k| made_up(k, 5 + 3 * k as usize)));
                let losses: Vec<f64> = (0..3).map(|epoch| student.epoch(epoch).unwrap()).collect();
                (losses, student.parameters)
            })
        };
        let (losses, parameters) = train(1);
        assert!(losses[2] < 0.7 * losses[0], "{losses:?}");
        assert!(train(3).1 == parameters, "the same bits on three threads");
    }

    /// The same episode with what a student did: some decisions far from what it would say now, so that the objective is clipped.
    #[cfg(feature = "gpu")]
    fn acting(mut record: Record) -> Record {
        let of = |k: usize| (0.7 * k as f32).sin();
        record.acted = (0..record.len())
            .map(|k| crate::tune::StudentAction {
                action: [0.3 * of(k), 0.1, 0.2],
                mean: [0.2 * of(k + 1), 0.0, 0.1],
                deviation: 0.1 + 0.05 * (k % 3) as f32,
                advantage: of(3 * k),
            })
            .collect();
        record
    }

    #[cfg(feature = "gpu")]
    #[test]
    fn the_card_learns_what_the_cpu_learns() {
        let taught = TrainSettings { rounds: 1, batch: 2, truncated: 3, ..Default::default() };
        let trials = TrainSettings { rounds: 1, batch: 2, truncated: 3, ..TrainSettings::tuning() };
        for settings in [taught, trials] {
            match crate::card::Gpu::new(&Default::default()) {
                Ok(gpu) => learns_alike(&settings, gpu),
                Err(why) => return crate::skipped::skipped(why),
            }
        }
    }

    #[cfg(feature = "gpu")]
    fn learns_alike(settings: &TrainSettings, gpu: crate::card::Gpu) {
        println!("{}", gpu.info.name);
        let student = || {
            let mut student = Student::new(settings).unwrap();
            // Some end within a stretch, and the lanes end at different times.
            student.add((0..4).map(|k| acting(made_up(k, 2 + 2 * k as usize))));
            student
        };
        let (mut cpu, mut card) = (student(), student().on_card(gpu).unwrap());
        let before = cpu.parameters.clone();
        for epoch in 0..2 {
            let losses = [cpu.epoch(epoch).unwrap(), card.epoch(epoch).unwrap()];
            let moved: f64 = cpu.parameters.iter().zip(&before).map(|(a, b)| f64::from(a - b).powi(2)).sum();
            let apart: f64 = cpu.parameters.iter().zip(&card.parameters).map(|(a, b)| f64::from(a - b).powi(2)).sum();
            println!("losses {losses:?}, apart {:e} of {:e}", apart.sqrt(), moved.sqrt());
            assert!((losses[0] / losses[1] - 1.0).abs() < 1e-3, "{losses:?}");
            assert!(apart < 1e-3 * moved, "{apart} of {moved}");
        }
    }

    #[test]
    fn lanes_and_stretches_do_not_change_what_is_learnt_from() {
        // At a rate that moves nothing, the mean loss is that of whole episodes from an empty memory, however they are cut.
        let loss_of = |batch: usize, truncated: usize| {
            let changes = Changes::none();
            let settings = TrainSettings { batch, truncated, rate: [1e-7; 2], changes, ..Default::default() };
            let mut student = Student::new(&settings).unwrap();
            student.add((0..9).map(|k| made_up(k, 1 + 4 * k as usize)));
            student.epoch(0).unwrap()
        };
        let whole = loss_of(9, 100);
        for (batch, truncated) in [(1, 100), (2, 7), (20, 3), (9, 1)] {
            let cut = loss_of(batch, truncated);
            assert!((cut / whole - 1.0).abs() < 1e-3, "{batch} lanes of {truncated}: {cut} for {whole}");
        }
    }

    #[test]
    fn a_training_can_end_sooner_but_not_in_the_past() {
        let mut student = Student::new(&TrainSettings::default()).unwrap();
        student.rounds = 5;
        for (wanted, expected) in [(9, 9), (2, 5)] {
            student.end_after(wanted);
            assert_eq!(student.rounds_in_all(), expected);
        }
    }

    #[test]
    fn settings_that_mean_nothing_are_named() {
        let bad = TrainSettings { rounds: 0, ..Default::default() };
        assert!(Student::new(&bad).err().unwrap().to_string().contains("rounds"));
        let later = Mixture { taught: f32::NAN, ..TrainSettings::default().later };
        let bad = TrainSettings { later, ..Default::default() };
        assert!(Student::new(&bad).err().unwrap().to_string().contains("later"));
        let bad = TrainSettings { rate: [1e-3, f32::NAN], ..Default::default() };
        assert!(Student::new(&bad).err().unwrap().to_string().contains("rate"));
    }
}
