//! The constant lag of the measured position behind its command, and behind the simulator, joint by joint.

use crate::clean::median_interval;
use crate::run::Run;
use qv_core::JointSeries;

/// Lags that are tried \[s\].
const SHORTEST: f64 = -0.05;
const LONGEST: f64 = 0.25;
/// As many are.
const MOST_LAGS: f64 = 3000.0;

/// Best constant lag of one joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Lag {
    /// Joint.
    pub joint: String,
    /// Lag at which the two differ least \[s\]; negative when the second leads.
    pub lag: f64,
    /// Root mean square difference without lag \[rad\], a constant offset left out.
    pub before: f64,
    /// The same at the best lag \[rad\].
    pub after: f64,
    /// Correlation of the two at the best lag, -1 to 1.
    pub correlation: f64,
}

impl Lag {
    /// Least correlation at which two motions are one with a lag: below, the best lag is where two unlike motions happen to differ least.
    pub const LEAST_CORRELATION: f64 = 0.8;

    /// Whether the correlation supports this lag.
    pub fn is_supported(&self) -> bool {
        self.correlation >= Self::LEAST_CORRELATION
    }
}

/// For each joint (column `columns[j]` of the run) the lag of position behind commanded position: see [`lags_behind`].
/// Empty when positions were not commanded.
pub fn lags_behind_command(run: &Run, columns: &[usize]) -> Vec<Lag> {
    match (&run.commands.position, &run.measured.position) {
        (Some(command), Some(position)) => lags_behind(command, columns, position, columns, &run.joint_names),
        _ => Vec::new(),
    }
}

/// For each pair of columns the constant lag of `later` behind `earlier` that explains most. `earlier` is interpolated; a
/// constant offset between the two is free; the least of the parabola through the three best lags on the grid of
/// `later` is taken. `names` are those of the columns of `later`. A joint that hardly moves, and one whose best lag is at
/// the edge of -50 to 250 ms, is left out.
pub fn lags_behind(
    earlier: &JointSeries,
    earlier_columns: &[usize],
    later: &JointSeries,
    later_columns: &[usize],
    names: &[String],
) -> Vec<Lag> {
    // Of stamps that are closer the lags on a coarser grid are tried.
    let step = median_interval(&later.time).max((LONGEST - SHORTEST) / MOST_LAGS);
    if !step.is_finite() || later.len() < 50 {
        return Vec::new();
    }
    let pairs = earlier_columns.iter().zip(later_columns);
    pairs.filter_map(|(&a, &b)| best_lag((earlier, a), (later, b), step, &names[b])).collect()
}

fn best_lag(earlier: (&JointSeries, usize), later: (&JointSeries, usize), step: f64, joint: &str) -> Option<Lag> {
    let values = earlier.0.column(earlier.1).filter(|x| x.is_finite());
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
    if high - low < 1e-3 || !(high - low).is_finite() {
        return None;
    }
    let first = (SHORTEST / step).round() as i64;
    let last = (LONGEST / step).round() as i64;
    let spread: Vec<f64> = (first..=last).map(|k| spread(earlier, later, k as f64 * step)).collect();
    let best = (0..spread.len()).min_by(|&a, &b| spread[a].total_cmp(&spread[b]))?;
    if best == 0 || best + 1 == spread.len() || !spread[best + 1].is_finite() || !spread[best - 1].is_finite() {
        return None;
    }
    let (a, b, c) = (spread[best - 1].powi(2), spread[best].powi(2), spread[best + 1].powi(2));
    let curve = a - 2.0 * b + c;
    let shift = if curve > 0.0 { 0.5 * (a - c) / curve } else { 0.0 };
    let after = (b - 0.25 * (a - c) * shift).max(0.0).sqrt();
    let before = spread[usize::try_from(-first).ok()?];
    let correlation = correlation(earlier, later, (first + best as i64) as f64 * step);
    let lag = (first as f64 + best as f64 + shift) * step;
    Some(Lag { joint: joint.to_string(), lag, before, after, correlation })
}

/// Standard deviation of later(t) - earlier(t - lag), over the times when both exist for every lag.
fn spread(earlier: (&JointSeries, usize), later: (&JointSeries, usize), lag: f64) -> f64 {
    let (mut sum, mut square, mut count) = (0.0, 0.0, 0usize);
    for_each_pair(earlier, later, lag, |later, [before, after]| {
        let d = later - before - after;
        if d.is_finite() {
            sum += d;
            square += d * d;
            count += 1;
        }
    });
    let n = count as f64;
    if count < 10 { f64::INFINITY } else { (square / n - (sum / n).powi(2)).max(0.0).sqrt() }
}

