//! What a recording cannot determine, and why: channels that it lacks, effects that it does not excite or that look alike in it.

use super::narrative::one_without_poses;
use crate::inference::linearised::LinearisedProblem;
use crate::inference::search::{direction, fitted};
use crate::problem::columns::Suspect;
use crate::problem::library::Effect;
use qv_fit::linear::{add_scaled, add_scaled_matrix, dot, product, times, transposed_product, transposed_times};
use qv_fit::{Cholesky, Matrix};
use qv_recording::Run;

/// Cosine of the angle between sensitivities from which effects count as alike.
const ALIKE: f64 = 0.75;

/// Effects that this recording cannot show, and channels whose lack is the reason.
pub fn missing(study: &LinearisedProblem, run: &Run, library: &[Effect]) -> Vec<String> {
    let m = &run.measured;
    let mut remarks = Vec::new();
    if study.rollout.on_legs {
        remarks.push(
            "no poses of the base were measured: windows start where its legs and its IMU say that it is, feet that slip at the start of one go \
             unnoticed, and where on the floor a cause lies cannot be determined"
                .to_string(),
        );
    }
    if m.torque.is_none() {
        remarks.push(
            "joint torques were not measured: what the motors do cannot be stated from what the links do".to_string(),
        );
    }
    if study.rollout.free && m.orientation.is_none() {
        remarks.push("there is no IMU orientation: tilt of the IMU and delay of the pose cannot be stated".to_string());
    }
    let lacking = lacking(study, library);
    if !lacking.is_empty() {
        remarks.push(format!("no channel or part of this robot could show {}", lacking.join(", ")));
    }
    remarks.extend(judged(study, run));
    remarks.extend(strangers(study, run));
    remarks.extend(resting(study));
    if study.rollout.free && m.gyro.is_none() {
        remarks.push("there is no gyroscope: its bias cannot be stated".to_string());
    }
    let weak = weak_of_measured(study, run);
    if !weak.is_empty() {
        remarks.push(format!("too little excitation to identify {}", weak.join(", ")));
    }
    remarks
}

/// Effects that this recording cannot show, by name: no channel or part could, or there is too little excitation.
pub fn cannot_show(study: &LinearisedProblem, run: &Run, library: &[Effect]) -> Vec<String> {
    let mut names: Vec<String> = lacking(study, library).into_iter().map(str::to_owned).collect();
    names.extend(weak_of_measured(study, run));
    if !study.at_rest.is_empty() && study.at_rest.len() == study.rollout.columns.len() {
        names.push("pose_delay".into());
    }
    names.sort();
    names.dedup();
    names
}

fn lacking<'l>(study: &LinearisedProblem, library: &'l [Effect]) -> Vec<&'l str> {
    let has = |e: &&Effect| study.columns.effects.iter().any(|s| s.name == e.name);
    // What is looked for in other robots alone is no lack of this recording.
    let is_sought = |e: &&Effect| !(study.rollout.free && e.held_only);
    library.iter().filter(|e| is_sought(e) && !has(e)).map(|e| e.name.as_str()).collect()
}

/// Effects with too little excitation. What has no channel of its own lacks none.
fn weak_of_measured(study: &LinearisedProblem, run: &Run) -> Vec<String> {
    let m = &run.measured;
    let is_measured = |effect: &String| match effect.as_str() {
        "gyro_bias" => m.gyro.is_some(),
        "imu_tilt" | "pose_delay" => m.orientation.is_some(),
        _ => true,
    };
    weak(study).into_iter().filter(is_measured).collect()
}

/// How much of the recording could be judged, where that is less than half.
fn judged(study: &LinearisedProblem, run: &Run) -> Option<String> {
    let cut = study.rollout.cut;
    let [first, last] = run.span();
    let windows = study.seen.iter().filter(|s| s.window.run == 0);
    let (count, [from, until]) = windows.fold((0, [f64::INFINITY, f64::NEG_INFINITY]), |(n, [from, until]), s| {
        (n + 1, [from.min(s.window.start), until.max(s.window.start + cut.window)])
    });
    let whole = (((last - first) / cut.window) as usize).min(cut.most);
    (2 * count < whole).then(|| {
        format!(
            "{count} of {whole} windows of {} s could be judged, from {from:.1} to {until:.1} s of {first:.1} to {last:.1} s: the others lack \
             values of a channel or jump",
            cut.window
        )
    })
}

