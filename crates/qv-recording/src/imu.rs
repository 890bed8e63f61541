//! How an IMU is mounted: its channels are turned into the trunk's axes, once and here. Everything after this reads the
//! trunk's axes, and the simulator's IMU reports in them ([`in_trunk_axes`]).

use crate::derive::base_angular_velocity;
use crate::run::Run;
use glam::{DQuat, DVec3};
use qv_core::JointSeries;
use qv_sim::Model;

/// Angle between two directions of "up" from which on one mount is determined from another, and a stand from a fall: what lies
/// nearer could be a slope that the robot stands on.
const APART: f64 = 0.5;
/// A trunk that stands leans less than this \[rad\].
const LEAN: f64 = 0.8;
/// Angle up to which an attitude is that of the poses, and from which on it is another \[rad\]: a mount that is turned by less cannot be reported.
const SAME: f64 = 0.1;
const ANOTHER: f64 = 0.3;
/// Turning (root of mean square) from which on axes of a gyroscope can be reported \[rad/s\].
const LEAST_TURNING: f64 = 0.05;

/// Names of links that are an IMU, as the simulator looks for them.
const LINKS: [&str; 2] = ["imu", "imu_link"];

/// Rotation of the IMU on the base, by the model's link `imu` or `imu_link`.
pub fn mount_of(model: &Model) -> Option<DQuat> {
    let frame = model.frames.iter().find(|f| LINKS.contains(&f.name.as_str()))?;
    (frame.link == Some(0) && model.base_dofs() == 6).then_some(frame.link_from_frame.rotation)
}

/// Makes the model's IMU report in the trunk's axes, as runs do; where it sits stays.
pub fn in_trunk_axes(model: &mut Model) {
    for frame in model.frames.iter_mut().filter(|f| f.link == Some(0) && LINKS.contains(&f.name.as_str())) {
        frame.link_from_frame.rotation = DQuat::IDENTITY;
    }
}

/// Which axes a channel is in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Axes {
    Sensor,
    Trunk,
}

/// Turns attitude, gyroscope and acceleration of `run` from the axes of an IMU with rotation `base_from_imu` into the trunk's,
/// and says what was done.
///
/// `stated`: the recording states the mount; then the channels are in the sensor's axes. Else each channel is looked at: an
/// upright trunk (by the poses, where there are some) and the turning of the base show which axes it is in; what they do
/// not show is in the sensor's axes, as `formats.md` has it.
pub fn to_trunk(run: &mut Run, base_from_imu: DQuat, stated: bool) -> Vec<String> {
    let mut remarks = Vec::new();
    if base_from_imu.angle_between(DQuat::IDENTITY) < 1e-6 {
        return remarks;
    }
    let up = up_in_trunk(run);
    let axes = |seen: Option<DVec3>| match seen {
        Some(seen) if !stated => axes_of(seen, up, base_from_imu),
        _ => Some(Axes::Sensor),
    };
    let by_poses = if stated { Some(Axes::Sensor) } else { axes_of_attitude(run, base_from_imu) };
    let attitude = by_poses.or_else(|| axes(run.measured.orientation.as_ref().and_then(up_of_attitude)));
    let acceleration = axes(run.measured.acceleration.as_ref().and_then(mean)).or(attitude);
    let gyro = if stated { Some(Axes::Sensor) } else { axes_of_gyro(run, base_from_imu) };
    let gyro = gyro.or(acceleration.filter(|_| run.measured.acceleration.is_some())).or(attitude);
    let m = &mut run.measured;
    let mut kept = Vec::new();
    for (name, series, axes) in [
        ("attitude", &mut m.orientation, attitude),
        ("gyroscope", &mut m.gyro, gyro),
        ("acceleration", &mut m.acceleration, acceleration),
    ] {
        let Some(series) = series else { continue };
        if axes == Some(Axes::Trunk) {
            kept.push(name);
        } else if series.joints == 4 {
            turn_attitude(series, base_from_imu);
        } else {
            turn_vectors(series, base_from_imu);
        }
    }
    let [roll, pitch, yaw] = rpy(base_from_imu);
    let mount = format!("the IMU is mounted at roll {roll:.3}, pitch {pitch:.3}, yaw {yaw:.3} rad");
    remarks.push(match kept.len() {
        0 => format!("{mount}: its channels were turned into the trunk's axes"),
        _ => format!("{mount}, but {} are in the trunk's axes already: they stay as they are", kept.join(" and ")),
    });
    let leaning = [
        ("attitude", run.measured.orientation.as_ref().and_then(up_of_attitude)),
        ("acceleration", run.measured.acceleration.as_ref().and_then(mean)),
    ];
    for (name, seen) in leaning {
        let lean = seen.map_or(0.0, |seen| seen.angle_between(up));
        if lean > LEAN {
            remarks.push(format!(
                "the mount of the IMU contradicts gravity: by its {name} the standing trunk leans {lean:.2} rad \
                 (state `rotation` in [imu] of run.toml)"
            ));
        }
    }
    remarks
}

/// Roll, pitch and yaw about fixed axes \[rad\].
fn rpy(rotation: DQuat) -> [f64; 3] {
    let (yaw, pitch, roll) = rotation.to_euler(glam::EulerRot::ZYX);
    [roll, pitch, yaw]
}

