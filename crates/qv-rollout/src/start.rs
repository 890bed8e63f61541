//! The state of the robot at a given time of a recording, smoothed: where a simulation starts.
//!
//! Joints by a local cubic over +-6 samples. Base orientation by the IMU, its yaw turned onto that of the poses. Base
//! position and velocity by least squares over +-0.4 s: the acceleration measured at the IMU, integrated twice, gives
//! the shape of the path; the poses give its start and speed, and a constant error of the acceleration.

use crate::RolloutError;
use crate::legs::{Legs, walked};
use crate::sensors::{SensorErrors, rotation_near, rotation_of, tilt_of};
use glam::{DQuat, DVec3};
use qv_core::{GRAVITY, JointSeries, Pose};
use qv_recording::derive::{base_angular_velocity, base_velocity, joint_filter, joint_velocity};
use qv_recording::smooth::LocalPolynomial;
use qv_recording::{Run, median_interval};
use qv_sim::State;
use std::borrow::Cow;
use std::sync::Arc;

/// Half-width of the fit of the base's path \[s\].
const BASE_HALF_WIDTH: f64 = 0.4;

/// Spread of a pose's position \[m\] and of the accelerometer's constant error \[m/s²\] that the fit assumes.
const POSE_SPREAD: f64 = 0.003;
const BIAS_SPREAD: f64 = 0.2;

/// Gives smoothed states of one run.
pub struct Starts<'a> {
    run: &'a Run,
    free: bool,
    /// Column of the run for each joint of the model.
    columns: Vec<usize>,
    errors: SensorErrors,
    /// Base from IMU, by the tilt that is assumed.
    tilt: DQuat,
    /// Poses of the base: measured, or by its legs.
    poses: Option<Cow<'a, JointSeries>>,
    /// Shared by all errors that concern the joints and the gyroscope alone.
    prepared: Arc<SmoothedStart>,
}

/// What takes most of the time.
#[derive(Default)]
struct SmoothedStart {
    /// Sine and cosine of the yaw from the IMU's world to that of each pose.
    yaws: Vec<Yaw>,
    derived_velocity: Option<JointSeries>,
    base_velocity: Option<JointSeries>,
    base_rate: Option<JointSeries>,
    /// World from base at the stamps of the IMU.
    path: Option<ImuPath>,
    filters: Filters,
}

/// How channels are smoothed; each looks at all stamps of its own.
#[derive(Default)]
struct Filters {
    position: Option<LocalPolynomial>,
    velocity: Option<LocalPolynomial>,
    gyro: Option<LocalPolynomial>,
}

impl Filters {
    fn of(run: &Run) -> Self {
        let filter = |series: &Option<JointSeries>| series.as_ref().map(joint_filter);
        let m = &run.measured;
        Self { position: filter(&m.position), velocity: filter(&m.velocity), gyro: filter(&m.gyro) }
    }
}

/// How a pose is turned against the IMU.
#[derive(Clone, Copy)]
enum Yaw {
    /// Sine and cosine.
    Of(f64, f64),
    /// The pose has no rotation.
    NoPose,
    /// The IMU says nothing there.
    NoImu,
}

/// Acceleration of the IMU in the world, and its running integrals.
struct ImuPath {
    time: Vec<f64>,
    velocity: Vec<DVec3>,
    position: Vec<DVec3>,
}

impl<'a> Starts<'a> {
    /// Prepares `run` for a model whose joint `j` is column `columns[j]` of the run.
    ///
    /// # Errors
    /// When the run lacks joint positions, or a free base has no poses.
    pub fn new(run: &'a Run, columns: &[usize], free: bool, errors: SensorErrors) -> Result<Self, RolloutError> {
        let poses = run.measured.base_pose.as_ref().filter(|_| free).map(Cow::Borrowed);
        if free && poses.is_none() {
            return Err(RolloutError::run("replay of a free base", "a stream of base poses", "none"));
        }
        Self::prepared(run, columns, poses, errors)
    }

    /// The same for a free base without poses: it goes where its `legs` carry it (see [`Legs`]), from the origin.
    ///
    /// # Errors
    /// When the run lacks joint positions, the IMU's orientation, or the model has no feet.
    pub fn on_legs(run: &'a Run, columns: &[usize], errors: SensorErrors, legs: Legs) -> Result<Self, RolloutError> {
        // What is not measured is not late.
        let errors = SensorErrors { pose_delay: 0.0, ..errors };
        let poses = walked(run, columns, &errors, tilt_of(&errors), legs);
        let lacks = || {
            RolloutError::run(
                "a walk without poses",
                "feet, joint positions and the IMU's orientation",
                "not all of them",
            )
        };
        Self::prepared(run, columns, Some(Cow::Owned(poses.ok_or_else(lacks)?)), errors)
    }

