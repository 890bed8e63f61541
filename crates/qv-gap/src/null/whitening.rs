//! What the features of a robot without an effect look like, and features in units of that.

use qv_core::statistics::median;
use qv_fit::linear::{add_diagonal, add_scaled, add_scaled_matrix, diagonal_of, from_columns, minus, outer, squared};
use qv_fit::{Cholesky, Matrix};
use qv_rollout::Raw;
use qv_rollout::Rollout;
use qv_rollout::law;

/// Least and most share of a covariance that is taken from its diagonal: samples are few.
const SHRINKAGE: [f64; 2] = [0.02, 0.2];
/// Added to each variance, as a share of the mean variance of its channel.
const FLOOR: f64 = 0.02;
/// Samples of a window from which on it has a spread of its own.
const OWN_SAMPLES: usize = 30;
/// Rounds in which a correlation settles.
const ROUNDS: usize = 8;
/// Degrees of freedom of Student's t.
const FREEDOM: f64 = 5.0;

/// Features of a window of a simulated recording without an effect.
#[derive(Debug, Clone)]
pub struct Sample {
    /// Index of the window in the run.
    pub window: usize,
    /// Whether it moves.
    pub moving: bool,
    /// The features.
    pub raw: Raw,
}

/// Mean and spread of the features of windows that are alike.
#[derive(Clone)]
struct Mode {
    mean: Vec<f64>,
    /// Of the covariance.
    root: Cholesky,
    law_mean: Vec<f64>,
    law_deviation: Vec<f64>,
    /// Standard deviation of each feature.
    deviation: Vec<f64>,
}

/// Mean and spread of the features of each window of a run when there is no effect.
pub struct Whitener {
    /// Of each window, as an index into `modes`.
    of_window: Vec<usize>,
    modes: Vec<Mode>,
    law_bins: usize,
}

impl Whitener {
    /// From windows of simulated recordings of a run, each of whose windows moves or does not; or of other recordings,
    /// whose windows are only alike (`are_of_windows` is false).
    ///
    /// Windows that move and windows that do not have a mean and a covariance each. Where there are samples enough of
    /// each window it has a spread of its own: noise in the start of an arm that stands on its head grows within a
    /// window far beyond what it does when it hangs.
    pub fn new(rollout: &Rollout, samples: &[Sample], moving: &[bool], are_of_windows: bool) -> Option<Self> {
        let windows = moving.len();
        let law_bins = law::bins(rollout);
        let of = |moving: bool| {
            let some: Vec<&Sample> = samples.iter().filter(|s| s.moving == moving).collect();
            let all: Vec<&Sample> = samples.iter().collect();
            mode(rollout, if some.len() < 30 { &all } else { &some }, law_bins)
        };
        let mut modes = vec![of(false)?, of(true)?];
        let mut of_window: Vec<usize> = moving.iter().map(|m| usize::from(*m)).collect();
        let own: Option<Vec<(Vec<f64>, Vec<f64>)>> =
            (0..windows).map(|w| if are_of_windows { own_spread(samples, w) } else { None }).collect();
        if let Some(own) = own {
            let unit = |s: &Sample| {
                let (middle, spread) = &own[s.window];
                minus(&s.raw.motion, middle).iter().zip(spread).map(|(x, s)| x / s).collect()
            };
            let units: Vec<Vec<f64>> = samples.iter().map(unit).collect();
            let size = own.first().map_or(0, |o| o.0.len());
            let all = correlation(&from_columns(size, &units));
            let of_one = |(w, own): (usize, &(Vec<f64>, Vec<f64>))| {
                let mine = units.iter().zip(samples).filter(|u| u.1.window == w).map(|u| u.0.clone());
                let mine: Vec<Vec<f64>> = mine.collect();
                let share = mine.len() as f64 / (mine.len() + size) as f64;
                let mut mixed = &all * (1.0 - share);
                add_scaled_matrix(&mut mixed, share, &correlation(&from_columns(size, &mine)));
                modes[of_window[w]].with_own(&mixed, own)
            };
            modes = own.iter().enumerate().map(of_one).collect::<Option<_>>()?;
            of_window = (0..windows).collect();
        }
        Some(Self { of_window, modes, law_bins })
    }

