//! Figures of many trials: shares with intervals, tests between two rows, times, SPL.

use crate::task::{DECISIONS, End, PERIOD, Trial};
use serde::{Deserialize, Serialize};

/// A row of the table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Episodes.
    pub episodes: usize,
    /// Those that were reached.
    pub reached: usize,
    /// Share that was reached, with its 95 % interval after Wilson.
    pub success: f64,
    /// See `success`.
    pub interval: [f64; 2],
    /// Mean time of those that were reached \[s\]; none when none was.
    pub time: Option<f64>,
    /// The same with all others counted as 25 s \[s\].
    pub time_with_failures: f64,
    /// Success weighted by path length (Anderson et al. 2018).
    pub spl: f64,
    /// Shares in which the head came within 0.25 and 0.50 m at any time, without a fall or collision.
    pub near: [f64; 2],
    /// How many ended how, in the order of [`End::ALL`].
    pub ends: [usize; 7],
}

impl Row {
    /// Of trials; all zeros without any.
    pub fn of(trials: &[Trial]) -> Self {
        let count = trials.len();
        let most = DECISIONS as f64 * PERIOD;
        let reached: Vec<&Trial> = trials.iter().filter(|t| t.reached()).collect();
        let share = |sum: f64| if count > 0 { sum / count as f64 } else { 0.0 };
        let sum = reached.iter().map(|t| t.time).sum::<f64>();
        let bad = |t: &&Trial| matches!(t.end, End::Collision | End::Pushed | End::Fell);
        let near = |d: f64| share(trials.iter().filter(|t| !bad(t) && t.nearest <= d).count() as f64);
        Self {
            episodes: count,
            reached: reached.len(),
            success: share(reached.len() as f64),
            interval: wilson(reached.len(), count),
            time: (!reached.is_empty()).then(|| sum / reached.len() as f64),
            time_with_failures: share(sum + most * (count - reached.len()) as f64),
            // An empty sum of floats is -0.
            spl: share(reached.iter().map(|t| t.shortest / t.length.max(t.shortest)).sum::<f64>() + 0.0),
            near: [near(0.25), near(0.50)],
            ends: End::ALL.map(|end| trials.iter().filter(|t| t.end == end).count()),
        }
    }
}

/// A share with its 95 % interval after Wilson.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Share {
    /// Hits.
    pub hits: usize,
    /// Of so many.
    pub n: usize,
    /// Their share; 0 of none.
    pub share: f64,
    /// Its interval.
    pub interval: [f64; 2],
}

impl Share {
    /// Of `n` tries.
    pub fn of(hits: usize, n: usize) -> Self {
        Self { hits, n, share: hits as f64 / n.max(1) as f64, interval: wilson(hits, n) }
    }
}

/// A mean with its 95 % interval: 1.96 standard errors to each side.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Mean {
    /// The mean; 0 of none.
    pub value: f64,
    /// Its interval.
    pub interval: [f64; 2],
    /// Of so many.
    pub n: usize,
}

impl Mean {
    /// Of some numbers.
    pub fn of(numbers: impl Iterator<Item = f64>) -> Self {
        let all: Vec<f64> = numbers.collect();
        let n = all.len();
        // An empty sum of floats is -0.
        let value = (all.iter().sum::<f64>() + 0.0) / n.max(1) as f64;
        let squares: f64 = all.iter().map(|x| (x - value).powi(2)).sum();
        let half = 1.96 * (squares / (n.max(2) - 1) as f64 / n.max(1) as f64).sqrt();
        Self { value, interval: [value - half, value + half], n }
    }
}

/// The 95 % interval of a share (Wilson 1927).
pub fn wilson(hits: usize, count: usize) -> [f64; 2] {
    if count == 0 {
        return [0.0, 1.0];
    }
    let (z, n) = (1.959_963_985f64, count as f64);
    let p = hits as f64 / n;
    let middle = (p + z * z / (2.0 * n)) / (1.0 + z * z / n);
    let half = z / (1.0 + z * z / n) * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
    [(middle - half).max(0.0), (middle + half).min(1.0)]
}

/// Exact two-sided p of McNemar's test: `only_a` and `only_b` are the episodes that only one of two reached.
pub(crate) fn mcnemar(only_a: usize, only_b: usize) -> f64 {
    let n = only_a + only_b;
    let least = only_a.min(only_b);
    // Terms of the binomial distribution with p = 1/2, by their logarithms.
    let mut log_term = -(n as f64) * std::f64::consts::LN_2;
    let mut tail = 0.0;
    for k in 0..=least {
        tail += log_term.exp();
        log_term += ((n - k) as f64).ln() - ((k + 1) as f64).ln();
    }
    (2.0 * tail).min(1.0)
}

/// The same for two lists of trials of the same episodes.
pub fn compared(a: &[Trial], b: &[Trial]) -> f64 {
    let only = |a: &[Trial], b: &[Trial]| a.iter().zip(b).filter(|(a, b)| a.reached() && !b.reached()).count();
    mcnemar(only(a, b), only(b, a))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_and_shares_have_intervals() {
        let mean = Mean::of([1.0, 2.0, 3.0, 2.0].into_iter());
        assert!((mean.value - 2.0).abs() < 1e-12 && mean.n == 4);
        assert!((mean.interval[1] - 2.0 - 1.96 * (2.0 / 3.0 / 4.0f64).sqrt()).abs() < 1e-12);
        assert_eq!(Mean::of(std::iter::empty()), Mean { value: 0.0, interval: [0.0; 2], n: 0 });
        let share = Share::of(5, 10);
        assert!(share.share == 0.5 && share.interval == wilson(5, 10) && Share::of(0, 0).share == 0.0);
    }

    #[test]
    fn intervals_and_tests_are_those_of_the_tables() {
        // Published values: 21 of 25, and 24 against 8 discordant pairs.
        let [low, high] = wilson(21, 25);
        assert!((low - 0.6535).abs() < 1e-3 && (high - 0.9360).abs() < 1e-3, "{low} {high}");
        assert!((mcnemar(24, 8) - 0.0070).abs() < 2e-4, "{}", mcnemar(24, 8));
        assert_eq!((mcnemar(0, 0), mcnemar(5, 5)), (1.0, 1.0));
        assert!((mcnemar(0, 6) - 2.0 / 64.0).abs() < 1e-12);
        assert_eq!(wilson(0, 0), [0.0, 1.0]);
    }

    #[test]
    fn rows_count() {
        let trial =
            |end, time, nearest| Trial { end, time, length: 4.0, shortest: 2.0, nearest, seen: None, track: vec![] };
        let row = Row::of(&[trial(End::Reached, 10.0, 0.2), trial(End::Fell, 3.0, 0.2), trial(End::Slow, 25.0, 0.4)]);
        assert_eq!((row.reached, row.ends, row.time), (1, [1, 0, 0, 1, 0, 0, 1], Some(10.0)));
        assert!((row.spl - 0.5 / 3.0).abs() < 1e-12 && (row.time_with_failures - 20.0).abs() < 1e-12);
        assert_eq!(row.near, [1.0 / 3.0, 2.0 / 3.0]);
    }
}
