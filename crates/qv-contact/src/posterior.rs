//! From losses of windows on a grid of frictions to a posterior with an interval.

use crate::prior::Prior;
use serde::Serialize;

/// Points of the fine grid.
const FINE: usize = 400;
/// Step of the logarithm over which slope and bend of a window's loss are taken.
const STEP: f64 = 0.12;

/// A distribution of friction on a grid.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Distribution {
    /// Frictions, evenly spread in the logarithm.
    pub friction: Vec<f64>,
    /// Probability of the cell about each; sums to 1.
    pub probability: Vec<f64>,
}

impl Distribution {
    /// From log densities over log friction.
    fn from_logs(friction: Vec<f64>, logs: &[f64]) -> Self {
        let top = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let mut probability: Vec<f64> = logs.iter().map(|l| (l - top).exp()).collect();
        let sum: f64 = probability.iter().sum();
        probability.iter_mut().for_each(|p| *p /= sum);
        Self { friction, probability }
    }

    /// The prior on the fine grid.
    pub fn prior(prior: &Prior, range: [f64; 2]) -> Self {
        let friction = fine(range);
        let logs: Vec<f64> = friction.iter().map(|mu| log_prior(prior, *mu)).collect();
        Self::from_logs(friction, &logs)
    }

    /// Mean.
    pub fn mean(&self) -> f64 {
        self.friction.iter().zip(&self.probability).map(|(f, p)| f * p).sum()
    }

    /// Mean and standard deviation of the logarithm.
    pub fn log_moments(&self) -> [f64; 2] {
        let moment = |of: &dyn Fn(f64) -> f64| -> f64 {
            self.friction.iter().zip(&self.probability).map(|(f, p)| p * of(f.ln())).sum()
        };
        let mean = moment(&|x| x);
        [mean, moment(&|x| (x - mean).powi(2)).sqrt()]
    }

    /// The friction that this share of the probability lies below.
    pub fn quantile(&self, share: f64) -> f64 {
        let (mut below, last) = (0.0, self.friction.len() - 1);
        for k in 0..=last {
            let p = self.probability[k];
            if below + p >= share {
                let inside = if p > 0.0 { (share - below) / p } else { 0.5 };
                // Cells reach halfway to their neighbours, in the logarithm.
                let step = (self.friction[last] / self.friction[0]).ln() / last as f64;
                return self.friction[k] * (step * (inside - 0.5)).exp();
            }
            below += p;
        }
        self.friction[last]
    }

    /// Information gained over `before` \[nats\] (Kullback and Leibler's divergence); both on the same grid.
    pub fn gain(&self, before: &Self) -> f64 {
        let term = |(p, q): (&f64, &f64)| if *p > 1e-300 { p * (p / q.max(1e-300)).ln() } else { 0.0 };
        self.probability.iter().zip(&before.probability).map(term).sum::<f64>().max(0.0)
    }
}

/// What windows say of one friction.
#[derive(Debug, Clone, PartialEq)]
pub struct Evidence {
    /// Sum of the losses on the fine grid, weighted as `weight` says.
    pub losses: Vec<f64>,
    /// Weight of a loss: below 1 where windows disagree more than their losses allow.
    pub weight: f64,
    /// Least loss, by friction.
    pub least: f64,
}

fn fine(range: [f64; 2]) -> Vec<f64> {
    (0..FINE).map(|k| range[0] * (range[1] / range[0]).powf(k as f64 / (FINE - 1) as f64)).collect()
}

fn log_prior(prior: &Prior, friction: f64) -> f64 {
    let [middle, deviation] = prior.log_moments();
    -0.5 * ((friction.ln() - middle) / deviation).powi(2)
}

/// Value at the logarithm `x` between grid points, by the cubic through the two on either side with their mean slopes
/// limited so that it does not overshoot (Fritsch and Carlson, SIAM Journal on Numerical Analysis 17, 1980).
pub fn interpolate(grid: &[f64], values: &[f64], x: f64) -> f64 {
    let n = grid.len();
    let k = grid.partition_point(|g| *g <= x).clamp(1, n - 1) - 1;
    let secant = |i: usize| (values[i + 1] - values[i]) / (grid[i + 1] - grid[i]);
    let slope = |i: usize| {
        if i == 0 || i + 1 == n {
            return secant(i.min(n - 2));
        }
        let (a, b) = (secant(i - 1), secant(i));
        if a * b <= 0.0 { 0.0 } else { 2.0 * a * b / (a + b) }
    };
    let h = grid[k + 1] - grid[k];
    let t = ((x - grid[k]) / h).clamp(0.0, 1.0);
    let (t2, t3) = (t * t, t * t * t);
    values[k] * (2.0 * t3 - 3.0 * t2 + 1.0)
        + h * slope(k) * (t3 - 2.0 * t2 + t)
        + values[k + 1] * (3.0 * t2 - 2.0 * t3)
        + h * slope(k + 1) * (t3 - t2)
}

