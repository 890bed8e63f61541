//! Robots with a fixed base by their torque balance, or by the positions of their servos: from recordings to evidence.

use super::options::{Diagnosis, Options, PreparedRuns};
use super::progress;
use crate::GapError;
use crate::decision::evidence::{ActsOn, Comparison, EffectFacts, Evidence, FORMAT, ReportData};
use crate::findings::{Gap, HeatMap, JointShare, Level, Share, Stage, Timing, Traces, UNKNOWN, Where};
use crate::problem::library::{Effect, Interface};
use crate::report;
use qv_recording::Run;
use qv_recording::run::Base;
use qv_sim::Model;

/// Whether recordings are judged so: a fixed base; torques with references or a controller that can be simulated; or servos with references.
pub(super) fn is_weighed(prepared: &PreparedRuns) -> bool {
    let is_fixed = prepared.usable.first().is_some_and(|run| run.base == Base::Fixed);
    is_fixed && qv_held::can_measure(&prepared.usable, &prepared.reference)
}

/// The diagnosis, and those without each of the `leave_out` first effects. None where simulated robots do not follow the recording's commands, where
/// a piece of a reference of servos is too short, and where beside simulated robots something is there that no hypothesis explains: the path with
/// windows knows more effects, such as backlash and drift.
pub(super) fn diagnose(
    prepared: &PreparedRuns,
    model: &Model,
    options: &Options,
    leave_out: usize,
) -> Result<Option<Diagnosis>, GapError> {
    let Some((evidence, report)) = one(prepared, model, options, &options.without)? else { return Ok(None) };
    if prepared.reference.is_empty() && report.verdict == report::Verdict::Unexplained {
        return Ok(None);
    }
    let mut without = Vec::new();
    for ranked in report.ranking.iter().filter(|r| r.effect != UNKNOWN).take(leave_out) {
        let names = [&options.without[..], std::slice::from_ref(&ranked.effect)].concat();
        if let Some((evidence, report)) = one(prepared, model, options, &names)? {
            without.push((ranked.effect.clone(), report, evidence));
        }
    }
    Ok(Some(Diagnosis { report, evidence, without }))
}

fn one(
    prepared: &PreparedRuns,
    model: &Model,
    options: &Options,
    without: &[String],
) -> Result<Option<(Evidence, report::Report)>, GapError> {
    let now = || options.clock.map_or(0.0, |clock| clock());
    let begun = now();
    if let Some(notify) = options.progress {
        notify(&progress::Plan::new(false, 0).begin(progress::SEARCH));
    }
    let request = qv_held::Request {
        runs: &prepared.usable,
        references: &prepared.reference,
        model,
        given: &options.given,
        without,
        seed: options.effort.seed,
        policy: &options.policy.held,
    };
    let held = match qv_held::measure(&request) {
        Err(qv_held::HeldError::Fleet(..) | qv_held::HeldError::Short(..)) => return Ok(None),
        measured => measured?,
    };
    let named = match qv_held::decide(&held, &options.policy.held).outcome {
        qv_held::Outcome::Cause(k, _) => Some(&held.tested[k]),
        qv_held::Outcome::Pair(k, _) => Some(&held.pairs[k].test),
        _ => None,
    };
    let torque_traces = held.torque_traces(named).into_iter().map(rounded).collect();
    let seconds = now() - begun;
    let evidence = Evidence {
        format: FORMAT.into(),
        is_free: false,
        joints: model.joint_names().to_vec(),
        effects: options.library.iter().map(|e| facts(e, without)).collect(),
        level: Level { ratio: held.loss / held.reference_loss(), null: held.reference_loss(), count: f64::NAN },
        held_out: [held.loss, held.reference_loss()],
        rounds: Vec::new(),
        corrected: None,
        report: Some(data(prepared, &held, torque_traces, seconds)),
        camera: None,
        held: Some(held),
    };
    let report = report::report(&evidence, &options.policy)?;
    Ok(Some((evidence, report)))
}

