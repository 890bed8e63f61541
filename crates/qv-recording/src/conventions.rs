//! Signs, units and orders that are another convention's: each channel against what others say of the same motion.
//!
//! Joint velocities against derived ones, torques against the law of the actuators, the gyroscope and quaternions against each other,
//! accelerations against gravity. Only what fits another convention well is reported; a sensor that is merely bad is not. What can be read
//! in that convention is ([`read_in_ours`]), the rest is left out, and so are channels that lack too much.

use crate::clean::median_interval;
use crate::commanded::{self, Analysis, Check};
use crate::derive::{joint_filter, joint_velocity, shorter_turn};
use crate::frozen::replace;
use crate::run::{ActuatorKind, Fault, FaultKind, Run};
use crate::slopes::{Fit, Reading, SAME, convention, fit};
use glam::{DQuat, DVec3};
use qv_core::statistics::median;
use qv_core::{GRAVITY, JointSeries};
use std::borrow::Cow;

/// No walking robot's trunk moves faster \[m/s\].
pub const FASTEST_BASE: f64 = 10.0;
/// Share of the time with joint positions that a channel may lack: with more it costs more of the recording than it shows.
const MOST_LACKING: f64 = 0.5;
/// Samples that are compared, at most.
const MOST: usize = 4000;
/// Least motion to compare (root of mean square): speed of joints \[rad/s\], torque \[N m\], turning of the base \[rad/s\].
const LEAST_SPEED: f64 = 0.1;
const LEAST_TORQUE: f64 = 0.3;
const LEAST_TURNING: f64 = 0.05;
/// Height of a walking robot's trunk \[m\].
const HEIGHTS: std::ops::Range<f64> = 0.2..0.5;
/// Time over which the base's turn is compared with the gyroscope's mean \[s\].
const TURN: f64 = 0.05;

/// A channel of another convention.
struct Foreign {
    /// `velocity NAME`, `torque NAME`, `gyro x`, `orientation`, `base pose` or `acceleration`.
    channel: String,
    /// What it is of what was expected.
    what: String,
    /// How to read it.
    reading: Reading,
}

/// All channels of another convention.
fn foreign(run: &Run, commands: &Analysis) -> Vec<Foreign> {
    let lacking = lacking(run);
    // Torques are judged by commands that are read right.
    let mended = commanded::mended(run, commands);
    let mut found = foreign_joints(mended.as_ref().unwrap_or(run));
    found.extend(foreign_turning(run));
    let m = &run.measured;
    let trunk = [
        ("acceleration", m.acceleration.as_ref().and_then(in_gravities)),
        ("base pose", m.base_pose.as_ref().and_then(too_fast)),
    ];
    for (channel, seen) in trunk {
        found.extend(seen.map(|(what, reading)| Foreign { channel: channel.into(), what, reading }));
    }
    found.retain(|f| lacking.iter().all(|l| l.channel != f.channel));
    lacking.into_iter().chain(found).collect()
}

/// Channels that lack most of their values and can be done without.
fn lacking(run: &Run) -> Vec<Foreign> {
    let m = &run.measured;
    let Some(position) = m.position.as_ref().filter(|p| p.len() > 20) else { return Vec::new() };
    let whole = position.len() as f64 * median_interval(&position.time);
    let axis = |k: usize| format!("gyro {}", ["x", "y", "z"][k.min(2)]);
    let joint = |kind: &'static str| move |k: usize| format!("{kind} {}", run.joint_names[k]);
    let of = |series: &Option<JointSeries>, name: &dyn Fn(usize) -> String| -> Vec<Foreign> {
        let Some(series) = series.as_ref().filter(|s| !s.is_empty()) else { return Vec::new() };
        let period = median_interval(&series.time);
        let share = |k: usize| 1.0 - series.column(k).filter(|x| x.is_finite()).count() as f64 * period / whole;
        let lacks = (0..series.joints).map(|k| (k, share(k))).filter(|(_, share)| *share > MOST_LACKING);
        let remarks = |(k, share)| Foreign {
            channel: name(k),
            what: format!("no values in {:.0} % of the recording", 100.0 * share),
            reading: Reading::Unknown,
        };
        lacks.map(remarks).collect()
    };
    let mut found = of(&m.velocity, &joint("velocity"));
    found.extend(of(&m.torque, &joint("torque")));
    found.extend(of(&m.gyro, &axis));
    // One line for a quaternion or a vector.
    found.extend(of(&m.orientation, &|_| "orientation".into()).into_iter().take(1));
    found.extend(of(&m.acceleration, &|_| "acceleration".into()).into_iter().take(1));
    found
}

