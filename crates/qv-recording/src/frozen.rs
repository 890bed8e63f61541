//! Channels that keep one value while the robot moves: a frozen sensor, a dead wire, a logger that repeats itself.

use crate::run::{FaultKind, Run};
use qv_core::JointSeries;
use std::ops::Range;

/// A joint's position or velocity that stands still for so long while others move is suspected to be frozen \[s\].
const FROZEN: f64 = 0.5;
/// Torques may stay at a limit, and a trunk at rest, a little longer \[s\].
const FROZEN_LONG: f64 = 1.0;
/// What counts as moving, of the joint that moves most, and of a joint whose torque is looked at \[rad\].
const MOVES: f64 = 0.05;
const MOVES_FAR: f64 = 0.2;

/// A channel with the columns that are given by one name.
pub struct Channel<'a> {
    /// `position`, `velocity`, `torque`, `gyro`, `orientation` or `base pose`, with the joint where it has one.
    pub name: String,
    /// What was measured.
    pub series: &'a JointSeries,
    /// Its columns; all of them keep their value.
    pub columns: Range<usize>,
}

/// Samples in which a channel stood still while the robot moved.
pub(crate) struct FrozenChannel<'a> {
    /// The channel.
    pub channel: Channel<'a>,
    /// Stretches of samples.
    pub stretches: Vec<Range<usize>>,
}

impl FrozenChannel<'_> {
    /// Samples in all of them.
    pub fn count(&self) -> usize {
        self.stretches.iter().map(ExactSizeIterator::len).sum()
    }

    /// Share of the channel's samples.
    pub fn share(&self) -> f64 {
        self.count() as f64 / self.channel.series.len().max(1) as f64
    }
}

/// All channels that stood still while the robot moved, which its joint positions show.
pub(crate) fn frozen_channels(run: &Run) -> Vec<FrozenChannel<'_>> {
    let m = &run.measured;
    let Some(position) = &m.position else { return vec![] };
    let mut found = vec![];
    let mut look = |name: String, series, columns: Range<usize>, least: f64, moves: &dyn Fn(f64, f64) -> bool| {
        let channel = Channel { name, series, columns };
        let stretches = stretches(&channel, least, moves);
        if !stretches.is_empty() {
            found.push(FrozenChannel { channel, stretches });
        }
    };
    for (kind, series) in [("position", &m.position), ("velocity", &m.velocity), ("torque", &m.torque)] {
        let Some(series) = series else { continue };
        for joint in 0..series.joints.min(run.joint_names.len()) {
            let others = |from: f64, to: f64| {
                let is_one = |j| j != joint && moved(position, j, from, to, MOVES);
                !is_stuck(run, position, joint, [from, to]) && (0..position.joints).any(is_one)
            };
            let itself = |from: f64, to: f64| moved(position, joint, from, to, MOVES_FAR);
            let (least, moves): (f64, &dyn Fn(f64, f64) -> bool) =
                if kind == "torque" { (FROZEN_LONG, &itself) } else { (FROZEN, &others) };
            look(format!("{kind} {}", run.joint_names[joint]), series, joint..joint + 1, least, moves);
        }
    }
    let any = |from: f64, to: f64| (0..position.joints).any(|j| moved(position, j, from, to, MOVES_FAR));
    for (axis, name) in ["x", "y", "z"].iter().enumerate() {
        if let Some(series) = m.gyro.as_ref().filter(|s| s.joints > axis) {
            look(format!("gyro {name}"), series, axis..axis + 1, FROZEN_LONG, &any);
        }
    }
    for (name, series) in [("orientation", &m.orientation), ("base pose", &m.base_pose)] {
        if let Some(series) = series {
            look(name.into(), series, 0..series.joints, FROZEN_LONG, &any);
        }
    }
    found
}

