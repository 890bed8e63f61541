//! Parameters from windows of recordings: those that are most probable by [`qv_fit::fit`].
//!
//! Numbers of a window that go together are in units of how they lie in windows without anything to find ([`Windows::null`]).
//! Windows have the tails of Student's t: where a foot slips that did not, the window says little of the motors. Deviations are by how
//! windows differ (the sandwich; White, Econometrica 50, 1982).

use crate::ResidualError;
use crate::identify::{Coordinate, FitSettings, expanded, shared};
use qv_fit::{Blocks, Loss, Options, Problem, Scatter, StopReason};
use qv_rollout::ENGINE_ERROR;
use rayon::prelude::*;

/// Degrees of freedom of a window's tails.
const FREEDOM: f64 = 4.0;
/// Loss of each number of a window that ran away.
const RAN_AWAY: f64 = 10.0;
/// Dampings of a step, and shares of the undamped one, that are tried.
const DAMPINGS: [f64; 6] = [0.0, 1e-3, 1e-2, 0.1, 1.0, 10.0];
const SHARES: [f64; 5] = [0.05, 0.12, 0.25, 0.5, 0.75];
/// Difference for a slope in prior deviations: feet that touch down earlier or later make smaller ones say nothing of what lies a step away.
const DIFFERENCE: f64 = 1.0 / 3.0;
/// Levels of a coordinate that are tried alone, in prior deviations from neutral.
const LEVELS: [f64; 6] = [-2.0, -1.0, -0.4, 0.4, 1.0, 2.0];
/// Most coordinates that are chosen one after another: each costs as much as a step of all joints, and the fit of all joints takes it from there.
const MOST_CHOSEN: usize = 4;
/// Most steps of the fit after each choice.
const CHOICE_STEPS: usize = 3;
/// A step that lowers the cost by less than this for each number is the last: a tenth of what one number may differ by chance, since 0.5 is one
/// standard deviation of one number.
const SETTLED: f64 = 0.05;

/// Windows of recordings that are simulated at points of some coordinates.
pub trait Windows {
    /// Simulated against measured, `[points][windows][numbers]`; empty where a window ran away.
    ///
    /// # Errors
    /// When the simulator refuses a number.
    fn residuals(&self, coordinates: &[Coordinate], points: &[Vec<f64>]) -> Result<Vec<Blocks>, ResidualError>;

    /// Windows of a robot that is as the simulator has it at a point: what noise and numerics leave.
    ///
    /// # Errors
    /// When the simulator refuses a number.
    fn null(&self, coordinates: &[Coordinate], point: &[f64]) -> Result<Blocks, ResidualError>;

    /// Which numbers of a window go together; those in no group are left out.
    fn groups(&self) -> Vec<Vec<usize>>;
}

/// A fit.
#[derive(Debug, Clone)]
pub struct Fit {
    /// Its coordinates.
    pub coordinates: Vec<Coordinate>,
    /// Maximum a posteriori.
    pub point: Vec<f64>,
    /// Standard deviations: the sandwich by windows, and for [`fit_shared_first`] what engines differ in.
    pub deviations: Vec<f64>,
    /// Cost after each step, each in units of its own null.
    pub costs: Vec<f64>,
}

impl Fit {
    /// Its value of each of `coordinates`, by name; those that it has not are neutral.
    pub fn at(&self, coordinates: &[Coordinate]) -> Vec<f64> {
        let own = |name: &str| self.coordinates.iter().zip(&self.point).find(|(c, _)| c.name == name).map(|(_, x)| *x);
        coordinates.iter().map(|c| own(&c.name).unwrap_or(c.neutral)).collect()
    }
}

