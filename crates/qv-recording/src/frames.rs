//! Axes that another frame has: an IMU that is mounted at an angle that nothing states, poses with y up, accelerations without gravity.
//!
//! The gyroscope is compared with how attitude and poses turn, under each of the 24 rotations that map axes to axes.

use crate::derive::shorter_turn;
use crate::run::{Base, Fault, FaultKind, Run};
use glam::{DMat3, DQuat, DVec3};
use qv_core::JointSeries;
use qv_core::statistics::median;

/// Time over which turns are compared \[s\], and pairs that are, at most.
const TURN: f64 = 0.05;
const MOST: usize = 2000;
/// Turning (root of mean square) that shows a rotation \[rad/s\].
const LEAST_TURNING: f64 = 0.1;
/// Share of the turning that the right rotation may leave, and the stated axes must.
const AGREES: f64 = 0.2;
const DIFFERS: f64 = 0.6;
/// Mean acceleration below which gravity is missing \[m/s²\].
const NO_GRAVITY: f64 = 2.0;
const GRAVITY: f64 = 9.81;
/// Heights that a base may stand at \[m\].
const HEIGHTS: std::ops::Range<f64> = 0.1..1.5;
/// A way of which this much lies along one axis \[m\], and the share of it along the axis that is up.
const LEAST_WAY: f64 = 0.2;
const LEVEL: f64 = 0.1;

fn fault(run: &Run, (channel, detail): (&str, String)) -> Fault {
    Fault { kind: FaultKind::Convention, channel: channel.into(), time: run.span()[0], count: 1, detail }
}

/// Poses with y up and accelerations without gravity, as faults.
pub(crate) fn faults(run: &Run) -> Vec<Fault> {
    let m = &run.measured;
    if run.base != Base::Free {
        return Vec::new();
    }
    let poses = m.base_pose.as_ref().filter(|p| p.joints == 7).and_then(up_is_y);
    let gravity = m.acceleration.as_ref().and_then(without_gravity);
    let all = [poses.map(|what| ("base pose", what)), gravity.map(|what| ("acceleration", what))];
    all.into_iter().flatten().map(|what| fault(run, what)).collect()
}

/// Adds to the faults of `run` an IMU whose axes are not the trunk's: after its channels were turned by what is known of its mount.
pub fn report_mount(run: &mut Run) {
    // Axes of poses with another up say nothing of the IMU.
    let is_known =
        |f: &Fault| f.kind == FaultKind::Convention && ["base pose", "orientation"].contains(&f.channel.as_str());
    if run.base == Base::Free
        && !run.faults.iter().any(is_known)
        && let Some(what) = imu_turned(run)
    {
        // Axis by axis it is no more than this.
        run.faults.retain(|f| !(f.kind == FaultKind::Convention && f.channel.starts_with("gyro ")));
        run.faults.push(fault(run, what));
    }
}

/// Rotations that map axes to axes: no reflections.
fn rotations() -> Vec<DMat3> {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let signed: Vec<DVec3> = axes.iter().flat_map(|a| [*a, -*a]).collect();
    let mut all = Vec::new();
    for x in &signed {
        for y in signed.iter().filter(|y| y.dot(*x) == 0.0) {
            all.push(DMat3::from_cols(*x, *y, x.cross(*y)));
        }
    }
    all
}

/// The gyroscope's mean and the mean angular velocity by quaternions, in their body, over short times.
fn turns(gyro: &JointSeries, series: &JointSeries, first: usize) -> Vec<(DVec3, DVec3)> {
    let rotation = |i: usize| {
        let q = &series.row(i)[first..first + 4];
        DQuat::from_xyzw(q[1], q[2], q[3], q[0])
    };
    let (mut pairs, mut later, mut begun) = (Vec::new(), 0, 0);
    for i in (0..series.len()).step_by(series.len().div_ceil(MOST).max(1)) {
        while later < series.len() && series.time[later] < series.time[i] + TURN {
            later += 1;
        }
        if later == series.len() {
            break;
        }
        let (from, to) = (series.time[i], series.time[later]);
        begun += gyro.time[begun..].partition_point(|t| *t < from);
        let rows = begun..begun + gyro.time[begun..].partition_point(|t| *t <= to);
        let count = rows.len() as f64;
        let mean = rows.map(|k| DVec3::from_slice(&gyro.row(k)[..3])).sum::<DVec3>() / count;
        let turn = shorter_turn((rotation(i).conjugate() * rotation(later)).normalize()) / (to - from);
        if mean.is_finite() && turn.is_finite() {
            pairs.push((mean, turn));
        }
    }
    pairs
}

