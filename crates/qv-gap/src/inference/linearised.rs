//! All that a diagnosis knows before it suspects anything: residuals, sensitivities, and what no effect looks like.

use crate::GapError;
use crate::inference::gaussian_evidence::{Marginal, Normal, Sums, sum};
use crate::jacobian::{AT_A_TIME, Nominal, NominalLaw, beside_law, sensitivities, with_law};
use crate::null::reference;
use crate::null::whitening::{Sample, Whitener};
use crate::problem::columns::{Column, Columns, Group};
use crate::problem::excitation::{at_rest, is_unshown};
use qv_core::random::SplitMix64;
use qv_fit::Matrix;
use qv_fit::linear::{add_scaled_matrix, from_columns, gram, squared, transposed_product, transposed_times};
use qv_recording::Run;
use qv_rollout::Trace;
use qv_rollout::law::{self, Reading};
use qv_rollout::noise::Noise;
use qv_rollout::replicate::{Replicate, record};
use qv_rollout::{Numerics, Overrides, Rollout, Window};
use qv_rollout::{Raw, Residuals, TracedResiduals, compare, compare_and_trace, joint_lags};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Share of a tolerance that is as good as none.
const FORGOTTEN: f64 = 1e-3;
/// Columns that belong to no unit: torques may be out of step with the positions that they are reported with.
pub(crate) const EXTRA: usize = 1;
/// Tolerance of that step in columns.
const SHIFT_TOLERANCE: f64 = 1.0;

/// Share of the tolerances that is left where reference recordings show the same robot before a change.
const UNCHANGED: f64 = 0.1;

/// How many more recordings without an effect are simulated of a robot that is held: it costs a fraction of one that
/// walks, and has the room to give each window a null of its own.
pub const HELD: usize = 5;

/// Rows of a product up to which each is done alone.
const FEW_ROWS: usize = 5;

/// How much is done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NullOptions {
    /// Simulated recordings without an effect, of a robot with a free base; of one that is held [`HELD`] times as many.
    pub replicates: usize,
    /// Seed of all that is random.
    pub seed: u64,
    /// Standard deviation of the ground's height under a foot, where the ground is a mesh that was reconstructed \[m\].
    pub ground_error: f64,
}

impl Default for NullOptions {
    fn default() -> Self {
        Self { replicates: 12, seed: 1, ground_error: 0.0 }
    }
}

/// A window with its sensitivities in units of the null.
pub struct LinearisedWindow {
    /// Its place among the windows of its run.
    pub index: usize,
    /// The window.
    pub window: Window,
    /// Sensitivities, shape `[features, columns]`.
    pub j: Matrix,
    /// `J'J`.
    pub h: Matrix,
    /// Raw residual of the nominal robot.
    pub raw: Raw,
    /// What joints of the nominal robot did at each step, where no fit sees the window.
    pub trace: Option<Trace>,
    /// Whitened residual of the nominal robot.
    pub residual: Vec<f64>,
    /// Weight in sums: below 1 where nothing explains the window.
    pub weight: f64,
}

/// What a run has of its own.
pub struct RunProblem {
    /// The null.
    pub whitener: Whitener,
    /// Noise of the sensors.
    pub noise: Noise,
    /// How stamps of torques lie.
    pub alignment: law::Alignment,
}

impl RunProblem {
    /// How its laws are read.
    pub(crate) fn reading(&self) -> Reading<'_> {
        Reading { alignment: self.alignment, noise: Some(&self.noise) }
    }
}

