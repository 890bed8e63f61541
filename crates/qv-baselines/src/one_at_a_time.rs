//! One effect at a time: each effect of the library alone is fitted by least squares; the one that leaves the least in the
//! windows that no fit saw is named. This is what identification of one parameter does; all other deviations that a robot
//! has are not known to it.

use crate::plain::Plain;
use crate::{Answer, Size, sizes};
use qv_fit::linear::{dot, minus, squared, times};
use qv_fit::{Cholesky, Matrix};
use qv_gap::GapError;
use qv_gap::inference::level::mean;
use qv_gap::problem::columns::{Columns, Suspect};
use qv_rollout::Overrides;

/// Windows looked at while groups and starts are chosen.
const COARSE_WINDOWS: usize = 12;
/// Groups of an effect that are tried along its range.
const GROUPS: usize = 2;
/// Starts along the range, as shares of the way from absent to either end.
const STARTS: [f64; 5] = [0.08, 0.2, 0.4, 0.7, 1.0];
/// The same for a limit, as shares of the largest value that was measured.
const LIMITS: [f64; 7] = [0.9, 0.8, 0.7, 0.55, 0.4, 0.25, 0.12];
/// Rounds of Gauss-Newton, and the shares of its step that are tried.
const ROUNDS: usize = 3;
const SHARES: [f64; 3] = [1.0, 0.5, 0.2];
/// Standard errors by which the held-out loss must fall.
const ERRORS: f64 = 2.0;

/// An effect at its best values.
struct Fit {
    suspect: Suspect,
    loss: f64,
}

/// An effect's fall of the loss in windows that no fit saw, and the standard error of that over windows.
struct Judged {
    suspect: Suspect,
    fall: f64,
    error: f64,
}

/// Fits all effects but those named in `without`, and names the best.
///
/// # Errors
/// When a setting has a value that means nothing.
pub fn answer(plain: &mut Plain, without: &[String]) -> Result<Answer, GapError> {
    let mut fits = Vec::new();
    for effect in 0..plain.study.columns.effects.len() {
        if !without.contains(&plain.study.columns.effects[effect].name) {
            fits.extend(start(plain, effect)?);
        }
    }
    for _ in 0..ROUNDS {
        improve(plain, &mut fits)?;
    }
    let mut judged = judge(plain, fits)?;
    // One that surely helps shows that there is a gap; what helps most is named, however much it varies over windows.
    let is_gap = judged.iter().any(|j| j.fall > ERRORS * j.error);
    judged.retain(|j| is_gap && j.fall > 0.0);
    judged.sort_by(|a, b| b.fall.total_cmp(&a.fall));
    let best: Vec<Suspect> = judged.into_iter().map(|j| j.suspect).collect();
    let setting = settings(plain, &best[..best.len().min(1)]).pop();
    let closed = setting.map_or(Ok(0.0), |s| plain.closed(&s))?;
    let columns = &plain.study.columns;
    let name = |s: &Suspect| columns.effects[columns.groups[s.group].effect].name.clone();
    let verdict = if best.is_empty() { "no_gap" } else { "explained" };
    let of_best: Vec<Size> = best.iter().take(1).flat_map(|s| sizes(columns, s)).collect();
    Ok(Answer::new(verdict, best.iter().map(name).collect(), of_best, closed))
}

fn settings(plain: &Plain, suspects: &[Suspect]) -> Vec<Overrides> {
    let study = &plain.study;
    suspects.iter().map(|s| study.columns.setting_of(&study.rollout, std::slice::from_ref(s))).collect()
}

/// The best of several starts of an effect, in its most promising groups.
fn start(plain: &mut Plain, effect: usize) -> Result<Option<Fit>, GapError> {
    let some = plain.some(COARSE_WINDOWS);
    let mut tried: Vec<Suspect> = Vec::new();
    for promising in promising(plain, effect, &some)? {
        tried.extend(starts(&plain.study.columns, &promising));
    }
    let settings = settings(plain, &tried);
    let losses: Vec<f64> = plain.losses(&settings, &some)?.iter().map(|l| mean(l)).collect();
    let best = (0..tried.len()).min_by(|&a, &b| losses[a].total_cmp(&losses[b]));
    Ok(best.map(|k| Fit { suspect: tried[k].clone(), loss: losses[k] }))
}

