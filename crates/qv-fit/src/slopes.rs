//! Slopes of the loss, and what they say of how well parameters are known.

use crate::linear::{
    Cholesky, Matrix, add_diagonal, add_outer, add_scaled, add_scaled_matrix, diagonal_of, from_columns, gram, product,
    transposed_times,
};
use crate::problem::{Blocks, Differences, Evaluate, Loss, Problem, asked};

/// Slope and curvature of the loss at a point, the priors' included: reweighted squares (Gauss and Newton).
#[derive(Debug, Clone)]
pub struct Slopes {
    /// Slope of the loss downwards, shape `[parameters]`.
    pub force: Vec<f64>,
    /// Curvature, shape `[parameters, parameters]`.
    pub curvature: Matrix,
    /// Slope downwards of each block's loss, shape `[blocks][parameters]`; blocks that ran away somewhere have none.
    pub scores: Vec<Vec<f64>>,
    /// Curvature of the priors alone, by parameter.
    pub stiffness: Vec<f64>,
}

impl Slopes {
    /// Of residuals at a point and at the points beside it; blocks that ran away in one of them are left out.
    pub(crate) fn of(problem: &Problem, loss: &Loss, values: &[f64], here: &Blocks, beside: &Beside) -> Self {
        let count = values.len();
        let stiffness: Vec<f64> = problem.prior.iter().map(|p| p.map_or(0.0, |[_, d]| d.powi(-2))).collect();
        let pull = |k: usize| problem.prior[k].map_or(0.0, |[mean, _]| stiffness[k] * (mean - values[k]));
        let mut slopes = Self {
            force: (0..count).map(pull).collect(),
            curvature: Matrix::zeros(count, count),
            scores: Vec::new(),
            stiffness,
        };
        for (block, residual) in here.iter().enumerate().filter(|(_, r)| !r.is_empty()) {
            if let Some(columns) = beside.columns(here, block) {
                slopes.add(loss, residual, &from_columns(residual.len(), &columns));
            }
        }
        add_diagonal(&mut slopes.curvature, &slopes.stiffness);
        slopes
    }

    /// Adds a block's residual and its slopes along each parameter, shape `[numbers, parameters]`.
    fn add(&mut self, loss: &Loss, residual: &[f64], jacobian: &Matrix) {
        let weight = loss.weight(residual);
        add_scaled_matrix(&mut self.curvature, weight, &gram(jacobian));
        let score: Vec<f64> = transposed_times(jacobian, residual).iter().map(|s| -weight * s).collect();
        add_scaled(&mut self.force, 1.0, &score);
        self.scores.push(score);
    }

    /// Covariance of the parameters if residuals are what the loss takes them for: the inverse of the curvature. `None` where a parameter
    /// shows in nothing and has no prior.
    pub fn posterior(&self) -> Option<Matrix> {
        Some(Cholesky::new(&self.curvature)?.inverse())
    }

    /// Covariance by how blocks differ in what they ask for, whatever correlates within them: `A^-1 (c S + P) A^-1` with the curvature `A`,
    /// the sum `S` of the squares of the blocks' scores, `c = n / (n - 1)` of `n` blocks, and the priors `P` as one more observation
    /// (Liang and Zeger, Biometrika 73, 1986, theorem 2; White, Econometrica 50, 1982). `None` of fewer than two blocks.
    pub fn sandwich(&self) -> Option<Matrix> {
        let count = self.scores.len() as f64;
        let inverse = self.posterior().filter(|_| count > 1.0)?;
        let mut middle = Matrix::zeros(inverse.nrows(), inverse.ncols());
        self.scores.iter().for_each(|s| add_outer(&mut middle, count / (count - 1.0), s));
        add_diagonal(&mut middle, &self.stiffness);
        Some(product(&product(&inverse, &middle), &inverse))
    }
}

/// Roots of the diagonal of a covariance: standard deviations.
pub(crate) fn deviations(covariance: &Matrix) -> Vec<f64> {
    diagonal_of(covariance).iter().map(|v| v.max(0.0).sqrt()).collect()
}

/// Points beside one, for its slopes.
pub(crate) struct Beside {
    /// Parameter and signed distance of each point.
    moves: Vec<(usize, f64)>,
    /// Residuals of each.
    found: Vec<Blocks>,
    parameters: usize,
}

/// Where residuals are asked for: parameter and signed distance of each point.
pub(crate) fn moves(problem: &Problem, values: &[f64]) -> Vec<(usize, f64)> {
    let one = |k: usize| -> Vec<(usize, f64)> {
        let step = problem.step[k];
        let is_inside = |x: f64| (problem.low[k]..=problem.high[k]).contains(&x);
        let (ahead, back) = (is_inside(values[k] + step), is_inside(values[k] - step));
        match problem.differences {
            Differences::Central if ahead && back => vec![(k, step), (k, -step)],
            _ if ahead => vec![(k, step)],
            _ if back => vec![(k, -step)],
            // Between bounds that are nearer than the step: to the farther one.
            _ if problem.high[k] - values[k] >= values[k] - problem.low[k] => vec![(k, problem.high[k] - values[k])],
            _ => vec![(k, problem.low[k] - values[k])],
        }
    };
    (0..values.len()).flat_map(one).filter(|m| m.1 != 0.0).collect()
}

/// A point moved along one parameter.
pub(crate) fn moved(values: &[f64], (k, distance): (usize, f64)) -> Vec<f64> {
    let mut moved = values.to_vec();
    moved[k] += distance;
    moved
}

impl Beside {
    pub(crate) fn new(moves: Vec<(usize, f64)>, found: Vec<Blocks>, parameters: usize) -> Self {
        Self { moves, found, parameters }
    }

    /// Slopes of a block along each parameter, shape `[parameters][numbers]`; `None` where it ran away in one of the points.
    fn columns(&self, here: &Blocks, block: usize) -> Option<Vec<Vec<f64>>> {
        let residual = &here[block];
        let mut columns = vec![vec![0.0; residual.len()]; self.parameters];
        for (at, &(k, distance)) in self.moves.iter().enumerate() {
            let other = &self.found[at][block];
            if other.is_empty() {
                return None;
            }
            let share = 1.0 / self.moves.iter().filter(|m| m.0 == k).count() as f64;
            let slope = other.iter().zip(residual).map(|(o, r)| share * (o - r) / distance);
            columns[k].iter_mut().zip(slope).for_each(|(c, s)| *c += s);
        }
        Some(columns)
    }
}

/// Slopes at a point, for its covariance, from one call of `evaluate` ([`crate::fit`] says what that is).
///
/// # Errors
/// Those of `evaluate`, and those of [`crate::fit`].
pub fn slopes<E: From<crate::FitError>>(
    problem: &Problem,
    loss: &Loss,
    values: &[f64],
    evaluate: Evaluate<E>,
) -> Result<Slopes, E> {
    problem.check()?;
    let moves = moves(problem, values);
    let points: Vec<Vec<f64>> =
        std::iter::once(values.to_vec()).chain(moves.iter().map(|m| moved(values, *m))).collect();
    let mut found = asked(evaluate, &points, None)?;
    let here = found.remove(0);
    Ok(Slopes::of(problem, loss, values, &here, &Beside::new(moves, found, values.len())))
}