    fn prepared(
        run: &'a Run,
        columns: &[usize],
        poses: Option<Cow<'a, JointSeries>>,
        errors: SensorErrors,
    ) -> Result<Self, RolloutError> {
        if run.measured.position.is_none() {
            return Err(RolloutError::run("replay", "measured joint positions", "none"));
        }
        let tilt = tilt_of(&errors);
        let columns = columns.to_vec();
        let free = poses.is_some();
        let mut starts = Self { run, free, columns, tilt, errors, poses, prepared: Arc::default() };
        let derived_velocity = match run.measured.velocity {
            Some(_) => None,
            None => joint_velocity(run).map(|d| d.series),
        };
        let mut prepared = SmoothedStart { derived_velocity, filters: Filters::of(run), ..SmoothedStart::default() };
        if let Some(poses) = &starts.poses {
            prepared.yaws = starts.yaws();
            prepared.path = starts.imu_path();
            // Derived from the poses only where no IMU shows better: differentiating costs more than all else here.
            if prepared.path.is_none() {
                prepared.base_velocity = base_velocity(poses).map(|d| d.series);
            }
            if run.measured.gyro.is_none() {
                prepared.base_rate = base_angular_velocity(poses).map(|d| d.series);
            }
        }
        starts.prepared = Arc::new(prepared);
        Ok(starts)
    }

    /// The same recording with other errors of the sensors, in a fraction of the time; `None` where they change the path of the base.
    pub fn with_errors(&self, errors: &SensorErrors) -> Option<Self> {
        let is_measured = matches!(self.poses, None | Some(Cow::Borrowed(_)));
        let same_path = self.errors.imu_tilt == errors.imu_tilt && self.errors.pose_delay == errors.pose_delay;
        (is_measured && same_path).then(|| Self {
            run: self.run,
            free: self.free,
            columns: self.columns.clone(),
            errors: errors.clone(),
            tilt: self.tilt,
            poses: self.poses.clone(),
            prepared: self.prepared.clone(),
        })
    }

    /// The smoothed state at `time` \[s\]; `None` where too little was measured near it.
    pub fn at(&self, time: f64) -> Option<State> {
        let (q, v) = self.joints(time)?;
        let state = if self.free {
            let (pose, linear, angular) = self.base(time)?;
            let [w, x, y, z] = pose.wxyz();
            let p = pose.position;
            State {
                q: [p.x, p.y, p.z, w, x, y, z].into_iter().chain(q).collect(),
                v: linear.to_array().into_iter().chain(angular.to_array()).chain(v).collect(),
            }
        } else {
            State { q, v }
        };
        state.q.iter().chain(&state.v).all(|x| x.is_finite()).then_some(state)
    }

    fn joints(&self, time: f64) -> Option<(Vec<f64>, Vec<f64>)> {
        let latency = |j: usize| self.errors.encoder_latency.get(j).copied().unwrap_or(0.0);
        let first = latency(0);
        let (mut q, mut v) = self.joints_as_reported(time + first)?;
        // Joints rarely differ in latency: another look at the recording for each that does.
        for j in (1..q.len()).filter(|&j| latency(j) != first) {
            let (other_q, other_v) = self.joints_as_reported(time + latency(j))?;
            (q[j], v[j]) = (other_q[j], other_v[j]);
        }
        Some((q, v))
    }

    /// Smoothed positions, freed of their bias, and velocities at the stamp `time`.
    fn joints_as_reported(&self, time: f64) -> Option<(Vec<f64>, Vec<f64>)> {
        let position = self.run.measured.position.as_ref()?;
        let filters = &self.prepared.filters;
        let at = filters.position?.at(position, time);
        let speeds: Vec<f64> = match self.run.measured.velocity.as_ref() {
            Some(velocity) => filters.velocity?.at(velocity, time).iter().map(|s| s.value).collect(),
            None => at.iter().map(|s| s.slope).collect(),
        };
        let bias = |j: usize| self.errors.encoder_bias.get(j).copied().unwrap_or(0.0);
        let q = self.columns.iter().enumerate().map(|(j, &c)| at[c].value - bias(j)).collect();
        let v = self.columns.iter().map(|&c| speeds[c]).collect();
        Some((q, v))
    }

    /// Joint velocities to compare with \[rad/s\]: measured, else derived from positions.
    pub fn velocities(&self) -> Option<&JointSeries> {
        self.run.measured.velocity.as_ref().or(self.prepared.derived_velocity.as_ref())
    }

