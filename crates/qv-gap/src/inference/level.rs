//! How far a robot is from the recording: losses over those of the null.

use crate::GapError;
use crate::findings::Level;
use crate::inference::gaussian_evidence::Sums;
use crate::inference::linearised::{LinearisedProblem, LinearisedWindow};
use crate::inference::regions::is_within_reach;
use crate::inference::regions::place;
use crate::inference::search::fitted;
use qv_fit::linear::squared;

/// The level of a study.
///
/// # Errors
/// When the normal equations are no good.
pub fn level(study: &LinearisedProblem) -> Result<Level, GapError> {
    level_outside(study, &[])
}

/// The level in the windows outside some regions. Where feet slip, the residuals of a right model are not small: whether
/// a foot lets go is decided by what no recording shows.
///
/// # Errors
/// When the normal equations are no good.
pub(crate) fn level_outside(study: &LinearisedProblem, regions: &[[f64; 4]]) -> Result<Level, GapError> {
    let inside = |seen: &LinearisedWindow| regions.iter().any(|r| is_within_reach(*r, place(&seen.window)));
    let outside = study.seen.iter().filter(|s| fitted(s) > 0.0 && !inside(s)).count();
    let loss = |seen: &LinearisedWindow| squared(&seen.residual) / seen.residual.len() as f64;
    let mut losses: Vec<f64> = study.seen.iter().filter(|s| fitted(s) > 0.0).map(loss).collect();
    losses.sort_by(f64::total_cmp);
    let middle = losses.get(losses.len() / 2).copied().unwrap_or(0.0);
    // A robot that was on that ground all the time is judged by the quieter half of its windows.
    let counts = |seen: &LinearisedWindow| if outside < 8 { loss(seen) <= middle } else { !inside(seen) };
    let fitted = |seen: &LinearisedWindow| if regions.is_empty() || counts(seen) { fitted(seen) } else { 0.0 };
    let marginal = study.marginal(fitted)?;
    let of = |sums: &Sums| marginal.loss(sums) / sums.count.max(1.0);
    let all: Vec<usize> = (0..study.seen.len()).collect();
    let nulls: Vec<f64> =
        study.replicates.iter().map(|g| of(&study.sums(g, &all, fitted))).filter(|x| x.is_finite()).collect();
    let null = mean(&nulls);
    let sums = study.nominal(fitted);
    Ok(Level { ratio: of(&sums) / null, null, count: sums.count })
}

/// Mean; 0 of nothing.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}
