//! Levenberg and Marquardt's method, many points at a time.
//!
//! Each round takes two calls of the residuals: the points beside the present one, for slopes, and one trial for each damping. The step of a
//! damping `d` solves `(A + d diag A) step = force` (Marquardt, Journal of the Society for Industrial and Applied Mathematics 11, 1963,
//! section 3) among the parameters that no bound holds (an active set; Nocedal and Wright, Numerical Optimization, 2nd edition, section 16.5).

use crate::FitError;
use crate::linear::{Cholesky, Matrix};
use crate::problem::{Blocks, Evaluate, Loss, Problem, asked};
use crate::slopes::{Beside, Slopes, deviations, moved, moves};

/// By how much dampings grow where none helps.
const MORE: f64 = 1e3;

/// How a fit goes.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The loss of a block.
    pub loss: Loss,
    /// Rounds at most.
    pub rounds: usize,
    /// Dampings tried in each round, as shares of the curvature.
    pub dampings: Vec<f64>,
    /// Shares of the undamped step that are tried beside them: dampings leave out what is weakly reported, shares do not.
    pub shares: Vec<f64>,
    /// A round that lowers the cost by less than this share of it is the last.
    pub fall: f64,
    /// The same as a difference of the cost, which is minus a log probability: 0.5 is one standard deviation of one parameter.
    pub gain: f64,
    /// A step that is shorter than this share of each parameter's difference (`Problem::step`) is the last.
    pub short: f64,
}

impl Default for Options {
    fn default() -> Self {
        let dampings = vec![0.0, 1e-4, 1e-3, 0.01, 0.1, 1.0, 10.0];
        Self { loss: Loss::SQUARES, rounds: 30, dampings, shares: vec![0.5, 0.2], fall: 1e-9, gain: 0.0, short: 1e-6 }
    }
}

/// Why a fit ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopReason {
    /// The last round gained less than was asked for.
    Fall,
    /// The last step was short.
    Short,
    /// No damping helped: a minimum, or slopes that say nothing of what lies a step away.
    Stuck,
    /// Rounds were over.
    Rounds,
}

/// A fit.
#[derive(Debug, Clone)]
pub struct Fit {
    /// Values of the parameters.
    pub values: Vec<f64>,
    /// Loss of all blocks and priors there: minus a log posterior, but for a constant.
    pub cost: f64,
    /// Cost at the start and after each round that helped.
    pub costs: Vec<f64>,
    /// Residuals by block.
    pub residuals: Blocks,
    /// Slopes where the last round began: those of the fit itself, where it ended because nothing helped or little was gained.
    pub slopes: Slopes,
    /// Why it ended.
    pub stopped: StopReason,
}

impl Fit {
    /// Standard deviations by the curvature alone; infinite where parameters are not distinguished.
    pub fn deviations(&self) -> Vec<f64> {
        self.slopes.posterior().map_or(vec![f64::INFINITY; self.values.len()], |c| deviations(&c))
    }

    /// Standard deviations by how blocks differ; infinite where that cannot be reported.
    pub fn block_deviations(&self) -> Vec<f64> {
        self.slopes.sandwich().map_or(vec![f64::INFINITY; self.values.len()], |c| deviations(&c))
    }

    /// Value less and plus `quantile` deviations; 1.96 for 95 %.
    pub fn intervals(&self, deviations: &[f64], quantile: f64) -> Vec<[f64; 2]> {
        self.values.iter().zip(deviations).map(|(v, d)| [v - quantile * d, v + quantile * d]).collect()
    }
}

/// Fits a problem. `evaluate` gives residuals of many points at once, shape `[points][blocks][numbers]`; a block that ran away is empty.
///
/// # Errors
/// Those of `evaluate`; when the problem or the residuals mean nothing, or the start runs away in all blocks.
pub fn fit<E: From<FitError>>(
    problem: &Problem,
    options: &Options,
    mut evaluate: impl FnMut(&[Vec<f64>]) -> Result<Vec<Blocks>, E>,
) -> Result<Fit, E> {
    Descent::begin(problem, options, &mut evaluate)?.descend(&mut evaluate)
}

/// The present point of a fit.
struct Descent<'p> {
    problem: &'p Problem,
    options: &'p Options,
    /// Numbers of each block.
    lengths: Vec<usize>,
    values: Vec<f64>,
    residuals: Blocks,
    slopes: Slopes,
    costs: Vec<f64>,
}

impl<'p> Descent<'p> {
    /// The start with its slopes, in one call.
    fn begin<E: From<FitError>>(problem: &'p Problem, options: &'p Options, evaluate: Evaluate<E>) -> Result<Self, E> {
        problem.check()?;
        let values = problem.clamped(&problem.start);
        let moves = moves(problem, &values);
        let points: Vec<Vec<f64>> =
            std::iter::once(values.clone()).chain(moves.iter().map(|m| moved(&values, *m))).collect();
        let mut found = asked(evaluate, &points, None)?;
        let residuals = found.remove(0);
        if residuals.iter().all(Vec::is_empty) {
            return Err(FitError::ran_away().into());
        }
        let whole = |k: usize| found.iter().chain([&residuals]).map(|b| b[k].len()).max().unwrap_or(0);
        let lengths: Vec<usize> = (0..residuals.len()).map(whole).collect();
        let beside = Beside::new(moves, found, values.len());
        let slopes = Slopes::of(problem, &options.loss, &values, &residuals, &beside);
        let mut descent = Self { problem, options, lengths, values, residuals, slopes, costs: Vec::new() };
        descent.costs.push(descent.cost(&descent.values, &descent.residuals));
        if descent.costs[0].is_infinite() {
            return Err(FitError::ran_away().into());
        }
        Ok(descent)
    }

