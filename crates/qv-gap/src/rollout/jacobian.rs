//! What windows leave under settings of the parameters, and what each column changes there.

use crate::GapError;
use crate::problem::columns::{Column, Columns};
use crate::problem::{Overrides, Problem, Window};
use crate::rollout::actuator_model::{self, ActuatorModel};
use crate::rollout::windows::{Raw, Traced, compare, compare_and_trace, longest_latency};
use qv_replay::replay::Trace;
use rayon::prelude::*;

/// Settings simulated at a time: their features are in memory together.
pub(crate) const AT_A_TIME: usize = 96;
/// Change of the step between torques and positions whose effect is a column \[s\].
const SHIFT: f64 = 0.0005;

/// The nominal robot in windows.
pub(crate) struct Nominal {
    /// Raw residuals, by window; empty where the simulation ran away.
    pub raw: Vec<Raw>,
    /// What joints did, by window; see [`compare_and_trace`].
    pub traces: Vec<Option<Trace>>,
}

/// The nominal robot and raw sensitivities, by window; empty where something ran away.
pub(crate) fn sensitivities(
    problem: &Problem,
    alignment: actuator_model::Alignment,
    columns: &Columns,
    windows: &[Window],
    steps: &mut usize,
) -> Result<(Nominal, Vec<Vec<Raw>>), GapError> {
    let chosen: Vec<&Window> = windows.iter().collect();
    let alignments = vec![alignment; chosen.len()];
    let Traced { residuals: base, traces } =
        compare_and_trace(problem, &problem.numerics, &chosen, &[Overrides::new()])?;
    *steps += base.steps;
    let raw = with_law(problem, &alignments, &chosen, &[Overrides::new()], base.values).remove(0);
    let mut sensitivities: Vec<Vec<Raw>> =
        raw.iter().zip(windows).map(|(r, w)| vec![shift_column(problem, alignment, w, r)]).collect();
    let all: Vec<&Column> = columns.columns.iter().collect();
    let found = changes(problem, columns, &all, (&chosen, &alignments, &raw), steps)?;
    for (all, of_window) in sensitivities.iter_mut().zip(found) {
        match of_window.into_iter().collect::<Option<Vec<Raw>>>() {
            Some(rest) => all.extend(rest),
            None => all.clear(),
        }
    }
    Ok((Nominal { raw, traces }, sensitivities))
}

/// What some columns change in windows with their alignments and raw residuals, shape `[windows][columns]`; `None` where something ran
/// away.
pub(crate) fn changes(
    problem: &Problem,
    columns: &Columns,
    some: &[&Column],
    (windows, alignments, raw): (&[&Window], &[actuator_model::Alignment], &[Raw]),
    steps: &mut usize,
) -> Result<Vec<Vec<Option<Raw>>>, GapError> {
    let mut settings: Vec<Overrides> = some.iter().map(|c| columns.setting(problem, &[(c.unit, c.value)])).collect();
    // Latencies cost memory: those that have one are simulated together.
    let mut order: Vec<usize> = (0..settings.len()).collect();
    order.sort_by_key(|&k| longest_latency(problem, &settings[k]) > 0.0);
    let mut found: Vec<Vec<Option<Raw>>> = vec![vec![None; settings.len()]; windows.len()];
    for at in order.chunks(AT_A_TIME) {
        let of_some: Vec<Overrides> = at.iter().map(|&k| std::mem::take(&mut settings[k])).collect();
        let residuals = compare(problem, &problem.numerics, windows, &of_some)?;
        *steps += residuals.steps;
        for (&k, of_setting) in at.iter().zip(with_law(problem, alignments, windows, &of_some, residuals.values)) {
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
fn shift_column(problem: &Problem, alignment: actuator_model::Alignment, window: &Window, raw: &Raw) -> Raw {
    let shifted = actuator_model::Alignment { state: alignment.state + SHIFT, ..alignment };
    let shifted = actuator_model::residual(problem, window, &Overrides::new(), shifted);
    let law = raw.law.iter().zip(shifted).map(|(a, b)| a - b).collect();
    Raw { motion: vec![0.0; raw.motion.len()], law }
}

/// The law's residuals beside those of the motion.
pub(crate) fn with_law(
    problem: &Problem,
    alignments: &[actuator_model::Alignment],
    windows: &[&Window],
    settings: &[Overrides],
    motion: Vec<Vec<Vec<f64>>>,
) -> Vec<Vec<Raw>> {
    let nominal: Vec<Vec<f64>> = windows
        .par_iter()
        .zip(alignments)
        .map(|(w, a)| actuator_model::residual(problem, w, &Overrides::new(), *a))
        .collect();
    beside_law(problem, alignments, (windows, nominal.iter().map(Vec::as_slice).collect()), settings, motion)
}

/// The same where the law's residuals of the nominal robot are known in each window.
pub(crate) fn beside_law(
    problem: &Problem,
    alignments: &[actuator_model::Alignment],
    (windows, nominal): (&[&Window], Vec<&[f64]>),
    settings: &[Overrides],
    motion: Vec<Vec<Vec<f64>>>,
) -> Vec<Vec<Raw>> {
    let bins = actuator_model::bins(problem);
    let joints = || problem.law_joints.iter().copied().enumerate();
    settings
        .par_iter()
        .zip(motion)
        .map(|(setting, motion)| {
            let concerned = joints().filter(|&(_, j)| actuator_model::concerns(problem, setting, j));
            let laws: Vec<(usize, ActuatorModel)> =
                concerned.map(|(k, j)| (k, ActuatorModel::new(problem, setting, j))).collect();
            let one = |(w, motion): (usize, Vec<f64>)| {
                let mut law = nominal[w].to_vec();
                for (k, of_setting) in &laws {
                    let values = actuator_model::of_joint(problem, windows[w], of_setting, alignments[w]);
                    law[k * bins..(k + 1) * bins].copy_from_slice(&values);
                }
                let whole = law.iter().all(|x| x.is_finite());
                if motion.is_empty() || !whole { Raw::default() } else { Raw { motion, law } }
            };
            motion.into_iter().enumerate().map(one).collect()
        })
        .collect()
}
