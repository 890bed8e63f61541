//! The measured side of a comparison: channels of a window as features, one number per channel and bin.
//!
//! A feature is the value at the middle of its bin of a straight line through the samples in it, so that samples at
//! other instants on the simulated side make no difference.

use crate::channels::Channel;
use crate::robot::Rollout;
use crate::sensors::SensorErrors;
use crate::start::Starts;
use crate::window::Window;
use glam::{DQuat, DVec3};
use qv_core::JointSeries;
use qv_recording::Run;

/// Times of the samples of a window that starts at `start`: after each interval.
pub(crate) fn sample_times<'a>(rollout: &'a Rollout, start: f64) -> impl Iterator<Item = f64> + 'a {
    let count = rollout.cut.bins() * rollout.cut.samples_per_bin();
    (1..=count).map(move |k| start + k as f64 * rollout.cut.sample)
}

/// The measured attitude of the base at each sample, `world_from_base`; `None` when it cannot be reported.
pub(crate) fn attitudes(rollout: &Rollout, view: &Run, starts: &Starts, start: f64) -> Option<Vec<DQuat>> {
    let yaw = yaw_of_imu(rollout, view, starts, start)?;
    sample_times(rollout, start).map(|t| attitude_at(view, yaw, &SensorErrors::default(), t)).collect()
}

/// Turn about z from the IMU's own world to that of the poses; 0 without an IMU.
fn yaw_of_imu(rollout: &Rollout, view: &Run, starts: &Starts, start: f64) -> Option<f64> {
    let Some(imu) = &view.measured.orientation else { return Some(0.0) };
    let middle = start + 0.5 * rollout.cut.window;
    let turn = starts.orientation(middle)? * (rotation_at(imu, 0, middle)? * starts.tilt().conjugate()).conjugate();
    Some(2.0 * turn.z.atan2(turn.w))
}

fn attitude_at(view: &Run, yaw: f64, errors: &SensorErrors, time: f64) -> Option<DQuat> {
    match &view.measured.orientation {
        Some(imu) => Some(DQuat::from_rotation_z(yaw) * rotation_at(imu, 0, time)? * tilt_of(errors).conjugate()),
        None => rotation_at(view.measured.base_pose.as_ref()?, 3, time + errors.pose_delay),
    }
}

/// Base from IMU.
fn tilt_of(errors: &SensorErrors) -> DQuat {
    DQuat::from_rotation_y(errors.imu_tilt[1]) * DQuat::from_rotation_x(errors.imu_tilt[0])
}

/// The rotation at `time` from the quaternion w, x, y, z in columns `first` to `first + 3`.
pub fn rotation_at(series: &JointSeries, first: usize, time: f64) -> Option<DQuat> {
    let rotation = |row: &[f64]| {
        let q = DQuat::from_xyzw(row[first + 1], row[first + 2], row[first + 3], row[first]);
        (q.is_finite() && q.length_squared() > 0.25).then(|| q.normalize())
    };
    if series.is_empty() {
        return None;
    }
    let i = series.index_at(time).unwrap_or(0);
    let a = rotation(series.row(i))?;
    if i + 1 >= series.len() || time <= series.time[i] {
        return Some(a);
    }
    let b = rotation(series.row(i + 1))?;
    Some(a.slerp(b, ((time - series.time[i]) / (series.time[i + 1] - series.time[i])).clamp(0.0, 1.0)))
}

/// The small turn from `b` to `a` as a vector in the world \[rad\].
pub fn turn(a: DQuat, b: DQuat) -> DVec3 {
    let q = a * b.conjugate();
    (if q.w < 0.0 { -q } else { q }).to_scaled_axis()
}

/// Features of the measured channels of a window, freed of the sensors' errors; NaN where a channel has a hole. `starts`
/// are those of the window's view under the same errors.
/// [`Channel::Ground`] is left at 0: it comes with the start.
pub fn features(rollout: &Rollout, window: &Window, starts: &Starts, errors: &SensorErrors) -> Vec<f64> {
    let (view, cut) = (&window.view, rollout.cut);
    let bins = cut.bins();
    let times: Vec<f64> = sample_times(rollout, window.start).collect();
    let turns = Turns::new(rollout, window, starts, errors, &times);
    let m = &view.measured;
    let mut out = Vec::new();
    for &channel in &rollout.channels {
        let series = |series: &Option<JointSeries>, column: usize, shift: f64, out: &mut Vec<f64>| {
            let line = |b: usize| match series {
                Some(s) => line_through(s, column, window.start + shift + b as f64 * cut.bin, cut.bin),
                None => f64::NAN,
            };
            out.extend((0..bins).map(line));
        };
        let latency = |j: usize| errors.encoder_latency.get(j).copied().unwrap_or(0.0);
        match channel {
            Channel::Position(j) => series(&m.position, rollout.columns[j], latency(j), &mut out),
            Channel::Velocity(j) => series(&m.velocity, rollout.columns[j], latency(j), &mut out),
            Channel::Base(axis) => series(&m.base_pose, axis, errors.pose_delay, &mut out),
            Channel::Gyro(axis) => out.extend(rates(view, window.start, cut.bin, bins, errors).iter().map(|r| r[axis])),
            Channel::Attitude(axis) => out.extend(middles(&turns.attitude, axis, bins)),
            Channel::PoseAgainstImu(axis) => out.extend(middles(&turns.pose, axis, bins)),
            Channel::Ground => out.push(0.0),
        }
    }
    out
}