/// Quaternions first, since the gyroscope is judged by them.
fn foreign_turning(run: &Run) -> Vec<Foreign> {
    let mut found = Vec::new();
    let m = &run.measured;
    let Some(gyro) = m.gyro.as_ref().filter(|g| g.joints == 3 && !g.is_empty()) else { return found };
    for (channel, series, first) in [("orientation", &m.orientation, 0), ("base pose", &m.base_pose, 3)] {
        let Some(series) = series.as_ref().filter(|s| s.joints >= first + 4) else { continue };
        let mut seen = turning(gyro, series, first);
        if let Turning::OfQuaternion(what, reading) = seen {
            found.push(Foreign { channel: channel.into(), what: what.into(), reading });
            let mut read = series.clone();
            read.values.chunks_exact_mut(series.joints).for_each(|row| reading.of(&mut row[first..first + 4]));
            seen = turning(gyro, &read, first);
        }
        // Poses are asked only where the IMU has no attitude of its own.
        if let (Turning::OfGyro(axes), true) = (seen, first == 0 || m.orientation.is_none()) {
            for (axis, what, reading) in axes {
                let what = format!("against the {channel}, {what}");
                found.push(Foreign { channel: format!("gyro {axis}"), what, reading });
            }
        }
    }
    found
}

/// Velocities and torques of joints. The law of the actuators needs velocities that are right.
fn foreign_joints(run: &Run) -> Vec<Foreign> {
    let derived = derived_velocities(run);
    let names = || run.joint_names.iter().enumerate();
    let velocities = names().filter_map(|(joint, name)| {
        let (what, reading) = of_velocity(run, joint, &derived)?;
        Some(Foreign { channel: format!("velocity {name}"), what: format!("against its positions, {what}"), reading })
    });
    let mut found: Vec<Foreign> = velocities.collect();
    let mut read = Cow::Borrowed(run);
    found.iter().for_each(|f| f.read(read.to_mut()));
    found.extend(names().filter_map(|(joint, name)| {
        let (what, reading) = of_torque(&read, joint)?;
        let what = format!("against the law of the actuator, {what}");
        Some(Foreign { channel: format!("torque {name}"), what, reading })
    }));
    found
}

/// All that is found, as faults.
pub(crate) fn faults(run: &Run, commands: &Analysis) -> Vec<Fault> {
    let start = run.span()[0];
    let fault = |f: Foreign| {
        let detail = match f.reading {
            Reading::Unknown => f.what,
            _ => format!("{}; it is read so", f.what),
        };
        Fault { kind: FaultKind::Convention, channel: f.channel, time: start, count: 1, detail }
    };
    foreign(run, commands).into_iter().map(fault).collect()
}

/// What each channel was compared with and what came of it: the commands first. Takes the faults of `run` as they were found when it was
/// read.
pub fn table(run: &Run) -> Vec<Check> {
    let mut checks = commanded::analyse(run).checks;
    let m = &run.measured;
    let looks: [(&str, bool, &str); 6] = [
        ("velocity", m.velocity.is_some(), "velocities against slopes of positions"),
        ("torque", m.torque.is_some() && run.commands.position.is_some(), "torques against gains times errors"),
        ("orientation", m.orientation.is_some() && m.gyro.is_some(), "attitude against the gyroscope"),
        ("gyro", m.gyro.is_some(), "gyroscope against the attitude"),
        ("acceleration", m.acceleration.is_some(), "acceleration against gravity"),
        ("base pose", m.base_pose.is_some(), "speed and turning of the base"),
    ];
    for (channel, _, name) in looks.into_iter().filter(|look| look.1) {
        let is_of =
            |f: &&Fault| f.kind == FaultKind::Convention && f.channel.split(' ').next() == channel.split(' ').next();
        let found: Vec<&Fault> = run.faults.iter().filter(is_of).collect();
        let what = match found.first() {
            None => "as expected".into(),
            Some(first) if found.len() == 1 => format!("{}: {}", first.channel, first.detail),
            Some(first) => format!("{}: {}, and {} more", first.channel, first.detail, found.len() - 1),
        };
        checks.push(Check { name: name.into(), found: what, is_ours: Some(found.is_empty()) });
    }
    checks
}