    /// Pose `world_from_base`, linear velocity in the world, angular velocity in the base.
    fn base(&self, time: f64) -> Option<(Pose, DVec3, DVec3)> {
        let rotation = self.orientation(time)?;
        let angular = self.angular(time)?;
        let poses = self.poses.as_deref()?;
        let late = time + self.errors.pose_delay;
        let (position, velocity) = match &self.prepared.path {
            Some(path) => {
                let (p, v) = path.fit(poses, time, self.errors.pose_delay, |t| self.imu_offset(t))?;
                let arm = DVec3::from_array(self.run.imu_position);
                (p - rotation * arm, v - rotation * angular.cross(arm))
            }
            None => {
                let filter = LocalPolynomial { half_width: 0.1, degree: 3 };
                let at = filter.at(poses, late);
                let speed = filter.at(self.prepared.base_velocity.as_ref()?, late);
                (vector(&at, |s| s.value), vector(&speed, |s| s.value))
            }
        };
        Some((Pose { position, rotation }, velocity, angular))
    }

    /// From the base to the IMU in the world at `time` \[m\].
    fn imu_offset(&self, time: f64) -> Option<DVec3> {
        Some(self.orientation(time)? * DVec3::from_array(self.run.imu_position))
    }

    fn angular(&self, time: f64) -> Option<DVec3> {
        match &self.run.measured.gyro {
            Some(gyro) => {
                let at = self.prepared.filters.gyro?.at(gyro, time);
                let measured = vector(&at, |s| s.value) - DVec3::from_array(self.errors.gyro_bias);
                Some(self.tilt() * measured)
            }
            None => {
                let rate = self.prepared.base_rate.as_ref()?;
                let mut out = [0.0; 3];
                rate.interpolate(time + self.errors.pose_delay, &mut out);
                Some(DVec3::from_array(out))
            }
        }
    }

    /// Base from IMU, by the tilt that is assumed.
    pub fn tilt(&self) -> DQuat {
        self.tilt
    }

    /// How each pose is turned against the IMU, if there is one.
    fn yaws(&self) -> Vec<Yaw> {
        let (Some(poses), Some(imu)) = (&self.poses, &self.run.measured.orientation) else {
            return Vec::new();
        };
        let of = |i: usize| {
            let Some(there) = rotation_near(imu, 0, poses.time[i] - self.errors.pose_delay) else { return Yaw::NoImu };
            let there = there * self.tilt.conjugate();
            let Some(pose) = rotation_of(&poses.row(i)[3..7]) else { return Yaw::NoPose };
            let turn = pose * there.conjugate();
            let yaw = 2.0 * turn.z.atan2(turn.w);
            Yaw::Of(yaw.sin(), yaw.cos())
        };
        (0..poses.len()).map(of).collect()
    }

    /// World from base: the IMU's, turned about z by the mean yaw between it and the poses nearby.
    pub fn orientation(&self, time: f64) -> Option<DQuat> {
        let poses = self.poses.as_deref()?;
        let late = time + self.errors.pose_delay;
        let Some(imu) = &self.run.measured.orientation else { return rotation_near(poses, 3, late) };
        let here = rotation_near(imu, 0, time)? * self.tilt().conjugate();
        let (mut sine, mut cosine) = (0.0, 0.0);
        let first = poses.time.partition_point(|&t| t < late - BASE_HALF_WIDTH);
        let last = poses.time.partition_point(|&t| t <= late + BASE_HALF_WIDTH);
        for yaw in &self.prepared.yaws[first..last] {
            match yaw {
                Yaw::Of(s, c) => (sine, cosine) = (sine + s, cosine + c),
                Yaw::NoPose => {}
                Yaw::NoImu => return None,
            }
        }
        Some(DQuat::from_rotation_z(sine.atan2(cosine)) * here)
    }

    fn imu_path(&self) -> Option<ImuPath> {
        let acceleration = self.run.measured.acceleration.as_ref()?;
        self.run.measured.orientation.as_ref()?;
        let mut path = ImuPath { time: Vec::new(), velocity: Vec::new(), position: Vec::new() };
        let (mut v, mut p, mut before) = (DVec3::ZERO, DVec3::ZERO, None);
        // One yaw for all: the turn between IMU and poses is found again at each start.
        for (i, &t) in acceleration.time.iter().enumerate() {
            let row = acceleration.row(i);
            let (Some(rotation), true) = (self.orientation_at_sample(t), row.iter().all(|x| x.is_finite())) else {
                continue;
            };
            let a = rotation * DVec3::new(row[0], row[1], row[2]) - GRAVITY * DVec3::Z;
            if let Some((t0, a0)) = before {
                let dt: f64 = t - t0;
                let mean: DVec3 = 0.5 * (a + a0);
                p += v * dt + 0.5 * mean * dt * dt;
                v += mean * dt;
            }
            before = Some((t, a));
            path.time.push(t);
            path.velocity.push(v);
            path.position.push(p);
        }
        (path.time.len() > 3).then_some(path)
    }

