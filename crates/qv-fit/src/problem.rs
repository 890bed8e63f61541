//! What is fitted, as plain data, and the loss.

use crate::FitError;
use crate::linear::squared;

/// Residuals of one point by block, such as windows of a recording; empty where a block ran away.
pub type Blocks = Vec<Vec<f64>>;

/// What gives residuals of many points at once, shape `[points][blocks][numbers]`.
pub type Evaluate<'e, E> = &'e mut dyn FnMut(&[Vec<f64>]) -> Result<Vec<Blocks>, E>;

/// From which sides slopes are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Differences {
    /// One point for each parameter, away from the nearer bound.
    #[default]
    OneSided,
    /// Two points for each: for residuals that cost little.
    Central,
}

/// Parameters that are fitted.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Problem {
    /// Value of each parameter that the fit begins at.
    pub start: Vec<f64>,
    /// Least value of each; minus infinity where there is none.
    pub low: Vec<f64>,
    /// Greatest value of each; infinity where there is none.
    pub high: Vec<f64>,
    /// Mean and standard deviation of each one's normal prior, if it has one.
    pub prior: Vec<Option<[f64; 2]>>,
    /// By how much each is moved for its slope, not 0; the other way where a bound is nearer.
    pub step: Vec<f64>,
    /// From which sides.
    pub differences: Differences,
}

impl Problem {
    /// Without bounds and priors.
    pub fn new(start: &[f64], step: &[f64]) -> Self {
        let count = start.len();
        Self {
            start: start.to_vec(),
            low: vec![f64::NEG_INFINITY; count],
            high: vec![f64::INFINITY; count],
            prior: vec![None; count],
            step: step.to_vec(),
            differences: Differences::OneSided,
        }
    }

    pub(crate) fn check(&self) -> Result<(), FitError> {
        let count = self.start.len();
        let lengths = [self.low.len(), self.high.len(), self.prior.len(), self.step.len()];
        if count == 0 || lengths != [count; 4] {
            let found = format!("{count} starts and lists of {lengths:?}");
            return Err(FitError::input("problem", "a bound, a prior and a step for each parameter", found));
        }
        for k in 0..count {
            let is_ordered = self.low[k] <= self.high[k] && self.start[k].is_finite();
            let has_prior = self.prior[k].is_none_or(|[mean, deviation]| mean.is_finite() && deviation > 0.0);
            if !(is_ordered && has_prior && self.step[k] != 0.0 && self.step[k].is_finite()) {
                let found = format!(
                    "start {}, bounds {} to {}, prior {:?}, step {}",
                    self.start[k], self.low[k], self.high[k], self.prior[k], self.step[k]
                );
                return Err(FitError::input(format!("parameter {k}"), "a finite start, ordered bounds, a step", found));
            }
        }
        Ok(())
    }

    pub(crate) fn clamped(&self, values: &[f64]) -> Vec<f64> {
        (0..values.len()).map(|k| values[k].clamp(self.low[k], self.high[k])).collect()
    }

    /// Half the squares of the distances from the priors, in their deviations.
    pub fn prior_cost(&self, values: &[f64]) -> f64 {
        let of = |(prior, x): (&Option<[f64; 2]>, &f64)| prior.map_or(0.0, |[mean, d]| 0.5 * ((x - mean) / d).powi(2));
        self.prior.iter().zip(values).map(of).sum()
    }
}

/// The loss of a block. With squares `s` of its `n` numbers it is `s / 2`; with tails of `f` degrees of freedom
/// `(f + n) / 2 ln(1 + s / f)`, minus the log likelihood of a multivariate t, whose slope is that of squares with the weight `(f + n) / (f + s)`
/// (Lange, Little and Taylor, Journal of the American Statistical Association 84, 1989, eqs. 2 and 5).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Loss {
    /// Degrees of freedom of the tails; none for squares.
    pub freedom: Option<f64>,
    /// Share of a block's numbers that count as independent: its squares and their count are multiplied by it.
    pub independent: f64,
    /// Loss of each such number of a block that ran away; infinite where none may.
    pub ran_away: f64,
}

impl Loss {
    /// Plain squares.
    pub const SQUARES: Self = Self { freedom: None, independent: 1.0, ran_away: f64::INFINITY };

    /// Student's t.
    pub const fn student(freedom: f64) -> Self {
        Self { freedom: Some(freedom), ..Self::SQUARES }
    }

    /// Loss of a block's residuals.
    pub fn of(&self, residual: &[f64]) -> f64 {
        let (squares, count) = (self.independent * squared(residual), self.independent * residual.len() as f64);
        match self.freedom {
            None => 0.5 * squares,
            Some(freedom) => 0.5 * (freedom + count) * (squares / freedom).ln_1p(),
        }
    }

    /// Factor of the squares of a block whose slope and curvature those of the loss are taken for.
    pub fn weight(&self, residual: &[f64]) -> f64 {
        let (squares, count) = (self.independent * squared(residual), self.independent * residual.len() as f64);
        self.independent * self.freedom.map_or(1.0, |freedom| (freedom + count) / (freedom + squares))
    }

    /// Loss of all blocks, of which those that ran away would have `lengths` numbers; infinite where that has no number.
    pub(crate) fn all(&self, blocks: &[Vec<f64>], lengths: &[usize]) -> f64 {
        let of = |(block, length): (&Vec<f64>, &usize)| match block.is_empty() && *length > 0 {
            true => self.ran_away * self.independent * *length as f64,
            false => self.of(block),
        };
        let sum: f64 = blocks.iter().zip(lengths).map(of).sum();
        if sum.is_finite() { sum } else { f64::INFINITY }
    }
}

/// Residuals of `points`, those with a number that is none made empty.
pub(crate) fn asked<E: From<FitError>>(
    evaluate: Evaluate<E>,
    points: &[Vec<f64>],
    lengths: Option<&[usize]>,
) -> Result<Vec<Blocks>, E> {
    let mut found = evaluate(points)?;
    if found.len() != points.len() {
        return Err(FitError::input("residuals", format!("{} points", points.len()), found.len().to_string()).into());
    }
    found.iter_mut().flatten().filter(|b| b.iter().any(|x| !x.is_finite())).for_each(Vec::clear);
    let lengths: Vec<usize> = lengths.map_or_else(|| found[0].iter().map(Vec::len).collect(), <[usize]>::to_vec);
    for blocks in &found {
        let fits = |(b, length): (&Vec<f64>, &usize)| b.is_empty() || *length == 0 || b.len() == *length;
        if blocks.len() != lengths.len() || !blocks.iter().zip(&lengths).all(fits) {
            let of = blocks.iter().map(Vec::len).collect::<Vec<_>>();
            return Err(
                FitError::input("residuals", format!("blocks of {lengths:?} numbers"), format!("{of:?}")).into()
            );
        }
    }
    Ok(found)
}
