//! Several effects fitted at once. On real machines several things are off together, and the effect that fits best alone takes over what
//! belongs to the others: a position gain of half of the stated one looks like damping, and the like.
//!
//! Levenberg-Marquardt (Nocedal and Wright 2006, section 10.3) in the simulator, with tolerated deviations at their best. Each value has a normal prior about
//! "absent" whose deviation is the one of the linear step ([`Search::linear`]), so that what a recording cannot show stays absent.

use crate::GapError;
use crate::inference::linearised::LinearisedProblem;
use crate::inference::search::{Fit, Residuals, Search, Tangent, WIDE};
use crate::problem::columns::{Group, Suspect};
use crate::problem::library::Scope;
use qv_fit::linear::{add_scaled, diagonal_of};
use qv_fit::{Cholesky, Matrix};

/// Rounds at most.
const ROUNDS: usize = 10;
/// Damping that is tried in each round, as shares of the curvature.
const DAMPING: [f64; 5] = [0.0, 0.03, 0.3, 3.0, 30.0];
/// Slopes are taken over this share of the usual range.
const STEP: f64 = 0.01;
/// A round that lowers the loss by less is the last.
const SETTLED: f64 = 1.0;
/// Log likelihood ratio from which an effect is missed: odds of e at the ten nats that the policy takes for one.
const LEAST: f64 = 10.0;
/// Effects alone that a fit begins from.
const STARTS: usize = 3;
/// Correlation from which two values are not distinguished: each one's variance is ten times what it would be without the other (a variance
/// inflation factor of 10, as is usual in regression).
const COLLINEAR: f64 = 0.95;

/// Values of several effects that belong together.
#[derive(Debug, Clone, PartialEq)]
pub struct JointFit {
    /// One fit of each effect: values beside the others, and what the loss is with all of them.
    pub fits: Vec<Fit>,
    /// Correlation of all values after one another, shape `[values, values]`.
    pub correlation: Matrix,
    /// Groups of the study that are not distinguished: one that is in `fits`, and one that is left out for it.
    pub alike: Vec<[usize; 2]>,
    /// Loss with all of them.
    pub loss: f64,
}

impl JointFit {
    /// The effect that is missed least, if it is not missed enough to be reported.
    fn least_missed(&self) -> Option<usize> {
        let all = self.fits.iter().enumerate().filter(|(_, f)| f.evidence < LEAST);
        all.min_by(|a, b| a.1.evidence.total_cmp(&b.1.evidence)).map(|(k, _)| k)
    }
}

/// All values of a fit after one another, and where each comes from.
struct Layout {
    suspects: Vec<Suspect>,
    /// Suspect and axis of each value.
    of_value: Vec<[usize; 2]>,
    range: Vec<[f64; 2]>,
    /// Deviation of each value's prior.
    wide: Vec<f64>,
}

impl Layout {
    fn new(study: &LinearisedProblem, suspects: Vec<Suspect>) -> Self {
        let mut layout = Self { suspects, of_value: Vec::new(), range: Vec::new(), wide: Vec::new() };
        for (s, suspect) in layout.suspects.iter().enumerate() {
            let effect = &study.columns.effects[study.columns.groups[suspect.group].effect];
            for axis in 0..suspect.values.len() {
                layout.of_value.push([s, axis]);
                layout.range.push(effect.range);
                layout.wide.push(WIDE * effect.span().min(effect.usual_span));
            }
        }
        layout
    }

    fn suspects(&self, values: &[f64]) -> Vec<Suspect> {
        let mut suspects = self.suspects.clone();
        for (&[s, axis], &value) in self.of_value.iter().zip(values.iter()) {
            suspects[s].values[axis] = value;
        }
        suspects
    }

    /// Half of what the prior adds to the loss is a log probability.
    fn prior(&self, values: &[f64]) -> f64 {
        values.iter().zip(&self.wide).map(|(v, w)| (v / w).powi(2)).sum()
    }

    /// Values without those of a suspect.
    fn without(&self, values: &[f64], suspect: usize) -> Vec<f64> {
        let kept = self.of_value.iter().zip(values).filter(|([s, _], _)| *s != suspect);
        kept.map(|(_, v)| *v).collect()
    }

    /// Two effects of one value each that are not distinguished, the one that comes first and the other.
    fn collinear(&self, correlation: &Matrix) -> Option<[usize; 2]> {
        let is_one = |k: usize| self.suspects[self.of_value[k][0]].values.len() == 1;
        let pairs = (0..self.wide.len()).flat_map(|j| (0..j).map(move |i| [i, j]));
        let mut alike: Vec<([usize; 2], f64)> =
            pairs.filter(|[i, j]| is_one(*i) && is_one(*j)).map(|p| (p, correlation[(p[0], p[1])].abs())).collect();
        alike.retain(|(_, c)| *c > COLLINEAR);
        let most = alike.into_iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(most.0.map(|k| self.of_value[k][0]))
    }

