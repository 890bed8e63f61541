//! Two recordings of one robot: what moved between them, with what they share integrated out.
//!
//! Deviations of the robot are `u + e`, where `u` is the robot's own, the same in both recordings, with the tolerance `t` of its kind, and `e` is
//! the day's, with the share `s` of it. So the two recordings' deviations have the covariance `t^2 [[1 + s^2, 1], [1, 1 + s^2]]` beforehand. A change
//! `a` along a line `d` of the second recording then has the curvature `k = d'Hd - (H_t d)' A^-1 (H_t d)` with `A = P^-1 + H_tt` of both recordings
//! together, and its best value is `f / k` (Rasmussen and Williams 2006, eq. A.9, as in `gaussian_evidence`).

use super::moments::{Line, Moments};
use crate::GapError;
use qv_fit::linear::{corner, dot, times};
use qv_fit::{Cholesky, Matrix};
use rayon::prelude::*;

/// Ghosts are compared with those this many further, and twice as many: each of four kinds of numerics with its own kind.
const ROUND: usize = 4;
/// Pairs of ghosts that a spread of 1 counts as beforehand.
const PRIOR_PAIRS: f64 = 12.0;

/// What is known of a change along one line, in units of its step.
#[derive(Debug, Clone)]
pub(super) struct Along {
    /// Pull at the line.
    pub force: f64,
    /// Curvature; 0 of what is not shown.
    pub curvature: f64,
    /// Variance of the pull over the curvature: 1 for noise alone.
    pub spread: f64,
}

/// See the module.
pub(super) struct Contrast {
    pub lines: Vec<Line>,
    pub along: Vec<Along>,
    /// Curvature between lines, shape `[lines, lines]`.
    pub curvature: Matrix,
    /// Levels of both recordings.
    pub levels: [f64; 2],
}

/// The deviations of both recordings, integrated out.
struct SharedDeviations<'m> {
    then: &'m Moments,
    now: &'m Moments,
    /// Of `P^-1 + H_tt`.
    factor: Cholesky,
    /// Columns of each recording that are tolerated.
    tolerated: [usize; 2],
}

impl SharedDeviations<'_> {
    /// What a change along `line` of `now` moves in the columns of both: what is left of it is the line less the deviations that look like it.
    fn without_deviations(&self, line: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let [first, second] = self.tolerated;
        let pulled = times(&self.now.h, line);
        let mut both = vec![0.0; first + second];
        both[first..].copy_from_slice(&pulled[..second]);
        let best = self.factor.solve(&both);
        let mut then = vec![0.0; self.then.b.len()];
        (0..first).for_each(|k| then[k] = -best[k]);
        let mut now = line.to_vec();
        (0..second).for_each(|k| now[k] -= best[first + k]);
        (then, now)
    }
}

impl Contrast {
    /// # Errors
    /// When the numbers are no good.
    pub fn new(then: &Moments, now: &Moments, session: f64) -> Result<Self, GapError> {
        let no_good = || GapError::run("sensitivities", "finite numbers", "others");
        let tolerated = [then.tolerance.len(), now.tolerance.len()];
        let factor = Cholesky::new(&precision(then, now, session)).ok_or_else(no_good)?;
        let shared = SharedDeviations { then, now, factor, tolerated };
        let residues: Vec<_> = now.lines.par_iter().map(|line| shared.without_deviations(&line.along)).collect();
        let pulled: Vec<Vec<f64>> = now.lines.par_iter().map(|line| times(&now.h, &line.along)).collect();
        let count = now.lines.len();
        let rows: Vec<Vec<f64>> =
            residues.par_iter().map(|(_, own)| pulled.iter().map(|p| dot(own, p)).collect()).collect();
        let curvature = Matrix::from_fn(count, count, |a, b| 0.5 * (rows[a][b] + rows[b][a]));
        let level = then.level.max(now.level).max(1.0);
        let along = |(index, (earlier, own)): (usize, &(Vec<f64>, Vec<f64>))| {
            let k = curvature[(index, index)];
            // What the deviations explain to within rounding is not shown.
            let whole = dot(&now.lines[index].along, &pulled[index]);
            if !(k.is_finite() && k > 1e-9 * whole && k > 0.0) {
                return Along { force: 0.0, curvature: 0.0, spread: 1.0 };
            }
            let force = dot(earlier, &then.b) + dot(own, &now.b);
            let spread =
                of_ghosts(then, now, (earlier, own), k).max(of_windows(then, now, (earlier, own), k)).max(level);
            Along { force, curvature: k, spread }
        };
        let along = residues.par_iter().enumerate().map(along).collect();
        Ok(Self { lines: now.lines.clone(), along, curvature, levels: [then.level, now.level] })
    }