/// Stretches longer than `least` \[s\] in which the columns keep their bits while `moves` says that the robot moves between two times.
fn stretches(channel: &Channel, least: f64, moves: &dyn Fn(f64, f64) -> bool) -> Vec<Range<usize>> {
    let (series, columns) = (channel.series, &channel.columns);
    let bits = |i: usize| series.row(i)[columns.clone()].iter().map(|x| x.to_bits());
    let is_known = |i: usize| series.row(i)[columns.clone()].iter().all(|x| x.is_finite());
    let (mut start, mut out) = (0, vec![]);
    for i in 1..=series.len() {
        if i < series.len() && bits(i).eq(bits(start)) {
            continue;
        }
        let (from, to) = (series.time[start], series.time[i - 1]);
        if to - from > least && is_known(start) && moves(from, to) {
            out.push(start..i);
        }
        start = i;
    }
    out
}

/// Whether friction may hold a joint between two times, of which a sensor that reads in steps says one number for seconds: it is commanded to hold
/// its place, or moves on from where it was. A reading that froze jumps when it lives again.
fn is_stuck(run: &Run, position: &JointSeries, joint: usize, [from, to]: [f64; 2]) -> bool {
    let asked = |least| run.commands.position.as_ref().is_some_and(|c| moved(c, joint, from, to, least));
    if run.commands.position.is_some() && !asked(MOVES) {
        return true;
    }
    let value = |t: f64| position.hold(t)[joint];
    match position.time[position.time.partition_point(|&t| t <= to)..].iter().find(|&&t| !value(t).is_nan()) {
        Some(&next) => (value(next) - value(from)).abs() < MOVES && !asked(MOVES_FAR),
        None => false,
    }
}

/// Whether a joint's position covers more than `least` \[rad\] between two times.
fn moved(position: &JointSeries, joint: usize, from: f64, to: f64, least: f64) -> bool {
    let (first, last) = (position.time.partition_point(|&t| t < from), position.time.partition_point(|&t| t <= to));
    let values = (first..last).map(|i| position.row(i)[joint]).filter(|x| !x.is_nan());
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
    high - low > least
}

/// Share of a channel from which on it counts as broken throughout; nothing can take the place of positions and poses, which do
/// when they live for less than so long \[s\].
const BROKEN: f64 = 0.6;
const LEAST_ALIVE: f64 = 4.0;

/// The run without what stood still: stretches become gaps, a trunk's channel that hardly ever lives is taken out, velocities of such a joint
/// are those of its positions. Faults stay for channels that are broken throughout; a joint's position that is has no replacement.
pub fn without_frozen(run: &Run) -> Run {
    let mut out = run.clone();
    let mut mended = vec![];
    for one in frozen_channels(run) {
        let Channel { name, columns, .. } = &one.channel;
        let kind = ["position", "velocity", "torque", "gyro", "orientation", "base pose"]
            .into_iter()
            .find(|k| name.starts_with(k));
        let m = &mut out.measured;
        let slot = match kind {
            Some("position") => &mut m.position,
            Some("velocity") => &mut m.velocity,
            Some("torque") => &mut m.torque,
            Some("gyro") => &mut m.gyro,
            Some("orientation") => &mut m.orientation,
            _ => &mut m.base_pose,
        };
        let time = &one.channel.series.time;
        let alive = (1.0 - one.share()) * (time[time.len() - 1] - time[0]);
        let is_broken = match kind {
            Some("position" | "base pose") => alive < LEAST_ALIVE,
            _ => one.share() > BROKEN,
        };
        if is_broken {
            match kind {
                Some("gyro" | "orientation" | "base pose") => *slot = None,
                Some("velocity") => replace(slot, columns.start, crate::derive::joint_velocity(run).map(|d| d.series)),
                _ => {}
            }
            continue;
        }
        let Some(series) = slot else { continue };
        for i in one.stretches.iter().flat_map(Clone::clone) {
            let first = i * series.joints;
            series.values[first + columns.start..first + columns.end].fill(f64::NAN);
        }
        mended.push(name.clone());
    }
    out.faults.retain(|f| f.kind != FaultKind::Frozen || !mended.contains(&f.channel));
    out
}

