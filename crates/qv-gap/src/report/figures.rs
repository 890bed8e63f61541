//! What a report shows: errors by joint and time, the gap by place, joints before and after.

use crate::GapError;
use crate::inference::linearised::LinearisedProblem;
use crate::inference::regions::place;
use crate::report::{Curve, FloorPoint, HeatMap, Traces, traces};
use qv_fit::linear::squared;
use qv_rollout::Channel;
use qv_rollout::Overrides;
use qv_rollout::Raw;
use qv_rollout::channels;

/// Joints whose curves are shown.
const CURVES: usize = 4;

/// All of it.
pub struct Figures {
    /// Errors by joint and time.
    pub heat_map: HeatMap,
    /// The gap by place.
    pub floor_plan: Vec<FloorPoint>,
    /// Examples.
    pub curves: Vec<Curve>,
    /// Every joint.
    pub traces: Traces,
}

/// All pictures of a study, with the corrections as `setting`.
///
/// # Errors
/// When a value means nothing.
pub fn all(study: &mut LinearisedProblem, setting: &Overrides) -> Result<Figures, GapError> {
    let every: Vec<usize> = (0..study.seen.len()).collect();
    let (after, traces) = study.raw_and_traces(setting, &every)?;
    Ok(Figures {
        heat_map: heat_map(study, &after),
        floor_plan: floor_plan(study, &after),
        curves: curves(study, &after),
        traces: traces::traces(study, setting, &traces),
    })
}

/// The positions' residuals of a joint in a window.
fn of_joint<'r>(study: &LinearisedProblem, raw: &'r Raw, joint: usize) -> &'r [f64] {
    let bins = study.rollout.cut.bins();
    let mut first = 0;
    for &channel in &study.rollout.channels {
        let width = channels::width(channel, bins);
        if channel == Channel::Position(joint) && !raw.is_empty() {
            return &raw.motion[first..first + width];
        }
        first += width;
    }
    &[]
}

fn rms(values: &[f64]) -> f64 {
    if values.is_empty() { 0.0 } else { (values.iter().map(|x| x * x).sum::<f64>() / values.len() as f64).sqrt() }
}

fn heat_map(study: &LinearisedProblem, after: &[Raw]) -> HeatMap {
    let names = study.rollout.model.joint_names();
    let row = |raws: &mut dyn Iterator<Item = &Raw>, j: usize| raws.map(|raw| rms(of_joint(study, raw, j))).collect();
    HeatMap {
        joints: names.to_vec(),
        times: study.seen.iter().map(|s| s.window.start).collect(),
        before: (0..names.len()).map(|j| row(&mut study.seen.iter().map(|s| &s.raw), j)).collect(),
        after: (0..names.len()).map(|j| row(&mut after.iter(), j)).collect(),
    }
}

fn floor_plan(study: &LinearisedProblem, after: &[Raw]) -> Vec<FloorPoint> {
    if !study.rollout.free {
        return Vec::new();
    }
    let mut points = Vec::new();
    for (seen, raw) in study.seen.iter().zip(after) {
        let [x, y] = place(&seen.window);
        let level = |raw: &Raw| {
            let r = study.whitener(seen).residual(seen.index, raw);
            squared(&r) / r.len() as f64
        };
        if x.is_finite() && y.is_finite() && !raw.is_empty() {
            points.push(FloorPoint { x, y, before: level(&seen.raw), after: level(raw) });
        }
    }
    points
}

/// The joints with the largest error, each in the held-out window where it is largest.
fn curves(study: &LinearisedProblem, after: &[Raw]) -> Vec<Curve> {
    let mut worst: Vec<(f64, usize, usize)> = Vec::new();
    for j in 0..study.rollout.columns.len() {
        let held_out = (0..study.seen.len()).filter(|&w| study.seen[w].window.held_out && !after[w].is_empty());
        let of = |w: usize| (rms(of_joint(study, &study.seen[w].raw, j)), j, w);
        worst.extend(held_out.map(of).max_by(|a, b| a.0.total_cmp(&b.0)));
    }
    worst.sort_by(|a, b| b.0.total_cmp(&a.0));
    worst.iter().take(CURVES).filter_map(|&(_, j, w)| curve(study, &after[w], j, w)).collect()
}

fn curve(study: &LinearisedProblem, after: &Raw, joint: usize, window: usize) -> Option<Curve> {
    let seen = &study.seen[window];
    let (cut, column) = (study.rollout.cut, study.rollout.columns[joint]);
    let position = seen.window.view.measured.position.as_ref()?;
    let mut row = vec![0.0; position.joints];
    let time: Vec<f64> = (0..cut.bins()).map(|b| seen.window.start + (b as f64 + 0.5) * cut.bin).collect();
    let measured: Vec<f64> = time
        .iter()
        .map(|&t| {
            position.interpolate(t, &mut row);
            row[column]
        })
        .collect();
    let minus = |raw: &Raw| measured.iter().zip(of_joint(study, raw, joint)).map(|(m, r)| m - r).collect();
    let joint_name = study.rollout.model.joint_names()[joint].clone();
    Some(Curve { joint: joint_name, before: minus(&seen.raw), after: minus(after), time, measured })
}