/// The groups of an effect that promise the least loss, with the values of one linear step, or of the best level.
fn promising(plain: &mut Plain, effect: usize, windows: &[usize]) -> Result<Vec<Suspect>, GapError> {
    let of_effect = |g: &usize| plain.study.columns.groups[*g].effect == effect;
    let groups: Vec<usize> = (0..plain.study.columns.groups.len()).filter(of_effect).collect();
    let points: Vec<Vec<Suspect>> = groups.iter().map(|&g| points(&plain.study.columns, g)).collect();
    let flat: Vec<Suspect> = points.iter().flatten().cloned().collect();
    let settings = settings(plain, &flat);
    let vectors = plain.vectors(&settings, windows)?;
    let nominal: Vec<Vec<f64>> = windows.iter().map(|&w| plain.nominal_vector(w)).collect();
    let mut found: Vec<(f64, Suspect)> = Vec::new();
    let mut next = 0;
    for of_group in &points {
        let range = next..next + of_group.len();
        next = range.end;
        let level = |k: usize| (mean(&plain.losses_of(&vectors[k], windows)), flat[k].clone());
        let mut options: Vec<(f64, Suspect)> = range.clone().map(level).collect();
        options.extend(linear(&plain.study.columns, of_group, &nominal, &vectors[range]));
        found.extend(options.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)));
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(found.into_iter().take(GROUPS).map(|f| f.1).collect())
}

/// A group at each level of each axis, the other axes absent.
fn points(columns: &Columns, group: usize) -> Vec<Suspect> {
    let of = &columns.groups[group];
    let effect = &columns.effects[of.effect];
    let absent: Vec<f64> = (0..effect.axes.len()).map(|axis| absent(columns, group, axis)).collect();
    let mut points = Vec::new();
    for axis in 0..effect.axes.len() {
        for level in 0..effect.levels.len() {
            let of_units = columns.units_of(of, axis).filter_map(|u| columns.column(u, level));
            let at: Vec<f64> = of_units.map(|c| columns.columns[c].value).collect();
            if !at.is_empty() {
                let mut values = absent.clone();
                values[axis] = mean(&at).clamp(effect.range[0], effect.range[1]);
                points.push(Suspect::everywhere(group, values));
            }
        }
    }
    points
}

/// Value of an axis when the effect is absent; not finite for a limit.
pub(super) fn absent(columns: &Columns, group: usize, axis: usize) -> f64 {
    columns.units_of(&columns.groups[group], axis).next().map_or(0.0, |u| columns.units[u].absent)
}

/// The loss that one linear step from absent foretells, and where it leads; from the first level of each axis.
fn linear(
    columns: &Columns,
    points: &[Suspect],
    nominal: &[Vec<f64>],
    vectors: &[Vec<Option<Vec<f64>>>],
) -> Option<(f64, Suspect)> {
    let group = points.first()?.group;
    let effect = &columns.effects[columns.groups[group].effect];
    let axes = effect.axes.len();
    let absent: Vec<f64> = (0..axes).map(|axis| absent(columns, group, axis)).collect();
    // Of the first level of each axis; a limit has no slope.
    let moved = |axis: usize| (0..points.len()).find(|&k| points[k].values[axis] != absent[axis]);
    let first: Vec<usize> = (0..axes).filter(|&a| absent[a].is_finite()).map_while(moved).collect();
    if first.len() < axes {
        return None;
    }
    let mut normal = Normal::new(axes);
    let mut loss = 0.0;
    for (w, r) in nominal.iter().enumerate() {
        let at: Option<Vec<&Vec<f64>>> = first.iter().map(|&k| vectors[k][w].as_ref()).collect();
        let steps = first.iter().enumerate().map(|(a, &k)| points[k].values[a] - absent[a]);
        loss += squared(r) / r.len() as f64 / nominal.len() as f64;
        if let Some(at) = at {
            let slopes: Vec<Vec<f64>> = at.iter().zip(steps).map(|(x, step)| slope(r, x, step)).collect();
            normal.add(&slopes, r, 1.0 / (r.len() * nominal.len()) as f64);
        }
    }
    let step = normal.solve()?;
    let [low, high] = effect.range;
    let values: Vec<f64> = absent.iter().zip(&step).map(|(a, s)| (a + s).clamp(low, high)).collect();
    let taken: Vec<f64> = values.iter().zip(&absent).map(|(v, a)| v - a).collect();
    Some((loss - normal.gain(&taken), Suspect::everywhere(group, values)))
}

