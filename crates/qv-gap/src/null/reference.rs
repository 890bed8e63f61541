//! Recordings of the same robot before something changed: what the simulator lacked then is no cause of what is new.
//!
//! Actuators and sensors of the simulated robot are first fitted to the reference recordings; what they leave even then
//! takes the place of the simulated null. A servo whose friction no model catches can so be asked what it carries.

use crate::GapError;
use crate::findings::Correction;
use crate::problem::columns::Columns;
use crate::problem::library::{Effect, Interface};
use nalgebra::{DMatrix, DVector};
use qv_core::random::SplitMix64;
use qv_core::statistics::median;
use qv_recording::Run;
use qv_rollout::Raw;
use qv_rollout::compare;
use qv_rollout::{Overrides, Rollout, Window};

/// Rounds of Gauss-Newton.
const ROUNDS: usize = 6;
/// Shares of a step that are tried.
const SHARES: [f64; 4] = [1.0, 0.5, 0.2, 0.05];
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
        if !fit.improve()? {
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
        matches!(effect.interface, Interface::Actuator | Interface::Sensing) && !effect.local && column.level == 0
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
    residuals: Vec<Vec<f64>>,
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
        let mut fit = Self { rollout, columns, units, values, windows, residuals: Vec::new(), scales: Vec::new() };
        fit.residuals = fit.simulate(&[fit.values.clone()])?.remove(0);
        fit.scales = fit.scales_of(&fit.residuals);
        Ok(fit)
    }

    fn setting(&self, values: &[f64]) -> Overrides {
        let units = |(&c, &v): (&usize, &f64)| (self.columns.columns[c].unit, v);
        let values: Vec<(usize, f64)> = self.units.iter().zip(values).map(units).collect();
        self.columns.setting(self.rollout, &values)
    }

    fn simulate(&self, points: &[Vec<f64>]) -> Result<Vec<Vec<Vec<f64>>>, GapError> {
        let settings: Vec<Overrides> = points.iter().map(|p| self.setting(p)).collect();
        let windows: Vec<&Window> = self.windows.iter().collect();
        Ok(compare(self.rollout, &self.rollout.numerics, &windows, &settings)?.values)
    }

    /// Root mean square of the smaller nine tenths of each channel's residuals.
    fn scales_of(&self, residuals: &[Vec<f64>]) -> Vec<f64> {
        let bins = self.rollout.cut.bins();
        let mut scales = Vec::new();
        for &channel in &self.rollout.channels {
            let width = qv_rollout::features::width(channel, bins);
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

    /// Robust loss (Student's t with one degree of freedom for each window) beside the prior's.
    fn loss(&self, values: &[f64], residuals: &[Vec<f64>]) -> f64 {
        let of_window = |r: &Vec<f64>| {
            let count = self.scales.len() as f64;
            if r.is_empty() { count * 5.0 } else { count * (1.0 + self.square(r) / count).ln() }
        };
        residuals.iter().map(of_window).sum::<f64>() + self.prior(values)
    }

    fn square(&self, residual: &[f64]) -> f64 {
        residual.iter().zip(&self.scales).map(|(r, s)| (r / s).powi(2)).sum()
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

    fn prior(&self, values: &[f64]) -> f64 {
        values.iter().enumerate().map(|(k, v)| ((v - self.absent(k)) / self.usual(k)).powi(2)).sum()
    }

    /// One step of Gauss-Newton; whether it helped.
    fn improve(&mut self) -> Result<bool, GapError> {
        let count = self.units.len();
        let step = |k: usize| {
            let column = &self.columns.columns[self.units[k]];
            DIFFERENCE * (column.value - self.absent(k))
        };
        let mut points = Vec::new();
        for k in 0..count {
            let mut moved = self.values.clone();
            moved[k] += step(k);
            points.push(moved);
        }
        let moved = self.simulate(&points)?;
        let (mut h, mut g) = (DMatrix::<f64>::zeros(count, count), DVector::<f64>::zeros(count));
        for (w, residual) in self.residuals.iter().enumerate() {
            if residual.is_empty() || moved.iter().any(|m| m[w].is_empty()) {
                continue;
            }
            let weight = 1.0 / (1.0 + self.square(residual) / self.scales.len() as f64);
            let slope = |k: usize| {
                let one = residual.iter().zip(&moved[k][w]).zip(&self.scales).map(move |((r, m), s)| (r - m) / s);
                DVector::from_iterator(residual.len(), one) / step(k)
            };
            let j = DMatrix::from_columns(&(0..count).map(slope).collect::<Vec<_>>());
            let r = DVector::from_iterator(residual.len(), residual.iter().zip(&self.scales).map(|(r, s)| r / s));
            h.gemm_tr(weight, &j, &j, 1.0);
            g.gemv_tr(weight, &j, &r, 1.0);
        }
        for k in 0..count {
            let stiffness = 1.0 / self.usual(k).powi(2);
            h[(k, k)] += stiffness;
            g[k] -= stiffness * (self.values[k] - self.absent(k));
        }
        let Some(step) = h.cholesky().map(|c| c.solve(&g)) else { return Ok(false) };
        let tried: Vec<Vec<f64>> =
            SHARES.iter().map(|s| self.values.iter().zip(step.iter()).map(|(v, d)| v + s * d).collect()).collect();
        let results = self.simulate(&tried)?;
        let before = self.loss(&self.values, &self.residuals);
        let losses: Vec<f64> = tried.iter().zip(&results).map(|(v, r)| self.loss(v, r)).collect();
        let best = (0..tried.len()).min_by(|&a, &b| losses[a].total_cmp(&losses[b])).unwrap_or(0);
        if losses[best] >= before {
            return Ok(false);
        }
        self.values = tried[best].clone();
        self.residuals = results.into_iter().nth(best).unwrap_or_default();
        self.scales = self.scales_of(&self.residuals);
        Ok(true)
    }
}

/// Takes out windows of a reference that are missed by far more than most: something happened there, once.
pub fn drop_outliers(pool: &mut Vec<(bool, Raw)>) {
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
