//! How far a robot is from the recording: losses over those of the null.

use crate::GapError;
use crate::findings::Level;
use crate::inference::gaussian_evidence::{Marginal, Sums};
use crate::inference::linearised::{LinearisedProblem, LinearisedWindow};
use crate::inference::regions::is_within_reach;
use crate::inference::regions::place;
use crate::inference::search::fitted;
use qv_fit::linear::squared;

/// Share of the windows that are the quieter ones.
const QUIETER: f64 = 0.75;

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
    let null = nulls.iter().sum::<f64>() / nulls.len().max(1) as f64;
    let sums = study.nominal(fitted);
    let ratio = of(&sums) / null;
    // One that is held has no feet.
    let quiet = if study.rollout.free { quiet(study, &marginal, fitted) } else { ratio };
    Ok(Level { ratio, quiet, null, count: sums.count })
}

/// Loss per number in the quieter windows, deviations at their best in all, over that of the null in its own.
fn quiet(study: &LinearisedProblem, marginal: &Marginal, weight: impl Fn(&LinearisedWindow) -> f64 + Copy) -> f64 {
    let of = |residuals: &[Option<&Vec<f64>>]| {
        let left = study.without_deviations(marginal, residuals, weight);
        let mut losses: Vec<f64> = left.iter().flatten().map(|r| squared(r) / r.len() as f64).collect();
        losses.sort_by(f64::total_cmp);
        losses.truncate((QUIETER * losses.len() as f64).ceil() as usize);
        mean(&losses)
    };
    let null: Vec<f64> = study.residuals_of_replicates().map(|g| of(&g)).filter(|x| x.is_finite()).collect();
    of(&study.residuals()) / mean(&null)
}

/// Mean; 0 of nothing.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}