/// The rotation that makes the gyroscope turn as quaternions do, where the stated axes do not.
fn rotation_between(pairs: &[(DVec3, DVec3)]) -> Option<DMat3> {
    let all: f64 = pairs.iter().map(|(_, turn)| turn.length_squared()).sum();
    if pairs.len() < 50 || all / (pairs.len() as f64) < LEAST_TURNING * LEAST_TURNING {
        return None;
    }
    let left = |r: &DMat3| pairs.iter().map(|(gyro, turn)| (*r * *gyro - *turn).length_squared()).sum::<f64>() / all;
    let best = rotations().into_iter().min_by(|a, b| left(a).total_cmp(&left(b)))?;
    (left(&DMat3::IDENTITY) > DIFFERS && left(&best) < AGREES).then_some(best)
}

/// An IMU, or its gyroscope alone, whose axes are not the trunk's.
fn imu_turned(run: &Run) -> Option<(&'static str, String)> {
    let m = &run.measured;
    let gyro = m.gyro.as_ref().filter(|g| g.joints == 3 && !g.is_empty())?;
    let of = |series: &Option<JointSeries>, first: usize| {
        let series = series.as_ref().filter(|s| s.joints >= first + 4 && !s.is_empty())?;
        rotation_between(&turns(gyro, series, first))
    };
    let words = |r: DMat3| {
        let (yaw, pitch, roll) = DQuat::from_mat3(&r).to_euler(glam::EulerRot::ZYX);
        format!(
            "turned by roll {roll:.2}, pitch {pitch:.2}, yaw {yaw:.2} rad; run.toml: [imu] rotation = [{roll:.4}, {pitch:.4}, {yaw:.4}]"
        )
    };
    if let Some(r) = of(&m.orientation, 0) {
        return Some(("gyro", format!("against the attitude its axes are {}", words(r))));
    }
    let r = of(&m.base_pose, 3)?;
    Some((
        "imu",
        format!(
            "against the poses the axes of the IMU are {} (or the poses are of a body that is turned so)",
            words(r)
        ),
    ))
}

/// Poses whose way lies along x and z, at a height along y.
fn up_is_y(pose: &JointSeries) -> Option<String> {
    let column = |k: usize| pose.column(k).filter(|x| x.is_finite()).collect::<Vec<f64>>();
    let range = |mut all: Vec<f64>| {
        all.sort_by(f64::total_cmp);
        let at = |share: f64| all.get((share * all.len() as f64) as usize).copied().unwrap_or(f64::NAN);
        at(0.95) - at(0.05)
    };
    let (y, z) = (range(column(1)), range(column(2)));
    let height = median(&mut column(1));
    let is_so = z > LEAST_WAY && y < LEVEL * z && HEIGHTS.contains(&height);
    is_so.then(|| {
        format!(
            "they go {z:.2} m along z and {y:.2} m along y, at {height:.2} m: y is up there; expected z up: read them as x, -z, y, and \
             quaternions w, x, -z, y (or --fix)"
        )
    })
}

fn without_gravity(acceleration: &JointSeries) -> Option<String> {
    let rows = (0..acceleration.len()).map(|i| DVec3::from_slice(&acceleration.row(i)[..3]));
    let rows: Vec<DVec3> = rows.filter(|a| a.is_finite()).collect();
    let mean = (rows.iter().sum::<DVec3>() / rows.len().max(1) as f64).length();
    // A robot that turned over has gravity in each sample, and little of it in the mean.
    let usual = median(&mut rows.iter().map(|a| a.length()).collect::<Vec<f64>>());
    let is_small = mean < NO_GRAVITY && usual < 0.5 * GRAVITY;
    (rows.len() > 50 && is_small && !(0.9..1.1).contains(&mean)).then(|| {
        format!(
            "its mean is {mean:.2}, expected 9.81 m/s²: gravity was taken away, or it holds velocities; it is left out"
        )
    })
}