    fn mode(&self, window: usize) -> &Mode {
        &self.modes[self.of_window[window]]
    }

    /// A residual as independent numbers of variance 1, less the mean.
    pub fn residual(&self, window: usize, raw: &Raw) -> Vec<f64> {
        let mode = self.mode(window);
        let mut all = minus(&raw.motion, &mode.mean);
        mode.root.whiten(&mut all);
        let law = raw.law.iter().enumerate().map(|(i, x)| x - mode.law_mean[i / self.law_bins]);
        all.extend(law.enumerate().map(|(i, x)| x / mode.law_deviation[i / self.law_bins]));
        all.extend(raw.state_noise.iter().zip(&mode.law_deviation).map(|(x, deviation)| x / deviation));
        all
    }

    /// Differences of residuals in the same units, shape `[features, differences]`.
    pub fn differences(&self, window: usize, raw: &[&Raw]) -> Matrix {
        let mode = self.mode(window);
        let size = mode.mean.len();
        let mut motion = Matrix::from_fn(size, raw.len(), |i, k| raw[k].motion[i]);
        mode.root.whiten_columns(&mut motion);
        let of_law = raw.first().map_or(0, |r| r.law.len());
        let features = size + of_law + raw.first().map_or(0, |r| r.state_noise.len());
        let law = |i: usize, k: usize| match i.checked_sub(of_law) {
            Some(joint) => raw[k].state_noise[joint] / mode.law_deviation[joint],
            None => raw[k].law[i] / mode.law_deviation[i / self.law_bins],
        };
        Matrix::from_fn(features, raw.len(), |i, k| if i < size { motion[(i, k)] } else { law(i - size, k) })
    }

    /// Each feature less its mean, in units of its own spread: dependent numbers, for shares only.
    pub(crate) fn separate(&self, window: usize, raw: &Raw) -> Raw {
        let mode = self.mode(window);
        let motion = raw.motion.iter().enumerate().map(|(i, x)| (x - mode.mean[i]) / mode.deviation[i]).collect();
        let of_law = |(i, x): (usize, &f64)| {
            let j = i / self.law_bins;
            (x - mode.law_mean[j]) / mode.law_deviation[j]
        };
        Raw { motion, law: raw.law.iter().enumerate().map(of_law).collect(), state_noise: Vec::new() }
    }
}

impl Mode {
    /// The same mode with another middle and spread of each feature.
    fn with_own(&self, correlation: &Matrix, (mean, spread): &(Vec<f64>, Vec<f64>)) -> Option<Self> {
        let size = spread.len();
        let covariance = Matrix::from_fn(size, size, |i, k| correlation[(i, k)] * spread[i] * spread[k]);
        let root = Cholesky::new(&covariance)?;
        Some(Self { root, mean: mean.clone(), deviation: spread.clone(), ..self.clone() })
    }
}

/// Median of each feature in one window's samples, and the spread about it with outliers cut off; `None` where there are
/// too few.
fn own_spread(samples: &[Sample], window: usize) -> Option<(Vec<f64>, Vec<f64>)> {
    let own: Vec<&Sample> = samples.iter().filter(|s| s.window == window).collect();
    if own.len() < OWN_SAMPLES {
        return None;
    }
    let size = own[0].raw.motion.len();
    let (mut middles, mut spreads) = (vec![0.0; size], vec![0.0; size]);
    for i in 0..size {
        let mut all: Vec<f64> = own.iter().map(|s| s.raw.motion[i]).collect();
        middles[i] = median(&mut all);
        all.iter_mut().for_each(|x| *x = (*x - middles[i]).abs());
        all.sort_by(f64::total_cmp);
        // Nine tenths of a normal distribution lie within 1.645 deviations; their root mean square is 0.789 of one.
        all.truncate((all.len() * 9).div_ceil(10));
        spreads[i] = (all.iter().map(|x| x * x).sum::<f64>() / all.len() as f64).sqrt() / 0.789 + 1e-9;
    }
    Some((middles, spreads))
}

