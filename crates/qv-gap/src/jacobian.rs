//! What windows leave under settings of the parameters, and what each column changes there.

use crate::GapError;
use crate::problem::columns::{Column, Columns};
use qv_rollout::Trace;
use qv_rollout::law::{self, ActuatorModel};
use qv_rollout::{Overrides, Rollout, Window};
use qv_rollout::{Raw, TracedResiduals, compare, compare_and_trace};
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
    rollout: &Rollout,
    alignment: law::Alignment,
    columns: &Columns,
    windows: &[Window],
    steps: &mut usize,
) -> Result<(Nominal, Vec<Vec<Raw>>), GapError> {
    let chosen: Vec<&Window> = windows.iter().collect();
    let alignments = vec![alignment; chosen.len()];
    let TracedResiduals { residuals: base, traces } =
        compare_and_trace(rollout, &rollout.numerics, &chosen, &[Overrides::new()])?;
    *steps += base.steps;
    let raw = with_law(rollout, &alignments, &chosen, &[Overrides::new()], base.values).remove(0);
    let mut sensitivities: Vec<Vec<Raw>> =
        raw.iter().zip(windows).map(|(r, w)| vec![shift_column(rollout, alignment, w, r)]).collect();
    let all: Vec<&Column> = columns.columns.iter().collect();
    let found = changes(rollout, columns, &all, (&chosen, &alignments, &raw), steps)?;
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
    rollout: &Rollout,
    columns: &Columns,
    some: &[&Column],
    (windows, alignments, raw): (&[&Window], &[law::Alignment], &[Raw]),
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
        for (&k, of_setting) in at.iter().zip(with_law(rollout, alignments, windows, &of_some, residuals.values)) {
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
fn shift_column(rollout: &Rollout, alignment: law::Alignment, window: &Window, raw: &Raw) -> Raw {
    let shifted = law::Alignment { state: alignment.state + SHIFT, ..alignment };
    let shifted = law::residual(rollout, window, &Overrides::new(), shifted);
    let law = raw.law.iter().zip(shifted).map(|(a, b)| a - b).collect();
    Raw { motion: vec![0.0; raw.motion.len()], law }
}

/// The law's residuals beside those of the motion.
pub(crate) fn with_law(
    rollout: &Rollout,
    alignments: &[law::Alignment],
    windows: &[&Window],
    settings: &[Overrides],
    motion: Vec<Vec<Vec<f64>>>,
) -> Vec<Vec<Raw>> {
    let nominal: Vec<Vec<f64>> =
        windows.par_iter().zip(alignments).map(|(w, a)| law::residual(rollout, w, &Overrides::new(), *a)).collect();
    beside_law(rollout, alignments, (windows, nominal.iter().map(Vec::as_slice).collect()), settings, motion)
}

/// The same where the law's residuals of the nominal robot are known in each window.
pub(crate) fn beside_law(
    rollout: &Rollout,
    alignments: &[law::Alignment],
    (windows, nominal): (&[&Window], Vec<&[f64]>),
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
                let mut law = nominal[w].to_vec();
                for (k, of_setting) in &laws {
                    let values = law::of_joint(rollout, windows[w], of_setting, alignments[w]);
                    law[k * bins..(k + 1) * bins].copy_from_slice(&values);
                }
                let whole = law.iter().all(|x| x.is_finite());
                if motion.is_empty() || !whole { Raw::default() } else { Raw { motion, law } }
            };
            motion.into_iter().enumerate().map(one).collect()
        })
        .collect()
}