/// Reads poses with y up as this crate's: z up. The fault becomes a remark.
pub fn fix(mut run: Run) -> Run {
    let is_ours =
        |f: &Fault| f.kind == FaultKind::Convention && f.channel == "base pose" && f.detail.contains("y is up");
    let Some(at) = run.faults.iter().position(is_ours) else { return run };
    let fault = run.faults.remove(at);
    for row in run.measured.base_pose.iter_mut().flat_map(|p| p.values.chunks_exact_mut(7)) {
        (row[1], row[2]) = (-row[2], row[1]);
        (row[5], row[6]) = (-row[6], row[5]);
    }
    run.remarks.push(format!("base pose: {}; read so (--fix)", fault.detail));
    run
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::Robot;

    fn sway(time: f64) -> DQuat {
        DQuat::from_euler(
            glam::EulerRot::ZYX,
            0.5 * (0.7 * time).sin(),
            0.2 * (2.1 * time).sin(),
            0.3 * (1.3 * time).cos(),
        )
    }

    /// Ten seconds of a base that sways and walks along x; its gyroscope's axes are those of `mount`.
    fn run(mount: DMat3) -> Run {
        let time: Vec<f64> = (0..2000).map(|i| 0.005 * f64::from(i)).collect();
        let mut run = Run::empty(Robot::Named("a".into()), Base::Free, vec!["a".into()]);
        let rows = |of: &dyn Fn(f64) -> Vec<f64>, joints: usize| {
            Some(JointSeries { time: time.clone(), values: time.iter().flat_map(|t| of(*t)).collect(), joints })
        };
        let rate = |t: f64| shorter_turn(sway(t).conjugate() * sway(t + 1e-4)) / 1e-4;
        run.measured.position = rows(&|_| vec![0.0], 1);
        run.measured.gyro = rows(&|t| (mount.transpose() * rate(t)).to_array().to_vec(), 3);
        let quaternion = |t: f64| [sway(t).w, sway(t).x, sway(t).y, sway(t).z];
        run.measured.orientation = rows(&|t| quaternion(t).to_vec(), 4);
        run.measured.base_pose = rows(&|t| [vec![0.2 * t, 0.01 * t, 0.3], quaternion(t).to_vec()].concat(), 7);
        run.measured.acceleration = rows(&|_| vec![0.1, 0.0, 9.8], 3);
        run
    }

    #[test]
    fn right_axes_are_not_reported_and_turned_ones_are_named() {
        let reported = |mut run: Run| {
            report_mount(&mut run);
            run.faults
        };
        assert_eq!(reported(run(DMat3::IDENTITY)), []);
        for r in rotations().into_iter().filter(|r| *r != DMat3::IDENTITY) {
            let found = reported(run(r));
            let (yaw, pitch, roll) = DQuat::from_mat3(&r).to_euler(glam::EulerRot::ZYX);
            let line = format!("[imu] rotation = [{roll:.4}, {pitch:.4}, {yaw:.4}]");
            assert!(matches!(&found[..], [f] if f.channel == "gyro" && f.detail.contains(&line)), "{r} {found:?}");
        }
    }

    #[test]
    fn poses_with_y_up_are_named_and_read() {
        let right = run(DMat3::IDENTITY);
        let mut turned = right.clone();
        turned.measured.base_pose.as_mut().unwrap().values.chunks_exact_mut(7).for_each(|row| {
            (row[1], row[2]) = (row[2], -row[1] - 0.1 * row[0]);
            (row[5], row[6]) = (row[6], -row[5]);
        });
        turned.faults = faults(&turned);
        assert!(matches!(&turned.faults[..], [f] if f.channel == "base pose" && f.detail.contains("y is up")));
        let fixed = fix(turned);
        assert!(fixed.faults.is_empty() && fixed.remarks.len() == 1);
        let heights = |run: &Run| run.measured.base_pose.as_ref().unwrap().column(2).collect::<Vec<f64>>();
        assert_eq!(heights(&fixed), heights(&right));
        assert_eq!(faults(&fixed), []);
    }

    #[test]
    fn accelerations_without_gravity_are_named() {
        let mut run = run(DMat3::IDENTITY);
        run.measured.acceleration.as_mut().unwrap().values.iter_mut().skip(2).step_by(3).for_each(|z| *z -= 9.81);
        let found = faults(&run);
        assert!(matches!(&found[..], [f] if f.channel == "acceleration"), "{found:?}");
    }

    #[test]
    fn a_robot_that_turned_over_has_gravity() {
        let rows = (0..400).flat_map(|k| [0.1, -0.2, if k < 200 { 9.7 } else { -9.7 }]).collect();
        let acceleration =
            JointSeries { time: (0..400).map(|k| 0.01 * f64::from(k)).collect(), values: rows, joints: 3 };
        assert_eq!(without_gravity(&acceleration), None);
    }
}