    fn clamped(&self, mut values: Vec<f64>) -> Vec<f64> {
        values.iter_mut().zip(&self.range).for_each(|(v, r)| *v = v.clamp(r[0], r[1]));
        values
    }
}

/// A point of the search.
struct Point {
    values: Vec<f64>,
    residuals: Residuals,
    loss: f64,
    /// What the prior adds to the loss, in units of the dispersion.
    prior: f64,
}

impl Point {
    fn cost(&self, dispersion: f64) -> f64 {
        self.loss + dispersion * self.prior
    }
}

impl Search<'_, '_> {
    /// The best fit of each effect that acts always and has a value when absent, taken together. `fits` are those of each alone, best first.
    /// `None` where fewer than two are there. `null` is the loss of a robot without an effect.
    ///
    /// # Errors
    /// When a value means nothing.
    pub fn together(&mut self, fits: &[Fit], null: f64) -> Result<Option<JointFit>, GapError> {
        let mut alone = self.one_of_each(fits);
        let mut alike: Vec<[usize; 2]> = Vec::new();
        let mut begun: Option<Vec<f64>> = None;
        // Backward elimination: what is not distinguished from another or is not missed goes, one after another.
        loop {
            if alone.len() < 2 {
                return Ok(None);
            }
            let layout = Layout::new(self.study, alone.clone());
            let point = match begun.take() {
                Some(values) => self.descend(&layout, values, null)?,
                None => self.best_of_starts(&layout, null)?,
            };
            let mut found = self.remarks(&layout, &point)?;
            let pair = layout.collinear(&found.correlation);
            let Some(dropped) = pair.map(|p| p[1]).or_else(|| found.least_missed()) else {
                found.alike = alike;
                return Ok(Some(found));
            };
            alike.extend(pair.map(|p| p.map(|s| alone[s].group)));
            begun = Some(layout.without(&point.values, dropped));
            alone.remove(dropped);
        }
    }

    /// The best of several fits, each begun from one of the first effects alone.
    fn best_of_starts(&mut self, layout: &Layout, null: f64) -> Result<Point, GapError> {
        let mut best: Option<Point> = None;
        for start in 0..layout.suspects.len().min(STARTS) {
            let of_start = |&[s, axis]: &[usize; 2]| if s == start { layout.suspects[s].values[axis] } else { 0.0 };
            let values = layout.of_value.iter().map(of_start).collect();
            let found = self.descend(layout, values, null)?;
            if best.as_ref().is_none_or(|b| found.loss < b.loss) {
                best = Some(found);
            }
        }
        Ok(best.expect("there is a start"))
    }

    /// Each steady effect once: where it was followed alone its best fit, else absent. Those of joints act on all joints alike, but for
    /// those whose sign is a direction, such as the error of an angle: they are no one's but a single joint's. What was followed comes first.
    fn one_of_each(&self, fits: &[Fit]) -> Vec<Suspect> {
        let columns = self.columns();
        let mut sorted: Vec<&Fit> = fits.iter().filter(|f| f.suspect.extent.is_none() && f.loss.is_finite()).collect();
        sorted.sort_by(|a, b| a.loss.total_cmp(&b.loss));
        let of_joints = |group: &usize| columns.effects[columns.groups[*group].effect].scope == Scope::Joints;
        let absent = |group: usize| {
            let axes = columns.effects[columns.groups[group].effect].axes.len();
            Suspect::everywhere(group, vec![0.0; axes])
        };
        let others = (0..columns.groups.len()).filter(of_joints).map(absent);
        let mut chosen: Vec<Suspect> = Vec::new();
        let mut seen = Vec::new();
        for suspect in sorted.into_iter().map(|f| f.suspect.clone()).chain(others) {
            let index = columns.groups[suspect.group].effect;
            let effect = &columns.effects[index];
            if seen.contains(&index) || effect.local {
                continue;
            }
            seen.push(index);
            let is_signed = (effect.range[0] + effect.range[1]).abs() < 1e-9 * effect.span();
            // The group of all members comes first.
            let all = columns.groups.iter().position(|g| g.effect == index).expect("it has one");
            let on_all = effect.scope == Scope::Joints && !is_signed;
            let is_one = columns.groups[suspect.group].members.len() == 1;
            if on_all || (is_one && suspect.values.iter().any(|v| *v != 0.0)) {
                chosen.push(Suspect { group: if on_all { all } else { suspect.group }, ..suspect });
            }
        }
        let has_absence = |group: &Group| {
            let axes = 0..columns.effects[group.effect].axes.len();
            axes.flat_map(|a| columns.units_of(group, a)).all(|u| columns.units[u].absent == 0.0)
        };
        chosen.retain(|s| {
            let group = &columns.groups[s.group];
            has_absence(group) && self.study.may_be(group)
        });
        chosen
    }

