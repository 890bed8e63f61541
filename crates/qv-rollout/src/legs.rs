//! Where a walking robot goes by its legs: for recordings without poses of the base.
//!
//! The lowest feet stand and roll without slipping (legged odometry, as in Bloesch et al., RSS 2012, without its filter: windows
//! of a second need none). That gives the velocity of the base at each instant; its integral is the path, which begins above
//! the origin, the lowest foot on z = 0, and drifts. Attitude is the IMU's. A foot that slips, or a leg whose encoders are off, makes the path wrong
//! by as much: nothing is to be compared with it, it is where simulations start.

use crate::sensors::{SensorErrors, rotation_near};
use glam::{DQuat, DVec3};
use qv_core::{JointSeries, Pose};
use qv_recording::Run;
use qv_recording::derive::{joint_velocity, shorter_turn};
use qv_sim::{Model, Shape};
use std::borrow::Cow;

/// Least time between two instants that are looked at \[s\].
const INTERVAL: f64 = 0.004;
/// How far above the lowest foot another still counts (standard deviation) \[m\].
const NEAR_GROUND: f64 = 0.004;
/// Half the time across which the speed of a foot is taken \[s\].
const STEP: f64 = 1e-4;

/// What walks.
#[derive(Clone, Copy)]
pub struct Legs<'a> {
    /// The robot.
    pub model: &'a Model,
    /// Shapes of its feet.
    pub feet: &'a [usize],
}

/// Poses of the base, `world_from_base`, rows of x, y, z \[m\], w, x, y, z, at stamps of the joint states; free of the sensors' `errors`. `None`
/// when there are no feet, no orientation of an IMU, or too few joint states.
pub(crate) fn walked(
    run: &Run,
    columns: &[usize],
    errors: &SensorErrors,
    tilt: DQuat,
    legs: Legs,
) -> Option<JointSeries> {
    let m = &run.measured;
    let position = m.position.as_ref()?;
    let velocity = match &m.velocity {
        Some(velocity) => Cow::Borrowed(velocity),
        None => Cow::Owned(joint_velocity(run)?.series),
    };
    if legs.feet.is_empty() || m.orientation.as_ref().is_none_or(JointSeries::is_empty) || position.len() < 4 {
        return None;
    }
    let walker = Walker { run, columns, errors, tilt, legs, position, velocity: &velocity };
    let mut path = JointSeries { time: Vec::new(), values: Vec::new(), joints: 7 };
    let mut before: Option<(f64, DVec3, DVec3)> = None;
    for &time in &position.time {
        if before.is_some_and(|b| time < b.0 + INTERVAL) {
            continue;
        }
        let Some(Step { rotation, speed, lowest }) = walker.at(time) else { continue };
        let first = DVec3::new(0.0, 0.0, -lowest);
        let place = before.map_or(first, |(t, p, v)| p + 0.5 * (time - t) * (v + speed));
        before = Some((time, place, speed));
        path.time.push(time);
        path.values.extend(place.to_array());
        path.values.extend(Pose { position: place, rotation }.wxyz());
    }
    (path.len() > 3).then_some(path)
}

/// What the legs say at an instant.
struct Step {
    /// World from base.
    rotation: DQuat,
    /// Velocity of the base in the world \[m/s\].
    speed: DVec3,
    /// Height of the lowest point of the feet above the base's origin \[m\].
    lowest: f64,
}

struct Walker<'a> {
    run: &'a Run,
    columns: &'a [usize],
    errors: &'a SensorErrors,
    /// Base from IMU.
    tilt: DQuat,
    legs: Legs<'a>,
    position: &'a JointSeries,
    velocity: &'a JointSeries,
}

impl Walker<'_> {
    fn at(&self, time: f64) -> Option<Step> {
        let imu = rotation_near(self.run.measured.orientation.as_ref()?, 0, time)?;
        let rotation = imu * self.tilt.conjugate();
        let (q, v) = self.joints(time);
        let turned = match &self.run.measured.gyro {
            Some(gyro) => {
                let mut rate = [0.0; 3];
                gyro.interpolate(time, &mut rate);
                self.tilt * (DVec3::from_array(rate) - DVec3::from_array(self.errors.gyro_bias))
            }
            None => self.turning(time, imu)?,
        };
        let feet = |step: f64| {
            let [w, x, y, z] =
                Pose { position: DVec3::ZERO, rotation: rotation * DQuat::from_scaled_axis(turned * step) }.wxyz();
            let joints = q.iter().zip(&v).map(|(q, v)| q + v * step);
            let state: Vec<f64> = [0.0, 0.0, 0.0, w, x, y, z].into_iter().chain(joints).collect();
            self.legs.model.world_from_links(&state)
        };
        let (earlier, later) = (feet(-STEP), feet(STEP));
        let mut standing: Vec<(f64, DVec3)> = Vec::with_capacity(self.legs.feet.len());
        for &foot in self.legs.feet {
            let geom = &self.legs.model.geoms[foot];
            let radius = if let Shape::Sphere(radius) = geom.shape { radius } else { 0.0 };
            let centre = |poses: &[Pose]| poses[geom.link].transform_point(geom.link_from_geom.position);
            let (a, b) = (centre(&earlier), centre(&later));
            let rolled = later[geom.link].rotation * earlier[geom.link].rotation.conjugate();
            let rolling = shorter_turn(rolled) / (2.0 * STEP);
            // The centre of a foot that rolls moves as the turn about the point below it does.
            let speed = rolling.cross(radius * DVec3::Z) - (b - a) / (2.0 * STEP);
            standing.push((0.5 * (a.z + b.z) - radius, speed));
        }
        let lowest = standing.iter().map(|s| s.0).fold(f64::INFINITY, f64::min);
        let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
        for (height, speed) in standing {
            let weight = (-0.5 * ((height - lowest) / NEAR_GROUND).powi(2)).exp();
            sum += weight * speed;
            weights += weight;
        }
        let speed = sum / weights;
        (speed.is_finite() && lowest.is_finite()).then_some(Step { rotation, speed, lowest })
    }

    /// Positions and velocities of the joints in the model's order.
    fn joints(&self, time: f64) -> (Vec<f64>, Vec<f64>) {
        let mut row = vec![0.0; self.position.joints.max(self.velocity.joints)];
        let mut of = |series: &JointSeries, j: usize| {
            let latency = self.errors.encoder_latency.get(j).copied().unwrap_or(0.0);
            series.interpolate(time + latency, &mut row[..series.joints]);
            row[self.columns[j]]
        };
        let bias = |j: usize| self.errors.encoder_bias.get(j).copied().unwrap_or(0.0);
        let joints = 0..self.columns.len();
        let q = joints.clone().map(|j| of(self.position, j) - bias(j)).collect();
        (q, joints.map(|j| of(self.velocity, j)).collect())
    }

    /// Angular velocity of the base by the IMU's attitudes around `time` \[rad/s\], in its own frame.
    fn turning(&self, time: f64, imu: DQuat) -> Option<DVec3> {
        let after = rotation_near(self.run.measured.orientation.as_ref()?, 0, time + INTERVAL)?;
        Some(self.tilt * shorter_turn(imu.conjugate() * after) / INTERVAL)
    }
}