    /// World from IMU with the yaw of the nearest pose.
    fn orientation_at_sample(&self, time: f64) -> Option<DQuat> {
        let poses = self.poses.as_deref()?;
        let imu = rotation_near(self.run.measured.orientation.as_ref()?, 0, time)?;
        let pose = rotation_near(poses, 3, time + self.errors.pose_delay)?;
        let turn = pose * (imu * self.tilt().conjugate()).conjugate();
        Some(DQuat::from_rotation_z(2.0 * turn.z.atan2(turn.w)) * imu)
    }
}

impl ImuPath {
    /// Position and velocity of the IMU at `time`, by least squares against the poses near it.
    fn fit(
        &self,
        poses: &JointSeries,
        time: f64,
        delay: f64,
        offset: impl Fn(f64) -> Option<DVec3>,
    ) -> Option<(DVec3, DVec3)> {
        let (p_here, v_here) = self.interpolate(time);
        let first = poses.time.partition_point(|&t| t - delay < time - BASE_HALF_WIDTH);
        let last = poses.time.partition_point(|&t| t - delay <= time + BASE_HALF_WIDTH);
        // Unknowns: position, velocity, and constant error of the acceleration, the last held near zero.
        let mut normal = [[0.0; 3]; 3];
        let mut right = [DVec3::ZERO; 3];
        normal[2][2] = (POSE_SPREAD / BIAS_SPREAD).powi(2);
        let mut used = 0;
        for i in first..last {
            let t = poses.time[i] - delay;
            let row = poses.row(i);
            let at = DVec3::new(row[0], row[1], row[2]) + offset(t)?;
            if t < self.time[0] || t > self.time[self.time.len() - 1] || !at.is_finite() {
                continue;
            }
            let s = t - time;
            let moved = self.interpolate(t).0 - p_here - v_here * s;
            let terms = [1.0, s, 0.5 * s * s];
            for a in 0..3 {
                for b in 0..3 {
                    normal[a][b] += terms[a] * terms[b];
                }
                right[a] += terms[a] * (at - moved);
            }
            used += 1;
        }
        if used < 4 {
            return None;
        }
        let matrix = glam::DMat3::from_cols_array_2d(&normal);
        let inverse = (matrix.determinant().abs() > 1e-30).then(|| matrix.inverse())?;
        let solve =
            |k: usize| right[0] * inverse.col(0)[k] + right[1] * inverse.col(1)[k] + right[2] * inverse.col(2)[k];
        Some((solve(0), solve(1)))
    }

    fn interpolate(&self, time: f64) -> (DVec3, DVec3) {
        let i = self.time.partition_point(|&t| t <= time).clamp(1, self.time.len() - 1);
        let (t0, t1) = (self.time[i - 1], self.time[i]);
        let f = ((time - t0) / (t1 - t0)).clamp(0.0, 1.0);
        let v = self.velocity[i - 1].lerp(self.velocity[i], f);
        // Within one interval the velocity is linear: its integral is exact.
        let dt = f * (t1 - t0);
        (self.position[i - 1] + 0.5 * (self.velocity[i - 1] + v) * dt, v)
    }
}

fn vector(
    at: &[qv_recording::smooth::ValueAndSlope],
    part: impl Fn(&qv_recording::smooth::ValueAndSlope) -> f64,
) -> DVec3 {
    DVec3::new(part(&at[0]), part(&at[1]), part(&at[2]))
}

/// A series, and what is a hole in it: an interval longer than five periods, which all of its stamps show.
#[derive(Clone, Copy)]
pub struct CoveredSeries<'a> {
    /// The series.
    pub series: &'a JointSeries,
    longest: f64,
}

impl<'a> CoveredSeries<'a> {
    /// Looks at all stamps, once.
    pub fn new(series: &'a JointSeries) -> Self {
        Self { series, longest: 5.0 * median_interval(&series.time).max(1e-9) }
    }

    /// Whether nothing is missing between `from` and `to` \[s\].
    pub fn is_whole(&self, from: f64, to: f64) -> bool {
        let time = &self.series.time;
        let first = time.partition_point(|&t| t < from).saturating_sub(1);
        let last = time.partition_point(|&t| t <= to).min(time.len().saturating_sub(1));
        time[first..=last].windows(2).all(|w| w[1] - w[0] <= self.longest)
    }
}
