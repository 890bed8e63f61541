//! How likely a recording decides between two hypotheses.
//!
//! In the linear-Gaussian model, tolerated deviations integrated out, hypothesis A of size `a` leaves the whitened residual `a d_A`. The log
//! evidence of A over that of B, each at its best size, is then normal with mean `D = a² (k_AA - k_AB² / k_BB) / 2` and variance `2 D`, where
//! `k` is the curvature of the loss (Kass and Raftery 1995, section 4.1; the normal form of Chernoff 1972, "Sequential analysis and optimal
//! design", section 7). It decides where that exceeds what the policy takes for odds of nine to one.

use crate::GapError;
use crate::decision::Policy;
use crate::inference::linearised::LinearisedProblem;
use crate::inference::search::{Direction, direction};
use qv_fit::linear::{add_diagonal, add_scaled, dot, product, times, transposed_product, transposed_times};
use qv_fit::{Cholesky, Matrix};
use serde::Serialize;

/// Odds at which a hypothesis is taken for decided against another.
const ODDS: f64 = 9.0;

/// An effect on a part of the robot, with its size.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Hypothesis {
    /// Effect of the library.
    pub effect: String,
    /// On what it acts, as reports have it.
    pub scope: Vec<String>,
    /// Value of each of its axes.
    pub values: Vec<f64>,
    /// Log evidence so far \[nats\].
    pub evidence: f64,
}

/// How likely a recording decides for one hypothesis, if it is true, against another.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Decides {
    /// The effect that is there.
    #[serde(rename = "true")]
    pub truth: String,
    /// The one that it is to be distinguished from.
    pub rival: String,
    /// Probability, 0 to 1.
    pub probability: f64,
    /// Log evidence that is to be expected \[nats\].
    pub expected_nats: f64,
}

/// What the recording of a study reports hypotheses.
///
/// # Errors
/// When one is none of the library's, or the normal equations are no good.
pub(super) fn worth(study: &LinearisedProblem, policy: &Policy, all: &[Hypothesis]) -> Result<Worth, GapError> {
    let marginal = study.marginal(|seen| seen.weight)?;
    let curvature = &marginal.curvature;
    let lines: Vec<Line> = all.iter().map(|h| Line::new(study, h)).collect::<Result<_, _>>()?;
    let needed = policy.nats * ODDS.ln();
    let mut pairs = Vec::new();
    let mut of_truths = Vec::new();
    for (a, truth) in lines.iter().enumerate() {
        let mut least = 1.0_f64;
        for (b, rival) in lines.iter().enumerate().filter(|(b, _)| *b != a) {
            let expected = expected_nats(curvature, &truth.along, &rival.direction.d);
            let probability = exceeds(expected, needed);
            least = least.min(probability);
            pairs.push(Decides {
                truth: all[a].effect.clone(),
                rival: all[b].effect.clone(),
                probability,
                expected_nats: expected,
            });
        }
        of_truths.push(least);
    }
    let decides = of_truths.iter().sum::<f64>() / of_truths.len().max(1) as f64;
    let shared = |a: usize, b: usize| dot(&lines[a].along, &times(curvature, &lines[b].along));
    let mut information = Matrix::from_fn(lines.len(), lines.len(), shared);
    // One nat on the diagonal: sizes are known to within themselves already.
    add_diagonal(&mut information, &vec![1.0; lines.len()]);
    let log_determinant = Cholesky::new(&information).map_or(1e-300_f64.ln(), |c| c.log_determinant());
    Ok(Worth { decides, pairs, log_determinant })
}

/// Where a hypothesis points in the columns of a study.
struct Line {
    direction: Direction,
    /// Along its values.
    along: Vec<f64>,
}

