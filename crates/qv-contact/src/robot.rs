//! The robot that walked, identified before its ground: what its motors and the softness of the ground do differently looks like friction.

use crate::ContactError;
use crate::measured::Recording;
use crate::prior::{Prior, RANGE};
use crate::simulate::Simulator;
use crate::whiten::Usual;
use crate::windows::{self, Window};
use qv_fit::linear::{
    add_diagonal, add_outer, add_scaled, add_scaled_matrix, from_columns, gram, minus, outer, squared, transposed_times,
};
use qv_fit::{Cholesky, Matrix};
use qv_rollout::{Overrides, name_parts};
use serde::Serialize;
use std::collections::BTreeMap;

/// How a coordinate changes a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Change {
    /// By a factor.
    Factor,
    /// By a sum.
    Sum,
}

/// A number that all joints share. At 0 it leaves the robot as it is; its prior is the standard normal distribution.
#[derive(Debug, Clone, Copy)]
struct Coordinate {
    /// Names of its parameters, `*` for each joint.
    name: &'static str,
    change: Change,
    /// Standard deviation beforehand: of the logarithm for a factor.
    deviation: f64,
}

/// Motors and the ground's softness. Deviations are about a third of the largest sizes in the library of `qv diagnose`.
const COORDINATES: [Coordinate; 6] = [
    Coordinate { name: "actuator.*.strength", change: Change::Factor, deviation: 0.15 },
    Coordinate { name: "actuator.*.command_latency", change: Change::Sum, deviation: 0.01 },
    Coordinate { name: "actuator.*.lag", change: Change::Sum, deviation: 0.01 },
    Coordinate { name: "joint.*.viscous_friction", change: Change::Sum, deviation: 0.15 },
    Coordinate { name: "joint.*.coulomb_friction", change: Change::Sum, deviation: 0.3 },
    Coordinate { name: "contact.time_constant", change: Change::Factor, deviation: 0.6 },
];
/// Iterations of Gauss and Newton.
const ITERATIONS: usize = 5;
/// Step of a coordinate for its derivative. Contacts that begin or end otherwise change a window by as much for a small step: a step of 0.3 took
/// derivatives for so much larger that five iterations found a third of a friction.
const STEP: f64 = 1.5;

/// A parameter of the robot that was identified.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct IdentifiedValue {
    /// Its name, `*` for each joint.
    pub parameter: String,
    /// Value of the first joint before, in the parameter's unit.
    pub before: f64,
    /// Value of the first joint.
    pub value: f64,
    /// Standard deviation.
    pub deviation: f64,
}

/// The robot as its recording shows it.
pub(crate) struct IdentifiedRobot<'a> {
    /// It walks here.
    pub simulator: Simulator<'a>,
    /// What was identified.
    pub values: Vec<IdentifiedValue>,
    /// The same robot moved by one standard deviation, along directions that are independent.
    pub moved: Vec<Simulator<'a>>,
}

/// Indices of the parameters of each coordinate that is not given, and the coordinate.
fn coordinates(simulator: &Simulator, given: &[String]) -> Vec<(Coordinate, Vec<usize>)> {
    let catalogue = &simulator.rollout().catalogue;
    let is_of = |pattern: &str, name: &str| match (&name_parts(pattern)[..], &name_parts(name)[..]) {
        ([kind, "*", field], [k, _, f]) => kind == k && field == f,
        (a, b) => a == b,
    };
    let indices = |c: &Coordinate| -> Vec<usize> {
        (0..catalogue.len()).filter(|&i| is_of(c.name, &catalogue[i].name)).collect()
    };
    let is_given = |list: &[usize]| list.iter().any(|&i| given.contains(&catalogue[i].name));
    COORDINATES.into_iter().map(|c| (c, indices(&c))).filter(|(_, list)| !list.is_empty() && !is_given(list)).collect()
}

/// The least coordinate at which no value is negative.
fn least(coordinate: &Coordinate, before: f64) -> f64 {
    if coordinate.change == Change::Sum { -before / coordinate.deviation } else { f64::NEG_INFINITY }
}

fn value(coordinate: &Coordinate, before: f64, x: f64) -> f64 {
    match coordinate.change {
        Change::Factor => before * (coordinate.deviation * x).exp(),
        Change::Sum => (before + coordinate.deviation * x).max(0.0),
    }
}

