//! Problems that several tests fit.

use qv_core::random::SplitMix64;
use qv_fit::{Blocks, FitError};

/// A line at places -1 to 1: `values[0] + values[1] x`, one block for each number. Shape `[points][blocks][1]`.
pub fn line(y: &[f64], points: &[Vec<f64>]) -> Result<Vec<Blocks>, FitError> {
    let at = |k: usize| -1.0 + 2.0 * k as f64 / (y.len() - 1) as f64;
    let of = |p: &Vec<f64>| (0..y.len()).map(|k| vec![y[k] - p[0] - p[1] * at(k)]).collect();
    Ok(points.iter().map(of).collect())
}

/// What such a line gives with noise of deviation `noise`.
pub fn noisy_line(truth: [f64; 2], count: usize, noise: f64, seed: u64) -> Vec<f64> {
    let mut random = SplitMix64::of(seed, 0);
    let at = |k: usize| -1.0 + 2.0 * k as f64 / (count - 1) as f64;
    (0..count).map(|k| truth[0] + truth[1] * at(k) + random.normal(noise)).collect()
}