/// See the module.
pub struct LinearisedProblem<'a> {
    /// The robot and the ground.
    pub rollout: Rollout<'a>,
    /// What may be suspected.
    pub columns: Columns,
    /// The windows.
    pub seen: Vec<LinearisedWindow>,
    /// What each run has of its own.
    pub parts: Vec<RunProblem>,
    /// Normal equations of each simulated recording without an effect, by window.
    pub replicates: Vec<Vec<Option<Normal>>>,
    /// Their residuals, by window.
    pub ghost_residuals: Vec<Vec<Option<Vec<f64>>>>,
    /// Their deviations, in the tolerated columns; empty where they are drawn from reference recordings.
    pub ghost_deviations: Vec<Vec<f64>>,
    /// Tolerance of the first columns.
    pub tolerance: Vec<f64>,
    /// Effects that the library is taken never to have heard of.
    pub ablated: Vec<usize>,
    /// Joints that are at rest on average over the windows (indices, in the order of the model).
    pub at_rest: Vec<usize>,
    /// How far each joint is behind the simulated one \[s\], shape `[joints]`, by the first recording that shows; `None` where none does.
    pub lags: Vec<Option<f64>>,
    /// Mean square of residuals of noise and numerics alone.
    pub floor: f64,
    /// Steps simulated so far.
    steps: AtomicUsize,
    /// Those when they were asked for last.
    steps_reported: AtomicUsize,
    /// Whether the null is what reference recordings leave, pushes and blows among it.
    pub is_relative: bool,
}

impl<'a> LinearisedProblem<'a> {
    /// Simulates what is needed to judge `runs`, which are of one robot on one ground. Where there are recordings of the
    /// same robot without what is looked for, `reference`, what they leave is the null.
    ///
    /// # Errors
    /// When the runs have too little, or the simulator refuses.
    pub fn new(
        rollout: Rollout<'a>,
        columns: Columns,
        runs: &[Run],
        reference: &[Run],
        effort: &NullOptions,
    ) -> Result<Self, GapError> {
        let replicates = vec![Vec::new(); ghosts_of(rollout.free, effort)];
        let mut study = Self {
            rollout,
            columns,
            seen: Vec::new(),
            parts: Vec::new(),
            ghost_residuals: replicates.iter().map(|_| Vec::new()).collect(),
            replicates,
            ghost_deviations: Vec::new(),
            tolerance: Vec::new(),
            ablated: Vec::new(),
            at_rest: Vec::new(),
            lags: Vec::new(),
            floor: 0.0,
            steps: AtomicUsize::new(0),
            steps_reported: AtomicUsize::new(0),
            is_relative: !reference.is_empty(),
        };
        study.tolerance = study.tolerances();
        // More recordings share the windows that one has, down to a number that still shows something.
        study.rollout.cut.most = (study.rollout.cut.most / runs.len().max(1)).max(24).min(study.rollout.cut.most);
        let pool = study.pool(reference)?;
        for (index, run) in runs.iter().enumerate() {
            study.add(run, index, &pool, effort)?;
        }
        study.floor /= runs.len().max(1) as f64;
        // The first recording in which joints move enough to show.
        for run in runs {
            study.lags = joint_lags(&study.rollout, run)?;
            if study.lags.iter().any(Option::is_some) {
                break;
            }
        }
        study.at_rest = at_rest(&study.rollout, study.seen.iter().map(|s| &s.window));
        Ok(study)
    }

    /// Tolerance of the first columns.
    pub(crate) fn tolerances(&self) -> Vec<f64> {
        // The robot of the reference is this one: what did not change deviates as it did there.
        let share = if self.is_relative { UNCHANGED } else { 1.0 };
        let is_forgotten = |c: &Column| self.ablated.contains(&self.columns.units[c.unit].effect);
        let tolerance = |c: &Column| c.tolerance * if is_forgotten(c) { FORGOTTEN } else { share };
        let tolerated = self.columns.columns.iter().take(self.columns.tolerated).map(tolerance);
        std::iter::once(SHIFT_TOLERANCE).chain(tolerated).collect()
    }

