//! What the features of a robot without an effect look like, and features in units of that.

use crate::law;
use crate::problem::Problem;
use nalgebra::{DMatrix, DVector};

/// Share of the covariance that is taken from its diagonal: samples are few.
const SHRINKAGE: f64 = 0.2;
/// Added to each variance, as a share of the mean variance of its channel.
const FLOOR: f64 = 0.02;

/// Raw features of a window: simulated ones, then those of the actuator's law.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Raw {
    /// Measured minus simulated, shape `[features]`.
    pub motion: Vec<f64>,
    /// Measured minus expected torque, shape `[law joints, bins]`.
    pub law: Vec<f64>,
}

impl Raw {
    /// Whether there is nothing.
    pub fn is_empty(&self) -> bool {
        self.motion.is_empty()
    }

    /// `self - other`.
    pub fn minus(&self, other: &Self) -> Self {
        let minus = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect();
        Self { motion: minus(&self.motion, &other.motion), law: minus(&self.law, &other.law) }
    }
}

/// Mean and spread of one mode.
struct Mode {
    mean: DVector<f64>,
    /// Lower triangle with `L L' = covariance`.
    root: DMatrix<f64>,
    law_mean: Vec<f64>,
    law_deviation: Vec<f64>,
    /// Standard deviation of each feature.
    deviation: DVector<f64>,
}

/// Mean and spread of the features when there is no effect, for windows that move and windows that do not.
pub struct Whitener {
    still: Mode,
    moving: Mode,
    law_bins: usize,
}

impl Whitener {
    /// From windows of simulated recordings, with whether they move.
    pub fn new(problem: &Problem, samples: &[(bool, Raw)]) -> Option<Self> {
        let law_bins = law::bins(problem);
        let of = |moving: bool| {
            let some: Vec<&Raw> = samples.iter().filter(|s| s.0 == moving).map(|s| &s.1).collect();
            let all: Vec<&Raw> = samples.iter().map(|s| &s.1).collect();
            mode(problem, if some.len() < 30 { &all } else { &some }, law_bins)
        };
        Some(Self { still: of(false)?, moving: of(true)?, law_bins })
    }

    fn mode(&self, moving: bool) -> &Mode {
        if moving { &self.moving } else { &self.still }
    }

    /// A residual as independent numbers of variance 1, less the mean.
    pub fn residual(&self, moving: bool, raw: &Raw) -> DVector<f64> {
        let mode = self.mode(moving);
        let motion = DVector::from_column_slice(&raw.motion) - &mode.mean;
        let law = raw.law.iter().enumerate().map(|(i, x)| x - mode.law_mean[i / self.law_bins]);
        self.scaled(mode, motion, law)
    }

    /// A difference of residuals in the same units.
    pub fn difference(&self, moving: bool, raw: &Raw) -> DVector<f64> {
        let mode = self.mode(moving);
        self.scaled(mode, DVector::from_column_slice(&raw.motion), raw.law.iter().copied())
    }

    /// Each feature less its mean, in units of its own spread: dependent numbers, for shares only.
    pub fn separate(&self, moving: bool, raw: &Raw) -> Raw {
        let mode = self.mode(moving);
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

fn mode(problem: &Problem, samples: &[&Raw], law_bins: usize) -> Option<Mode> {
    let size = samples.first()?.motion.len();
    let count = samples.len() as f64;
    let mut mean = DVector::zeros(size);
    samples.iter().for_each(|s| mean += DVector::from_column_slice(&s.motion) / count);
    let mut spread = DMatrix::<f64>::zeros(size, samples.len());
    for (k, s) in samples.iter().enumerate() {
        spread.set_column(k, &(DVector::from_column_slice(&s.motion) - &mean));
    }
    let mut covariance = &spread * spread.transpose() / (count - 1.0).max(1.0);
    add_floor(problem, &mut covariance);
    let diagonal = covariance.diagonal();
    covariance *= 1.0 - SHRINKAGE;
    (0..size).for_each(|i| covariance[(i, i)] += SHRINKAGE * diagonal[i]);
    let deviation = covariance.diagonal().map(f64::sqrt);
    let root = covariance.cholesky()?.unpack();
    let joints = problem.law_joints.len();
    let (mut law_mean, mut law_deviation) = (Vec::new(), Vec::new());
    for j in 0..joints {
        let of_joint = |s: &Raw| s.law[j * law_bins..(j + 1) * law_bins].to_vec();
        let all: Vec<f64> = samples.iter().flat_map(|s| of_joint(s)).filter(|x| x.is_finite()).collect();
        let n = all.len().max(1) as f64;
        let m = all.iter().sum::<f64>() / n;
        law_mean.push(m);
        law_deviation.push((all.iter().map(|x| (x - m).powi(2)).sum::<f64>() / n).sqrt().max(1e-6));
    }
    Some(Mode { mean, root, law_mean, law_deviation, deviation })
}

/// A feature that hardly varies among few samples must not become all-important.
fn add_floor(problem: &Problem, covariance: &mut DMatrix<f64>) {
    let bins = problem.cut.bins();
    let mut first = 0;
    for &channel in &problem.channels {
        let width = crate::observe::width(channel, bins);
        let mean = (first..first + width).map(|i| covariance[(i, i)]).sum::<f64>() / width as f64;
        (first..first + width).for_each(|i| covariance[(i, i)] += FLOOR * mean + 1e-16);
        first += width;
    }
}