    fn cost(&self, values: &[f64], residuals: &Blocks) -> f64 {
        self.options.loss.all(residuals, &self.lengths) + self.problem.prior_cost(values)
    }

    fn descend<E: From<FitError>>(mut self, evaluate: Evaluate<E>) -> Result<Fit, E> {
        for round in 0..self.options.rounds {
            if round > 0 {
                self.look(evaluate)?;
            }
            let stopped = match self.step(evaluate, 1.0)? {
                None => self.step(evaluate, MORE)?,
                moved => moved,
            };
            let Some((gained, length)) = stopped else { return Ok(self.ended(StopReason::Stuck)) };
            if gained <= self.options.gain.max(self.options.fall * self.now().abs()) {
                return Ok(self.ended(StopReason::Fall));
            }
            if length < self.options.short {
                return Ok(self.ended(StopReason::Short));
            }
        }
        Ok(self.ended(StopReason::Rounds))
    }

    fn now(&self) -> f64 {
        self.costs[self.costs.len() - 1]
    }

    fn ended(self, stopped: StopReason) -> Fit {
        let cost = self.now();
        Fit { values: self.values, cost, costs: self.costs, residuals: self.residuals, slopes: self.slopes, stopped }
    }

    /// Slopes at the present point.
    fn look<E: From<FitError>>(&mut self, evaluate: Evaluate<E>) -> Result<(), E> {
        let moves = moves(self.problem, &self.values);
        let points: Vec<Vec<f64>> = moves.iter().map(|m| moved(&self.values, *m)).collect();
        let found = asked(evaluate, &points, Some(&self.lengths))?;
        let beside = Beside::new(moves, found, self.values.len());
        self.slopes = Slopes::of(self.problem, &self.options.loss, &self.values, &self.residuals, &beside);
        Ok(())
    }

    /// Where steps of all dampings lead, times `more`, and at first shares of the undamped one.
    fn trials(&self, more: f64) -> Vec<Vec<f64>> {
        let to = |damping: f64| step_to(self.problem, &self.slopes, &self.values, damping);
        let mut tried: Vec<Vec<f64>> = self.options.dampings.iter().filter_map(|d| to(more * d)).collect();
        let Some(whole) = to(0.0) else { return tried };
        for share in &self.options.shares {
            let moved = |(x, to): (&f64, &f64)| x + share / more * (to - x);
            tried.push(self.values.iter().zip(&whole).map(moved).collect());
        }
        tried
    }

    /// Goes to the best trial; what that gains, and how long the step is in differences. `None` where none helps.
    fn step<E: From<FitError>>(&mut self, evaluate: Evaluate<E>, more: f64) -> Result<Option<(f64, f64)>, E> {
        let mut tried = self.trials(more);
        tried.retain(|to| *to != self.values);
        tried.dedup();
        if tried.is_empty() {
            return Ok(None);
        }
        let found = asked(evaluate, &tried, Some(&self.lengths))?;
        let costs: Vec<f64> = tried.iter().zip(&found).map(|(v, r)| self.cost(v, r)).collect();
        let best = (0..tried.len()).min_by(|&a, &b| costs[a].total_cmp(&costs[b])).unwrap_or(0);
        let gained = self.now() - costs[best];
        if gained.is_nan() || gained <= 0.0 {
            return Ok(None);
        }
        let to = tried.swap_remove(best);
        let share = |k: usize| (to[k] - self.values[k]).abs() / self.problem.step[k].abs();
        let length = (0..to.len()).map(share).fold(0.0, f64::max);
        (self.values, self.residuals) = (to, found.into_iter().nth(best).unwrap_or_default());
        self.costs.push(costs[best]);
        Ok(Some((gained, length)))
    }
}

/// Where a damped step leads from a point, within the bounds: what leaves them is held at the bound, and the rest solved again. `None` where
/// the curvature has no inverse.
fn step_to(problem: &Problem, slopes: &Slopes, values: &[f64], damping: f64) -> Option<Vec<f64>> {
    let count = values.len();
    let is_held = |k: usize| {
        (values[k] <= problem.low[k] && slopes.force[k] <= 0.0)
            || (values[k] >= problem.high[k] && slopes.force[k] >= 0.0)
    };
    let mut free: Vec<usize> = (0..count).filter(|&k| !is_held(k)).collect();
    let mut to = values.to_vec();
    while !free.is_empty() {
        let step = solve_free(slopes, &free, values, &to, damping)?;
        free.iter().zip(&step).for_each(|(&k, s)| to[k] = values[k] + s);
        let leaves = |k: usize| to[k] < problem.low[k] || to[k] > problem.high[k];
        let (gone, left): (Vec<usize>, Vec<usize>) = free.iter().partition(|&&k| leaves(k));
        if gone.is_empty() {
            break;
        }
        gone.into_iter().for_each(|k| to[k] = to[k].clamp(problem.low[k], problem.high[k]));
        free = left;
    }
    to.iter().all(|x| x.is_finite()).then_some(to)
}

/// Step of the free parameters, the others being moved to `to`.
fn solve_free(slopes: &Slopes, free: &[usize], values: &[f64], to: &[f64], damping: f64) -> Option<Vec<f64>> {
    let a = &slopes.curvature;
    let damped = |i: usize, k: usize| a[(free[i], free[k])] * if i == k { 1.0 + damping } else { 1.0 };
    let others: Vec<usize> = (0..values.len()).filter(|k| !free.contains(k)).collect();
    let right = |i: &usize| slopes.force[*i] - others.iter().map(|&k| a[(*i, k)] * (to[k] - values[k])).sum::<f64>();
    let factor = Cholesky::new(&Matrix::from_fn(free.len(), free.len(), damped))?;
    Some(factor.solve(&free.iter().map(right).collect::<Vec<f64>>()))
}
