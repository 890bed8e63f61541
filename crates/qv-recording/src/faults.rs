//! Finding what is wrong with a recording: missing, repeated and impossible samples.

use crate::clean::median_interval;
pub use crate::conventions::FASTEST_BASE;
use crate::frozen::frozen_channels;
use crate::mapping::Mapping;
use crate::run::{Clock, Fault, FaultKind, Run};
use crate::{commanded, conventions, frames};
use qv_core::JointSeries;
use qv_core::statistics::median;
use std::f64::consts::TAU;
use std::ops::Range;

/// A gap is longer than this many periods; a drop than one and a half.
const GAP_PERIODS: f64 = 5.0;

/// No robot's joint turns faster \[rad/s\]: a larger step between samples is a jump.
pub(crate) const FASTEST_JOINT: f64 = 100.0;

/// Joint angles beyond this are hardly radians, unless the joint turns without end.
const LARGEST_ANGLE: f64 = 20.0;

/// Adds to `run.faults` what can be seen in the channels, and sorts all by time. The mapping's limits sharpen it.
pub fn examine(run: &mut Run, mapping: Option<&Mapping>) {
    let mut faults = std::mem::take(&mut run.faults);
    for (name, series, first) in
        [("orientation", &mut run.measured.orientation, 0), ("base pose", &mut run.measured.base_pose, 3)]
    {
        if let Some(series) = series {
            rotations(name, series, first, &mut faults);
        }
    }
    for (channel, series) in [("position", &mut run.measured.position), ("commands", &mut run.commands.position)] {
        if let Some(series) = series {
            unwrap_turns(channel, series, &run.joint_names, &mut faults);
        }
    }
    if let Some(position) = &mut run.measured.position {
        spikes(position, &run.joint_names, &mut faults);
    }
    let m = &run.measured;
    for (name, series) in
        [("commands", &run.commands.position), ("joint states", &m.position), ("base pose", &m.base_pose)]
    {
        if let Some(series) = series {
            gaps(name, &series.time, &mut faults);
        }
    }
    if let Some(position) = &m.position {
        repeats("position", position, m.velocity.as_ref(), &mut faults);
        for joint in 0..position.joints {
            let name = format!("position {}", run.joint_names[joint]);
            jumps(&name, position, joint..joint + 1, FASTEST_JOINT, 0.2, &mut faults);
        }
        degrees(run, position, mapping, &mut faults);
    }
    for (name, series) in [("position", &m.position), ("velocity", &m.velocity), ("torque", &m.torque)] {
        if let Some(series) = series {
            holes(name, series, &run.joint_names, &mut faults);
        }
    }
    sparse(run, &mut faults);
    frozen(run, &mut faults);
    // Where positions are not radians, nothing can be judged by them.
    if faults.iter().all(|f| f.kind != FaultKind::DegreesSuspected) {
        let commands = commanded::analyse(run);
        faults.extend(commanded::faults(run, &commands));
        let channels = conventions::faults(run, &commands);
        // A channel is named once.
        let is_new = |f: &Fault| !channels.iter().any(|known| known.channel.starts_with(&f.channel));
        faults.extend(frames::faults(run).into_iter().filter(is_new));
        faults.extend(channels);
    }
    if let Some(pose) = &m.base_pose {
        jumps("base pose", pose, 0..3, FASTEST_BASE, 0.2, &mut faults);
    }
    if let (Some(torque), Some(mapping)) = (&m.torque, mapping) {
        efforts(run, torque, mapping, &mut faults);
    }
    faults.sort_by(|a, b| a.time.total_cmp(&b.time));
    run.faults = faults;
}

fn fault(kind: FaultKind, channel: &str, time: f64, count: usize, detail: String) -> Fault {
    Fault { kind, channel: channel.into(), time, count, detail }
}