/// What is searched: coordinates of the robot, then the logarithm of the friction of each label that is touched, in deviations of its prior.
struct Problem<'s, 'a> {
    nominal: &'s Simulator<'a>,
    recordings: &'s [Recording<'s>],
    windows: &'s [Window],
    coordinates: Vec<(Coordinate, Vec<usize>)>,
    /// Frictions beforehand, of all labels.
    frictions: Vec<f64>,
    /// Labels that are touched, and the deviation of their log friction.
    labels: Vec<(usize, f64)>,
}

/// Coordinates, shape `[n]`, and the differences of all windows there.
type Point = (Vec<f64>, Vec<Vec<f64>>);

/// Normal equations of the whitened differences at a point, the prior left out.
struct Normal {
    /// Shape `[n, n]`.
    bend: Matrix,
    /// Half the gradient, downwards, shape `[n]`.
    force: Vec<f64>,
    /// Sum of its outer products over clusters of windows, shape `[n, n]`.
    scatter: Matrix,
}

impl<'a> Problem<'_, 'a> {
    fn simulator(&self, x: &[f64]) -> Result<Simulator<'a>, ContactError> {
        let nominal = &self.nominal.rollout().nominal;
        let mut values = Overrides::new();
        for ((coordinate, indices), x) in self.coordinates.iter().zip(x) {
            values.extend(indices.iter().map(|&i| (i, value(coordinate, nominal[i], *x))));
        }
        let mut simulator = self.nominal.with(&values);
        simulator.settle(&self.recordings[0])?;
        Ok(simulator)
    }

    fn differences(&self, x: &[f64]) -> Result<Vec<Vec<f64>>, ContactError> {
        let mut frictions = self.frictions.clone();
        for (&(label, deviation), x) in self.labels.iter().zip(&x[self.coordinates.len()..]) {
            frictions[label] = (frictions[label] * (deviation * x).exp()).clamp(RANGE[0], RANGE[1]);
        }
        windows::differences(&self.simulator(x)?, self.recordings, self.windows, &frictions)
    }

    /// Value of a coordinate's first parameter beforehand.
    fn before(&self, k: usize) -> f64 {
        self.nominal.rollout().nominal[self.coordinates[k].1[0]]
    }

    /// Negative log posterior but for a constant.
    fn cost(usual: &Usual, differences: &[Vec<f64>], x: &[f64]) -> f64 {
        differences.iter().map(|d| usual.loss(d)).sum::<f64>() + 0.5 * squared(x)
    }

    fn normal(&self, usual: &Usual, at: &[Vec<f64>], x: &[f64]) -> Result<Normal, ContactError> {
        let n = x.len();
        let mut moved = Vec::new();
        for k in 0..n {
            let mut there = x.to_vec();
            there[k] += STEP;
            moved.push(self.differences(&there)?);
        }
        let mut clusters: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
        let (mut bend, mut force) = (Matrix::zeros(n, n), vec![0.0; n]);
        for (w, window) in self.windows.iter().enumerate() {
            let Some(residual) = usual.whitened(at[w].clone()) else { continue };
            let slope = |of: &Vec<Vec<f64>>| {
                let moved = minus(&usual.whitened(of[w].clone())?, &residual);
                Some(moved.into_iter().map(|x| x / STEP).collect::<Vec<f64>>())
            };
            let Some(slopes) = moved.iter().map(slope).collect::<Option<Vec<_>>>() else { continue };
            let weight = usual.weight(squared(&residual));
            let jacobian = from_columns(residual.len(), &slopes);
            add_scaled_matrix(&mut bend, weight, &gram(&jacobian));
            let pull = transposed_times(&jacobian, &residual);
            add_scaled(&mut force, -weight, &pull);
            add_scaled(clusters.entry(window.cluster()).or_insert_with(|| vec![0.0; n]), -weight, &pull);
        }
        let mut scatter = Matrix::zeros(n, n);
        let mean: Vec<f64> = force.iter().map(|f| f / clusters.len().max(1) as f64).collect();
        clusters.values().for_each(|pull| add_outer(&mut scatter, 1.0, &minus(pull, &mean)));
        Ok(Normal { bend, force, scatter })
    }

    /// The most probable point and a factor of its covariance, shape `[n, n]`; `None` when the equations are no good.
    fn solve(&self) -> Result<Option<(Vec<f64>, Matrix)>, ContactError> {
        let mut x = vec![0.0; self.coordinates.len() + self.labels.len()];
        let mut at = self.differences(&x)?;
        let mut last = None;
        for _ in 0..ITERATIONS {
            let Some(usual) = Usual::about_zero(&at) else { return Ok(None) };
            let normal = self.normal(&usual, &at, &x)?;
            let Some(step) = newton(&normal, &x) else { return Ok(None) };
            let cost = Self::cost(&usual, &at, &x);
            last = Some(normal);
            let Some(better) = self.better(&usual, cost, &x, &step)? else { break };
            (x, at) = better;
        }
        Ok(last.and_then(|normal| covariance_factor(&normal)).map(|factor| (x, factor)))
    }

    /// The end of the longest part of a step, halved at most three times, that is better.
    fn better(&self, usual: &Usual, cost: f64, x: &[f64], step: &[f64]) -> Result<Option<Point>, ContactError> {
        let lowest = |k: usize| self.coordinates.get(k).map_or(f64::NEG_INFINITY, |(c, _)| least(c, self.before(k)));
        for share in [1.0, 0.5, 0.25, 0.125] {
            let there: Vec<f64> = (0..x.len()).map(|k| (x[k] + share * step[k]).max(lowest(k))).collect();
            let differences = self.differences(&there)?;
            if Self::cost(usual, &differences, &there) < cost {
                return Ok(Some((there, differences)));
            }
        }
        Ok(None)
    }
}