/// The run in this crate's convention. What no reading is known for is left out: torques are gaps, velocities those of the positions; its
/// faults stay.
pub fn read_in_ours(mut run: Run) -> Run {
    if run.faults.iter().all(|f| f.kind != FaultKind::Convention) {
        return run;
    }
    let commands = commanded::analyse(&run);
    if run
        .faults
        .iter()
        .any(|f| f.kind == FaultKind::Convention && f.channel == "acceleration" && f.detail.ends_with("left out"))
    {
        run.measured.acceleration = None;
    }
    for one in foreign(&run, &commands) {
        one.read(&mut run);
        if one.reading != Reading::Unknown {
            run.faults.retain(|f| f.kind != FaultKind::Convention || f.channel != one.channel);
        }
    }
    run
}

impl Foreign {
    /// Reads the channel of `run`, or takes it out.
    fn read(&self, run: &mut Run) {
        let (kind, rest) = self.channel.split_once(' ').unwrap_or((&self.channel, ""));
        let joint = run.joint_names.iter().position(|n| n == rest);
        let axis = ["x", "y", "z"].iter().position(|a| *a == rest);
        let is_known = self.reading != Reading::Unknown;
        let derived = if is_known || kind != "velocity" { None } else { joint_velocity(run) };
        let m = &mut run.measured;
        let (slot, columns) = match (kind, joint, axis) {
            ("velocity", Some(j), _) => (&mut m.velocity, j..j + 1),
            ("torque", Some(j), _) => (&mut m.torque, j..j + 1),
            ("gyro", _, Some(a)) => (&mut m.gyro, a..a + 1),
            ("orientation", ..) => (&mut m.orientation, 0..4),
            ("acceleration", ..) => (&mut m.acceleration, 0..3),
            // Its place has a unit, its rotation an order.
            _ if matches!(self.reading, Reading::Scaled(_)) => (&mut m.base_pose, 0..3),
            _ => (&mut m.base_pose, 3..7),
        };
        match (slot.as_mut(), kind) {
            (Some(series), _) if is_known => {
                let rows = series.values.chunks_exact_mut(series.joints);
                rows.for_each(|row| self.reading.of(&mut row[columns.clone()]));
            }
            (Some(_), "velocity") => replace(slot, columns.start, derived.map(|d| d.series)),
            (Some(series), "torque") => {
                series.values.iter_mut().skip(columns.start).step_by(series.joints).for_each(|x| *x = f64::NAN);
            }
            _ => *slot = None,
        }
    }
}

/// Indices of samples that are compared.
fn some(series: &JointSeries) -> impl Iterator<Item = usize> {
    (0..series.len()).step_by(series.len().div_ceil(MOST).max(1))
}

/// Times and velocities of all joints by their positions.
fn derived_velocities(run: &Run) -> Vec<(f64, Vec<f64>)> {
    let Some(position) = run.measured.position.as_ref().filter(|p| p.len() > 20) else { return Vec::new() };
    let filter = joint_filter(position);
    let at = |i: usize| (position.time[i], filter.at(position, position.time[i]).iter().map(|s| s.slope).collect());
    some(position).map(at).collect()
}

fn of_velocity(run: &Run, joint: usize, derived: &[(f64, Vec<f64>)]) -> Option<(String, Reading)> {
    let velocity = run.measured.velocity.as_ref().filter(|v| !v.is_empty())?;
    let mut row = vec![0.0; velocity.joints];
    let pair = |(time, slopes): &(f64, Vec<f64>)| {
        velocity.interpolate(*time, &mut row);
        (slopes[joint], row[joint])
    };
    let pairs: Vec<(f64, f64)> = derived.iter().map(pair).collect();
    convention(fit(&pairs, LEAST_SPEED)?)
}