fn gaps(name: &str, time: &[f64], faults: &mut Vec<Fault>) {
    let period = median_interval(time);
    let mut dropped = 0;
    let mut first = None;
    for pair in time.windows(2) {
        let step = pair[1] - pair[0];
        if step > GAP_PERIODS * period {
            let missing = (step / period).round() as usize - 1;
            let detail = format!("nothing for {step:.4} s (period {period:.4} s)");
            faults.push(fault(FaultKind::Gap, name, pair[0], missing, detail));
        } else if step > 1.5 * period {
            dropped += (step / period).round() as usize - 1;
            first.get_or_insert(pair[0]);
        }
    }
    if let Some(time) = first {
        faults.push(fault(FaultKind::Drop, name, time, dropped.max(1), format!("{dropped} single samples missing")));
    }
}

/// Rows equal to the one before in all columns, where that is not the rule (a robot without noise standing still).
fn repeats(name: &str, series: &JointSeries, other: Option<&JointSeries>, faults: &mut Vec<Fault>) {
    let other = other.filter(|o| o.time == series.time);
    let same = |s: &JointSeries, i: usize| s.row(i).iter().zip(s.row(i - 1)).all(|(a, b)| a.to_bits() == b.to_bits());
    let repeated: Vec<usize> =
        (1..series.len()).filter(|&i| same(series, i) && other.is_none_or(|o| same(o, i))).collect();
    if repeated.is_empty() || 2 * repeated.len() > series.len() {
        return;
    }
    let detail = format!("{} samples repeat the one before in every joint", repeated.len());
    faults.push(fault(FaultKind::Repeat, name, series.time[repeated[0]], repeated.len(), detail));
}

/// Share of a turn by which a step may differ from a whole one: what the joint moves within a sample beside it.
const NEAR_TURN: f64 = 0.1;

/// Reads angles on beyond a turn where they start anew, as those of a continuous joint do whose driver keeps them within ±π
/// (ros_controllers #274).
fn unwrap_turns(channel: &str, series: &mut JointSeries, names: &[String], faults: &mut Vec<Fault>) {
    for (joint, name) in names.iter().enumerate().take(series.joints) {
        let (mut before, mut turns, mut found) = (None, 0.0, Vec::new());
        for i in 0..series.len() {
            let value = series.values[i * series.joints + joint];
            if !value.is_finite() {
                continue;
            }
            if let Some((last, time)) = before.replace((value, series.time[i])) {
                let step: f64 = value - last;
                let is_turn = (step.abs() / TAU - 1.0).abs() < NEAR_TURN;
                if is_turn && step.abs() > FASTEST_JOINT * (series.time[i] - time) {
                    turns -= step.signum();
                    found.push(series.time[i]);
                }
            }
            series.values[i * series.joints + joint] = value + TAU * turns;
        }
        if let Some(&first) = found.first() {
            let detail = format!("{} steps of a whole turn within a sample: read on beyond a turn", found.len());
            faults.push(fault(FaultKind::Jump, &format!("{channel} {name}"), first, found.len(), detail));
        }
    }
}

/// Turns single positions that no joint can reach and leave within a sample into gaps: an encoder's slip, which would
/// spoil every fit around it.
fn spikes(position: &mut JointSeries, names: &[String], faults: &mut Vec<Fault>) {
    for joint in 0..position.joints {
        let at = |i: usize| position.row(i)[joint];
        let far = |a: usize, b: usize| {
            let step = (at(b) - at(a)).abs();
            step > 0.2 && step > FASTEST_JOINT * (position.time[b] - position.time[a])
        };
        let found: Vec<usize> = (1..position.len().saturating_sub(1))
            .filter(|&i| far(i - 1, i) && far(i, i + 1) && !far(i - 1, i + 1))
            .collect();
        if let Some(&first) = found.first() {
            let (value, before) = (at(first), at(first - 1));
            let detail = format!("single values such as {value:.3} rad between {before:.3} and its like: kept as gaps");
            let name = format!("position {}", names[joint]);
            faults.push(fault(FaultKind::Jump, &name, position.time[first], found.len(), detail));
        }
        for i in found {
            position.values[i * position.joints + joint] = f64::NAN;
        }
    }
}