    /// What the windows of reference recordings leave, with whether each moves.
    fn pool(&mut self, reference: &[Run]) -> Result<Vec<(bool, Raw)>, GapError> {
        let mut pool = Vec::new();
        for run in reference {
            let windows = self.rollout.windows(run)?;
            let all: Vec<&Window> = windows.iter().collect();
            let residuals = compare(&self.rollout, &self.rollout.numerics, &all, &[Overrides::new()])?;
            self.count(residuals.steps);
            let readings = vec![Reading { alignment: law::align(&self.rollout, &all), noise: None }; all.len()];
            let raw = with_law(&self.rollout, &readings, &all, &[Overrides::new()], residuals.values).remove(0);
            pool.extend(windows.iter().map(|w| w.moving).zip(raw).filter(|p| !p.1.is_empty()));
        }
        reference::drop_outliers(&mut pool);
        Ok(pool)
    }

    /// Adds the windows of one run, with its own noise, and its own null unless there is a pool for it.
    fn add(&mut self, run: &Run, index: usize, pool: &[(bool, Raw)], effort: &NullOptions) -> Result<(), GapError> {
        let mut windows = self.rollout.windows(run)?;
        if index == 0 {
            // The stillest window is the first to look like standing.
            let still = windows.iter().find(|w| !w.moving).unwrap_or(&windows[0]);
            self.rollout.settle_in(still)?;
        }
        let (rollout, columns) = (&self.rollout, &self.columns);
        windows.iter_mut().for_each(|w| w.run = index);
        let noise = Noise::of(run, &rollout.columns);
        let mut steps = 0;
        let alignment = law::align(rollout, &windows.iter().collect::<Vec<_>>());
        let (Nominal { raw, traces }, sensitivities) =
            sensitivities(rollout, Reading { alignment, noise: Some(&noise) }, columns, &windows, &mut steps)?;
        let good: Vec<bool> = raw.iter().zip(&sensitivities).map(|(r, s)| !r.is_empty() && !s.is_empty()).collect();
        if good.iter().filter(|g| **g).count() < 8 {
            return Err(GapError::run("simulation", "at least 8 windows that can be simulated", "fewer"));
        }
        let (ghost_raw, (samples, deviations)) = if pool.is_empty() {
            let (raw, deviations) = replicates(rollout, columns, &windows, &noise, (effort, index), &mut steps)?;
            let samples = samples(&windows, &sensitivities, &raw, &deviations);
            (raw, (samples, deviations))
        } else {
            // Each stands for a window that moves as it does.
            let alike = |moving| windows.iter().position(|w| w.moving == moving).unwrap_or(0);
            let at = [alike(false), alike(true)];
            let sample = |(moving, raw): &(bool, Raw)| Sample {
                window: at[usize::from(*moving)],
                moving: *moving,
                raw: raw.clone(),
            };
            let drawn = reference::draw(&windows, pool, self.replicates.len(), effort.seed.wrapping_add(index as u64));
            (drawn, (pool.iter().map(sample).collect(), Vec::new()))
        };
        // The same robots in all runs.
        self.ghost_deviations = deviations;
        let moving: Vec<bool> = windows.iter().map(|w| w.moving).collect();
        let few = || GapError::run("simulation without an effect", "windows that do not run away", "too few");
        let whitener = Whitener::new(rollout, &samples, &moving, pool.is_empty()).ok_or_else(few)?;
        let of_sample = |sample: &Sample| {
            let r = whitener.residual(sample.window, &sample.raw);
            squared(&r) / r.len() as f64
        };
        // Summed in order: the same bits on any number of threads.
        let floor: Vec<f64> = samples.par_iter().map(of_sample).collect();
        self.floor += floor.iter().sum::<f64>() / samples.len() as f64;
        let seen: Vec<Option<LinearisedWindow>> = windows
            .into_par_iter()
            .enumerate()
            .zip(raw.into_par_iter().zip(traces))
            .zip(sensitivities)
            .map(|(((index, window), (raw, trace)), sensitivity)| {
                let is_whole = !raw.is_empty() && !sensitivity.is_empty();
                is_whole.then(|| see(&whitener, (index, window), (raw, trace), &sensitivity))
            })
            .collect();
        for (k, run) in ghost_raw.iter().enumerate() {
            let residual = |(raw, seen): (&Raw, &Option<LinearisedWindow>)| {
                let seen = seen.as_ref()?;
                Some((!raw.is_empty()).then(|| whitener.residual(seen.index, raw)))
            };
            let residuals: Vec<Option<Vec<f64>>> = run.par_iter().zip(&seen).filter_map(residual).collect();
            let here: Vec<&LinearisedWindow> = seen.iter().flatten().collect();
            let normal = |(r, seen): (&Option<Vec<f64>>, &&LinearisedWindow)| r.as_ref().map(|r| seen.normal_of(r));
            self.replicates[k].par_extend(residuals.par_iter().zip(here.par_iter()).map(normal));
            self.ghost_residuals[k].extend(residuals);
        }
        let first = self.seen.len();
        self.seen.extend(seen.into_iter().flatten());
        self.seen[first..].iter_mut().filter(|_| !pool.is_empty()).for_each(LinearisedWindow::weigh);
        self.parts.push(RunProblem { whitener, noise, alignment });
        self.count(steps);
        Ok(())
    }

