//! Recordings of the same robot before something changed: what the simulator lacked then is no cause of what is new.
//!
//! Actuators and sensors of the simulated robot are first fitted to the reference recordings; what they leave even then
//! takes the place of the simulated null. A servo whose friction no model catches can so be asked what it carries.

use crate::GapError;
use crate::findings::Correction;
use crate::problem::columns::Columns;
use crate::problem::library::{Effect, Interface};
use qv_core::random::SplitMix64;
use qv_core::statistics::median;
use qv_fit::{Blocks, Loss, Options, Problem, StopReason};
use qv_recording::Run;
use qv_rollout::Raw;
use qv_rollout::compare;
use qv_rollout::{Overrides, Rollout, Window};

/// Rounds of Gauss-Newton.
const ROUNDS: usize = 6;
/// Shares of a step that are tried beside the whole one: what actuators do is weakly distinguished, and dampings would leave that out.
const SHARES: [f64; 3] = [0.5, 0.2, 0.05];
/// Loss of each number of a window that ran away.
const RAN_AWAY: f64 = 5.0;
/// Mean square over that of the middle window from which on a window is one of its own.
pub const OUTLIER: f64 = 20.0;
/// Deviation of a sensor that is nothing unusual, in those of any robot.
const SENSOR_TOLERANCES: f64 = 3.0;
/// Difference of a unit for its slope, in its first level's distance from absent.
const DIFFERENCE: f64 = 0.2;

/// Values of a robot's actuators and sensors that make the simulator follow `runs` as well as it can. What links weigh is
/// taken as it is stated: torques are known no better than that from positions alone.
///
/// # Errors
/// When the runs have too little, or the simulator refuses.
pub fn calibrate(rollout: &Rollout, runs: &[Run], library: &[Effect]) -> Result<Vec<Correction>, GapError> {
    let first = runs.first().ok_or_else(|| GapError::run("reference", "at least one run", "none"))?;
    let columns = Columns::new(rollout, first, library)?;
    let units = units(&columns);
    let mut windows = Vec::new();
    for run in runs {
        windows.extend(rollout.windows(run)?);
    }
    let mut fit = Fit::new(rollout, &columns, units, windows)?;
    for _ in 0..ROUNDS {
        if fit.units.is_empty() || !fit.improve()? {
            break;
        }
    }
    let setting = fit.setting(&fit.values);
    let correction = |&(id, value): &(usize, f64)| {
        let info = &rollout.catalogue[id];
        Correction { parameter: info.name.clone(), value, nominal: rollout.nominal[id], unit: info.unit.into() }
    };
    Ok(setting.iter().map(correction).collect())
}

/// Units of actuators and sensors of which some deviation is tolerated in any robot: first column of each.
fn units(columns: &Columns) -> Vec<usize> {
    let fitted = |&c: &usize| {
        let column = &columns.columns[c];
        let effect = &columns.effects[columns.units[column.unit].effect];
        matches!(effect.interface, Interface::Actuator | Interface::Sensing)
            && !effect.local
            && column.level == 0
            && columns.units[column.unit].absent.is_finite()
    };
    (0..columns.tolerated).filter(fitted).collect()
}

/// A joint fit of many units.
struct Fit<'p> {
    rollout: &'p Rollout<'p>,
    columns: &'p Columns,
    /// Column of each unit that is fitted.
    units: Vec<usize>,
    /// Value of each.
    values: Vec<f64>,
    windows: Vec<Window>,
    /// Root mean square of each feature's channel.
    scales: Vec<f64>,
}

impl<'p> Fit<'p> {
    fn new(
        rollout: &'p Rollout<'p>,
        columns: &'p Columns,
        units: Vec<usize>,
        windows: Vec<Window>,
    ) -> Result<Self, GapError> {
        let values = units.iter().map(|&c| columns.units[columns.columns[c].unit].absent).collect();
        let mut fit = Self { rollout, columns, units, values, windows, scales: Vec::new() };
        let residuals = fit.simulate(&[fit.values.clone()])?.remove(0);
        fit.scales = fit.sizes(&residuals);
        Ok(fit)
    }

    fn setting(&self, values: &[f64]) -> Overrides {
        let units = |(&c, &v): (&usize, &f64)| (self.columns.columns[c].unit, v);
        let values: Vec<(usize, f64)> = self.units.iter().zip(values).map(units).collect();
        self.columns.setting(self.rollout, &values)
    }

    fn simulate(&self, points: &[Vec<f64>]) -> Result<Vec<Blocks>, GapError> {
        let settings: Vec<Overrides> = points.iter().map(|p| self.setting(p)).collect();
        let windows: Vec<&Window> = self.windows.iter().collect();
        Ok(compare(self.rollout, &self.rollout.numerics, &windows, &settings)?.values)
    }

    /// The same in units of the scales.
    fn scaled(&self, points: &[Vec<f64>]) -> Result<Vec<Blocks>, GapError> {
        let mut all = self.simulate(points)?;
        for residual in all.iter_mut().flatten() {
            residual.iter_mut().zip(&self.scales).for_each(|(r, s)| *r /= s);
        }
        Ok(all)
    }

