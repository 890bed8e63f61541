//! What a recording says of every parameter of the linear model, without the recording.

use crate::GapError;
use crate::inference::linearised::{EXTRA, LinearisedProblem, LinearisedWindow};
use crate::inference::search::direction;
use crate::problem::columns::{Columns, Group};
use qv_fit::Matrix;
use qv_fit::linear::{add_scaled, add_scaled_matrix, minus, times};

/// The first level of an effect, at which slopes are taken.
const FIRST: usize = 0;

/// A column, the same in every recording of a robot: effect, axis, member, level. The step between the clocks of a recorder has none: it is
/// another one every day.
pub(super) type Key = Option<(String, usize, usize, usize)>;

/// One axis of one part of the robot, along which a change is looked for.
#[derive(Debug, Clone)]
pub(super) struct Line {
    pub effect: String,
    pub scope: Vec<String>,
    pub parameter: String,
    pub unit: String,
    /// Value of the parameter in the calibrated robot.
    pub value: f64,
    /// Least and largest value that the simulator has.
    pub bounds: [f64; 2],
    /// Change of the parameter for each unit along `along`.
    pub step: f64,
    /// Change that is as large as the effect's range.
    pub furthest: f64,
    /// What robots of one kind differ by, in the parameter's unit.
    pub tolerance: f64,
    /// Shape `[columns]`.
    pub along: Vec<f64>,
}

/// See the module.
pub(super) struct Moments {
    pub keys: Vec<Key>,
    pub tolerance: Vec<f64>,
    /// Sum of `J'J`, shape `[columns, columns]`.
    pub h: Matrix,
    /// Sum of `J'r`.
    pub b: Vec<f64>,
    /// The same of simulated recordings of the robot, their own deviations taken away: noise and numerics.
    pub ghosts: Vec<Vec<f64>>,
    /// What each window pulls at the columns, with the deviations at their best.
    pub scores: Vec<Vec<f64>>,
    /// Mean square of residuals with the deviations at their best; 1 for noise alone.
    pub level: f64,
    pub lines: Vec<Line>,
}

impl Moments {
    pub fn of(study: &LinearisedProblem) -> Result<Self, GapError> {
        let weight = |seen: &LinearisedWindow| seen.weight;
        let marginal = study.marginal(weight)?;
        let sums = study.nominal(weight);
        let best = marginal.deviations(&sums);
        let mut h = Matrix::zeros(study.width(), study.width());
        let mut full = vec![0.0; study.width()];
        full[..best.len()].copy_from_slice(&best);
        let mut scores = Vec::new();
        for seen in &study.seen {
            add_scaled_matrix(&mut h, seen.weight, &seen.h);
            let mut score = minus(&seen.nominal().b, &times(&seen.h, &full));
            score.iter_mut().for_each(|x| *x *= seen.weight);
            scores.push(score);
        }
        let all: Vec<usize> = (0..study.seen.len()).collect();
        let ghost = |(normals, deviations): (&Vec<_>, &Vec<f64>)| {
            let mut b = study.sums(normals, &all, weight).b;
            let mut own = vec![0.0; study.width()];
            own[EXTRA..EXTRA + deviations.len()].copy_from_slice(deviations);
            add_scaled(&mut b, -1.0, &times(&h, &own));
            b
        };
        let ghosts = study.replicates.iter().zip(&study.ghost_deviations).map(ghost).collect();
        let level = marginal.loss(&sums) / sums.count.max(1.0);
        Ok(Self {
            keys: keys(&study.columns),
            tolerance: study.tolerance.clone(),
            b: sums.b,
            ghosts,
            scores,
            level,
            lines: lines(study),
            h,
        })
    }
}

fn keys(columns: &Columns) -> Vec<Key> {
    let key = |c: &crate::problem::columns::Column| {
        let unit = &columns.units[c.unit];
        Some((columns.effects[unit.effect].name.clone(), unit.axis, unit.member, c.level))
    };
    std::iter::repeat_n(None, EXTRA).chain(columns.columns.iter().map(key)).collect()
}

fn lines(study: &LinearisedProblem) -> Vec<Line> {
    study.columns.groups.iter().enumerate().flat_map(|(index, group)| of_group(study, index, group)).collect()
}

/// Limits, which have no slope, and what acts for a part of the time are not among them.
fn of_group(study: &LinearisedProblem, index: usize, group: &Group) -> Vec<Line> {
    let columns = &study.columns;
    let effect = &columns.effects[group.effect];
    let Some(found) = direction(columns, index, FIRST).filter(|_| study.may_be(group) && !effect.local) else {
        return Vec::new();
    };
    if found.absent.iter().any(|a| !a.is_finite()) {
        return Vec::new();
    }
    let line = |(axis, named): (usize, &crate::problem::library::Axis)| {
        let moves: Vec<(usize, f64)> =
            columns.units_of(group, axis).filter_map(|u| columns.units[u].moves.first().copied()).collect();
        // An axis with a unit of its own is reported as its parameter.
        let factor = |own: f64| if named.unit.is_some() { own } else { 1.0 };
        let value = |&(id, own): &(usize, f64)| study.rollout.nominal[id] * factor(own) / own;
        let count = moves.len().max(1) as f64;
        let scale = moves.iter().map(|m| factor(m.1)).sum::<f64>() / count;
        let furthest = effect.range.iter().map(|limit| (limit - found.absent[axis]).abs()).fold(0.0, f64::max);
        let bound = |end: f64| {
            let bounds = moves
                .iter()
                .map(|&(id, own)| study.rollout.catalogue[id].clamped(end * own.signum()) * factor(own) / own);
            bounds.sum::<f64>() / count
        };
        Line {
            bounds: [bound(f64::NEG_INFINITY), bound(f64::INFINITY)],
            effect: effect.name.clone(),
            scope: group.names.clone(),
            parameter: named.name.clone(),
            unit: named.unit.clone().unwrap_or_else(|| effect.unit.clone()),
            value: moves.iter().map(value).sum::<f64>() / count,
            step: found.steps[axis] * scale,
            furthest: furthest * scale.abs(),
            tolerance: effect.tolerance * scale.abs(),
            along: found.d.col_as_slice(axis).to_vec(),
        }
    };
    effect.axes.iter().enumerate().map(line).collect()
}
