//! Whether several recordings ask for the same size of an effect, and if not, which, and since when.
//!
//! Each window asks for a change of the value as in [`super::stationarity`]; those of a recording have a mean and its robust standard error
//! (White 1980). Where recordings have dates they are taken in that order, else in the order given; the two parts that differ most are compared.

use super::stationarity::asks;
use crate::decision::Policy;
use crate::findings::OfRecording;
use crate::inference::linearised::LinearisedProblem;
use crate::problem::columns::Group;

/// Recordings that ask for different sizes.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// The first recording of those that ask for another size.
    pub since: usize,
    /// Mean value in those before it and in those from it on.
    pub values: [f64; 2],
}

/// Windows of a recording from which it is asked.
const LEAST_WINDOWS: usize = 4;

/// What each recording asks of an effect whose value in the study's robot is `value`, in the order of their dates; empty for a single recording.
/// A value that was fitted to all of them is that of their mean (`is_fitted`).
pub fn by_recording(
    study: &LinearisedProblem,
    name: &str,
    group: &Group,
    (value, is_fitted): (f64, bool),
) -> Vec<OfRecording> {
    let recordings = study.seen.iter().map(|s| s.window.run + 1).max().unwrap_or(0);
    if recordings < 2 {
        return Vec::new();
    }
    let mut all = asks(study, name, group);
    if is_fitted {
        let total: f64 = all.iter().map(|a| a.weight).sum();
        let mean = all.iter().map(|a| a.weight * a.change).sum::<f64>() / total.max(f64::MIN_POSITIVE);
        all.iter_mut().for_each(|a| a.change -= mean);
    }
    let mut order: Vec<usize> = (0..recordings).collect();
    let date = |run: usize| study.seen.iter().find(|s| s.window.run == run).map_or(0, |s| s.window.view.epoch);
    if order.iter().all(|&run| date(run) > 0) {
        order.sort_by_key(|&run| date(run));
    }
    let of = |run: usize| {
        let asked: Vec<[f64; 2]> =
            all.iter().filter(|a| study.seen[a.window].window.run == run).map(|a| [a.change, a.weight]).collect();
        let (mean, error) = mean_and_error(&asked)?;
        let half = 1.96 * error;
        Some(OfRecording { recording: run, value: value + mean, ci95: [value + mean - half, value + mean + half] })
    };
    order.into_iter().filter_map(of).collect()
}

/// Mean of changes with weights, and its standard error by the scatter.
fn mean_and_error(asked: &[[f64; 2]]) -> Option<(f64, f64)> {
    let total: f64 = asked.iter().map(|a| a[1]).sum();
    if asked.len() < LEAST_WINDOWS || total <= 0.0 {
        return None;
    }
    let mean = asked.iter().map(|[c, w]| c * w).sum::<f64>() / total;
    let squares: f64 = asked.iter().map(|[c, w]| (w * (c - mean)).powi(2)).sum();
    let error = squares.sqrt() / total;
    (error > 0.0).then_some((mean, error))
}

/// The recording since which the size is another one; `None` where all agree within `policy.recording_errors` and `policy.change_share`.
pub fn change(of: &[OfRecording], policy: &Policy) -> Option<Change> {
    let part = |some: &[OfRecording]| {
        let weight = |o: &OfRecording| (3.92 / (o.ci95[1] - o.ci95[0])).powi(2);
        let total: f64 = some.iter().map(weight).sum();
        let mean = some.iter().map(|o| weight(o) * o.value).sum::<f64>() / total;
        (mean, 1.0 / total, some.iter().map(|o| (o.value - mean).powi(2)).sum::<f64>())
    };
    let compared = |at: usize| {
        let ((before, v, a), (after, w, b)) = (part(&of[..at]), part(&of[at..]));
        // Recordings may differ by more than their windows know: each motion is missed in its own way.
        let between = if of.len() > 2 { (a + b) / (of.len() - 2) as f64 } else { 0.0 };
        let variance = v.max(between / at as f64) + w.max(between / (of.len() - at) as f64);
        let errors = (after - before).abs() / variance.sqrt();
        (Change { since: of[at].recording, values: [before, after] }, errors)
    };
    let most = (1..of.len()).map(compared).max_by(|a, b| a.1.total_cmp(&b.1));
    let (found, errors) = most?;
    let [before, after] = found.values;
    let is_large = (after - before).abs() > policy.change_share * before.abs().max(after.abs());
    (errors > policy.recording_errors && is_large).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(values: &[f64]) -> Vec<OfRecording> {
        let one =
            |(recording, &value): (usize, &f64)| OfRecording { recording, value, ci95: [value - 0.1, value + 0.1] };
        values.iter().enumerate().map(one).collect()
    }

    #[test]
    fn the_recording_since_which_something_is_there_is_told() {
        let policy = Policy::default();
        let found = change(&of(&[0.02, -0.03, 0.41, 0.44]), &policy).unwrap();
        assert_eq!(found.since, 2);
        assert!((found.values[0] + 0.005).abs() < 1e-9 && (found.values[1] - 0.425).abs() < 1e-9, "{found:?}");
        assert_eq!(change(&of(&[0.4, 0.43, 0.41]), &policy), None);
        // As far apart within the parts as between them.
        assert_eq!(change(&of(&[0.1, 0.9, 0.2, 0.5, 1.2, 0.9]), &policy), None);
        assert_eq!(change(&of(&[0.4]), &policy), None);
        assert_eq!(change(&[], &policy), None);
    }

    #[test]
    fn a_mean_has_the_error_of_its_scatter() {
        let asked: Vec<[f64; 2]> = (0..100).map(|k| [if k % 2 == 0 { 1.0 } else { -1.0 }, 2.0]).collect();
        let (mean, error) = mean_and_error(&asked).unwrap();
        assert!(mean.abs() < 1e-12 && (error - 0.1).abs() < 1e-12, "{mean} {error}");
        assert_eq!(mean_and_error(&asked[..3]), None);
    }
}