    /// Root mean square of the smaller nine tenths of each channel's residuals.
    fn sizes(&self, residuals: &[Vec<f64>]) -> Vec<f64> {
        let bins = self.rollout.cut.bins();
        let mut scales = Vec::new();
        for &channel in &self.rollout.channels {
            let width = qv_rollout::channels::width(channel, bins);
            let range = scales.len()..scales.len() + width;
            let of_window = |r: &Vec<f64>| r.get(range.clone()).map(|r| r.iter().map(|x| x.abs()).collect::<Vec<_>>());
            let mut all: Vec<f64> = residuals.iter().filter_map(of_window).flatten().collect();
            all.sort_by(f64::total_cmp);
            all.truncate((all.len() * 9).div_ceil(10));
            let rms = (all.iter().map(|x| x * x).sum::<f64>() / all.len().max(1) as f64).sqrt();
            scales.extend(std::iter::repeat_n(rms.max(1e-9), width));
        }
        scales
    }

    /// Distance of a unit from absent that is nothing unusual.
    fn usual(&self, k: usize) -> f64 {
        let effect = &self.columns.effects[self.columns.units[self.columns.columns[self.units[k]].unit].effect];
        match effect.interface {
            // A bias of the encoder turns gravity about the joint: left free it would take upon itself what the load does.
            Interface::Sensing => SENSOR_TOLERANCES * effect.tolerance,
            _ => 0.4 * effect.usual_span,
        }
    }

    fn absent(&self, k: usize) -> f64 {
        self.columns.units[self.columns.columns[self.units[k]].unit].absent
    }

    /// What is fitted now. The prior counts twice: with so many degrees of freedom the loss is nearly twice that of squares.
    fn problem(&self) -> Problem {
        let each = 0..self.units.len();
        let step = |k: usize| DIFFERENCE * (self.columns.columns[self.units[k]].value - self.absent(k));
        let prior = |k: usize| Some([self.absent(k), self.usual(k) * 0.5_f64.sqrt()]);
        Problem {
            prior: each.clone().map(prior).collect(),
            ..Problem::new(&self.values, &each.map(step).collect::<Vec<_>>())
        }
    }

    /// One round, in units of what the one before it left; whether it helped. Windows have tails of as many degrees of freedom as numbers.
    fn improve(&mut self) -> Result<bool, GapError> {
        let loss = Loss { ran_away: RAN_AWAY, ..Loss::student(self.scales.len() as f64) };
        let options = Options { loss, rounds: 1, dampings: vec![0.0], shares: SHARES.to_vec(), ..Options::default() };
        let found = qv_fit::fit(&self.problem(), &options, |points| self.scaled(points))?;
        let sizes = self.sizes(&found.residuals);
        self.scales.iter_mut().zip(sizes).for_each(|(scale, size)| *scale = (*scale * size).max(1e-9));
        self.values = found.values;
        Ok(found.stopped != StopReason::Stuck)
    }
}

/// Takes out windows of a reference that are missed by far more than most: something happened there, once.
pub(crate) fn drop_outliers(pool: &mut Vec<(bool, Raw)>) {
    let numbers = |raw: &Raw| raw.motion.iter().chain(&raw.law).copied().collect::<Vec<f64>>();
    let Some(size) = pool.first().map(|p| numbers(&p.1).len()) else { return };
    let all: Vec<Vec<f64>> = pool.iter().map(|p| numbers(&p.1)).collect();
    let middle = |i: usize| median(&mut all.iter().map(|x| x[i].abs()).collect::<Vec<f64>>());
    let typical: Vec<f64> = (0..size).map(|i| middle(i).max(1e-12)).collect();
    let length = |x: &Vec<f64>| x.iter().zip(&typical).map(|(x, t)| (x / t).powi(2)).sum::<f64>();
    let lengths: Vec<f64> = all.iter().map(length).collect();
    let most = OUTLIER * median(&mut lengths.clone());
    let mut lengths = lengths.into_iter();
    pool.retain(|_| lengths.next().is_some_and(|l| l <= most));
}

/// For each of `windows` as many windows of the reference as there are recordings without an effect, drawn among those
/// that move alike; `pool` says of each whether it moves.
pub fn draw(windows: &[Window], pool: &[(bool, Raw)], recordings: usize, seed: u64) -> Vec<Vec<Raw>> {
    let mut random = SplitMix64::of(seed, 9000);
    let mut one = |window: &Window| {
        let alike: Vec<&Raw> = pool.iter().filter(|p| p.0 == window.moving).map(|p| &p.1).collect();
        let from: Vec<&Raw> = if alike.is_empty() { pool.iter().map(|p| &p.1).collect() } else { alike };
        from.get((random.uniform() * from.len() as f64) as usize).map_or_else(Raw::default, |r| (*r).clone())
    };
    (0..recordings).map(|_| windows.iter().map(&mut one).collect()).collect()
}