    /// With the lines `free` at their best: their changes, and for each other line what is left.
    pub fn beside(&self, free: &[usize]) -> Option<(Vec<f64>, Vec<f64>, Vec<Along>)> {
        if free.is_empty() {
            return Some((Vec::new(), Vec::new(), self.along.clone()));
        }
        let inner = Matrix::from_fn(free.len(), free.len(), |a, b| self.curvature[(free[a], free[b])]);
        let factor = Cholesky::new(&inner)?;
        let forces: Vec<f64> = free.iter().map(|&k| self.along[k].force).collect();
        let sizes = factor.solve(&forces);
        let inverse = factor.inverse();
        let variances = (0..free.len()).map(|k| inverse[(k, k)] * self.along[free[k]].spread).collect();
        let left = |(index, along): (usize, &Along)| {
            let across: Vec<f64> = free.iter().map(|&k| self.curvature[(index, k)]).collect();
            let force = along.force - dot(&across, &sizes);
            let curvature = along.curvature - factor.length(&across);
            let is_shown = curvature > 1e-6 * along.curvature && !free.contains(&index);
            Along { force, curvature: if is_shown { curvature } else { 0.0 }, spread: along.spread }
        };
        let left = self.along.iter().enumerate().map(left).collect();
        Some((sizes, variances, left))
    }
}

/// `P^-1 + H_tt` of both recordings.
fn precision(then: &Moments, now: &Moments, session: f64) -> Matrix {
    let [first, second] = [then.tolerance.len(), now.tolerance.len()];
    let mut all = Matrix::zeros(first + second, first + second);
    let (earlier, later) = (corner(&then.h, first, first), corner(&now.h, second, second));
    for column in 0..first {
        (0..first).for_each(|row| all[(row, column)] = earlier[(row, column)]);
    }
    for column in 0..second {
        (0..second).for_each(|row| all[(first + row, first + column)] = later[(row, column)]);
    }
    // Of a pair with the covariance [[v, 1], [1, v]].
    let v = 1.0 + session * session;
    let [own, across] = [v / (v * v - 1.0), -1.0 / (v * v - 1.0)];
    let mut is_paired = vec![false; first];
    for (k, key) in now.keys.iter().take(second).enumerate() {
        let (at, t) = (first + k, now.tolerance[k]);
        let pair = then.keys.iter().take(first).position(|other| key.is_some() && other == key);
        let Some(other) = pair else {
            all[(at, at)] += 1.0 / (t * t);
            continue;
        };
        is_paired[other] = true;
        let t_other = then.tolerance[other];
        all[(at, at)] += own / (t * t);
        all[(other, other)] += own / (t_other * t_other);
        all[(at, other)] += across / (t * t_other);
        all[(other, at)] += across / (t * t_other);
    }
    for (k, _) in is_paired.iter().enumerate().filter(|p| !p.1) {
        all[(k, k)] += 1.0 / then.tolerance[k].powi(2);
    }
    all
}

/// Mean square pull of noise and numerics, in units of the curvature, over pairs of simulated recordings.
fn of_ghosts(then: &Moments, now: &Moments, (earlier, own): (&[f64], &[f64]), curvature: f64) -> f64 {
    let count = then.ghosts.len().min(now.ghosts.len());
    let (mut sum, mut pairs) = (PRIOR_PAIRS, PRIOR_PAIRS);
    for apart in [ROUND, 2 * ROUND].into_iter().filter(|apart| apart % count.max(1) != 0) {
        for k in 0..count {
            let pull = dot(earlier, &then.ghosts[k]) + dot(own, &now.ghosts[(k + apart) % count]);
            sum += pull * pull / curvature;
            pairs += 1.0;
        }
    }
    sum / pairs
}

