//! What the features of a robot without an effect look like, and features in units of that.

use nalgebra::{DMatrix, DVector};
use qv_core::statistics::median;
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
    mean: DVector<f64>,
    /// Lower triangle with `L L' = covariance`.
    root: DMatrix<f64>,
    law_mean: Vec<f64>,
    law_deviation: Vec<f64>,
    /// Standard deviation of each feature.
    deviation: DVector<f64>,
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
        let own: Option<Vec<(DVector<f64>, DVector<f64>)>> =
            (0..windows).map(|w| if are_of_windows { own_spread(samples, w) } else { None }).collect();
        if let Some(own) = own {
            let unit = |s: &Sample| {
                let (middle, spread) = &own[s.window];
                (DVector::from_column_slice(&s.raw.motion) - middle).component_div(spread)
            };
            let units: Vec<DVector<f64>> = samples.iter().map(unit).collect();
            let all = correlation(&units.iter().collect::<Vec<_>>());
            let of_one = |(w, own): (usize, &(DVector<f64>, DVector<f64>))| {
                let mine = units.iter().zip(samples).filter(|u| u.1.window == w).map(|u| u.0);
                let mine: Vec<&DVector<f64>> = mine.collect();
                let share = mine.len() as f64 / (mine.len() + own.0.len()) as f64;
                let mixed = correlation(&mine) * share + &all * (1.0 - share);
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
    pub fn residual(&self, window: usize, raw: &Raw) -> DVector<f64> {
        let mode = self.mode(window);
        let motion = DVector::from_column_slice(&raw.motion) - &mode.mean;
        let law = raw.law.iter().enumerate().map(|(i, x)| x - mode.law_mean[i / self.law_bins]);
        self.scaled(mode, motion, law)
    }

    /// A difference of residuals in the same units.
    pub fn difference(&self, window: usize, raw: &Raw) -> DVector<f64> {
        let mode = self.mode(window);
        self.scaled(mode, DVector::from_column_slice(&raw.motion), raw.law.iter().copied())
    }

    /// Each feature less its mean, in units of its own spread: dependent numbers, for shares only.
    pub fn separate(&self, window: usize, raw: &Raw) -> Raw {
        let mode = self.mode(window);
        let motion = raw.motion.iter().enumerate().map(|(i, x)| (x - mode.mean[i]) / mode.deviation[i]).collect();
        let of_law = |(i, x): (usize, &f64)| {
            let j = i / self.law_bins;
            (x - mode.law_mean[j]) / mode.law_deviation[j]
        };
        Raw { motion, law: raw.law.iter().enumerate().map(of_law).collect() }
    }

    fn scaled(&self, mode: &Mode, mut motion: DVector<f64>, law: impl Iterator<Item = f64>) -> DVector<f64> {
        mode.root.solve_lower_triangular_mut(&mut motion);
        let law = law.enumerate().map(|(i, x)| x / mode.law_deviation[i / self.law_bins]);
        let all: Vec<f64> = motion.iter().copied().chain(law).collect();
        DVector::from_vec(all)
    }
}

impl Mode {
    /// The same mode with another middle and spread of each feature.
    fn with_own(&self, correlation: &DMatrix<f64>, (mean, spread): &(DVector<f64>, DVector<f64>)) -> Option<Self> {
        let size = spread.len();
        let covariance = DMatrix::from_fn(size, size, |i, k| correlation[(i, k)] * spread[i] * spread[k]);
        let root = covariance.cholesky()?.unpack();
        Some(Self { root, mean: mean.clone(), deviation: spread.clone(), ..self.clone() })
    }
}

/// Median of each feature in one window's samples, and the spread about it with outliers cut off; `None` where there are
/// too few.
fn own_spread(samples: &[Sample], window: usize) -> Option<(DVector<f64>, DVector<f64>)> {
    let own: Vec<&Sample> = samples.iter().filter(|s| s.window == window).collect();
    if own.len() < OWN_SAMPLES {
        return None;
    }
    let size = own[0].raw.motion.len();
    let (mut middles, mut spreads) = (DVector::zeros(size), DVector::zeros(size));
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

/// Correlation of samples in units of their spreads, drawn towards none. They are taken to follow Student's t (Lange,
/// Little and Taylor, JASA 84, 1989): a simulation that fell over is no noise.
fn correlation(all: &[&DVector<f64>]) -> DMatrix<f64> {
    let size = all.first().map_or(0, |u| u.len());
    let mut correlation = DMatrix::identity(size, size);
    for _ in 0..ROUNDS {
        let Some(factor) = correlation.clone().cholesky() else { break };
        let mut next = DMatrix::<f64>::zeros(size, size);
        for &u in all {
            let length = u.dot(&factor.solve(u));
            next.ger((FREEDOM + size as f64) / (FREEDOM + length), u, u, 1.0);
        }
        let diagonal = next.diagonal().map(|x| x.max(1e-12).sqrt());
        let shrinkage = (size as f64 / all.len() as f64).clamp(SHRINKAGE[0], SHRINKAGE[1]);
        correlation = DMatrix::from_fn(size, size, |i, k| {
            if i == k { 1.0 } else { (1.0 - shrinkage) * next[(i, k)] / (diagonal[i] * diagonal[k]) }
        });
    }
    correlation
}

/// Mean and covariance of samples.
fn mode(rollout: &Rollout, samples: &[&Sample], law_bins: usize) -> Option<Mode> {
    let size = samples.first()?.raw.motion.len();
    let count = samples.len() as f64;
    let mut mean = DVector::zeros(size);
    samples.iter().for_each(|s| mean += DVector::from_column_slice(&s.raw.motion) / count);
    let mut spread = DMatrix::<f64>::zeros(size, samples.len());
    for (k, s) in samples.iter().enumerate() {
        spread.set_column(k, &(DVector::from_column_slice(&s.raw.motion) - &mean));
    }
    let mut covariance = &spread * spread.transpose() / (count - 1.0).max(1.0);
    add_floor(rollout, &mut covariance);
    let diagonal = covariance.diagonal();
    covariance *= 1.0 - SHRINKAGE[1];
    (0..size).for_each(|i| covariance[(i, i)] += SHRINKAGE[1] * diagonal[i]);
    let deviation = covariance.diagonal().map(f64::sqrt);
    let root = covariance.cholesky()?.unpack();
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
fn add_floor(rollout: &Rollout, covariance: &mut DMatrix<f64>) {
    let bins = rollout.cut.bins();
    let mut first = 0;
    for &channel in &rollout.channels {
        let width = qv_rollout::features::width(channel, bins);
        let mean = (first..first + width).map(|i| covariance[(i, i)]).sum::<f64>() / width as f64;
        (first..first + width).for_each(|i| covariance[(i, i)] += FLOOR * mean + 1e-16);
        first += width;
    }
}
