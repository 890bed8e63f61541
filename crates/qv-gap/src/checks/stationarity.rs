//! Whether what is accused of joints is the same at all speeds, loads and times. A friction that fades with speed is Coulomb friction
//! of no one size: each window, asked for itself, wants another.
//!
//! Each window and joint asks for a change of the accused value, `(b - H d) / h` with the deviations `d` at their best over all
//! windows. These are regressed on speed, nearness to rest, load and time with weights `h`; the error of the slope is that of White (1980,
//! Econometrica 48, 817), robust against windows that nothing explains.

use crate::inference::linearised::{EXTRA, LinearisedProblem, LinearisedWindow};
use crate::inference::search::fitted;
use crate::problem::columns::Group;
use qv_core::JointSeries;
use qv_fit::linear::{dot, minus, times};
use serde::{Deserialize, Serialize};

/// What a joint asks for in a window.
struct JointDemand {
    /// Change of the value.
    change: f64,
    /// Weight.
    weight: f64,
    /// What it may depend on, in the order of [`FACTORS`].
    known: [f64; 4],
}

/// What the accused value depends on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Dependence {
    /// Speed, nearness to rest, load or time.
    pub on: String,
    /// Slope over its standard error.
    pub errors: f64,
    /// Change of the value over two standard deviations of the factor.
    pub change: f64,
}

/// The last of the factors.
pub const TIME: &str = "time";
const FACTORS: [&str; 4] = ["speed", "nearness to rest", "load", TIME];
/// Windows from which a slope and its error are reported.
const LEAST_WINDOWS: usize = 8;
/// Speed below which a joint is nearly at rest, where friction fades fastest \[rad/s\].
const SLOW: f64 = 1.0;

/// How the value of an effect of joints that was accused depends on each factor, in the study of the corrected robot.
pub(crate) fn dependences(study: &LinearisedProblem, name: &str, group: &Group) -> Vec<Dependence> {
    let asked = asked(study, name, group);
    (0..FACTORS.len()).filter_map(|f| dependence(&asked, f)).collect()
}

/// How what acts for a while changes in that while, as a share of itself. `study` is that of the robot without it: one event
/// takes the place of any other in the simulator, so that nothing can be asked beside it. Windows that no fit has seen are asked, too.
pub fn fading(
    study: &LinearisedProblem,
    name: &str,
    group: &Group,
    values: &[f64],
    time: [f64; 2],
) -> Option<Dependence> {
    let columns = &study.columns;
    let effect = columns.effects.iter().position(|e| e.name == name)?;
    let of_group = Group { effect, ..group.clone() };
    // The whole of it, in steps of the columns.
    let mut along = vec![0.0; EXTRA + columns.columns.len()];
    for (axis, value) in values.iter().enumerate() {
        for unit in columns.units_of(&of_group, axis) {
            let column = columns.column(unit, 0)?;
            along[EXTRA + column] = value / (columns.columns[column].value - columns.units[unit].absent);
        }
    }
    let window = study.rollout.cut.window;
    let is_beside = |s: &LinearisedWindow| s.window.start >= time[1] || s.window.start + window <= time[0];
    let is_inside = |s: &&LinearisedWindow| s.window.start >= time[0] && s.window.start + window <= time[1];
    let beside = |s: &LinearisedWindow| if is_beside(s) { fitted(s) } else { 0.0 };
    let deviations = study.marginal(beside).ok()?.deviations(&study.nominal(beside));
    let ask = |seen: &LinearisedWindow| {
        let weight = dot(&along, &times(&seen.h, &along));
        let change = dot(&along, &minus(&seen.nominal().b, &times(&seen.h, &deviations))) / weight;
        // A robot that stands shows a force ten times as well as engines agree on it.
        let weight = 1.0 / (1.0 / weight + columns.effects[effect].engine_error.powi(2));
        (weight > 0.0).then_some(JointDemand { change, weight, known: [0.0, 0.0, 0.0, seen.window.start] })
    };
    let asked: Vec<JointDemand> = study.seen.iter().filter(is_inside).filter_map(ask).collect();
    if asked.len() < LEAST_WINDOWS {
        return None;
    }
    dependence(&asked, FACTORS.len() - 1)
}

/// A change of a value that a window asks for.
pub(super) struct Ask {
    /// Index of the window.
    pub window: usize,
    /// Index of the member, such as a joint.
    pub member: usize,
    /// In the unit of the effect's first axis.
    pub change: f64,
    /// Curvature of the loss along it.
    pub weight: f64,
}