/// Fits coordinates to windows from a point; `notify` hears of each step and its cost.
///
/// # Errors
/// When the simulator refuses a number, or all windows run away.
pub fn fit(
    windows: &dyn Windows,
    coordinates: Vec<Coordinate>,
    start: &[f64],
    steps: usize,
    notify: &mut dyn FnMut(usize, f64),
) -> Result<Fit, ResidualError> {
    let options = Options {
        loss: loss(),
        rounds: 1,
        dampings: DAMPINGS.to_vec(),
        shares: SHARES.to_vec(),
        fall: 0.0,
        gain: SETTLED * coordinates.len() as f64,
        ..Options::default()
    };
    let mut problem = problem(&coordinates, start);
    let deviations = coordinates.iter().map(|c| c.spread).collect();
    let mut fit = Fit { coordinates, point: start.to_vec(), deviations, costs: Vec::new() };
    for step in 0..steps {
        let whitening = Whitening::of(&windows.null(&fit.coordinates, &fit.point)?, windows.groups())?;
        let found = qv_fit::fit(&problem, &options, |points| -> Result<Vec<Blocks>, ResidualError> {
            let raw = windows.residuals(&fit.coordinates, points)?;
            Ok(raw.par_iter().map(|blocks| blocks.iter().map(|block| whitening.whitened(block)).collect()).collect())
        })?;
        let deviations = found.block_deviations();
        // One window alone has no scatter: then the prior's stay.
        if deviations.iter().all(|d| d.is_finite()) {
            fit.deviations = deviations;
        }
        fit.costs.push(found.cost);
        notify(step, found.cost);
        fit.point.clone_from(&found.values);
        problem.start = found.values;
        if found.stopped != StopReason::Rounds {
            break;
        }
    }
    Ok(fit)
}

/// The same from the neutral point: first what all joints share, then each joint.
///
/// All shared ones at once may end in a minimum in which a heavier base takes the place of weaker motors; so may one after another where several
/// effects act. Both are tried, and the lower cost counts. Deviations hold what engines differ in ([`ENGINE_ERROR`]), as those of a diagnosis do.
///
/// # Errors
/// Those of [`fit`].
pub fn fit_shared_first(
    windows: &dyn Windows,
    coordinates: Vec<Coordinate>,
    settings: &FitSettings,
    notify: &mut dyn FnMut(usize, f64),
) -> Result<Fit, ResidualError> {
    let shared = shared(&coordinates);
    let neutral: Vec<f64> = shared.iter().map(|c| c.neutral).collect();
    let together = fit(windows, shared.clone(), &neutral, settings.steps, notify)?.point;
    let one_by_one = chosen_one_by_one(windows, &shared, settings.steps, notify)?;
    let costs = costs(windows, &shared, &[together.clone(), one_by_one.clone()])?;
    let point = if costs[0] < costs[1] { together } else { one_by_one };
    let start = expanded(&coordinates, &shared, &point);
    let mut fit = fit(windows, coordinates, &start, settings.steps, notify)?;
    let away = fit.point.iter().zip(&fit.coordinates).map(|(x, c)| (x - c.neutral).abs());
    fit.deviations.iter_mut().zip(away).for_each(|(deviation, away)| *deviation = deviation.hypot(ENGINE_ERROR * away));
    Ok(fit)
}

/// Forward selection: the coordinate that alone lowers the cost most joins those that are fitted, until none lowers it by what chance does or
/// [`MOST_CHOSEN`] are.
fn chosen_one_by_one(
    windows: &dyn Windows,
    shared: &[Coordinate],
    steps: usize,
    notify: &mut dyn FnMut(usize, f64),
) -> Result<Vec<f64>, ResidualError> {
    let mut point: Vec<f64> = shared.iter().map(|c| c.neutral).collect();
    let mut chosen: Vec<usize> = Vec::new();
    while chosen.len() < MOST_CHOSEN.min(shared.len()) {
        let (found, gain) = best_level(windows, shared, &point, &chosen)?;
        // One standard deviation of one number lowers the cost by 0.5; the best of many by the logarithm of their number more (Bonferroni).
        if gain < 0.5 + (LEVELS.len() as f64 * shared.len() as f64).ln() {
            break;
        }
        let (coordinate, value) = found;
        point[coordinate] = value;
        chosen.push(coordinate);
        let some: Vec<Coordinate> = chosen.iter().map(|&k| shared[k].clone()).collect();
        let start: Vec<f64> = chosen.iter().map(|&k| point[k]).collect();
        let fit = fit(windows, some, &start, steps.min(CHOICE_STEPS), notify)?;
        chosen.iter().zip(fit.point).for_each(|(&k, x)| point[k] = x);
    }
    Ok(point)
}

