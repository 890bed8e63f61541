//! The constant lag of position behind command, joint by joint.

use crate::clean::median_interval;
use crate::run::Run;
use qv_core::JointSeries;

/// Lags that are tried \[s\].
const LONGEST: f64 = 0.25;

/// Best constant lag of one joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Lag {
    /// Joint.
    pub joint: String,
    /// Lag at which command and position differ least \[s\].
    pub lag: f64,
    /// Root mean square difference without lag \[rad\], a constant offset left out.
    pub before: f64,
    /// The same at the best lag \[rad\].
    pub after: f64,
}

/// For each joint (column `columns[j]` of the run) the lag of position behind commanded position that explains most:
/// both are compared on a common grid, a constant offset between them is free, and the least of the parabola through the
/// three best lags is taken. Empty when positions were not commanded; a joint that hardly moved is left out.
pub fn best_lags(run: &Run, columns: &[usize]) -> Vec<Lag> {
    let (Some(command), Some(position)) = (&run.commands.position, &run.measured.position) else { return Vec::new() };
    let step = median_interval(&position.time);
    if !step.is_finite() || position.len() < 50 {
        return Vec::new();
    }
    columns.iter().filter_map(|&c| best_lag(command, position, c, step, &run.joint_names[c])).collect()
}

fn best_lag(command: &JointSeries, position: &JointSeries, column: usize, step: f64, joint: &str) -> Option<Lag> {
    let held: Vec<f64> = command.column(column).filter(|x| x.is_finite()).collect();
    let (low, high) = held.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &x| (l.min(x), h.max(x)));
    if !(high - low > 1e-3) {
        return None;
    }
    let steps = (LONGEST / step) as usize;
    let spread: Vec<f64> = (0..=steps).map(|k| spread(command, position, column, k as f64 * step)).collect();
    let best = (0..=steps).min_by(|&a, &b| spread[a].total_cmp(&spread[b]))?;
    let mut lag = best as f64;
    let mut after = spread[best];
    if best > 0 && best < steps {
        let (a, b, c) = (spread[best - 1].powi(2), spread[best].powi(2), spread[best + 1].powi(2));
        let curve = a - 2.0 * b + c;
        if curve > 0.0 {
            let shift = 0.5 * (a - c) / curve;
            lag += shift;
            after = (b - 0.25 * (a - c) * shift).max(0.0).sqrt();
        }
    }
    Some(Lag { joint: joint.to_string(), lag: lag * step, before: spread[0], after })
}

/// Standard deviation of position(t) - command(t - lag), over the times when both exist for every lag.
fn spread(command: &JointSeries, position: &JointSeries, column: usize, lag: f64) -> f64 {
    let (mut sum, mut square, mut count) = (0.0, 0.0, 0usize);
    let mut i = 0;
    for (k, &t) in position.time.iter().enumerate() {
        if t < position.time[0] + LONGEST {
            continue;
        }
        while i + 1 < command.len() && command.time[i + 1] <= t - lag + 1e-9 {
            i += 1;
        }
        let d = position.row(k)[column] - command.row(i)[column];
        if d.is_finite() {
            sum += d;
            square += d * d;
            count += 1;
        }
    }
    let n = count as f64;
    if count < 10 { f64::INFINITY } else { (square / n - (sum / n).powi(2)).max(0.0).sqrt() }
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
        let lag = best_lag(&series(0.0, 0.0), &series(0.0235, 0.1), 0, 0.005, "j").unwrap();
        assert!((lag.lag - 0.0235).abs() < 3e-4, "{lag:?}");
        assert!(lag.after < 0.1 * lag.before, "{lag:?}");
        let still = JointSeries::new(time.clone(), vec![0.0; time.len()], 1).unwrap();
        assert!(best_lag(&still, &series(0.0, 0.0), 0, 0.005, "j").is_none());
    }
}