/// Correlation of later(t) and earlier(t - lag) over the same times; 0 where one of them does not move.
fn correlation(earlier: (&JointSeries, usize), later: (&JointSeries, usize), lag: f64) -> f64 {
    let mut pairs = Vec::new();
    for_each_pair(earlier, later, lag, |later, [before, after]| pairs.push([later, before + after]));
    pairs.retain(|pair| pair.iter().all(|x| x.is_finite()));
    let n = pairs.len().max(1) as f64;
    let [mean_a, mean_b] = [0, 1].map(|k| pairs.iter().map(|p| p[k]).sum::<f64>() / n);
    let product = |a: usize, b: usize| {
        let mean = [mean_a, mean_b];
        pairs.iter().map(|p| (p[a] - mean[a]) * (p[b] - mean[b])).sum::<f64>()
    };
    let scale = (product(0, 0) * product(1, 1)).sqrt();
    if scale > 0.0 { product(0, 1) / scale } else { 0.0 }
}

/// Calls with later(t) and the two terms of which the interpolated earlier(t - lag) is the sum, over the times when both exist for every lag.
fn for_each_pair(
    (earlier, a): (&JointSeries, usize),
    (later, b): (&JointSeries, usize),
    lag: f64,
    mut call: impl FnMut(f64, [f64; 2]),
) {
    let mut i = 0;
    let (from, to) = (later.time[0] + LONGEST, later.time[later.len() - 1] + SHORTEST);
    for (k, &t) in later.time.iter().enumerate().filter(|(_, t)| **t >= from && **t <= to) {
        let at = t - lag;
        if at < earlier.time[0] {
            continue;
        }
        while i + 2 < earlier.len() && earlier.time[i + 1] <= at {
            i += 1;
        }
        if i + 1 >= earlier.len() || at > earlier.time[i + 1] {
            break;
        }
        let f = ((at - earlier.time[i]) / (earlier.time[i + 1] - earlier.time[i])).clamp(0.0, 1.0);
        call(later.row(k)[b], [(1.0 - f) * earlier.row(i)[a], f * earlier.row(i + 1)[a]]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_lag_is_found_below_the_sample() {
        let time: Vec<f64> = (0..2000).map(|i| f64::from(i) * 0.005).collect();
        let wave = |t: f64| (3.0 * t).sin() + 0.3 * (11.0 * t).sin();
        let series = |lag: f64, offset: f64| {
            JointSeries::new(time.clone(), time.iter().map(|t| wave(t - lag) + offset).collect(), 1).unwrap()
        };
        let lag = best_lag((&series(0.0, 0.0), 0), (&series(0.0235, 0.1), 0), 0.005, "j").unwrap();
        assert!((lag.lag - 0.0235).abs() < 3e-4, "{lag:?}");
        assert!(lag.after < 0.1 * lag.before && lag.is_supported(), "{lag:?}");
        let lead = best_lag((&series(0.02, 0.0), 0), (&series(0.0, 0.0), 0), 0.005, "j").unwrap();
        assert!((lead.lag + 0.02).abs() < 3e-4, "{lead:?}");
        let still = JointSeries::new(time.clone(), vec![0.0; time.len()], 1).unwrap();
        assert!(best_lag((&still, 0), (&series(0.0, 0.0), 0), 0.005, "j").is_none());
    }

    /// Two motions that have nothing to do with each other differ least somewhere, too.
    #[test]
    fn the_best_lag_of_unlike_motions_is_not_supported() {
        let time: Vec<f64> = (0..2000).map(|i| f64::from(i) * 0.005).collect();
        let series =
            |wave: fn(f64) -> f64| JointSeries::new(time.clone(), time.iter().map(|t| wave(*t)).collect(), 1).unwrap();
        let (one, other) = (series(|t| (9.0 * t).sin()), series(|t| (6.1 * t + 0.7).sin()));
        let lag = best_lag((&one, 0), (&other, 0), 0.005, "j").unwrap();
        assert!(!lag.is_supported() && lag.correlation < 0.5, "{lag:?}");
    }
}
