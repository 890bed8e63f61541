//! What one linear step says of each effect, in the recording and in those without an effect.

use crate::inference::gaussian_evidence::Sums;
use crate::inference::linearised::LinearisedProblem;
use crate::inference::search::{Search, fitted};
use crate::problem::columns::Suspect;

/// Largest log evidence of each effect in recordings without one, 0 at least.
pub(crate) fn by_chance(search: &Search) -> Vec<f64> {
    let most = vec![0.0; search.study.columns.effects.len()];
    let larger = |most: Vec<f64>, replicate: Vec<f64>| most.iter().zip(replicate).map(|(m, e)| e.max(*m)).collect();
    of_replicates(search).into_iter().fold(most, larger)
}

/// Log evidence of each effect by one linear step, its best group's, in each recording without one: shape `[replicates][effects]`.
pub(crate) fn of_replicates(search: &Search) -> Vec<Vec<f64>> {
    let study = &search.study;
    let all: Vec<usize> = (0..study.seen.len()).collect();
    study.replicates.iter().map(|replicate| by_effect(search, &study.sums(replicate, &all, fitted))).collect()
}

/// Log evidence of each effect by one linear step, its best group's; minus infinity of one that may not be.
pub fn by_effect(search: &Search, sums: &Sums) -> Vec<f64> {
    let columns = &search.study.columns;
    let mut best = vec![f64::NEG_INFINITY; columns.effects.len()];
    for (evidence, suspect) in search.linear(sums) {
        let effect = columns.groups[suspect.group].effect;
        best[effect] = evidence.max(best[effect]);
    }
    best
}

/// Deviation of a fit from absent, in tolerances; infinite for effects of which nothing is tolerated.
pub fn size(study: &LinearisedProblem, suspect: &Suspect) -> f64 {
    let group = &study.columns.groups[suspect.group];
    let effect = &study.columns.effects[group.effect];
    if effect.tolerance == 0.0 {
        return f64::INFINITY;
    }
    let of = |(axis, value): (usize, &f64)| {
        let absent = study.columns.units_of(group, axis).next().map_or(0.0, |u| study.columns.units[u].absent);
        (value - absent).abs() / effect.tolerance
    };
    suspect.values.iter().enumerate().map(of).fold(0.0, f64::max)
}
