//! What windows leave under settings of the parameters, and what each column changes there.

use crate::GapError;
use crate::problem::columns::{Column, Columns};
use qv_rollout::Trace;
use qv_rollout::law::{self, ActuatorModel, Reading};
use qv_rollout::{Overrides, Rollout, Window};
use qv_rollout::{Raw, TracedResiduals, compare, compare_and_trace};
use rayon::prelude::*;

/// Settings simulated at a time: their features are in memory together.
pub(crate) const AT_A_TIME: usize = 96;
/// Change of the step between torques and positions whose effect is a column \[s\].
const SHIFT: f64 = 0.0005;
/// Share of what the noise of states leaves in a law that the correction for it has under the nominal robot: enough for what changes little, and
/// too little to count in the loss.
const AT_REST: f64 = 0.25;

/// The nominal robot in windows.
pub(crate) struct Nominal {
    /// Raw residuals, by window; empty where the simulation ran away.
    pub raw: Vec<Raw>,
    /// What joints did, by window; see [`compare_and_trace`].
    pub traces: Vec<Option<Trace>>,
}

/// The nominal robot and raw sensitivities, by window; empty where something ran away.
pub(crate) fn sensitivities(
    rollout: &Rollout,
    reading: Reading,
    columns: &Columns,
    windows: &[Window],
    steps: &mut usize,
) -> Result<(Nominal, Vec<Vec<Raw>>), GapError> {
    let chosen: Vec<&Window> = windows.iter().collect();
    let readings = vec![reading; chosen.len()];
    let TracedResiduals { residuals: base, traces } =
        compare_and_trace(rollout, &rollout.numerics, &chosen, &[Overrides::new()])?;
    *steps += base.steps;
    let raw = with_law(rollout, &readings, &chosen, &[Overrides::new()], base.values).remove(0);
    let mut sensitivities: Vec<Vec<Raw>> =
        raw.iter().zip(windows).map(|(r, w)| vec![shift_column(rollout, reading, w, r)]).collect();
    let all: Vec<&Column> = columns.columns.iter().collect();
    let found = changes(rollout, columns, &all, (&chosen, &readings, &raw), steps)?;
    for (all, of_window) in sensitivities.iter_mut().zip(found) {
        match of_window.into_iter().collect::<Option<Vec<Raw>>>() {
            Some(rest) => all.extend(rest),
            None => all.clear(),
        }
    }
    Ok((Nominal { raw, traces }, sensitivities))
}

/// What some columns change in windows with their readings and raw residuals, shape `[windows][columns]`; `None` where something ran
/// away.
pub(crate) fn changes(
    rollout: &Rollout,
    columns: &Columns,
    some: &[&Column],
    (windows, readings, raw): (&[&Window], &[Reading], &[Raw]),
    steps: &mut usize,
) -> Result<Vec<Vec<Option<Raw>>>, GapError> {
    let mut settings: Vec<Overrides> = some.iter().map(|c| columns.setting(rollout, &[(c.unit, c.value)])).collect();
    // Latencies cost memory: those that have one are simulated together.
    let mut order: Vec<usize> = (0..settings.len()).collect();
    order.sort_by_key(|&k| rollout.longest_latency(&settings[k]) > 0.0);
    let mut found: Vec<Vec<Option<Raw>>> = vec![vec![None; settings.len()]; windows.len()];
    for at in order.chunks(AT_A_TIME) {
        let of_some: Vec<Overrides> = at.iter().map(|&k| std::mem::take(&mut settings[k])).collect();
        let residuals = compare(rollout, &rollout.numerics, windows, &of_some)?;
        *steps += residuals.steps;
        for (&k, of_setting) in at.iter().zip(with_law(rollout, readings, windows, &of_some, residuals.values)) {
            for (w, changed) in of_setting.into_iter().enumerate() {
                if !changed.is_empty() && !raw[w].is_empty() {
                    found[w][k] = Some(raw[w].minus(&changed));
                }
            }
        }
    }
    Ok(found)
}