/// Rates of the base in each bin, freed of bias and tilt.
fn rates(view: &Run, start: f64, bin: f64, bins: usize, errors: &SensorErrors) -> Vec<DVec3> {
    let Some(gyro) = &view.measured.gyro else { return vec![DVec3::NAN; bins] };
    let at = |b: usize| {
        let axis = |a: usize| line_through(gyro, a, start + b as f64 * bin, bin) - errors.gyro_bias[a];
        tilt_of(errors) * DVec3::new(axis(0), axis(1), axis(2))
    };
    (0..bins).map(at).collect()
}

/// Small turns at the samples of a window.
struct Turns {
    attitude: Vec<DVec3>,
    pose: Vec<DVec3>,
}

impl Turns {
    fn new(rollout: &Rollout, window: &Window, starts: &Starts, errors: &SensorErrors, times: &[f64]) -> Self {
        let nothing = Self { attitude: Vec::new(), pose: Vec::new() };
        if !rollout.free {
            return nothing;
        }
        let view = &window.view;
        let Some(yaw) = yaw_of_imu(rollout, view, starts, window.start) else { return nothing };
        let mut turns = nothing;
        for (&time, &reference) in times.iter().zip(&window.attitude) {
            let seen = attitude_at(view, yaw, errors, time);
            turns.attitude.push(seen.map_or(DVec3::NAN, |q| turn(q, reference)));
            let pose = view.measured.base_pose.as_ref().and_then(|p| rotation_at(p, 3, time + errors.pose_delay));
            turns.pose.push(pose.zip(seen).map_or(DVec3::NAN, |(p, q)| turn(p, q)));
        }
        turns
    }
}

/// Values at the middles of the bins of samples that lie at the end of equal intervals.
pub fn middles(samples: &[DVec3], axis: usize, bins: usize) -> Vec<f64> {
    if samples.is_empty() {
        return vec![f64::NAN; bins];
    }
    let per_bin = samples.len() / bins;
    (0..bins).map(|b| middle((0..per_bin).map(|k| samples[b * per_bin + k][axis]), per_bin)).collect()
}

/// Value at the middle of a bin of the line through `count` samples at the ends of equal intervals.
pub fn middle(samples: impl Iterator<Item = f64>, count: usize) -> f64 {
    // Instants from the middle, in intervals: their mean is a half.
    let (mut sum, mut moment, mut square) = (0.0, 0.0, 0.0);
    for (k, x) in samples.enumerate() {
        let u = k as f64 + 0.5 - 0.5 * count as f64;
        sum += x;
        moment += u * x;
        square += u * u;
    }
    let mean = sum / count as f64;
    if count < 2 { mean } else { mean - 0.5 * moment / square }
}

/// Value at the middle of the bin from `from` \[s\] of a line through the rows in it; interpolated where there are fewer
/// than four.
pub fn line_through(series: &JointSeries, column: usize, from: f64, bin: f64) -> f64 {
    let centre = from + 0.5 * bin;
    let first = series.time.partition_point(|&t| t < from - 1e-9);
    let last = series.time.partition_point(|&t| t <= from + bin + 1e-9);
    let (mut n, mut t1, mut x1, mut t2, mut tx) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for i in first..last {
        let (t, x) = (series.time[i] - centre, series.values[i * series.joints + column]);
        if x.is_finite() {
            (n, t1, x1, t2, tx) = (n + 1.0, t1 + t, x1 + x, t2 + t * t, tx + t * x);
        }
    }
    let spread = n * t2 - t1 * t1;
    if n >= 4.0 && spread > 0.0 {
        return (x1 * t2 - t1 * tx) / spread;
    }
    let i = series.index_at(centre).unwrap_or(0);
    if i + 1 >= series.len() {
        return f64::NAN;
    }
    let at = |i: usize| series.values[i * series.joints + column];
    let f = (centre - series.time[i]) / (series.time[i + 1] - series.time[i]);
    at(i) + f * (at(i + 1) - at(i))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_line_has_one_value_at_the_middle_of_a_bin_however_it_is_sampled() {
        let line = |t: f64| 2.0 + 3.0 * t;
        let time: Vec<f64> = (0..100).map(|k| 0.002 * k as f64).collect();
        let series = JointSeries { values: time.iter().map(|&t| line(t)).collect(), time, joints: 1 };
        let measured = line_through(&series, 0, 0.05, 0.05);
        let simulated = middle((1..=10).map(|k| line(0.05 + 0.005 * k as f64)), 10);
        assert!((measured - line(0.075)).abs() < 1e-12 && (simulated - line(0.075)).abs() < 1e-12);
        // Three rows in a bin are too few for a line of their own.
        let slow: Vec<f64> = (0..10).map(|k| 0.02 * k as f64).collect();
        let series = JointSeries { values: slow.iter().map(|&t| line(t)).collect(), time: slow, joints: 1 };
        assert!((line_through(&series, 0, 0.05, 0.05) - line(0.075)).abs() < 1e-12);
        assert!(line_through(&series, 0, 5.0, 0.05).is_nan(), "nothing was measured there");
    }

    #[test]
    fn turns_are_small_rotation_vectors_in_the_world() {
        let a = DQuat::from_rotation_z(1.0);
        let by = DVec3::new(0.01, -0.02, 0.005);
        let turned = DQuat::from_scaled_axis(by) * a;
        assert!((turn(turned, a) - by).length() < 1e-12);
        assert!((turn(-turned, a) - by).length() < 1e-12);
    }
}