/// Evidence of windows, each with a loss for each friction of `grid` and the cluster that it belongs to. Losses of
/// neighbouring windows are not independent and no model of theirs is right, so that the sum of all is weighted to give
/// the least one the spread that clusters show: w = H / V of its bend H and the variance V of its slope (Lyddon, Holmes and
/// Walker, Biometrika 106, 2019); never more than 1. Where losses do not bend at the least one, the same is asked of their greatest rise D
/// from there on and its variance between clusters: both are those of a parabola if w = 2 D / V. A single cluster cannot determine, and counts whole.
pub fn evidence(grid: &[f64], windows: &[(usize, Vec<f64>)], range: [f64; 2]) -> Evidence {
    let logs: Vec<f64> = grid.iter().map(|mu| mu.ln()).collect();
    let friction = fine(range);
    let mut losses = vec![0.0; FINE];
    for (_, values) in windows {
        losses.iter_mut().zip(&friction).for_each(|(sum, mu)| *sum += interpolate(&logs, values, mu.ln()));
    }
    let least = (0..FINE).min_by(|&a, &b| losses[a].total_cmp(&losses[b])).unwrap_or(0);
    let at = friction[least].ln().clamp(range[0].ln() + STEP, range[1].ln() - STEP);
    let (mut clusters, mut bend) = (std::collections::BTreeMap::<usize, f64>::new(), 0.0);
    for (cluster, values) in windows {
        let [a, b, c] = [-STEP, 0.0, STEP].map(|d| interpolate(&logs, values, at + d));
        *clusters.entry(*cluster).or_default() += 0.5 * (c - a) / STEP;
        bend += (a - 2.0 * b + c) / (STEP * STEP);
    }
    let count = clusters.len() as f64;
    let mean = clusters.values().sum::<f64>() / count.max(1.0);
    let variance = clusters.values().map(|g| (g - mean).powi(2)).sum::<f64>() * count / (count - 1.0).max(1.0);
    let weight = if bend > 0.0 && variance > 0.0 {
        (bend / variance).clamp(1e-3, 1.0)
    } else {
        weight_of_rise(&logs, windows, [friction[least].ln(), friction[highest(&losses)].ln()])
    };
    let lowest = losses[least];
    losses.iter_mut().for_each(|l| *l = weight * (*l - lowest));
    Evidence { losses, weight, least: friction[least] }
}

fn highest(losses: &[f64]) -> usize {
    (0..losses.len()).max_by(|&a, &b| losses[a].total_cmp(&losses[b])).unwrap_or(0)
}

/// Weight by how far clusters agree on the rise of the loss from one logarithm to another.
fn weight_of_rise(logs: &[f64], windows: &[(usize, Vec<f64>)], [low, high]: [f64; 2]) -> f64 {
    let mut rises = std::collections::BTreeMap::<usize, f64>::new();
    for (cluster, values) in windows {
        *rises.entry(*cluster).or_default() += interpolate(logs, values, high) - interpolate(logs, values, low);
    }
    let (count, rise) = (rises.len() as f64, rises.values().sum::<f64>());
    let mean = rise / count.max(1.0);
    let variance = rises.values().map(|r| (r - mean).powi(2)).sum::<f64>() * count / (count - 1.0).max(1.0);
    if rise > 0.0 && variance > 0.0 { (2.0 * rise / variance).clamp(1e-3, 1.0) } else { 1.0 }
}

