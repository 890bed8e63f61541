//! What a recording can show, known before any fit: the least size of each effect that would be found with 90 % power.
//!
//! Along an effect of size `a` the whitened residual is `J a`, all tolerated deviations integrated out, so that the fitted size over its
//! standard deviation is normal about `a sqrt(k)` with variance 1, where `k` is the curvature of the loss (Rasmussen and Williams 2006,
//! eq. A.9). The log evidence of a fitted size is `z^2 / 2 - ln(1 + k w^2) / 2` for a prior of width `w`. It exceeds what the policy needs
//! where `z` exceeds `z0 = sqrt(2 need + ln(1 + k w^2))`; with probability 0.9 that is so for `a sqrt(k) = z0 + 1.2816`
//! (Cohen, Statistical Power Analysis, 1988, section 1.5, of a normal statistic).

use super::cannot_tell::confusable;
use crate::GapError;
use crate::decision::Policy;
use crate::findings::CanTell;
use crate::inference::gaussian_evidence::Marginal;
use crate::inference::linearised::LinearisedProblem;
use crate::inference::search::direction;
use crate::problem::columns::Suspect;
use qv_fit::linear::{dot, times};

/// Standard normal quantile of 0.9.
const POWER: f64 = 1.281_551_565_544_9;

/// One for each effect, part of the robot and axis. Limits, which have no slope, and what acts for a part of the time are not among them;
/// frictions and backlash, which have a kink at none, are taken along the line to their first level.
///
/// # Errors
/// When the normal equations are no good.
pub fn can_tell(study: &LinearisedProblem, policy: &Policy) -> Result<Vec<CanTell>, GapError> {
    let marginal = study.marginal(|seen| seen.weight)?;
    let mut all = Vec::new();
    for index in 0..study.columns.groups.len() {
        all.extend(of_group(study, &marginal, policy, index));
    }
    Ok(all)
}

fn of_group(study: &LinearisedProblem, marginal: &Marginal, policy: &Policy, index: usize) -> Vec<CanTell> {
    let group = &study.columns.groups[index];
    let effect = &study.columns.effects[group.effect];
    let Some(along) = direction(&study.columns, index, 0).filter(|_| study.may_be(group) && !effect.local) else {
        return Vec::new();
    };
    // Limits have no absent value, so that a level of theirs is no slope.
    if along.absent.iter().any(|a| !a.is_finite()) {
        return Vec::new();
    }
    let needed = match study.rollout.free {
        true => effect.least_evidence.unwrap_or(policy.least_evidence),
        false => policy.held_windows.least_evidence,
    } - effect.log_prior;
    let mut of = Vec::new();
    for (axis, named) in effect.axes.iter().enumerate() {
        let d = along.d.col_as_slice(axis);
        let curvature = dot(d, &times(&marginal.curvature, d)) / along.steps[axis].powi(2);
        let least = least_size(curvature, needed, effect.span(), policy.least_size * effect.tolerance);
        let furthest = effect.range.iter().map(|limit| (limit - along.absent[axis]).abs()).fold(0.0, f64::max);
        let least_size = least.filter(|size| *size <= furthest);
        let values = (0..effect.axes.len()).map(|k| along.absent[k] + if k == axis { along.steps[k] } else { 0.0 });
        of.push(CanTell {
            effect: effect.name.clone(),
            scope: group.names.clone(),
            parameter: named.name.clone(),
            unit: effect.unit.clone(),
            least_size,
            tolerance: effect.tolerance,
            range: effect.range,
            confusable_with: match least_size {
                Some(_) => confusable(study, &Suspect::everywhere(index, values.collect())),
                None => Vec::new(),
            },
        });
    }
    of
}

/// See above; `None` where the curvature is none, or no number. A size below `trifle` is no cause, whatever its evidence.
fn least_size(curvature: f64, needed: f64, width: f64, trifle: f64) -> Option<f64> {
    let is_seen = curvature.is_finite() && curvature > 0.0;
    is_seen.then(|| {
        let found = (2.0 * needed + (curvature * width * width).ln_1p()).sqrt();
        let deviation = curvature.sqrt().recip();
        ((found + POWER) * deviation).max(trifle + POWER * deviation)
    })
}

#[cfg(test)]
mod tests {
    use super::least_size;
    use qv_core::random::SplitMix64;

    /// Draws fitted sizes of an effect of the least size: nine of ten exceed the evidence that is needed.
    #[test]
    fn nine_of_ten_are_found() {
        let (curvature, needed, width): (f64, f64, f64) = (400.0, 12.0, 2.0);
        let size = least_size(curvature, needed, width, 0.0).unwrap();
        let mut random = SplitMix64::new(7);
        let draws = 20_000;
        let found = (0..draws).filter(|_| {
            let z = size * curvature.sqrt() + random.normal(1.0);
            0.5 * z * z - 0.5 * (1.0 + curvature * width * width).ln() > needed
        });
        let share = found.count() as f64 / f64::from(draws);
        assert!((share - 0.9).abs() < 0.01, "{share}");
    }

    #[test]
    fn what_is_not_seen_has_no_least_size() {
        assert_eq!(least_size(0.0, 12.0, 1.0, 0.1), None);
        assert_eq!(least_size(f64::NAN, 12.0, 1.0, 0.1), None);
        // Nor is a trifle found, however well it is seen.
        assert!(least_size(1e12, 12.0, 1.0, 0.1).unwrap() > 0.1);
    }
}