/// Where up is for the trunk, on average: by its poses, else along z.
fn up_in_trunk(run: &Run) -> DVec3 {
    let from_poses = run.measured.base_pose.as_ref().and_then(|pose| {
        let quaternions = (0..pose.len()).map(|i| &pose.row(i)[3..7]);
        up_of(quaternions)
    });
    from_poses.unwrap_or(DVec3::Z)
}

fn up_of_attitude(series: &JointSeries) -> Option<DVec3> {
    up_of((0..series.len()).map(|i| series.row(i)))
}

/// Mean of the world's up in the axes of quaternions w, x, y, z.
fn up_of<'a>(quaternions: impl Iterator<Item = &'a [f64]>) -> Option<DVec3> {
    let known = quaternions.filter(|q| q.iter().all(|x| x.is_finite()));
    let sum: DVec3 = known.map(|q| DQuat::from_xyzw(q[1], q[2], q[3], q[0]).conjugate() * DVec3::Z).sum();
    (sum.length() > 0.0).then(|| sum.normalize())
}

/// Mean direction of vectors.
fn mean(series: &JointSeries) -> Option<DVec3> {
    let known = (0..series.len()).map(|i| DVec3::from_slice(series.row(i))).filter(|v| v.is_finite());
    let sum: DVec3 = known.sum();
    (sum.length() > 0.0).then(|| sum.normalize())
}

/// Which axes have up there; `None` where gravity cannot distinguish them.
fn axes_of(seen: DVec3, up: DVec3, base_from_imu: DQuat) -> Option<Axes> {
    let (as_sensor, as_trunk) = ((base_from_imu * seen).angle_between(up), seen.angle_between(up));
    ((as_sensor - as_trunk).abs() > APART).then_some(if as_sensor < as_trunk { Axes::Sensor } else { Axes::Trunk })
}

/// Which axes the attitude is in, where one of the two is that of the poses. Both may count yaw from a place of their own; then nothing is said.
fn axes_of_attitude(run: &Run, base_from_imu: DQuat) -> Option<Axes> {
    let attitude = run.measured.orientation.as_ref().filter(|series| !series.is_empty())?;
    let pose = run.measured.base_pose.as_ref()?;
    let quaternion = |q: &[f64]| DQuat::from_xyzw(q[1], q[2], q[3], q[0]);
    let (mut as_sensor, mut as_trunk, mut count) = (0.0, 0.0, 0);
    for i in 0..pose.len() {
        let (right, seen) = (quaternion(&pose.row(i)[3..7]), quaternion(attitude.hold(pose.time[i])));
        if right.is_finite() && seen.is_finite() {
            as_sensor += (seen * base_from_imu.conjugate()).angle_between(right);
            as_trunk += seen.angle_between(right);
            count += 1;
        }
    }
    let [as_sensor, as_trunk] = [as_sensor, as_trunk].map(|sum| sum / f64::from(count.max(1)));
    match (count > 0, as_sensor, as_trunk) {
        (true, near, far) if near < SAME && far > ANOTHER => Some(Axes::Sensor),
        (true, far, near) if near < SAME && far > ANOTHER => Some(Axes::Trunk),
        _ => None,
    }
}

/// Which axes the gyroscope is in, by the turning of the poses, else of the attitude in the trunk's axes.
fn axes_of_gyro(run: &Run, base_from_imu: DQuat) -> Option<Axes> {
    let gyro = run.measured.gyro.as_ref()?;
    let turning = base_angular_velocity(run.measured.base_pose.as_ref()?)?.series;
    let (mut as_sensor, mut as_trunk, mut all, mut count) = (0.0, 0.0, 0.0, 0);
    for i in 0..turning.len() {
        let (right, seen) = (DVec3::from_slice(turning.row(i)), DVec3::from_slice(gyro.hold(turning.time[i])));
        if right.is_finite() && seen.is_finite() {
            as_sensor += (base_from_imu * seen - right).length_squared();
            as_trunk += (seen - right).length_squared();
            all += right.length_squared();
            count += 1;
        }
    }
    // One of the two must be clearly nearer: a quarter of the other's square.
    let turns = count > 0 && all / f64::from(count) > LEAST_TURNING * LEAST_TURNING;
    match (turns, 4.0 * as_sensor < as_trunk, 4.0 * as_trunk < as_sensor) {
        (true, true, _) => Some(Axes::Sensor),
        (true, _, true) => Some(Axes::Trunk),
        _ => None,
    }
}

fn turn_vectors(series: &mut JointSeries, base_from_imu: DQuat) {
    for row in series.values.chunks_exact_mut(3) {
        row.copy_from_slice(&(base_from_imu * DVec3::from_slice(row)).to_array());
    }
}

/// World from IMU becomes world from base.
fn turn_attitude(series: &mut JointSeries, base_from_imu: DQuat) {
    for row in series.values.chunks_exact_mut(4) {
        let turned = DQuat::from_xyzw(row[1], row[2], row[3], row[0]) * base_from_imu.conjugate();
        row.copy_from_slice(&[turned.w, turned.x, turned.y, turned.z]);
    }
}
