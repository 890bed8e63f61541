//! Where a URDF and a recording of its robot differ: limits that the recording contradicts (a robot that did it can do it),
//! joints that it says nothing of.

use crate::faults;
use crate::run::{FaultKind, Run};
use qv_core::JointSeries;
use qv_sim::{Joint, JointKind, Model};

/// The simulator takes a motor's torque away between a speed limit and a tenth above it, and recorders' torques are estimates:
/// less than a tenth contradicts nothing.
const BEYOND: f64 = 1.1;
/// Samples beyond a limit that contradict it: fewer are a slip of an encoder or an impact.
const LEAST: usize = 5;
/// Time over which a speed is a difference of positions \[s\]: noise of a milliradian is a twentieth of a radian a second then.
const SPAN: f64 = 0.02;

/// How far beyond a limit a position is before it contradicts it \[rad, m\]: stops yield, and zeros of encoders are off by a degree.
const BEYOND_STOP: [f64; 2] = [0.02, 0.002];

/// Takes those limits on position, speed and torque from the joints of `model` that `run` went beyond, and reports each: both
/// numbers.
///
/// Positions that may be degrees contradict nothing. Speeds are slopes of the measured positions over 20 ms, so that no convention of another sensor counts. Torques are used
/// where they are measured in this crate's convention.
pub fn lift(run: &Run, model: &mut Model) -> Vec<String> {
    let mut remarks = Vec::new();
    for joint in &mut model.joints {
        let Some(column) = run.joint_names.iter().position(|n| *n == joint.name) else { continue };
        lift_position(run, column, joint, &mut remarks);
        lift_velocity(run, column, joint, &mut remarks);
        lift_effort(run, column, joint, &mut remarks);
    }
    remarks
}

/// Joints of `model` that `run` has no position of, and where each is held: at its first command, else at the position
/// within its limits that is nearest to zero \[rad or m\]. Empty where the run has no position of any joint.
pub fn held(run: &Run, model: &Model) -> Vec<(String, f64)> {
    let column = |name: &str| run.joint_names.iter().position(|n| n == name);
    let first = |series: &Option<JointSeries>, column: usize| {
        series.as_ref().and_then(|s| s.column(column).find(|x| x.is_finite()))
    };
    let is_measured = |joint: &&Joint| column(&joint.name).and_then(|c| first(&run.measured.position, c)).is_some();
    if !model.joints.iter().any(|j| is_measured(&j)) {
        return Vec::new();
    }
    let place = |joint: &Joint| {
        let command = column(&joint.name).and_then(|c| first(&run.commands.position, c));
        (joint.name.clone(), command.unwrap_or(0.0f64.max(joint.lower).min(joint.upper)))
    };
    model.joints.iter().filter(|j| !is_measured(j)).map(place).collect()
}

/// The measured positions, where they are in the model's unit.
fn positions(run: &Run) -> Option<&JointSeries> {
    let is_foreign = run.faults.iter().any(|f| f.kind == FaultKind::DegreesSuspected);
    run.measured.position.as_ref().filter(|_| !is_foreign)
}

fn lift_position(run: &Run, column: usize, joint: &mut Joint, remarks: &mut Vec<String>) {
    let Some(position) = positions(run) else { return };
    let known: Vec<f64> = position.column(column).filter(|x| x.is_finite()).collect();
    let (margin, unit) = match joint.kind {
        JointKind::Revolute => (BEYOND_STOP[0], "rad"),
        JointKind::Prismatic => (BEYOND_STOP[1], "m"),
    };
    if let Some(farthest) = beyond_stops(&known, joint.lower, joint.upper, margin) {
        remarks.push(format!(
            "joint `{}`: its file allows {:.3} to {:.3} {unit}, the recording reaches {farthest:.3}: no limit on its position is applied",
            joint.name, joint.lower, joint.upper
        ));
        (joint.lower, joint.upper) = (f64::NEG_INFINITY, f64::INFINITY);
    }
}

fn lift_velocity(run: &Run, column: usize, joint: &mut Joint, remarks: &mut Vec<String>) {
    let Some(position) = positions(run) else { return };
    if let Some(fastest) = beyond(&speeds(position, column), joint.velocity) {
        remarks.push(format!(
            "joint `{}`: its file allows {} {}/s, the recording reaches {fastest:.2}: no limit on its speed is applied",
            joint.name,
            joint.velocity,
            if joint.kind == JointKind::Revolute { "rad" } else { "m" }
        ));
        joint.velocity = f64::INFINITY;
    }
}