/// The coordinate and its level that lower the cost most, and by how much.
fn best_level(
    windows: &dyn Windows,
    shared: &[Coordinate],
    point: &[f64],
    chosen: &[usize],
) -> Result<((usize, f64), f64), ResidualError> {
    let left = (0..shared.len()).filter(|k| !chosen.contains(k));
    let levels = |k: usize| {
        LEVELS.map(|l| (k, (shared[k].neutral + l * shared[k].spread).clamp(shared[k].least, shared[k].most)))
    };
    let tried: Vec<(usize, f64)> = left.flat_map(levels).filter(|(k, x)| *x != shared[*k].neutral).collect();
    let mut points = vec![point.to_vec()];
    points.extend(tried.iter().map(|&(k, x)| {
        let mut moved = point.to_vec();
        moved[k] = x;
        moved
    }));
    let costs = costs(windows, shared, &points)?;
    let best = (1..costs.len()).min_by(|&a, &b| costs[a].total_cmp(&costs[b])).unwrap_or(0);
    Ok((tried.get(best.wrapping_sub(1)).copied().unwrap_or((0, point[0])), costs[0] - costs[best]))
}

/// Cost of each of some points in units of the null at the first.
fn costs(windows: &dyn Windows, coordinates: &[Coordinate], points: &[Vec<f64>]) -> Result<Vec<f64>, ResidualError> {
    let whitening = Whitening::of(&windows.null(coordinates, &points[0])?, windows.groups())?;
    let (loss, problem) = (loss(), problem(coordinates, &points[0]));
    let residuals = windows.residuals(coordinates, points)?;
    let of_block = |block: &Vec<f64>| match block.is_empty() {
        true => RAN_AWAY * whitening.numbers() as f64,
        false => loss.of(&whitening.whitened(block)),
    };
    let cost =
        |(blocks, point): (&Blocks, &Vec<f64>)| blocks.iter().map(of_block).sum::<f64>() + problem.prior_cost(point);
    Ok(residuals.par_iter().zip(points).map(cost).collect())
}

fn loss() -> Loss {
    Loss { ran_away: RAN_AWAY, ..Loss::student(FREEDOM) }
}

fn problem(coordinates: &[Coordinate], start: &[f64]) -> Problem {
    Problem {
        low: coordinates.iter().map(|c| c.least).collect(),
        high: coordinates.iter().map(|c| c.most).collect(),
        prior: coordinates.iter().map(|c| Some([c.neutral, c.spread])).collect(),
        ..Problem::new(start, &coordinates.iter().map(|c| DIFFERENCE * c.spread).collect::<Vec<_>>())
    }
}

/// Numbers of a window in units of how they usually lie together.
struct Whitening {
    groups: Vec<(Vec<usize>, Scatter)>,
}

impl Whitening {
    fn of(blocks: &Blocks, groups: Vec<Vec<usize>>) -> Result<Self, ResidualError> {
        let whole: Vec<&Vec<f64>> = blocks.iter().filter(|block| !block.is_empty()).collect();
        let of_group = |group: Vec<usize>| {
            let rows: Vec<Vec<f64>> = whole.iter().map(|block| group.iter().map(|&k| block[k]).collect()).collect();
            let scatter = Scatter::about_zero(&rows);
            let found = if rows.is_empty() { "none" } else { "a covariance that is singular" };
            let missing = || ResidualError::input("recordings", "windows that do not run away, with noise", found);
            Ok((group, scatter.ok_or_else(missing)?))
        };
        Ok(Self { groups: groups.into_par_iter().map(of_group).collect::<Result<_, ResidualError>>()? })
    }

    /// Numbers of a window.
    fn numbers(&self) -> usize {
        self.groups.iter().map(|group| group.0.len()).sum()
    }

    fn whitened(&self, block: &[f64]) -> Vec<f64> {
        if block.is_empty() {
            return Vec::new();
        }
        let of_group = |(group, scatter): &(Vec<usize>, Scatter)| {
            let mut numbers: Vec<f64> = group.iter().map(|&k| block[k]).collect();
            scatter.factor.whiten(&mut numbers);
            numbers
        };
        self.groups.iter().flat_map(of_group).collect()
    }
}
