//! Sizes with names, units and intervals.

use crate::findings::ParameterEstimate;
use crate::inference::linearised::LinearisedProblem;
use crate::inference::regions::EDGES;
use crate::inference::search::Fit;
use crate::problem::columns::Extent;
use crate::problem::library::Effect;

/// Values of a fit of a study.
pub(crate) fn estimates_of(study: &LinearisedProblem, fit: &Fit) -> Vec<ParameterEstimate> {
    let effect = &study.columns.effects[study.columns.groups[fit.suspect.group].effect];
    estimates(effect, fit, fit.suspect.extent)
}

/// Values of a fit by name, with intervals, and those of the extent that is reported.
pub fn estimates(effect: &Effect, fit: &Fit, extent: Option<Extent>) -> Vec<ParameterEstimate> {
    let mut names: Vec<(String, String, f64)> = effect
        .axes
        .iter()
        .map(|axis| {
            let (pattern, factor) =
                axis.moves.iter().next().map_or((axis.name.as_str(), 1.0), |(p, f)| (p.as_str(), *f));
            let parameter = pattern.rsplit('.').next().unwrap_or(pattern).to_string();
            axis.unit
                .clone()
                .map_or_else(|| (parameter.clone(), effect.unit.clone(), 1.0), |unit| (parameter.clone(), unit, factor))
        })
        .collect();
    let of_extent: &[(&str, &str)] = match extent {
        Some(Extent::Time(_)) => &[("start", "s"), ("end", "s")],
        Some(Extent::Region(_)) => &EDGES.map(|edge| (edge, "m")),
        None => &[],
    };
    names.extend(of_extent.iter().map(|(name, unit)| (name.to_string(), unit.to_string(), 1.0)));
    let length = fit.suspect.values.iter().map(|v| v * v).sum::<f64>().sqrt();
    let numbers = fit.suspect.values.iter().copied().chain(extent.iter().flat_map(Extent::numbers));
    names
        .into_iter()
        .zip(numbers)
        .enumerate()
        .map(|(k, ((name, unit, factor), value))| {
            // What engines differ in moves a value farther than noise does: a share of it is added, in any direction.
            let finite = |all: &[f64]| all.get(k).copied().filter(|d| d.is_finite()).unwrap_or(0.0);
            let deviation = finite(&fit.deviations).max(finite(&fit.scatter));
            let own =
                if k < effect.axes.len() { (effect.engine_error * length).max(0.7 * effect.tolerance) } else { 0.05 };
            let half = 1.96 * deviation.hypot(own);
            ParameterEstimate {
                name,
                value: factor * value,
                ci95: [value - half, value + half].map(|v| factor * v),
                unit,
            }
        })
        .collect()
}