/// By how much each number of a residual falls along an axis, of one with a step along it.
fn slope(residual: &[f64], moved: &[f64], step: f64) -> Vec<f64> {
    minus(residual, moved).iter().map(|d| d / step).collect()
}

/// Least squares along the axes of an effect.
struct Normal {
    curvature: Matrix,
    force: Vec<f64>,
}

impl Normal {
    fn new(axes: usize) -> Self {
        Self { curvature: Matrix::zeros(axes, axes), force: vec![0.0; axes] }
    }

    /// `slopes`: by how much the residual falls along each axis.
    fn add(&mut self, slopes: &[Vec<f64>], residual: &[f64], weight: f64) {
        for (a, slope) in slopes.iter().enumerate() {
            self.force[a] += weight * dot(slope, residual);
            for (b, other) in slopes.iter().enumerate() {
                self.curvature[(a, b)] += weight * dot(slope, other);
            }
        }
    }

    fn solve(&self) -> Option<Vec<f64>> {
        let step = Cholesky::new(&self.curvature)?.solve(&self.force);
        step.iter().all(|x| x.is_finite()).then_some(step)
    }

    /// By how much the loss falls with a step.
    fn gain(&self, step: &[f64]) -> f64 {
        2.0 * dot(&self.force, step) - dot(step, &times(&self.curvature, step))
    }
}

/// Values along the range of a group to start from.
fn starts(columns: &Columns, promising: &Suspect) -> Vec<Suspect> {
    let group = &columns.groups[promising.group];
    let effect = &columns.effects[group.effect];
    let [low, high] = effect.range;
    let clamped = |values: Vec<f64>| {
        Suspect::everywhere(promising.group, values.into_iter().map(|v: f64| v.clamp(low, high)).collect())
    };
    let mut all = vec![promising.clone()];
    if effect.axes.len() > 1 {
        all.extend([0.5, 2.0].map(|s| clamped(promising.values.iter().map(|v| s * v).collect())));
        return all;
    }
    let absent = absent(columns, promising.group, 0);
    if !absent.is_finite() {
        let largest = largest(columns, promising.group);
        all.extend(LIMITS.map(|s| clamped(vec![s * largest])));
        return all;
    }
    for end in [low, high].into_iter().filter(|end| (end - absent).abs() > 1e-9 * effect.span()) {
        all.extend(STARTS.map(|share| clamped(vec![absent + share * (end - absent)])));
    }
    all
}

/// The measured value that levels of a limit are shares of: the largest of the group's members.
pub(super) fn largest(columns: &Columns, group: usize) -> f64 {
    let group = &columns.groups[group];
    let effect = &columns.effects[group.effect];
    let of_unit = |u| columns.columns.iter().filter(move |c| c.unit == u).map(|c| c.value / effect.levels[c.level]);
    columns.units_of(group, 0).flat_map(of_unit).fold(0.0, f64::max)
}