/// The same by what the windows of both recordings scatter.
fn of_windows(then: &Moments, now: &Moments, (earlier, own): (&[f64], &[f64]), curvature: f64) -> f64 {
    let square = |scores: &[Vec<f64>], along: &[f64]| -> f64 { scores.iter().map(|s| dot(s, along).powi(2)).sum() };
    (square(&then.scores, earlier) + square(&now.scores, own)) / curvature
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_fit::linear::{add_outer, from_columns, gram, transposed_times};

    const SESSION: f64 = 0.1;
    const TOLERANCE: f64 = 2.0;

    /// A recording of eight numbers with one tolerated column and the clock's, and a line along the tolerated one.
    fn moments(columns: &[Vec<f64>; 2], residual: &[f64]) -> Moments {
        let j = from_columns(8, columns);
        let line = Line {
            effect: "strength".into(),
            scope: vec!["all".into()],
            parameter: "scale".into(),
            unit: "1".into(),
            value: 1.0,
            bounds: [0.0, f64::INFINITY],
            step: 0.1,
            furthest: 0.5,
            tolerance: 0.2,
            along: vec![0.0, 1.0],
        };
        Moments {
            keys: vec![None, Some(("strength".into(), 0, 0, 0))],
            tolerance: vec![1.0, TOLERANCE],
            h: gram(&j),
            b: transposed_times(&j, residual),
            ghosts: Vec::new(),
            scores: Vec::new(),
            level: 1.0,
            lines: vec![line],
        }
    }

    /// Columns and what is left of a recording then and one now.
    type Example = ([Vec<f64>; 2], [Vec<f64>; 2], Vec<f64>, Vec<f64>);

    fn example() -> Example {
        let first = [vec![1.0, -1.0, 0.5, 0.0, 0.0, 1.0, 0.3, -0.2], vec![2.0, 0.0, 1.0, 3.0, -1.0, 0.5, 0.0, 1.0]];
        let second = [vec![0.0, 1.0, -0.5, 0.7, 1.0, 0.0, 0.2, 0.9], vec![1.5, 1.0, 0.0, 2.0, -2.0, 0.0, 1.0, 0.4]];
        let then = vec![3.1, -0.4, 1.4, 4.2, -1.7, 1.0, 0.1, 1.2];
        let now = vec![3.0, 2.3, -0.1, 4.4, -3.9, 0.2, 2.2, 0.6];
        (first, second, then, now)
    }

    /// The covariance of all sixteen numbers, written out, says the same as the normal equations.
    #[test]
    fn a_change_is_that_of_the_joint_covariance() {
        let (first, second, then, now) = example();
        let found = Contrast::new(&moments(&first, &then), &moments(&second, &now), SESSION).unwrap();
        let (zero, joined) = (vec![0.0; 8], |a: &[f64], b: &[f64]| [a, b].concat());
        let mut covariance = Matrix::identity(16, 16);
        add_outer(&mut covariance, 1.0, &joined(&first[0], &zero));
        add_outer(&mut covariance, 1.0, &joined(&zero, &second[0]));
        let variance = TOLERANCE * TOLERANCE;
        add_outer(&mut covariance, variance, &joined(&first[1], &second[1]));
        add_outer(&mut covariance, variance * SESSION * SESSION, &joined(&first[1], &zero));
        add_outer(&mut covariance, variance * SESSION * SESSION, &joined(&zero, &second[1]));
        let factor = Cholesky::new(&covariance).unwrap();
        let (residual, line) = (joined(&then, &now), joined(&zero, &second[1]));
        let curvature = dot(&line, &factor.solve(&line));
        let force = dot(&line, &factor.solve(&residual));
        let along = &found.along[0];
        assert!((along.curvature - curvature).abs() < 1e-9 * curvature, "{} {curvature}", along.curvature);
        assert!((along.force - force).abs() < 1e-9 * force.abs().max(1.0), "{} {force}", along.force);
    }

    #[test]
    fn what_both_recordings_share_is_no_change_and_what_one_has_is() {
        let (first, second, _, _) = example();
        let of = |column: &[f64], size: f64| column.iter().map(|x| size * x).collect::<Vec<_>>();
        let change = |then: f64, now: f64| {
            let (then, now) = (moments(&first, &of(&first[1], then)), moments(&second, &of(&second[1], now)));
            let along = Contrast::new(&then, &now, SESSION).unwrap().along[0].clone();
            (along.force / along.curvature, along.curvature.sqrt().recip())
        };
        let (alike, deviation) = change(3.0, 3.0);
        assert!(alike.abs() < 0.2 * deviation, "{alike} {deviation}");
        let (grown, _) = change(3.0, 5.0);
        assert!((grown - 2.0).abs() < 0.2, "{grown}");
        // Without the calibration it would be one robot in three that differs by as much.
        assert!(deviation < 0.5 * TOLERANCE, "{deviation}");
    }
}