    /// Simulated steps so far.
    pub fn steps(&self) -> usize {
        self.steps.load(Ordering::Relaxed)
    }

    /// Simulated steps since this was asked last.
    pub(crate) fn steps_since(&self) -> usize {
        let steps = self.steps();
        steps - self.steps_reported.swap(steps, Ordering::Relaxed)
    }

    /// Adds steps that were simulated elsewhere.
    pub fn count(&self, steps: usize) {
        self.steps.fetch_add(steps, Ordering::Relaxed);
    }

    /// Whether a group's effect is known, could show here, and is a cause.
    pub fn may_be(&self, group: &Group) -> bool {
        let joints = self.rollout.columns.len();
        !self.columns.effects[group.effect].nuisance
            && !self.ablated.contains(&group.effect)
            && !is_unshown(&self.columns, group, &self.at_rest, joints)
    }

    /// The null of a window's run.
    pub fn whitener(&self, seen: &LinearisedWindow) -> &Whitener {
        &self.parts[seen.window.run].whitener
    }

    /// Number of columns, the extra ones included.
    pub fn width(&self) -> usize {
        EXTRA + self.columns.columns.len()
    }

    /// Deviations integrated out over the windows with `weight` above 0.
    ///
    /// # Errors
    /// When the normal equations are no good.
    pub fn marginal(&self, weight: impl Fn(&LinearisedWindow) -> f64) -> Result<Marginal, GapError> {
        let mut h = Matrix::zeros(self.width(), self.width());
        for seen in &self.seen {
            let w = weight(seen);
            if w > 0.0 {
                add_scaled_matrix(&mut h, w, &seen.h);
            }
        }
        Marginal::new(h, &self.tolerance).ok_or_else(|| GapError::run("sensitivities", "finite numbers", "others"))
    }

    /// Normal equations of each window under each setting; `None` where the simulation ran away.
    ///
    /// # Errors
    /// When a setting has a value that means nothing.
    pub fn evaluate(&self, settings: &[Overrides], windows: &[usize]) -> Result<Vec<Vec<Option<Normal>>>, GapError> {
        let mut all = Vec::new();
        for some in settings.chunks(AT_A_TIME) {
            let raw = self.raw(some, windows)?;
            let of_window = |(k, &w): (usize, &usize)| {
                let all: Vec<&Raw> = raw.iter().map(|of_setting| &of_setting[k]).collect();
                self.seen[w].normals(self.whitener(&self.seen[w]), &all)
            };
            let mut by_window: Vec<std::vec::IntoIter<Option<Normal>>> =
                windows.par_iter().enumerate().map(of_window).map(Vec::into_iter).collect();
            all.extend((0..some.len()).map(|_| by_window.iter_mut().map(|w| w.next().flatten()).collect()));
        }
        Ok(all)
    }