    /// Steps downwards from `values` until nothing is gained.
    fn descend(&mut self, layout: &Layout, values: Vec<f64>, null: f64) -> Result<Point, GapError> {
        let mut here = self.points(layout, vec![values])?.remove(0);
        for _ in 0..ROUNDS {
            // Losses are in units of what is left.
            self.dispersion = (here.loss / null).max(1.0);
            let Tangent { gradient, curvature, .. } = self.slopes(layout, &here)?;
            let step = |damping: &f64| {
                let mut damped = curvature.clone();
                (0..damped.nrows()).for_each(|i| damped[(i, i)] *= 1.0 + damping);
                let mut values = here.values.clone();
                add_scaled(&mut values, 1.0, &Cholesky::new(&damped)?.solve(&gradient));
                Some(layout.clamped(values))
            };
            let tried: Vec<Vec<f64>> = DAMPING.iter().filter_map(step).collect();
            let dispersion = self.dispersion;
            let cost = |p: &Point| p.cost(dispersion);
            let best = self.points(layout, tried)?.into_iter().min_by(|a, b| cost(a).total_cmp(&cost(b)));
            let Some(best) = best.filter(|b| cost(b) < cost(&here)) else { break };
            let gained = cost(&here) - cost(&best);
            here = best;
            if gained <= SETTLED * self.dispersion {
                break;
            }
        }
        Ok(here)
    }

    /// Simulates the robot with each of `values`.
    fn points(&mut self, layout: &Layout, values: Vec<Vec<f64>>) -> Result<Vec<Point>, GapError> {
        let windows = self.windows.clone();
        let of = |v: &Vec<f64>| self.columns().setting_of(&self.study.rollout, &layout.suspects(v));
        let settings: Vec<_> = values.iter().map(of).collect();
        let all = self.study.raw_vectors(&settings, &windows)?;
        let point = |(values, residuals): (Vec<f64>, Residuals)| {
            let loss = self.loss_of(&self.marginal, &self.normals(&residuals, &windows), &windows);
            Point { prior: layout.prior(&values), values, residuals, loss }
        };
        Ok(values.into_iter().zip(all).map(point).collect())
    }

    /// Slope and curvature of the cost.
    fn slopes(&mut self, layout: &Layout, here: &Point) -> Result<Tangent, GapError> {
        let mut tangent = self.bare_slopes(layout, here)?;
        tangent.add_prior(&here.values, &layout.wide, self.dispersion);
        Ok(tangent)
    }

    /// Those of the loss.
    fn bare_slopes(&mut self, layout: &Layout, here: &Point) -> Result<Tangent, GapError> {
        let windows = self.windows.clone();
        let step = |k: usize| {
            let step = STEP / WIDE * layout.wide[k];
            if here.values[k] + step > layout.range[k][1] { -step } else { step }
        };
        let steps: Vec<f64> = (0..layout.wide.len()).map(step).collect();
        let moved = |k: usize| {
            let mut values = here.values.clone();
            values[k] += steps[k];
            values
        };
        let moved = self.points(layout, (0..steps.len()).map(moved).collect())?;
        let vectors: Vec<&Residuals> =
            std::iter::once(&here.residuals).chain(moved.iter().map(|p| &p.residuals)).collect();
        Ok(self.tangent(&vectors, &windows, &steps))
    }

    /// The values of a point with what they may be off by.
    fn remarks(&mut self, layout: &Layout, point: &Point) -> Result<JointFit, GapError> {
        let tangent = self.slopes(layout, point)?;
        let size = layout.wide.len();
        let scatter = tangent.scatter();
        let covariance = Cholesky::new(&tangent.curvature).map(|c| c.inverse() * self.dispersion);
        let nothing = |i: usize, k: usize| if i == k { f64::INFINITY } else { 0.0 };
        let covariance = covariance.unwrap_or_else(|| Matrix::from_fn(size, size, nothing));
        let curved: Vec<f64> = diagonal_of(&covariance).iter().map(|v| v.sqrt()).collect();
        let correlation = Matrix::from_fn(size, size, |i, j| covariance[(i, j)] / (curved[i] * curved[j]));
        let fit = |suspect| Fit {
            suspect,
            deviations: Vec::new(),
            scatter: Vec::new(),
            loss: point.loss,
            evidence: 0.0,
            held_out: None,
        };
        let mut fits: Vec<Fit> = layout.suspects(&point.values).into_iter().map(fit).collect();
        for (k, &[s, _]) in layout.of_value.iter().enumerate() {
            fits[s].deviations.push(curved[k]);
            fits[s].scatter.push(scatter[k]);
            // Half of what the cost would rise by without it, the others at their best: a log likelihood ratio.
            fits[s].evidence += 0.5 * (point.values[k] / curved[k].max(scatter[k])).powi(2);
        }
        Ok(JointFit { fits, correlation, alike: Vec::new(), loss: point.loss })
    }
}