/// Posterior of prior and evidence. `own_error` is the standard deviation of the logarithm that even endless evidence
/// leaves, since no simulator's contact is the ground's: the likelihood is blurred by it.
pub fn posterior(prior: &Prior, evidence: &Evidence, range: [f64; 2], own_error: f64) -> Distribution {
    let friction = fine(range);
    let step = (range[1] / range[0]).ln() / (FINE - 1) as f64;
    let likelihood: Vec<f64> = evidence.losses.iter().map(|l| (-l).exp()).collect();
    let reach = (4.0 * own_error / step).ceil() as i64;
    let kernel: Vec<f64> =
        (-reach..=reach).map(|k| (-0.5 * (k as f64 * step / own_error.max(1e-9)).powi(2)).exp()).collect();
    let blurred = |k: usize| {
        let near = kernel.iter().zip(-reach..=reach);
        // Beyond the ends the likelihood goes on as it is there.
        let sum: f64 = near.map(|(w, d)| w * likelihood[(k as i64 + d).clamp(0, FINE as i64 - 1) as usize]).sum();
        sum / kernel.iter().sum::<f64>()
    };
    let logs: Vec<f64> = (0..FINE).map(|k| blurred(k).max(1e-300).ln() + log_prior(prior, friction[k])).collect();
    Distribution::from_logs(friction, &logs)
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::prior::RANGE;

    fn grid() -> Vec<f64> {
        (0..24).map(|k| 0.04 * (1.4_f64 / 0.04).powf(f64::from(k) / 23.0)).collect()
    }

    fn prior() -> Prior {
        Prior::new("x", 0.35, 0.14, "", "").unwrap()
    }

    /// Windows whose losses are parabolas in the logarithm about scattered frictions.
    fn windows(count: usize, middle: f64, scatter: f64, bend: f64) -> Vec<(usize, Vec<f64>)> {
        let of = |k: usize| {
            let at = middle.ln() + scatter * 3.46 * ((k as f64 * 0.618_033_988).fract() - 0.5);
            (k, grid().iter().map(|mu| 0.5 * bend * (mu.ln() - at).powi(2)).collect())
        };
        (1..=count).map(of).collect()
    }

    #[test]
    fn evidence_finds_the_friction_and_its_spread() {
        // Each window claims a deviation of 0.1, and they scatter by 0.3: the mean of 100 is good to 0.03.
        let found = evidence(&grid(), &windows(100, 0.2, 0.3, 100.0), RANGE);
        assert!((found.least / 0.2).ln().abs() < 0.03, "{}", found.least);
        assert!((found.weight - 0.11).abs() < 0.03, "{}", found.weight);
        let post = posterior(&prior(), &found, RANGE, 1e-6);
        let width = (post.quantile(0.95) / post.quantile(0.05)).ln() / 3.29;
        assert!((width - 0.03).abs() < 0.008, "{width}");
        let blurred = posterior(&prior(), &found, RANGE, 0.1);
        let width = (blurred.quantile(0.95) / blurred.quantile(0.05)).ln() / 3.29;
        assert!((width - 0.103).abs() < 0.01, "{width}");
    }

    #[test]
    fn flat_losses_leave_the_prior() {
        let flat = evidence(&grid(), &[(0, vec![3.0; 24]), (1, vec![2.0; 24])], RANGE);
        let (before, after) = (Distribution::prior(&prior(), RANGE), posterior(&prior(), &flat, RANGE, 0.05));
        assert!(after.gain(&before) < 1e-9 && (after.mean() - 0.35).abs() < 0.005, "{}", after.mean());
        assert!((before.probability.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_wall_on_one_side_bounds_from_below() {
        // No slip was seen: low frictions are wrong, all above 0.5 are equally right.
        let loss: Vec<f64> = grid().iter().map(|mu| if *mu < 0.5 { 30.0 * (0.5 / mu).ln() } else { 0.0 }).collect();
        let found = evidence(&grid(), &[(0, loss.clone()), (1, loss)], RANGE);
        let post = posterior(&prior(), &found, RANGE, 0.03);
        assert!(post.quantile(0.05) > 0.4 && post.mean() > 0.45, "{}", post.mean());
    }

    #[test]
    fn windows_that_disagree_about_a_slope_weigh_little() {
        // Losses that fall towards high friction and nowhere bend upwards; half of the windows say the contrary.
        let whole: Vec<f64> = (0..24).map(|k| RANGE[0] * (RANGE[1] / RANGE[0]).powf(f64::from(k) / 23.0)).collect();
        let of = |k: usize| {
            let slope = if k % 5 < 3 { -20.0 } else { 24.0 };
            (k, whole.iter().map(|mu| slope * mu.ln()).collect::<Vec<f64>>())
        };
        let found = evidence(&whole, &(0..50).map(of).collect::<Vec<_>>(), RANGE);
        assert!(found.weight < 0.02, "{}", found.weight);
        let agreeing = evidence(&whole, &(0..50).map(|k| (k, of(0).1)).collect::<Vec<_>>(), RANGE);
        assert!((agreeing.weight - 1.0).abs() < 1e-12, "{}", agreeing.weight);
    }

    #[test]
    fn interpolation_keeps_points_and_does_not_overshoot() {
        let (grid, values) = ([0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 1.0, 1.0]);
        for (x, v) in grid.iter().zip(values) {
            assert!((interpolate(&grid, &values, *x) - v).abs() < 1e-12);
        }
        for k in 0..=300 {
            let v = interpolate(&grid, &values, 0.01 * f64::from(k));
            assert!((-1e-12..=1.0 + 1e-12).contains(&v), "{v}");
        }
    }
}