/// Torque against gains times errors plus feed-forward, all as they were commanded.
fn of_torque(run: &Run, joint: usize) -> Option<(String, Reading)> {
    let (c, m) = (&run.commands, &run.measured);
    let (torque, position) = (m.torque.as_ref()?, m.position.as_ref().filter(|p| !p.is_empty())?);
    let wanted = c.position.as_ref().filter(|p| run.actuator.kind == ActuatorKind::Pd && !p.is_empty())?;
    let held = |series: &Option<JointSeries>, time: f64| {
        series.as_ref().filter(|s| !s.is_empty()).map(|s| s.hold(time)[joint])
    };
    let (mut q, mut v) = (vec![0.0; position.joints], vec![0.0; position.joints]);
    let velocity = m.velocity.as_ref().filter(|v| !v.is_empty());
    let filter = joint_filter(position);
    let law = |i: usize| {
        let time = torque.time[i];
        position.interpolate(time, &mut q);
        match velocity {
            Some(velocity) => velocity.interpolate(time, &mut v),
            // Without its damping the law asks for another torque where a joint moves fast.
            None => v[joint] = filter.at(position, time)[joint].slope,
        }
        let kp = held(&c.kp, time).or(run.actuator.kp).unwrap_or(f64::NAN);
        let kd = held(&c.kd, time).or(run.actuator.kd).unwrap_or(0.0);
        let damping = kd * (held(&c.velocity, time).unwrap_or(0.0) - v[joint]);
        let forward = held(&c.torque, time).unwrap_or(0.0);
        (kp * (wanted.hold(time)[joint] - q[joint]) + damping + forward, torque.row(i)[joint])
    };
    let pairs: Vec<(f64, f64)> = some(torque).map(law).collect();
    convention(fit(&pairs, LEAST_TORQUE)?)
}

