//! The least squares of the rivals: residuals in units of the sensors' noise, and nothing known of a null or of what other
//! effects any robot has.

use qv_core::JointSeries;
use qv_fit::linear::squared;
use qv_gap::GapError;
use qv_gap::checks::held_out::Closure;
use qv_gap::inference::linearised::LinearisedProblem;
use qv_recording::median_interval;
use qv_rollout::Channel;
use qv_rollout::Overrides;
use qv_rollout::Raw;
use qv_rollout::channels;
use qv_rollout::law;
use qv_rollout::replicate::Noise;

/// Loss of a window whose simulation ran away, over that of the nominal robot.
const RAN_AWAY: f64 = 10.0;
/// Settings simulated at a time: their residuals are in memory together.
const AT_A_TIME: usize = 64;
/// Least deviation of a channel, over the root mean square of its residual: a recording without noise counts by that.
const LEAST: f64 = 0.01;

/// The windows of a study in units of the sensors' noise.
pub struct Plain<'a> {
    /// The robot, the windows and the null; the null is for the yardstick only.
    pub study: LinearisedProblem<'a>,
    /// Windows of the fits.
    pub fitted: Vec<usize>,
    /// Windows that no fit sees.
    pub held_out: Vec<usize>,
    /// Deviation of each number by run, shape `[runs][features and law bins]`.
    scales: Vec<Vec<f64>>,
    /// Loss of the nominal robot by window.
    nominal: Vec<f64>,
}

impl<'a> Plain<'a> {
    /// Scales the windows of a study.
    pub fn new(study: LinearisedProblem<'a>) -> Self {
        let (held_out, fitted) = (0..study.seen.len()).partition(|&w| study.seen[w].window.held_out);
        let scales = (0..study.parts.len()).map(|run| scales(&study, run)).collect();
        let mut plain = Self { study, fitted, held_out, scales, nominal: Vec::new() };
        plain.nominal = plain.study.seen.iter().map(|s| mean_square(&plain.scaled(s.window.run, &s.raw))).collect();
        plain
    }

    /// Some of the windows of the fits, evenly spread, `most` at most.
    pub fn some(&self, most: usize) -> Vec<usize> {
        let count = self.fitted.len().min(most);
        (0..count).map(|k| self.fitted[k * self.fitted.len() / count]).collect()
    }

    /// Loss of the nominal robot in a window.
    pub fn nominal(&self, window: usize) -> f64 {
        self.nominal[window]
    }

    /// Residual of the nominal robot in a window.
    pub fn nominal_vector(&self, window: usize) -> Vec<f64> {
        let seen = &self.study.seen[window];
        self.scaled(seen.window.run, &seen.raw)
    }

    fn scaled(&self, run: usize, raw: &Raw) -> Vec<f64> {
        let all = raw.motion.iter().chain(&raw.law).zip(&self.scales[run]);
        all.map(|(x, s)| x / s).collect()
    }

    /// Residuals of windows under settings, shape `[settings][windows]`; `None` where the simulation ran away.
    ///
    /// # Errors
    /// When a setting has a value that means nothing.
    pub fn vectors(
        &mut self,
        settings: &[Overrides],
        windows: &[usize],
    ) -> Result<Vec<Vec<Option<Vec<f64>>>>, GapError> {
        let mut all = Vec::new();
        for some in settings.chunks(AT_A_TIME) {
            for raws in self.study.raw(some, windows)? {
                let one = |(raw, &w): (&Raw, &usize)| {
                    (!raw.is_empty()).then(|| self.scaled(self.study.seen[w].window.run, raw))
                };
                all.push(raws.iter().zip(windows).map(one).collect());
            }
        }
        Ok(all)
    }

    /// Mean squares by window under settings, shape `[settings][windows]`.
    ///
    /// # Errors
    /// When a setting has a value that means nothing.
    pub fn losses(&mut self, settings: &[Overrides], windows: &[usize]) -> Result<Vec<Vec<f64>>, GapError> {
        let mut all = Vec::new();
        for some in settings.chunks(AT_A_TIME) {
            let vectors = self.vectors(some, windows)?;
            all.extend(vectors.iter().map(|of_setting| self.losses_of(of_setting, windows)));
        }
        Ok(all)
    }

    /// Mean squares of residuals by window.
    pub fn losses_of(&self, vectors: &[Option<Vec<f64>>], windows: &[usize]) -> Vec<f64> {
        let loss = |(v, &w): (&Option<Vec<f64>>, &usize)| {
            v.as_ref().map_or(RAN_AWAY * self.nominal[w], |v| mean_square(v).min(RAN_AWAY * self.nominal[w]))
        };
        vectors.iter().zip(windows).map(loss).collect()
    }