impl Line {
    fn new(study: &LinearisedProblem, hypothesis: &Hypothesis) -> Result<Self, GapError> {
        let columns = &study.columns;
        let is_this = |g: &crate::problem::columns::Group| {
            columns.effects[g.effect].name == hypothesis.effect && g.names == hypothesis.scope
        };
        let unknown = || {
            let found = format!("{} on {}", hypothesis.effect, hypothesis.scope.join(", "));
            GapError::run("hypotheses", "effects on parts that this robot can show", found)
        };
        let group = columns.groups.iter().position(is_this).ok_or_else(unknown)?;
        let direction = direction(columns, group, 0).ok_or_else(unknown)?;
        let mut along = vec![0.0; direction.d.nrows()];
        for (axis, value) in hypothesis.values.iter().enumerate().take(direction.steps.len()) {
            // A limit has no value at which it is absent: its level stands for it.
            let absent = direction.absent[axis];
            let share = if absent.is_finite() { (value - absent) / direction.steps[axis] } else { 1.0 };
            add_scaled(&mut along, share, direction.d.col_as_slice(axis));
        }
        Ok(Self { direction, along })
    }
}

/// Log evidence of what points along `truth` over what spans the columns of `rival`, at its best.
fn expected_nats(curvature: &Matrix, truth: &[f64], rival: &Matrix) -> f64 {
    let own = dot(truth, &times(curvature, truth));
    let of_rival = product(curvature, rival);
    let gram = transposed_product(rival, &of_rival);
    let shared = transposed_times(&of_rival, truth);
    // A rival that this motion does not show takes nothing.
    let explained = Cholesky::new(&gram).map_or(0.0, |factor| factor.length(&shared));
    (0.5 * (own - explained)).max(0.0)
}

/// Probability that a normal log evidence of that mean, and twice that variance, exceeds what is needed.
fn exceeds(expected: f64, needed: f64) -> f64 {
    if expected <= 0.0 { 0.0 } else { standard_normal((expected - needed) / (2.0 * expected).sqrt()) }
}

/// Distribution function of the standard normal (Abramowitz and Stegun 1964, eq. 26.2.17; error below 7.5e-8).
fn standard_normal(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.231_641_9 * x.abs());
    let polynomial = [0.319_381_530, -0.356_563_782, 1.781_477_937, -1.821_255_978, 1.330_274_429];
    let sum = polynomial.iter().rev().fold(0.0, |sum, c| t * (c + sum));
    let tail = (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt() * sum;
    if x > 0.0 { 1.0 - tail } else { tail }
}

/// How well a motion shows hypotheses apart.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Worth {
    /// Probability that it decides: over hypotheses as the true one, mean of the least over its rivals.
    pub decides: f64,
    /// The pairs that this is made of.
    pub pairs: Vec<Decides>,
    /// Logarithm of the determinant of the information on all their sizes together (D-optimality), in units of the null.
    pub log_determinant: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_fit::linear::from_rows;

    #[test]
    fn a_rival_that_points_the_same_way_is_not_told_apart() {
        let curvature = from_rows(2, &[40.0, 10.0, 10.0, 90.0]);
        let truth = [1.0, 0.0];
        let same = from_rows(1, &[3.0, 0.0]);
        assert!(expected_nats(&curvature, &truth, &same) < 1e-9);
        let other = from_rows(1, &[0.0, 1.0]);
        let by_hand = 0.5 * (40.0 - 10.0 * 10.0 / 90.0);
        assert!((expected_nats(&curvature, &truth, &other) - by_hand).abs() < 1e-9);
        let unseen = Matrix::zeros(2, 1);
        assert!((expected_nats(&curvature, &truth, &unseen) - 20.0).abs() < 1e-9);
    }

    #[test]
    fn more_evidence_decides_more_often() {
        assert!((standard_normal(0.0) - 0.5).abs() < 1e-7 && (standard_normal(1.959_964) - 0.975).abs() < 1e-6);
        assert!((standard_normal(-1.281_552) - 0.1).abs() < 1e-6);
        assert_eq!(exceeds(0.0, 22.0), 0.0);
        assert!((exceeds(22.0, 22.0) - 0.5).abs() < 1e-7);
        assert!(exceeds(100.0, 22.0) > 0.99 && exceeds(5.0, 22.0) < 0.01);
    }
}