/// How far columns are at a sample from where they were at the one before.
fn step(series: &JointSeries, columns: Range<usize>, sample: usize) -> f64 {
    columns.map(|c| (series.row(sample)[c] - series.row(sample - 1)[c]).powi(2)).sum::<f64>().sqrt()
}

/// Whether columns moved by more than `least`, and faster than `fastest`, from one sample to this one.
pub fn jumped(series: &JointSeries, columns: Range<usize>, sample: usize, fastest: f64, least: f64) -> bool {
    let step = step(series, columns, sample);
    step > least && step > fastest * (series.time[sample] - series.time[sample - 1])
}

fn jumps(name: &str, series: &JointSeries, columns: Range<usize>, fastest: f64, least: f64, faults: &mut Vec<Fault>) {
    let is_jump = |i: &usize| jumped(series, columns.clone(), *i, fastest, least);
    let found: Vec<usize> = (1..series.len()).filter(is_jump).collect();
    if let Some(&first) = found.first() {
        let seconds = series.time[first] - series.time[first - 1];
        let detail = format!("{:.3} within {seconds:.4} s", step(series, columns, first));
        faults.push(fault(FaultKind::Jump, name, series.time[first], found.len(), detail));
    }
}

/// Channels that keep one value while joints move.
fn frozen(run: &Run, faults: &mut Vec<Fault>) {
    for one in frozen_channels(run) {
        let time = |i: usize| one.channel.series.time[i];
        let first = &one.stretches[0];
        let (from, to) = (time(first.start), time(first.end - 1));
        let more = match one.stretches.len() {
            1 => String::new(),
            n => format!(", and {} times more", n - 1),
        };
        let detail = format!("stood still from {from:.3} to {to:.3} s while other joints moved{more}");
        faults.push(fault(FaultKind::Frozen, &one.channel.name, from, one.count(), detail));
    }
}

/// Columns of joint states without a value for more than [`GAP_PERIODS`] samples on end, though they have some.
fn holes(name: &str, series: &JointSeries, names: &[String], faults: &mut Vec<Fault>) {
    for (joint, joint_name) in names.iter().enumerate().take(series.joints) {
        let lacks: Vec<bool> = series.column(joint).map(f64::is_nan).collect();
        let mut longest = 0..0;
        let mut start = 0;
        for i in 1..=lacks.len() {
            if i == lacks.len() || lacks[i] != lacks[start] {
                if lacks[start] && i - start > longest.len() {
                    longest = start..i;
                }
                start = i;
            }
        }
        let count = lacks.iter().filter(|x| **x).count();
        if longest.len() as f64 > GAP_PERIODS {
            let (from, to) = (series.time[longest.start], series.time[longest.end - 1]);
            let detail = format!("{count} of {} values missing, most of them from {from:.3} to {to:.3} s", lacks.len());
            faults.push(fault(FaultKind::Gap, &format!("{name} {joint_name}"), from, count, detail));
        }
    }
}

/// Most that rounding and a sensor's own arithmetic take from the length of a unit quaternion.
const OFF_UNIT: f64 = 0.02;

/// Length below which a quaternion says nothing of a rotation.
const NO_LENGTH: f64 = 0.1;