/// A column by that of another series with the same stamps.
pub(crate) fn replace(slot: &mut Option<JointSeries>, column: usize, by: Option<JointSeries>) {
    let (Some(series), Some(by)) = (slot, by) else { return };
    if series.time == by.time && series.joints == by.joints {
        for i in 0..series.len() {
            series.values[i * by.joints + column] = by.values[i * by.joints + column];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::{Base, Robot};

    /// Two joints that swing for 10 s, their torques, and a gyro.
    fn run() -> Run {
        let time: Vec<f64> = (0..1000).map(|i| 0.01 * f64::from(i)).collect();
        let series = |columns: usize, size: f64| {
            let values =
                time.iter().flat_map(|t| (0..columns).map(move |c| size * (3.0 * t + c as f64).sin())).collect();
            Some(JointSeries::new(time.clone(), values, columns).unwrap())
        };
        let mut run = Run::empty(Robot::Named("arm".into()), Base::Free, vec!["a".into(), "b".into()]);
        let m = &mut run.measured;
        (m.position, m.velocity, m.torque, m.gyro) = (series(2, 0.5), series(2, 1.5), series(2, 4.0), series(3, 0.3));
        run
    }

    fn freeze(series: &mut Option<JointSeries>, column: usize, from: usize) {
        let series = series.as_mut().unwrap();
        let (columns, value) = (series.joints, series.values[from * series.joints + column]);
        series.values[from * columns..].iter_mut().skip(column).step_by(columns).for_each(|x| *x = value);
    }

    #[test]
    fn what_stands_still_becomes_a_gap_or_goes() {
        let mut run = run();
        assert!(frozen_channels(&run).is_empty());
        freeze(&mut run.measured.torque, 1, 600);
        freeze(&mut run.measured.gyro, 0, 100);
        freeze(&mut run.measured.velocity, 0, 0);
        let found: Vec<(String, usize)> =
            frozen_channels(&run).iter().map(|s| (s.channel.name.clone(), s.count())).collect();
        assert_eq!(found, [("velocity a".into(), 1000), ("torque b".into(), 400), ("gyro x".into(), 900)]);
        let mended = without_frozen(&run).measured;
        let torque = mended.torque.unwrap();
        assert!(torque.column(1).skip(600).all(f64::is_nan) && torque.column(1).take(600).all(f64::is_finite));
        assert!(torque.column(0).all(f64::is_finite) && mended.gyro.is_none());
        let speed = mended.velocity.unwrap().row(500)[0];
        assert!((speed - 1.5 * (3.0f64 * 5.0).cos()).abs() < 0.01, "{speed}");
    }

    #[test]
    fn a_position_is_kept_as_long_as_enough_of_it_lives() {
        for (from, lives) in [(500, true), (300, false)] {
            let mut run = run();
            freeze(&mut run.measured.position, 0, from);
            let position = without_frozen(&run).measured.position.unwrap();
            assert_eq!(position.column(0).skip(from).all(f64::is_nan), lives, "{from}");
            assert!(position.column(0).take(from).chain(position.column(1)).all(f64::is_finite));
        }
    }

    #[test]
    fn a_joint_that_is_told_to_hold_its_place_is_no_fault() {
        let mut run = run();
        freeze(&mut run.measured.position, 0, 500);
        run.commands.position = run.measured.position.clone();
        assert!(frozen_channels(&run).is_empty());
        // The same with a command that swings on.
        run.commands.position = self::run().measured.position;
        assert_eq!(frozen_channels(&run).len(), 1);
    }

    /// Friction holds a joint while its command turns round; then it moves on from there.
    #[test]
    fn a_joint_that_sticks_is_no_fault() {
        let mut run = run();
        let position = run.measured.position.as_mut().unwrap();
        for i in 0..1000 {
            let q = 0.5 * (0.6 * position.time[i]).sin();
            position.values[2 * i] = q.clamp(-0.45, 0.45);
        }
        let stuck = frozen_channels(&run);
        assert!(stuck.is_empty(), "{}", stuck[0].channel.name);
        // Frozen where it is fast, it jumps.
        let position = run.measured.position.as_mut().unwrap();
        (550..700).for_each(|i| position.values[2 * i] = position.values[2 * 550]);
        assert_eq!(frozen_channels(&run).len(), 1);
    }

    #[test]
    fn what_rests_with_the_robot_is_no_fault() {
        let mut run = run();
        for joint in 0..2 {
            freeze(&mut run.measured.position, joint, 500);
        }
        freeze(&mut run.measured.torque, 1, 500);
        freeze(&mut run.measured.gyro, 0, 500);
        assert!(frozen_channels(&run).is_empty());
    }
}