    /// Whitened residuals of windows under settings, shape `[settings][windows]`.
    ///
    /// # Errors
    /// When a setting has a value that means nothing.
    #[allow(clippy::type_complexity)]
    pub(crate) fn raw_vectors(
        &self,
        settings: &[Overrides],
        windows: &[usize],
    ) -> Result<Vec<Vec<Option<Vec<f64>>>>, GapError> {
        let raw = self.raw(settings, windows)?;
        let white = |(raw, &w): (&Raw, &usize)| {
            (!raw.is_empty()).then(|| self.whitener(&self.seen[w]).residual(self.seen[w].index, raw))
        };
        Ok(raw.par_iter().map(|of_setting| of_setting.iter().zip(windows).map(white).collect()).collect())
    }

    /// Raw residuals of windows under settings, shape `[settings][windows]`.
    ///
    /// # Errors
    /// When a setting has a value that means nothing.
    pub fn raw(&self, settings: &[Overrides], windows: &[usize]) -> Result<Vec<Vec<Raw>>, GapError> {
        let chosen: Vec<&Window> = windows.iter().map(|&w| &self.seen[w].window).collect();
        let residuals = compare(&self.rollout, &self.rollout.numerics, &chosen, settings)?;
        Ok(self.with_law(&chosen, windows, settings, residuals))
    }

    /// The same of one setting, and what joints did in the windows that no fit sees. It takes no more steps.
    pub(crate) fn raw_and_traces(
        &self,
        setting: &Overrides,
        windows: &[usize],
    ) -> Result<(Vec<Raw>, Vec<Option<Trace>>), GapError> {
        let chosen: Vec<&Window> = windows.iter().map(|&w| &self.seen[w].window).collect();
        let settings = std::slice::from_ref(setting);
        let TracedResiduals { residuals, traces } =
            compare_and_trace(&self.rollout, &self.rollout.numerics, &chosen, settings)?;
        Ok((self.with_law(&chosen, windows, settings, residuals).remove(0), traces))
    }

    fn with_law(
        &self,
        chosen: &[&Window],
        windows: &[usize],
        settings: &[Overrides],
        residuals: Residuals,
    ) -> Vec<Vec<Raw>> {
        self.count(residuals.steps);
        let readings: Vec<Reading> = chosen.iter().map(|w| self.parts[w.run].reading()).collect();
        let law =
            |&w: &usize| NominalLaw { residual: &self.seen[w].raw.law, state_noise: &self.seen[w].raw.state_noise };
        let laws = windows.iter().map(law).collect();
        beside_law(&self.rollout, &readings, (chosen, laws), settings, residuals.values)
    }

    /// Sums over windows of one setting.
    pub fn sums(
        &self,
        normals: &[Option<Normal>],
        windows: &[usize],
        weight: impl Fn(&LinearisedWindow) -> f64,
    ) -> Sums {
        let parts = normals.iter().zip(windows).filter_map(|(n, &w)| n.as_ref().map(|n| (n, weight(&self.seen[w]))));
        sum(parts, self.width())
    }

    /// Sums of the nominal robot.
    pub fn nominal(&self, weight: impl Fn(&LinearisedWindow) -> f64) -> Sums {
        let normals: Vec<Normal> = self.seen.iter().map(LinearisedWindow::nominal).collect();
        let parts = normals.iter().zip(&self.seen).map(|(n, s)| (n, weight(s)));
        sum(parts, self.width())
    }
}

impl LinearisedWindow {
    /// Weighs it down where even reference recordings have nothing like it.
    pub(crate) fn weigh(&mut self) {
        let length = squared(&self.residual) / self.residual.len() as f64;
        self.weight = (reference::OUTLIER / length).min(1.0);
    }