/// What torques that are older than the positions beside them change.
fn shift_column(rollout: &Rollout, reading: Reading, window: &Window, raw: &Raw) -> Raw {
    let Reading { alignment, noise } = reading;
    let alignment = law::Alignment { state: alignment.state + SHIFT, ..alignment };
    let shifted = law::residual(rollout, window, &Overrides::new(), alignment);
    let law = raw.law.iter().zip(shifted).map(|(a, b)| a - b).collect();
    let kept = noises(rollout, window, Reading { alignment, noise });
    let state_noise = raw.state_noise.iter().zip(kept).map(|(&nominal, kept)| nominal - corrected(nominal, kept));
    Raw { motion: vec![0.0; raw.motion.len()], law, state_noise: state_noise.collect() }
}

/// What noise of the states leaves in each law of the nominal robot, shape `[law joints]` \[N² m²\].
fn noises(rollout: &Rollout, window: &Window, reading: Reading) -> Vec<f64> {
    let none = Overrides::new();
    let of = |&joint: &usize| reading.left_by_noise(rollout, window, &ActuatorModel::new(rollout, &none, joint));
    rollout.law_joints.iter().map(of).collect()
}

/// The correction of a law under a setting, where noise leaves `kept` \[N² m²\], and that of the nominal robot is `nominal` \[N m\].
fn corrected(nominal: f64, kept: f64) -> f64 {
    let at_first = nominal * nominal / AT_REST;
    (nominal * nominal + at_first - kept).max(0.0).sqrt()
}

/// The laws' residuals of the nominal robot in a window, and what corrects their squares.
pub(crate) struct NominalLaw<'a> {
    /// Shape `[law joints, bins]`.
    pub residual: &'a [f64],
    /// Shape `[law joints]`.
    pub state_noise: &'a [f64],
}

/// The law's residuals beside those of the motion.
pub(crate) fn with_law(
    rollout: &Rollout,
    readings: &[Reading],
    windows: &[&Window],
    settings: &[Overrides],
    motion: Vec<Vec<Vec<f64>>>,
) -> Vec<Vec<Raw>> {
    let of = |(w, r): (&&Window, &Reading)| {
        let state_noise = noises(rollout, w, *r).iter().map(|kept| (AT_REST * kept).sqrt()).collect();
        (law::residual(rollout, w, &Overrides::new(), r.alignment), state_noise)
    };
    let nominal: Vec<(Vec<f64>, Vec<f64>)> = windows.par_iter().zip(readings).map(of).collect();
    let nominal = nominal.iter().map(|(residual, state_noise)| NominalLaw { residual, state_noise }).collect();
    beside_law(rollout, readings, (windows, nominal), settings, motion)
}

/// The same where the law's residuals of the nominal robot are known in each window.
pub(crate) fn beside_law(
    rollout: &Rollout,
    readings: &[Reading],
    (windows, nominal): (&[&Window], Vec<NominalLaw>),
    settings: &[Overrides],
    motion: Vec<Vec<Vec<f64>>>,
) -> Vec<Vec<Raw>> {
    let bins = law::bins(rollout);
    let joints = || rollout.law_joints.iter().copied().enumerate();
    settings
        .par_iter()
        .zip(motion)
        .map(|(setting, motion)| {
            let concerned = joints().filter(|&(_, j)| law::concerns(rollout, setting, j));
            let laws: Vec<(usize, ActuatorModel)> =
                concerned.map(|(k, j)| (k, ActuatorModel::new(rollout, setting, j))).collect();
            let one = |(w, motion): (usize, Vec<f64>)| {
                let mut law = nominal[w].residual.to_vec();
                let mut state_noise = nominal[w].state_noise.to_vec();
                for (k, of_setting) in &laws {
                    let values = law::of_joint(rollout, windows[w], of_setting, readings[w].alignment);
                    law[k * bins..(k + 1) * bins].copy_from_slice(&values);
                    let kept = readings[w].left_by_noise(rollout, windows[w], of_setting);
                    state_noise[*k] = corrected(state_noise[*k], kept);
                }
                let whole = law.iter().all(|x| x.is_finite());
                if motion.is_empty() || !whole { Raw::default() } else { Raw { motion, law, state_noise } }
            };
            motion.into_iter().enumerate().map(one).collect()
        })
        .collect()
}