/// One round of Gauss-Newton for every fit, all of them simulated together.
fn improve(plain: &mut Plain, fits: &mut [Fit]) -> Result<(), GapError> {
    let windows = plain.fitted.clone();
    let mut points: Vec<Suspect> = Vec::new();
    for fit in fits.iter() {
        points.push(fit.suspect.clone());
        points.extend((0..fit.suspect.values.len()).map(|axis| beside(&plain.study.columns, &fit.suspect, axis)));
    }
    let at = settings(plain, &points);
    let vectors = plain.vectors(&at, &windows)?;
    let mut tried: Vec<Suspect> = Vec::new();
    let mut next = 0;
    for fit in fits.iter_mut() {
        let range = next..next + 1 + fit.suspect.values.len();
        next = range.end;
        fit.loss = mean(&plain.losses_of(&vectors[range.start], &windows));
        let step = gauss_newton(&points[range.clone()], &vectors[range]);
        let [low, high] = plain.study.columns.effects[plain.study.columns.groups[fit.suspect.group].effect].range;
        tried.extend(SHARES.map(|share| {
            let moved = |(v, s): (&f64, &f64)| (v + share * s).clamp(low, high);
            Suspect::everywhere(fit.suspect.group, fit.suspect.values.iter().zip(&step).map(moved).collect())
        }));
    }
    let at = settings(plain, &tried);
    let losses = plain.losses(&at, &windows)?;
    for (fit, trials) in fits.iter_mut().zip(tried.chunks(SHARES.len()).zip(losses.chunks(SHARES.len()))) {
        for (suspect, loss) in trials.0.iter().zip(trials.1) {
            if mean(loss) < fit.loss {
                *fit = Fit { suspect: suspect.clone(), loss: mean(loss) };
            }
        }
    }
    Ok(())
}

/// A suspect moved along one axis, by a share of its range.
fn beside(columns: &Columns, suspect: &Suspect, axis: usize) -> Suspect {
    let effect = &columns.effects[columns.groups[suspect.group].effect];
    let step = 0.04 * effect.span();
    let mut moved = suspect.clone();
    let inwards = moved.values[axis] + step > effect.range[1];
    moved.values[axis] += if inwards { -step } else { step };
    moved
}

/// The step from the first point, of slopes to the others; nothing where that cannot be told.
fn gauss_newton(points: &[Suspect], vectors: &[Vec<Option<Vec<f64>>>]) -> Vec<f64> {
    let axes = points.len() - 1;
    let mut normal = Normal::new(axes);
    for w in 0..vectors[0].len() {
        let of_window: Option<Vec<&Vec<f64>>> = vectors.iter().map(|v| v[w].as_ref()).collect();
        let Some(of_window) = of_window else { continue };
        let slope = |a: usize| {
            let step = points[1 + a].values[a] - points[0].values[a];
            slope(of_window[0], of_window[1 + a], step)
        };
        let slopes: Vec<Vec<f64>> = (0..axes).map(slope).collect();
        normal.add(&slopes, of_window[0], 1.0 / of_window[0].len() as f64);
    }
    normal.solve().unwrap_or_else(|| vec![0.0; axes])
}

fn judge(plain: &mut Plain, fits: Vec<Fit>) -> Result<Vec<Judged>, GapError> {
    let windows = plain.held_out.clone();
    let suspects: Vec<Suspect> = fits.into_iter().map(|f| f.suspect).collect();
    let settings = settings(plain, &suspects);
    let losses = plain.losses(&settings, &windows)?;
    let one = |(suspect, after): (Suspect, &Vec<f64>)| {
        let falls: Vec<f64> = windows.iter().zip(after).map(|(&w, a)| plain.nominal(w) - a).collect();
        let (fall, count) = (mean(&falls), falls.len().max(1) as f64);
        let variance = falls.iter().map(|f| (f - fall).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
        Judged { suspect, fall, error: (variance / count).sqrt() }
    };
    Ok(suspects.into_iter().zip(&losses).map(one).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_step_of_least_squares_is_found_and_its_gain_foretold() {
        let slopes = [vec![1.0, 0.0, 2.0], vec![0.0, 1.0, 1.0]];
        let residual = [0.5, -0.25, 0.75];
        let mut normal = Normal::new(2);
        normal.add(&slopes, &residual, 1.0);
        let step = normal.solve().unwrap();
        assert!((step[0] - 0.5).abs() < 1e-12 && (step[1] + 0.25).abs() < 1e-12, "{step:?}");
        assert!((normal.gain(&step) - squared(&residual)).abs() < 1e-12);
        assert!(Normal::new(2).solve().is_none(), "what moves nothing has no step");
    }
}