/// Newton's step with the prior.
fn newton(normal: &Normal, x: &[f64]) -> Option<Vec<f64>> {
    Some(Cholesky::new(&with_prior(&normal.bend))?.solve(&minus(&normal.force, x)))
}

fn with_prior(matrix: &Matrix) -> Matrix {
    let mut out = matrix.clone();
    add_diagonal(&mut out, &vec![1.0; matrix.nrows()]);
    out
}

/// A factor of the covariance by how clusters of windows disagree (the sandwich of Huber and White): H^-1 (V + 1) H^-1, H with the prior's 1.
fn covariance_factor(normal: &Normal) -> Option<Matrix> {
    let bend = Cholesky::new(&with_prior(&normal.bend))?;
    let half = Cholesky::new(&with_prior(&normal.scatter))?;
    Some(bend.solve_columns(half.lower()))
}

/// Identifies motors and softness together with the frictions of the labels that windows touch, which are found anew afterwards. `None` where
/// the equations are no good or everything is given.
///
/// # Errors
/// When the simulator refuses.
pub(crate) fn identify<'a>(
    nominal: &Simulator<'a>,
    recordings: &[Recording],
    windows: &[Window],
    priors: &[Prior],
    given: &[String],
) -> Result<Option<IdentifiedRobot<'a>>, ContactError> {
    let coordinates = coordinates(nominal, given);
    if coordinates.is_empty() {
        return Ok(None);
    }
    let is_touched = |label: &usize| windows.iter().any(|w| w.labels.contains(label));
    let labels = (0..priors.len()).filter(is_touched).map(|l| (l, priors[l].wide().log_moments()[1])).collect();
    let frictions = priors.iter().map(|p| p.mean).collect();
    let problem = Problem { nominal, recordings, windows, coordinates, frictions, labels };
    let Some((x, factor)) = problem.solve()? else { return Ok(None) };
    let n = problem.coordinates.len();
    // The robot's block of the covariance.
    let rows = Matrix::from_fn(n, x.len(), |i, j| factor[(i, j)]);
    let Some(factor) = Cholesky::new(&outer(&rows)) else { return Ok(None) };
    let moved = (0..n).map(|k| {
        let mut there = x.clone();
        add_scaled(&mut there[..n], 1.0, factor.lower().col_as_slice(k));
        problem.simulator(&there)
    });
    let moved = moved.collect::<Result<_, _>>()?;
    let values = (0..n).map(|k| {
        let (coordinate, before) = (&problem.coordinates[k].0, problem.before(k));
        let spread = (0..x.len()).map(|j| rows[(k, j)].powi(2)).sum::<f64>().sqrt();
        let value = value(coordinate, before, x[k]);
        let unit = if coordinate.change == Change::Factor { value } else { 1.0 };
        let deviation = unit * coordinate.deviation * spread;
        IdentifiedValue { parameter: coordinate.name.into(), before, value, deviation }
    });
    Ok(Some(IdentifiedRobot { simulator: problem.simulator(&x)?, values: values.collect(), moved }))
}