/// Quaternions, in four columns from `first` on, whose length is not one: made so, or gaps where there is nothing to go by.
fn rotations(name: &str, series: &mut JointSeries, first: usize, faults: &mut Vec<Fault>) {
    let width = series.joints;
    let mut found: Option<(f64, f64)> = None;
    let (mut count, mut gaps) = (0, 0);
    for (row, time) in series.values.chunks_exact_mut(width).zip(&series.time) {
        let quaternion = &mut row[first..first + 4];
        let length = quaternion.iter().map(|x| x * x).sum::<f64>().sqrt();
        if !length.is_finite() || (length - 1.0).abs() <= OFF_UNIT {
            continue;
        }
        found.get_or_insert((*time, length));
        count += 1;
        if length < NO_LENGTH {
            quaternion.fill(f64::NAN);
            gaps += 1;
        } else {
            quaternion.iter_mut().for_each(|x| *x /= length);
        }
    }
    if let Some((time, length)) = found {
        let detail = format!(
            "expected quaternions of length 1, found {length:.3}: {} made so, {gaps} kept as gaps",
            count - gaps
        );
        faults.push(fault(FaultKind::NoRotation, name, time, count, detail));
    }
}

/// Channels of which more values are missing than are there, without a hole that is reported as a gap. Rows of a table that lack a
/// whole channel are not in its series: they count by those of the positions.
fn sparse(run: &Run, faults: &mut Vec<Fault>) {
    let m = &run.measured;
    let trunk = [
        ("gyro", &m.gyro),
        ("acceleration", &m.acceleration),
        ("orientation", &m.orientation),
        ("base pose", &m.base_pose),
    ];
    let is_table = run.sources.iter().any(|s| s.clock == Clock::Column);
    let rows = m.position.as_ref().filter(|_| is_table).map_or(0, JointSeries::len);
    let mut look = |name: &str, series: &JointSeries, column: usize| {
        let known = series.column(column).filter(|x| !x.is_nan()).count();
        let all = series.len().max(rows);
        let missing = all - known;
        let is_told = faults.iter().any(|f| f.kind == FaultKind::Gap && f.channel == name);
        // A column without any value was not measured, which is no fault.
        if 2 * missing > all && known > 0 && !is_told {
            let detail = format!("{missing} of {all} values missing");
            faults.push(fault(FaultKind::Sparse, name, series.time[0], missing, detail));
        }
    };
    for (name, series) in [("position", &m.position), ("velocity", &m.velocity), ("torque", &m.torque)] {
        let Some(series) = series else { continue };
        for (column, joint) in run.joint_names.iter().enumerate().take(series.joints) {
            look(&format!("{name} {joint}"), series, column);
        }
    }
    for (name, series) in trunk {
        if let Some(series) = series {
            look(name, series, 0);
        }
    }
}

/// Positions that are far outside the limits, but inside when read as degrees; without limits, positions beyond
/// [`LARGEST_ANGLE`].
fn degrees(run: &Run, position: &JointSeries, mapping: Option<&Mapping>, faults: &mut Vec<Fault>) {
    let largest = |j: usize| position.column(j).filter(|x| !x.is_nan()).fold(0.0f64, |a, x| a.max(x.abs()));
    let limits = mapping.filter(|m| m.position_limits.len() == position.joints);
    let Some(mapping) = limits else {
        let joint = (0..position.joints).max_by(|&a, &b| largest(a).total_cmp(&largest(b)));
        if let Some(joint) = joint.filter(|&j| largest(j) > LARGEST_ANGLE) {
            let detail = format!("expected radians, found values up to {:.1}", largest(joint));
            let name = format!("position {}", run.joint_names[joint]);
            faults.push(fault(FaultKind::DegreesSuspected, &name, position.time[0], position.len(), detail));
        }
        return;
    };
    let share = |j: usize, scale: f64, slack: f64| {
        let (low, high) = mapping.position_limits[j];
        let outside = |x: &f64| *x * scale < low - slack || *x * scale > high + slack;
        let values: Vec<f64> = position.column(j).filter(|x| !x.is_nan()).collect();
        values.iter().filter(|x| outside(x)).count() as f64 / values.len().max(1) as f64
    };
    let outside: Vec<usize> = (0..position.joints).filter(|&j| share(j, 1.0, 1.0) > 0.5).collect();
    let radians = std::f64::consts::PI / 180.0;
    if !outside.is_empty() && outside.iter().all(|&j| largest(j) > 6.0 && share(j, radians, 0.1) < 0.1) {
        let joint = outside[0];
        let (low, high) = mapping.position_limits[joint];
        let detail = format!(
            "expected radians within {low:.2} to {high:.2}, found up to {:.1}; as degrees {} joints fit",
            largest(joint),
            outside.len()
        );
        let name = format!("position {}", run.joint_names[joint]);
        faults.push(fault(FaultKind::DegreesSuspected, &name, position.time[0], position.len(), detail));
        return;
    }
    for joint in (0..position.joints).filter(|&j| share(j, 1.0, 0.1) > 0.0) {
        let (low, high) = mapping.position_limits[joint];
        let beyond = share(joint, 1.0, 0.1);
        let kind = if beyond > 0.5 { FaultKind::WrongRobot } else { FaultKind::BeyondLimits };
        let detail = format!("{:.1} % of samples outside {low:.2} to {high:.2} rad", 100.0 * beyond);
        let count = (beyond * position.len() as f64).round() as usize;
        let first = (0..position.len()).find(|&i| {
            let x = position.row(i)[joint];
            x < low - 0.1 || x > high + 0.1
        });
        let time = first.map_or(position.time[0], |i| position.time[i]);
        faults.push(fault(kind, &format!("position {}", run.joint_names[joint]), time, count, detail));
    }
}