/// Correlation of samples in units of their spreads, shape `[features, samples]`, drawn towards none. They are taken to follow Student's t (Lange,
/// Little and Taylor, JASA 84, 1989): a simulation that fell over is no noise.
fn correlation(all: &Matrix) -> Matrix {
    let (size, count) = all.shape();
    let mut correlation = Matrix::identity(size, size);
    for _ in 0..ROUNDS {
        let Some(factor) = Cholesky::new(&correlation) else { break };
        let mut white = all.clone();
        factor.whiten_columns(&mut white);
        let root = |k: usize| ((FREEDOM + size as f64) / (FREEDOM + squared(white.col_as_slice(k)))).sqrt();
        let roots: Vec<f64> = (0..count).map(root).collect();
        let next = outer(&Matrix::from_fn(size, count, |i, k| roots[k] * all[(i, k)]));
        let diagonal: Vec<f64> = diagonal_of(&next).iter().map(|x| x.max(1e-12).sqrt()).collect();
        let shrinkage = (size as f64 / count as f64).clamp(SHRINKAGE[0], SHRINKAGE[1]);
        correlation = Matrix::from_fn(size, size, |i, k| {
            if i == k { 1.0 } else { (1.0 - shrinkage) * next[(i, k)] / (diagonal[i] * diagonal[k]) }
        });
    }
    correlation
}

/// Mean and covariance of samples.
fn mode(rollout: &Rollout, samples: &[&Sample], law_bins: usize) -> Option<Mode> {
    let size = samples.first()?.raw.motion.len();
    let count = samples.len() as f64;
    let mut mean = vec![0.0; size];
    samples.iter().for_each(|s| add_scaled(&mut mean, 1.0 / count, &s.raw.motion));
    let spread: Vec<Vec<f64>> = samples.iter().map(|s| minus(&s.raw.motion, &mean)).collect();
    let mut covariance = outer(&from_columns(size, &spread)) * (1.0 / (count - 1.0).max(1.0));
    add_floor(rollout, &mut covariance);
    let variances = diagonal_of(&covariance);
    covariance *= 1.0 - SHRINKAGE[1];
    add_diagonal(&mut covariance, &variances.iter().map(|v| SHRINKAGE[1] * v).collect::<Vec<_>>());
    let deviation = diagonal_of(&covariance).iter().map(|v| v.sqrt()).collect();
    let root = Cholesky::new(&covariance)?;
    let joints = rollout.law_joints.len();
    let (mut law_mean, mut law_deviation) = (Vec::new(), Vec::new());
    for j in 0..joints {
        let of_joint = |s: &Sample| s.raw.law[j * law_bins..(j + 1) * law_bins].to_vec();
        let all: Vec<f64> = samples.iter().flat_map(|s| of_joint(s)).filter(|x| x.is_finite()).collect();
        let n = all.len().max(1) as f64;
        let m = all.iter().sum::<f64>() / n;
        law_mean.push(m);
        law_deviation.push((all.iter().map(|x| (x - m).powi(2)).sum::<f64>() / n).sqrt().max(1e-6));
    }
    Some(Mode { mean, root, law_mean, law_deviation, deviation })
}

/// A feature that hardly varies among few samples must not become all-important.
fn add_floor(rollout: &Rollout, covariance: &mut Matrix) {
    let bins = rollout.cut.bins();
    let mut first = 0;
    for &channel in &rollout.channels {
        let width = qv_rollout::channels::width(channel, bins);
        let mean = (first..first + width).map(|i| covariance[(i, i)]).sum::<f64>() / width as f64;
        (first..first + width).for_each(|i| covariance[(i, i)] += FLOOR * mean + 1e-16);
        first += width;
    }
}