    /// Normal equations of raw residuals; `None` of empty ones.
    fn normals(&self, whitener: &Whitener, raw: &[&Raw]) -> Vec<Option<Normal>> {
        let whole: Vec<&&Raw> = raw.iter().filter(|r| !r.is_empty()).collect();
        let residuals: Vec<Vec<f64>> = whole.iter().map(|r| whitener.residual(self.index, r)).collect();
        if residuals.is_empty() {
            return vec![None; raw.len()];
        }
        // One product: the sensitivities are read once for all.
        let products: Vec<Vec<f64>> = if residuals.len() <= FEW_ROWS {
            residuals.iter().map(|r| transposed_times(&self.j, r)).collect()
        } else {
            let all = transposed_product(&self.j, &from_columns(self.residual.len(), &residuals));
            (0..all.ncols()).map(|k| all.col_as_slice(k).to_vec()).collect()
        };
        let normal = |(r, b): (&Vec<f64>, Vec<f64>)| Normal { b, e: squared(r), count: r.len() };
        let mut normals = residuals.iter().zip(products).map(normal);
        raw.iter().map(|r| if r.is_empty() { None } else { normals.next() }).collect()
    }

    /// Normal equations of the nominal robot.
    pub fn nominal(&self) -> Normal {
        self.normal_of(&self.residual)
    }

    /// Normal equations of a whitened residual.
    pub(crate) fn normal_of(&self, r: &[f64]) -> Normal {
        Normal { b: transposed_times(&self.j, r), e: squared(r), count: r.len() }
    }
}

fn ghosts_of(free: bool, effort: &NullOptions) -> usize {
    if free { effort.replicates } else { HELD * effort.replicates }
}

fn see(
    whitener: &Whitener,
    (index, window): (usize, Window),
    (raw, trace): (Raw, Option<Trace>),
    sensitivity: &[Raw],
) -> LinearisedWindow {
    let j = whitener.differences(index, &sensitivity.iter().collect::<Vec<_>>());
    let residual = whitener.residual(index, &raw);
    LinearisedWindow { h: gram(&j), j, residual, raw, trace, index, window, weight: 1.0 }
}

/// Numbers that the simulators of replicates have: what engines differ in.
fn numerics(k: usize) -> Numerics {
    let base = Numerics::default();
    match k % 4 {
        0 => base,
        1 => Numerics { timestep: 0.0005, impratio: 1.0, ..base },
        2 => Numerics { timestep: 0.00125, impratio: 100.0, implicit: false },
        _ => Numerics { timestep: 0.0005, impratio: 3.0, implicit: false },
    }
}

/// Raw residuals of windows recorded of replicates, shape `[replicates][windows]`, and their deviations in columns.
#[allow(clippy::type_complexity)]
fn replicates(
    rollout: &Rollout,
    columns: &Columns,
    windows: &[Window],
    noise: &Noise,
    (effort, run): (&NullOptions, usize),
    steps: &mut usize,
) -> Result<(Vec<Vec<Raw>>, Vec<Vec<f64>>), GapError> {
    // What a replicate is, what it takes and what is left of it; side by side, as each alone is too little for all threads.
    let one = |k: usize| -> Result<(Vec<Raw>, Vec<f64>, usize), GapError> {
        let (mut setting, of_columns) = draw(rollout, columns, effort.seed, k as u64);
        other_contact(rollout, &mut setting, effort.seed, k as u64);
        // The robot is the same in all runs, the noise is not.
        let seed = effort.seed.wrapping_add(977 * k as u64 + 31 * run as u64);
        let replicate = Replicate { setting, numerics: numerics(k), seed, ground_error: effort.ground_error };
        let recorded = record(rollout, windows, noise, std::slice::from_ref(&replicate))?.remove(0);
        let ticks = ((rollout.cut.window + 2.0 * rollout.cut.margin) / replicate.numerics.timestep) as usize;
        let mut steps = windows.len() * ticks;
        let (at, whole): (Vec<usize>, Vec<&Window>) =
            recorded.iter().enumerate().filter_map(|(w, r)| r.as_ref().map(|r| (w, r))).unzip();
        let mut raw = vec![Raw::default(); windows.len()];
        if !whole.is_empty() {
            let residuals = compare(rollout, &rollout.numerics, &whole, &[Overrides::new()])?;
            steps += residuals.steps;
            let reading = Reading { alignment: law::align(rollout, &whole), noise: None };
            let found =
                with_law(rollout, &vec![reading; whole.len()], &whole, &[Overrides::new()], residuals.values).remove(0);
            at.into_iter().zip(found).for_each(|(w, r)| raw[w] = r);
        }
        Ok((raw, of_columns, steps))
    };
    let found: Vec<_> =
        (0..ghosts_of(rollout.free, effort)).into_par_iter().map(one).collect::<Result<_, GapError>>()?;
    let (mut all, mut deviations) = (Vec::new(), Vec::new());
    for (raw, of_columns, taken) in found {
        all.push(raw);
        deviations.push(of_columns);
        *steps += taken;
    }
    Ok((all, deviations))
}