/// Whose convention is another's when a gyroscope and quaternions are compared.
enum Turning {
    /// Axes of the gyroscope, and what they are.
    OfGyro(Vec<(&'static str, String, Reading)>),
    /// The quaternions.
    OfQuaternion(&'static str, Reading),
    /// It does not turn, or nothing fits.
    Unknown,
}

/// Orders of quaternions other than this crate's: a name, and how to read them.
const ORDERS: [(&str, Reading); 3] = [
    ("as w, x, y, z it turns otherwise than the gyroscope says; as x, y, z, w it fits", Reading::ScalarLast),
    (
        "it turns otherwise than the gyroscope says; as w, x, y, z that were taken for x, y, z, w it fits",
        Reading::ScalarFirst,
    ),
    ("it turns otherwise than the gyroscope says; as the base's view of the world it fits", Reading::Inverse),
];

fn turning(gyro: &JointSeries, series: &JointSeries, first: usize) -> Turning {
    let rotation = |i: usize, reading: Option<Reading>| {
        let mut q: [f64; 4] = series.row(i)[first..first + 4].try_into().expect("four columns");
        reading.into_iter().for_each(|r| r.of(&mut q));
        DQuat::from_xyzw(q[1], q[2], q[3], q[0])
    };
    let rates = |reading: Option<Reading>| -> Vec<Option<Fit>> {
        let mut pairs = [const { Vec::new() }; 3];
        let mut later = 0;
        for i in some(series) {
            while later < series.len() && series.time[later] < series.time[i] + TURN {
                later += 1;
            }
            if later == series.len() {
                break;
            }
            let (from, to) = (series.time[i], series.time[later]);
            let turn = rotation(i, reading).conjugate() * rotation(later, reading);
            let turn = shorter_turn(turn.normalize()) / (to - from);
            let mean = mean_between(gyro, from, to);
            (0..3).for_each(|axis| pairs[axis].push((turn[axis], mean[axis])));
        }
        pairs.iter().map(|p| fit(p, LEAST_TURNING)).collect()
    };
    // All axes that turn, whichever way and in whatever unit.
    let fits = |all: &[Option<Fit>]| {
        let known: Vec<f64> = all.iter().flatten().map(|f| f.correlation).collect();
        known.len() >= 2 && known.iter().all(|c| c.abs() > SAME)
    };
    let agrees = |all: &[Option<Fit>]| fits(all) && all.iter().flatten().any(|f| f.correlation > SAME);
    let read = rates(None);
    let remarks = |all: &[Option<Fit>]| {
        let named = all.iter().zip(["x", "y", "z"]);
        let found = named.filter_map(|(f, name)| convention((*f)?).map(|(what, reading)| (name, what, reading)));
        found.collect::<Vec<_>>()
    };
    if agrees(&read) {
        return Turning::OfGyro(remarks(&read));
    }
    // One that fits as it is goes before one that fits with axes turned.
    let orders = ORDERS.map(|(what, reading)| (what, reading, rates(Some(reading))));
    let is_plain = |all: &[Option<Fit>]| all.iter().flatten().all(|f| f.correlation > SAME);
    let plain = orders.iter().find(|(_, _, all)| agrees(all) && is_plain(all));
    if let Some((what, reading, _)) = plain.or_else(|| orders.iter().find(|(_, _, all)| agrees(all))) {
        return Turning::OfQuaternion(what, *reading);
    }
    if fits(&read) { Turning::OfGyro(remarks(&read)) } else { Turning::Unknown }
}

/// Mean of the samples between two times.
fn mean_between(series: &JointSeries, from: f64, to: f64) -> [f64; 3] {
    let (first, last) = (series.time.partition_point(|&t| t < from), series.time.partition_point(|&t| t <= to));
    let mut sum = [0.0; 3];
    for i in first..last {
        (0..3).for_each(|k| sum[k] += series.row(i)[k]);
    }
    sum.map(|x| x / (last - first) as f64)
}

fn in_gravities(acceleration: &JointSeries) -> Option<(String, Reading)> {
    // Motion has no mean; what an IMU has freed of gravity has none either.
    let rows = some(acceleration).map(|i| DVec3::from_slice(&acceleration.row(i)[..3])).filter(|a| a.is_finite());
    let (sum, count) = rows.fold((DVec3::ZERO, 0), |(sum, n), a| (sum + a, n + 1));
    let middle = (sum / f64::from(count)).length();
    let near = |x: f64| (middle / x).ln().abs() < 0.2;
    let units = [("g", 1.0, GRAVITY), ("thousandths of g", 1e3, 1e-3 * GRAVITY), ("mm/s²", 1e3 * GRAVITY, 1e-3)];
    let (unit, _, by) = units.into_iter().find(|(_, gravity, _)| near(*gravity))?;
    Some((format!("gravity is {middle:.3}, expected {GRAVITY:.2} m/s²: {unit}"), Reading::Scaled(by)))
}

/// A base that often moves faster than any robot is not measured in metres.
fn too_fast(pose: &JointSeries) -> Option<(String, Reading)> {
    /// Noise of single samples is not to count \[s\].
    const APART: f64 = 0.1;
    let mut speeds = Vec::new();
    let mut before = 0;
    for i in 1..pose.len() {
        let passed = pose.time[i] - pose.time[before];
        if passed >= APART {
            let far: f64 = (0..3).map(|k| (pose.row(i)[k] - pose.row(before)[k]).powi(2)).sum();
            speeds.push(far.sqrt() / passed);
            before = i;
        }
    }
    speeds.retain(|x| x.is_finite());
    speeds.sort_by(f64::total_cmp);
    let often = *speeds.get(3 * speeds.len() / 4)?;
    // Only a height that a walking robot's trunk can have in one unit alone shows which.
    let mut heights: Vec<f64> = pose.column(2).filter(|z| z.is_finite()).collect();
    let height = median(&mut heights);
    let units = [("millimetres", 1e-3), ("centimetres", 1e-2), ("inches", 0.0254)];
    let fitting: Vec<(&str, f64)> = units.into_iter().filter(|(_, by)| HEIGHTS.contains(&(by * height))).collect();
    let (unit, reading) = match fitting[..] {
        [(unit, by)] => (unit, Reading::Scaled(by)),
        _ => ("some smaller unit", Reading::Unknown),
    };
    let what = format!("it moves at {often:.0} m/s, {height:.0} above the ground: expected metres, found {unit}");
    (speeds.len() > 20 && often > FASTEST_BASE).then_some((what, reading))
}