/// Joints of the recording that the model lacks, and joints of the model that nothing commands: one name written in two ways makes both.
fn strangers(study: &LinearisedProblem, run: &Run) -> Vec<String> {
    let columns = &study.rollout.columns;
    let unknown =
        run.joint_names.iter().enumerate().filter(|(k, _)| !columns.contains(k)).map(|(_, name)| name.as_str());
    let unknown: Vec<&str> = unknown.collect();
    let is_used = |name: &&str| columns.iter().any(|k| run.joint_names[*k] == *name);
    let silent: Vec<&str> = run.uncommanded().into_iter().filter(is_used).collect();
    let mut remarks = Vec::new();
    if !unknown.is_empty() {
        remarks.push(format!("joints of the recording that the model lacks are left out: {}", unknown.join(", ")));
    }
    if !silent.is_empty() {
        remarks.push(format!("no commands were recorded of {}: they are taken for 0", silent.join(", ")));
    }
    remarks
}

/// Joints at rest, and what they cannot show.
fn resting(study: &LinearisedProblem) -> Option<String> {
    let names = study.rollout.model.joint_names();
    let resting: Vec<&str> = study.at_rest.iter().map(|&j| names[j].as_str()).collect();
    let (whose, what) = match resting.len() {
        0 => return None,
        all if all == study.rollout.columns.len() => ("no joint moves: no delay of the pose,".to_string(), ""),
        _ => (format!("{} hardly move: no", resting.join(", ")), " of them"),
    };
    Some(format!("{whose} latency, lag, velocity gain, viscous friction or rotor inertia{what} is identified"))
}

/// Effects whose value this recording leaves open by more than half of their range.
fn weak(study: &LinearisedProblem) -> Vec<String> {
    let Ok(marginal) = study.marginal(fitted) else { return Vec::new() };
    let mut weak: Vec<String> = Vec::new();
    for (index, effect) in study.columns.effects.iter().enumerate() {
        let group = study.columns.groups.iter().position(|g| g.effect == index);
        let open = |level: usize| {
            let Some(d) = group.and_then(|g| direction(&study.columns, g, level)) else { return true };
            let h = transposed_product(&d.d, &product(&marginal.curvature, &d.d));
            // A limit that never bites has no curvature at any level.
            (0..d.steps.len()).all(|a| {
                h[(a, a)] < 1e-9 || d.steps[a].abs() / h[(a, a)].sqrt() > 0.25 * effect.span().max(d.steps[a].abs())
            })
        };
        if (0..effect.levels.len()).all(open) {
            weak.push(effect.name.clone());
        }
    }
    weak
}

/// Effects whose sensitivities point nearly the same way as a suspect's.
pub fn confusable(study: &LinearisedProblem, suspect: &Suspect) -> Vec<String> {
    let columns = &study.columns;
    let Some(own) = direction(columns, suspect.group, 0) else { return Vec::new() };
    let mut h = Matrix::zeros(study.width(), study.width());
    study.seen.iter().for_each(|s| add_scaled_matrix(&mut h, fitted(s), &s.h));
    // Along the values that were found.
    let mut along = vec![0.0; study.width()];
    for (axis, value) in suspect.values.iter().enumerate() {
        let absent = if own.absent[axis].is_finite() { own.absent[axis] } else { value - own.steps[axis] };
        add_scaled(&mut along, (value - absent) / own.steps[axis], own.d.col_as_slice(axis));
    }
    let length = dot(&along, &times(&h, &along)).sqrt();
    let names = &columns.groups[suspect.group].names;
    let mut alike: Vec<(f64, String)> = Vec::new();
    for (index, group) in columns.groups.iter().enumerate() {
        let effect = &columns.effects[group.effect];
        if group.effect == columns.groups[suspect.group].effect || (group.names != *names && group.names != ["all"]) {
            continue;
        }
        let Some(other) = direction(columns, index, 0) else { continue };
        // The angle to the space that the other effect's axes span.
        let hd = product(&h, &other.d);
        let projection = transposed_times(&hd, &along);
        let Some(factor) = Cholesky::new(&transposed_product(&other.d, &hd)) else { continue };
        let cosine = factor.length(&projection).sqrt() / length.max(1e-300);
        if cosine > ALIKE && !alike.iter().any(|(_, name)| *name == effect.name) {
            alike.push((cosine, effect.name.clone()));
        }
    }
    alike.sort_by(|a, b| b.0.total_cmp(&a.0));
    let own = &columns.effects[columns.groups[suspect.group].effect].name;
    let mut names: Vec<String> = alike.into_iter().map(|a| a.1).collect();
    for other in one_without_poses(own).filter(|_| study.rollout.on_legs) {
        if columns.effects.iter().any(|e| e.name == other) && !names.iter().any(|n| n == other) {
            names.push(other.into());
        }
    }
    names
}