    /// Closed share of the gap in the windows that no fit saw, in the units of the null that the diagnosis reports.
    ///
    /// # Errors
    /// When a setting has a value that means nothing.
    pub fn closed(&mut self, setting: &Overrides) -> Result<f64, GapError> {
        Ok(qv_gap::checks::held_out::closure(&mut self.study, setting)?.closed())
    }

    /// The same of residuals of the held-out windows; empty ones are left out.
    pub fn closed_by(&self, after: &[Raw]) -> f64 {
        let mut closure = Closure {
            windows: Vec::new(),
            before: Vec::new(),
            after_raw: Vec::new(),
            after: Vec::new(),
            floor: self.study.floor,
        };
        for (&w, raw) in self.held_out.iter().zip(after).filter(|(_, raw)| !raw.is_empty()) {
            closure.before.push(null_loss(&self.study, w, &self.study.seen[w].raw));
            closure.after.push(null_loss(&self.study, w, raw));
        }
        closure.closed()
    }
}

/// Mean square of a residual in units of the null.
fn null_loss(study: &LinearisedProblem, window: usize, raw: &Raw) -> f64 {
    let seen = &study.seen[window];
    mean_square(&study.whitener(seen).residual(seen.index, raw))
}

fn mean_square(v: &[f64]) -> f64 {
    squared(v) / v.len().max(1) as f64
}

/// Deviation of each number of a run's residuals that white noise of the sensors gives.
fn scales(study: &LinearisedProblem, run: usize) -> Vec<f64> {
    let rollout = &study.rollout;
    let Some(first) = study.seen.iter().find(|s| s.window.run == run) else { return Vec::new() };
    let m = &first.window.view.measured;
    let noise = &study.parts[run].noise;
    let mut all = Vec::with_capacity(first.raw.motion.len() + first.raw.law.len());
    for &channel in &rollout.channels {
        let width = channels::width(channel, rollout.cut.bins());
        let series = match channel {
            Channel::Position(_) => &m.position,
            Channel::Velocity(_) => &m.velocity,
            Channel::Gyro(_) => &m.gyro,
            Channel::Attitude(_) if m.orientation.is_some() => &m.orientation,
            _ => &m.base_pose,
        };
        let deviation = of_channel(noise, channel, m.orientation.is_some()) / root_count(series, rollout.cut.bin);
        all.extend(std::iter::repeat_n(deviation, width));
    }
    for &j in &rollout.law_joints {
        let deviation = noise.torque[j] / root_count(&m.torque, law::BIN);
        all.extend(std::iter::repeat_n(deviation, law::bins(rollout)));
    }
    at_least_a_share_of_the_residual(study, run, &mut all);
    all
}

/// Deviation of a sample.
fn of_channel(noise: &Noise, channel: Channel, imu: bool) -> f64 {
    match channel {
        Channel::Position(j) => noise.position[j],
        Channel::Velocity(j) => noise.velocity[j],
        Channel::Gyro(_) => noise.gyro,
        Channel::Attitude(_) => {
            if imu {
                noise.orientation
            } else {
                noise.pose
            }
        }
        Channel::PoseAgainstImu(_) => noise.pose.hypot(noise.orientation),
        Channel::Base(_) | Channel::Ground => noise.place,
    }
}

/// Root of the number of samples in a bin, at least 1.
fn root_count(series: &Option<JointSeries>, bin: f64) -> f64 {
    let interval = series.as_ref().map_or(0.0, |s| median_interval(&s.time));
    if interval > 0.0 { (bin / interval).max(1.0).sqrt() } else { 1.0 }
}

fn at_least_a_share_of_the_residual(study: &LinearisedProblem, run: usize, deviations: &mut [f64]) {
    let (bins, law_bins) = (study.rollout.cut.bins(), law::bins(&study.rollout));
    let widths = study.rollout.channels.iter().map(|&c| channels::width(c, bins));
    let widths: Vec<usize> = widths.chain(study.rollout.law_joints.iter().map(|_| law_bins)).collect();
    let mut first = 0;
    for width in widths {
        let (mut sum, mut count) = (0.0, 0usize);
        for seen in study.seen.iter().filter(|s| s.window.run == run && !s.window.held_out) {
            let all = seen.raw.motion.iter().chain(&seen.raw.law).skip(first).take(width);
            sum += all.map(|x| x * x).sum::<f64>();
            count += width;
        }
        let least = (LEAST * (sum / count.max(1) as f64).sqrt()).max(1e-9);
        deviations[first..first + width].iter_mut().for_each(|d| *d = d.max(least));
        first += width;
    }
}