/// A trace to a ten-thousandth of its units, as is seen of it.
fn rounded(mut trace: qv_held::TorqueTrace) -> qv_held::TorqueTrace {
    let t = &mut trace;
    let all = [&mut t.time, &mut t.speed, &mut t.measured, &mut t.predicted, &mut t.corrected, &mut t.friction];
    all.into_iter().flatten().for_each(|x| *x = (*x * 1e4).round() * 1e-4);
    trace
}

fn facts(effect: &Effect, without: &[String]) -> EffectFacts {
    EffectFacts {
        name: effect.name.clone(),
        acts_on: ActsOn::Other,
        is_known: !without.contains(&effect.name),
        interface: effect.interface.name().into(),
        experiment: effect.experiment.clone(),
    }
}

/// What a report shows of the robot as it is stated.
fn data(
    prepared: &PreparedRuns,
    held: &qv_held::Evidence,
    torque_traces: Vec<qv_held::TorqueTrace>,
    seconds: f64,
) -> ReportData {
    let floor = held.reference_loss();
    let gap = Gap {
        before: held.loss,
        after: held.loss,
        floor,
        closed: 0.0,
        closed_ci95: [0.0; 2],
        closed_in_fit: None,
        unit: unit(held),
        heldout: true,
        joint_rms: [f64::NAN; 2],
        joint_rms_apart: None,
    };
    let left: f64 = held.joints.iter().map(square_share).sum();
    let share = |j: &qv_held::JointRow| JointShare {
        name: j.joint.clone(),
        share: square_share(j) / left.max(1e-300),
        pos_rms: f64::NAN,
    };
    let mut cannot_tell = prepared.cannot_tell.clone();
    if prepared.reference.len() == 1 {
        cannot_tell.push(
            "One reference: how the robot differs from day to day is not known. Record references on several days, warm and cold.".into(),
        );
    }
    if held.is_fleet {
        cannot_tell.push(format!(
            "No reference: {} simulated robots within the tolerances stand for the robot as it should be. What lies within the tolerances is no cause.",
            held.references
        ));
    }
    if held.spikes > 0 {
        cannot_tell.push(format!("{} single samples that jumped out and back were replaced", held.spikes));
    }
    ReportData {
        title: String::new(),
        notes: Vec::new(),
        recordings: prepared.usable.len(),
        on_legs: false,
        fall: None,
        dead: Vec::new(),
        cannot_tell,
        cannot_show: Vec::new(),
        can_tell: Vec::new(),
        place: Where { joints: held.joints.iter().map(share).collect(), ..Where::default() },
        interfaces: Interface::ALL.map(|i| Share { name: i.name().into(), share: 0.0 }).into(),
        leads: Vec::new(),
        together: None,
        stated: Comparison {
            gap,
            depends_on: Vec::new(),
            heat_map: HeatMap::default(),
            floor_plan: Vec::new(),
            curves: Vec::new(),
            corrections: Vec::new(),
        },
        corrected: None,
        causes: Vec::new(),
        traces: Traces::default(),
        joint_rows: held.joints.clone(),
        torque_traces,
        stages: vec![Stage {
            name: if held.is_of_positions { "position error" } else { "torque balance" }.into(),
            steps: 0,
        }],
        timing: Timing { runtime_s: seconds, stages_s: vec![seconds] },
        provenance: None,
    }
}

/// What a loss is.
fn unit(held: &qv_held::Evidence) -> String {
    let channel = if held.is_of_positions { "position" } else { "torque" };
    let null = if held.is_fleet { "simulated robots within the tolerances" } else { "references" };
    format!("mean squared normalized {channel} residual, 1 = {null}")
}

/// Square of what the stated robot leaves of a joint's torque, over that of the torque.
fn square_share(row: &qv_held::JointRow) -> f64 {
    (row.torque[1] / row.torque[0].max(1e-12)).powi(2)
}

/// Friction and rotor of each joint, for the report of a diagnosis that is not decided by them; empty for a free base.
pub(super) fn joint_rows(runs: &[Run], model: &Model, options: &Options) -> Vec<qv_held::JointRow> {
    if runs.first().is_none_or(|run| run.base == Base::Free) {
        return Vec::new();
    }
    qv_held::joint_table(&qv_held::Request {
        runs,
        references: &[],
        model,
        given: &options.given,
        without: &[],
        seed: options.effort.seed,
        policy: &options.policy.held,
    })
}