/// What the windows of the fit ask of the first axis of an effect, deviations at their best over all of them.
pub(super) fn asks(study: &LinearisedProblem, name: &str, group: &Group) -> Vec<Ask> {
    let columns = &study.columns;
    let Some(effect) = columns.effects.iter().position(|e| e.name == name) else { return Vec::new() };
    let Ok(marginal) = study.marginal(fitted) else { return Vec::new() };
    let deviations = marginal.deviations(&study.nominal(fitted));
    let of_group = Group { effect, ..group.clone() };
    let units: Vec<usize> = columns.units_of(&of_group, 0).filter(|&u| columns.units[u].absent.is_finite()).collect();
    let mut all = Vec::new();
    for (window, seen) in study.seen.iter().enumerate().filter(|(_, s)| fitted(s) > 0.0) {
        let asks = seen.nominal().b;
        for &unit in &units {
            let Some(column) = columns.column(unit, 0) else { continue };
            let step = columns.columns[column].value - columns.units[unit].absent;
            let (member, column) = (columns.units[unit].member, EXTRA + column);
            let weight = seen.h[(column, column)] / (step * step);
            // Symmetric: a row of it is a column.
            let force = asks[column] - dot(&seen.h.col_as_slice(column)[..deviations.len()], &deviations);
            if weight > 0.0 {
                all.push(Ask { window, member, change: force / step / weight, weight });
            }
        }
    }
    all
}

fn asked(study: &LinearisedProblem, name: &str, group: &Group) -> Vec<JointDemand> {
    let of = |a: Ask| JointDemand {
        change: a.change,
        weight: a.weight,
        known: known(study, &study.seen[a.window], a.member),
    };
    asks(study, name, group).into_iter().map(of).collect()
}

fn known(study: &LinearisedProblem, seen: &LinearisedWindow, joint: usize) -> [f64; 4] {
    let measured = &seen.window.view.measured;
    let mean = |series, of| mean_of(study, seen, joint, series, of);
    let rest = mean(&measured.velocity, |v| SLOW * SLOW / (SLOW * SLOW + v * v));
    [mean(&measured.velocity, f64::abs), rest, mean(&measured.torque, f64::abs), seen.window.start]
}

/// Mean over a window of what `of` makes of a joint's samples; 0 without any.
pub(crate) fn mean_of(
    study: &LinearisedProblem,
    seen: &LinearisedWindow,
    joint: usize,
    series: &Option<JointSeries>,
    of: fn(f64) -> f64,
) -> f64 {
    let column = study.rollout.columns[joint];
    let Some(s) = series.as_ref().filter(|s| column < s.joints) else { return 0.0 };
    let (from, to) = (seen.window.start, seen.window.start + study.rollout.cut.window);
    let (first, last) = (s.time.partition_point(|&t| t < from), s.time.partition_point(|&t| t <= to));
    let all: Vec<f64> = (first..last).map(|i| s.values[i * s.joints + column]).filter(|x| x.is_finite()).collect();
    all.iter().map(|x| of(*x)).sum::<f64>() / all.len().max(1) as f64
}

fn dependence(asked: &[JointDemand], factor: usize) -> Option<Dependence> {
    let total: f64 = asked.iter().map(|a| a.weight).sum();
    let mean = |of: &dyn Fn(&JointDemand) -> f64| asked.iter().map(|a| a.weight * of(a)).sum::<f64>() / total;
    let centre = mean(&|a| a.known[factor]);
    let middle = mean(&|a| a.change);
    let spread = mean(&|a| (a.known[factor] - centre).powi(2)).sqrt();
    if !(total > 0.0 && spread > 0.0) {
        return None;
    }
    let z = |a: &JointDemand| (a.known[factor] - centre) / spread;
    let slope = mean(&|a| z(a) * (a.change - middle));
    let left = |a: &JointDemand| a.change - middle - slope * z(a);
    let variance: f64 = asked.iter().map(|a| (a.weight * z(a) * left(a)).powi(2)).sum::<f64>() / (total * total);
    let (on, change) = (FACTORS[factor].to_owned(), 2.0 * slope);
    (variance > 0.0).then(|| Dependence { on, errors: slope / variance.sqrt(), change })
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_core::random::SplitMix64;

    /// Eight hundred windows that ask for 0.1 per unit of speed and for nothing else, with noise.
    fn asked(slope: f64) -> Vec<JointDemand> {
        let mut random = SplitMix64::of(3, 1);
        let mut one = || {
            let known = [random.uniform(), random.uniform(), random.uniform(), random.uniform()];
            let change = slope * known[0] + 0.1 * (random.uniform() - 0.5);
            JointDemand { change, weight: 0.5 + random.uniform(), known }
        };
        (0..800).map(|_| one()).collect()
    }

    #[test]
    fn a_value_that_changes_with_speed_is_told_and_no_other() {
        let of = |asked: &[JointDemand]| -> Vec<Dependence> { (0..4).filter_map(|f| dependence(asked, f)).collect() };
        let changing = of(&asked(0.1));
        assert!(changing[0].errors > 10.0, "{changing:?}");
        // Two standard deviations of what lies evenly between 0 and 1.
        assert!((changing[0].change - 0.1 * 2.0 / 12f64.sqrt()).abs() < 0.01, "{changing:?}");
        assert!(changing[1..].iter().all(|d| d.errors.abs() < 3.0), "{changing:?}");
        assert!(of(&asked(0.0)).iter().all(|d| d.errors.abs() < 3.0));
    }

    #[test]
    fn windows_that_are_all_alike_say_nothing() {
        let alike: Vec<JointDemand> =
            (0..5).map(|_| JointDemand { change: 1.0, weight: 1.0, known: [2.0; 4] }).collect();
        assert!((0..4).all(|f| dependence(&alike, f).is_none()));
        assert_eq!(dependence(&[], 0), None);
    }
}