fn lift_effort(run: &Run, column: usize, joint: &mut Joint, remarks: &mut Vec<String>) {
    let channel = format!("torque {}", joint.name);
    let is_foreign = run.faults.iter().any(|f| f.kind == FaultKind::Convention && f.channel == channel);
    let Some(torque) = run.measured.torque.as_ref().filter(|_| !is_foreign) else { return };
    let sizes: Vec<f64> = torque.column(column).map(f64::abs).filter(|x| x.is_finite()).collect();
    if let Some(largest) = beyond(&sizes, joint.effort) {
        remarks.push(format!(
            "joint `{}`: its file allows {} {}, the recording reaches {largest:.2}: no limit on its torque is applied",
            joint.name,
            joint.effort,
            if joint.kind == JointKind::Revolute { "N m" } else { "N" }
        ));
        joint.effort = f64::INFINITY;
    }
}

/// The largest value, where enough of them contradict the limit.
fn beyond(values: &[f64], limit: f64) -> Option<f64> {
    let above = values.iter().filter(|v| **v > BEYOND * limit).count();
    (above >= LEAST).then(|| values.iter().fold(0.0, |a: f64, &b| a.max(b)))
}

/// The value that is farthest outside, where enough of them contradict the limits.
fn beyond_stops(values: &[f64], lower: f64, upper: f64, margin: f64) -> Option<f64> {
    let depth = |x: f64| (lower - x).max(x - upper);
    let outside = values.iter().filter(|x| depth(**x) > margin).count();
    let farthest = values.iter().copied().max_by(|a, b| depth(*a).total_cmp(&depth(*b)));
    farthest.filter(|_| outside >= LEAST)
}

/// Sizes of speeds, without those of jumps between samples.
fn speeds(position: &JointSeries, column: usize) -> Vec<f64> {
    let mut speeds = Vec::new();
    let mut start = 0;
    let known: Vec<usize> = (0..position.len()).filter(|&i| position.row(i)[column].is_finite()).collect();
    for (n, &end) in known.iter().enumerate() {
        let jumps = n > 0 && faults::jumped(position, column..column + 1, end, faults::FASTEST_JOINT, 0.2);
        if jumps {
            start = n;
        }
        while start + 1 < n && position.time[end] - position.time[known[start + 1]] >= SPAN {
            start += 1;
        }
        let first = known[start];
        let time = position.time[end] - position.time[first];
        // Slower recordings are taken as they come; across a hole nothing is known.
        if (SPAN..5.0 * SPAN).contains(&time) {
            speeds.push((position.row(end)[column] - position.row(first)[column]).abs() / time);
        }
    }
    speeds
}

#[cfg(test)]
mod tests {
    use super::*;

    fn swing(amplitude: f64, hertz: f64) -> JointSeries {
        let time: Vec<f64> = (0..1000).map(|i| 0.002 * f64::from(i)).collect();
        let values = time.iter().map(|t| amplitude * (std::f64::consts::TAU * hertz * t).sin()).collect();
        JointSeries { time, values, joints: 1 }
    }

    #[test]
    fn speeds_are_those_of_the_motion() {
        let position = swing(0.2, 1.0);
        let fastest = speeds(&position, 0).into_iter().fold(0.0, f64::max);
        assert!((fastest - 0.2 * std::f64::consts::TAU).abs() < 2e-3, "{fastest}");
        // A slip of one sample is no speed, and a jump is none.
        let mut slipped = swing(0.0, 1.0);
        slipped.values[500..].iter_mut().for_each(|x| *x += 1.0);
        assert!(speeds(&slipped, 0).iter().all(|v| *v == 0.0));
    }

    #[test]
    fn only_what_is_often_and_clearly_beyond_contradicts() {
        let mut values = vec![1.0; 100];
        assert_eq!(beyond(&values, 1.0), None);
        values[..4].fill(3.0);
        assert_eq!(beyond(&values, 1.0), None);
        values[4] = 2.0;
        assert_eq!(beyond(&values, 1.0), Some(3.0));
        assert_eq!(beyond(&values, f64::INFINITY), None);
    }

    #[test]
    fn stops_hold_until_positions_are_clearly_beyond() {
        let mut values = vec![0.0; 100];
        values[..50].fill(0.11);
        assert_eq!(beyond_stops(&values, -0.1, 0.1, 0.02), None);
        values[..4].fill(-0.5);
        assert_eq!(beyond_stops(&values, -0.1, 0.1, 0.02), None);
        values[4] = 0.3;
        assert_eq!(beyond_stops(&values, -0.1, 0.1, 0.02), Some(-0.5));
        assert_eq!(beyond_stops(&values, f64::NEG_INFINITY, f64::INFINITY, 0.02), None);
        assert_eq!(beyond_stops(&[], -0.1, 0.1, 0.02), None);
    }
}