/// Contact as other engines have it: what they call stiff differs by factors.
fn other_contact(rollout: &Rollout, setting: &mut Overrides, seed: u64, stream: u64) {
    let mut random = SplitMix64::of(seed, 5000 + stream);
    for (name, spread, range) in
        [("contact.time_constant", 0.5, (0.003, 0.016)), ("contact.damping_ratio", 0.3, (0.4, 2.0))]
    {
        let factor = random.normal(spread).exp();
        let Some(id) = rollout.parameter(name).filter(|_| !rollout.terrain.is_none()) else { continue };
        setting.retain(|s| s.0 != id);
        setting.push((id, (rollout.nominal[id] * factor).clamp(range.0, range.1)));
    }
    setting.sort_by_key(|s| s.0);
}

/// Deviations that any robot has: a setting, and the same in columns.
fn draw(rollout: &Rollout, columns: &Columns, seed: u64, stream: u64) -> (Overrides, Vec<f64>) {
    let mut random = SplitMix64::of(seed, 1 + stream);
    let (mut values, mut of_columns) = (Vec::new(), Vec::new());
    for column in &columns.columns[..columns.tolerated] {
        let unit = &columns.units[column.unit];
        let step = column.value - unit.absent;
        let deviation = random.normal(column.tolerance) * step;
        let effect = &columns.effects[unit.effect];
        // A friction below none means nothing.
        let one_sided = effect.range[0] >= unit.absent;
        let deviation = if one_sided { deviation.abs() } else { deviation };
        values.push((column.unit, unit.absent + deviation));
        of_columns.push(deviation / step);
    }
    (columns.setting(rollout, &values), of_columns)
}

/// Features of replicates with what their deviations do taken away: noise and numerics alone.
fn samples(
    windows: &[Window],
    sensitivities: &[Vec<Raw>],
    replicates: &[Vec<Raw>],
    deviations: &[Vec<f64>],
) -> Vec<Sample> {
    let one = |(run, deviation): (&Vec<Raw>, &Vec<f64>)| -> Vec<Sample> {
        let mut samples = Vec::new();
        for (window, (raw, columns)) in run.iter().zip(sensitivities).enumerate() {
            if raw.is_empty() || columns.is_empty() {
                continue;
            }
            let mut left = raw.clone();
            for (amount, column) in deviation.iter().zip(&columns[EXTRA..]) {
                left.motion.iter_mut().zip(&column.motion).for_each(|(x, c)| *x -= amount * c);
                left.law.iter_mut().zip(&column.law).for_each(|(x, c)| *x -= amount * c);
            }
            samples.push(Sample { window, moving: windows[window].moving, raw: left });
        }
        samples
    };
    replicates.par_iter().zip(deviations).flat_map_iter(one).collect()
}