fn efforts(run: &Run, torque: &JointSeries, mapping: &Mapping, faults: &mut Vec<Fault>) {
    if mapping.effort_limits.len() != torque.joints {
        return;
    }
    for joint in 0..torque.joints {
        let limit = mapping.effort_limits[joint];
        let beyond: Vec<usize> = (0..torque.len()).filter(|&i| torque.row(i)[joint].abs() > 1.1 * limit).collect();
        if let Some(&first) = beyond.first() {
            let mut over: Vec<f64> = beyond.iter().map(|&i| torque.row(i)[joint].abs()).collect();
            let detail = format!("median of those {:.1} N m, limit {limit:.1}", median(&mut over));
            let name = format!("torque {}", run.joint_names[joint]);
            faults.push(fault(FaultKind::BeyondEffort, &name, torque.time[first], beyond.len(), detail));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unwrapped(angles: &[f64], interval: f64) -> (Vec<f64>, Vec<Fault>) {
        let time = (0..angles.len()).map(|i| i as f64 * interval).collect();
        let mut series = JointSeries { time, values: angles.to_vec(), joints: 1 };
        let mut faults = Vec::new();
        unwrap_turns("position", &mut series, &["wrist".into()], &mut faults);
        (series.values, faults)
    }

    #[test]
    fn angles_go_on_beyond_a_turn_and_slips_stay() {
        let turning: Vec<f64> = (0..2000).map(|i| (0.005 * f64::from(i)).sin() * 7.0).collect();
        let wrapped: Vec<f64> = turning.iter().map(|x| x - TAU * (x / TAU).round()).collect();
        let (read, faults) = unwrapped(&wrapped, 0.002);
        assert!(read.iter().zip(&turning).all(|(a, b)| (a - b).abs() < 1e-9));
        assert_eq!((faults.len(), faults[0].kind, faults[0].channel.as_str()), (1, FaultKind::Jump, "position wrist"));
        assert!(faults[0].detail.contains("steps of a whole turn"), "{}", faults[0].detail);
        // An encoder that slips to -π for a sample, and steps between samples in which a joint can turn once.
        let slipping = [0.2, 0.21, -3.1, 0.22, 0.23];
        assert_eq!(unwrapped(&slipping, 0.002), (slipping.to_vec(), vec![]));
        let slow = [3.0, -3.0, f64::NAN, 3.0];
        let (read, faults) = unwrapped(&slow, 0.1);
        assert!(read[1] == -3.0 && read[3] == 3.0 && faults.is_empty());
    }
}
