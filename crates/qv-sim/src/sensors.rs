//! What the robot's sensors report: the state as its encoders, IMU, force sensors and localisation see it.

use crate::batch::lanes_of::Engine;
use crate::batch::quantities::BaseMotion;
use crate::engine::step::BlockContext;
use crate::model::Model;
use crate::parameters::{Catalogue, JointField, WorldField};
use crate::{BaseKind, SimError};
use glam::{DQuat, DVec3};
use qv_core::Pose;

/// One reading of all sensors, with bias, tilt, scale and delay of the environment's parameters. No noise: callers add
/// it with their own seed.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorReading {
    /// Encoder positions \[rad\], shape `[joints]`: those of the motors, where a spring is between them and their joints.
    pub q: Vec<f64>,
    /// Encoder speeds \[rad/s\], shape `[joints]`.
    pub dq: Vec<f64>,
    /// Torque estimates \[N m\] of the last step, shape `[joints]`.
    pub tau: Vec<f64>,
    /// Gyroscope in IMU axes \[rad/s\]. The IMU is the frame `imu` or `imu_link`, else the base; zero with a fixed base.
    pub gyro: [f64; 3],
    /// Accelerometer (specific force) in IMU axes at the IMU \[m/s²\], from the acceleration of the last step.
    pub acc: [f64; 3],
    /// World from IMU, w, x, y, z.
    pub imu_orientation: [f64; 4],
    /// Normal force of each collision shape on the ground \[N\] in the last step, shape `[geoms]`.
    pub foot_force: Vec<f64>,
    /// Reported base position in the world \[m\].
    pub base_position: [f64; 3],
    /// Reported base orientation, w, x, y, z.
    pub base_orientation: [f64; 4],
}

pub(crate) fn read(
    model: &Model,
    shared: &BlockContext,
    catalogue: &Catalogue,
    engine: &dyn Engine,
    imu: Option<usize>,
    env: usize,
    value: impl Fn(usize) -> f64,
) -> Result<SensorReading, SimError> {
    let world = |field: WorldField| value(catalogue.world_at + field as usize);
    let joint = |j: usize, field: JointField| value(j * JointField::COUNT + field as usize);
    let timestep = shared.options.timestep;
    let most = shared.options.max_sensor_latency;
    let age = |latency: f64, id: usize| -> Result<f64, SimError> {
        if latency > most {
            let (what, expected) = (catalogue.infos[id].name.clone(), format!("at most max_sensor_latency, {most} s"));
            return Err(SimError::Value { what, expected, found: latency });
        }
        Ok(latency / timestep)
    };
    let past = |latency: f64, id: usize| -> Result<(Vec<f64>, Vec<f64>), SimError> {
        let age = age(latency, id)?;
        let (mut q, mut v) = (vec![0.0; model.nq()], vec![0.0; model.nv()]);
        engine.read_past_state(env, age, &mut q, &mut v);
        Ok((q, v))
    };
    let (mut q, mut v) = (vec![0.0; model.nq()], vec![0.0; model.nv()]);
    engine.read_state(env, &mut q, &mut v);
    let (positions, dofs) = (shared.topology.base_positions, shared.topology.base_dofs);
    let mut reading = SensorReading {
        q: q[positions..].to_vec(),
        dq: v[dofs..].to_vec(),
        tau: engine.torque(env),
        gyro: [0.0; 3],
        acc: [0.0; 3],
        imu_orientation: [1.0, 0.0, 0.0, 0.0],
        foot_force: engine.geom_force(env),
        base_position: [0.0; 3],
        base_orientation: [1.0, 0.0, 0.0, 0.0],
    };
    for j in 0..model.joints.len() {
        let latency = joint(j, JointField::EncoderLatency);
        if latency > 0.0 {
            let age = age(latency, j * JointField::COUNT + JointField::EncoderLatency as usize)?;
            let sizes = [model.nq(), model.nv()];
            [reading.q[j], reading.dq[j]] = engine.past_joint(env, age, sizes, [positions + j, dofs + j]);
        } else {
            reading.q[j] += joint(j, JointField::SeriesCompliance) * reading.tau[j];
        }
        reading.q[j] += joint(j, JointField::EncoderBias);
        reading.tau[j] *= joint(j, JointField::TorqueScale);
    }
    reading.foot_force.iter_mut().for_each(|f| *f *= world(WorldField::FootForceScale));
    if model.base == BaseKind::Fixed {
        return Ok(reading);
    }
    let delay = world(WorldField::PoseDelay);
    let reported = match delay > 0.0 {
        true => base_pose(&past(delay, catalogue.world_at + WorldField::PoseDelay as usize)?.0),
        false => base_pose(&q),
    };
    reading.base_position = reported.position.to_array();
    reading.base_orientation = reported.wxyz();
    let motion = BaseMotion::of(&q, &v, &engine.acceleration(env));
    let seen = imu_reading(&motion, base_from_imu(model, imu), shared.options.gravity, world);
    (reading.gyro, reading.acc, reading.imu_orientation) = (seen.gyro, seen.acc, seen.orientation);
    Ok(reading)
}

/// What an IMU reports.
pub(crate) struct ImuReading {
    pub gyro: [f64; 3],
    pub acc: [f64; 3],
    /// World from IMU, w, x, y, z.
    pub orientation: [f64; 4],
}

/// Pose of the IMU in the base; the base itself where the model has no IMU on it.
pub(crate) fn base_from_imu(model: &Model, imu: Option<usize>) -> Pose {
    imu.map(|f| &model.frames[f]).filter(|f| f.link == Some(0)).map_or(Pose::IDENTITY, |f| f.link_from_frame)
}

/// The IMU of a free base, with the environment's mounting error and biases.
pub(crate) fn imu_reading(
    motion: &BaseMotion,
    base_from_imu: Pose,
    gravity: [f64; 3],
    world: impl Fn(WorldField) -> f64,
) -> ImuReading {
    let BaseMotion { q, v, a } = motion;
    let tilt =
        DQuat::from_rotation_y(world(WorldField::TiltPitch)) * DQuat::from_rotation_x(world(WorldField::TiltRoll));
    let imu_rotation = base_from_imu.rotation * tilt;
    let world_from_base = base_pose(q);
    let turning = DVec3::new(v[3], v[4], v[5]);
    let turning_rate = DVec3::new(a[3], a[4], a[5]);
    let arm = base_from_imu.position;
    let moving = DVec3::new(a[0], a[1], a[2]) - DVec3::from_array(gravity);
    let specific_force_in_base =
        world_from_base.rotation.conjugate() * moving + turning_rate.cross(arm) + turning.cross(turning.cross(arm));
    let bias = |x, y, z| DVec3::new(world(x), world(y), world(z));
    let gyro =
        imu_rotation.conjugate() * turning + bias(WorldField::GyroBiasX, WorldField::GyroBiasY, WorldField::GyroBiasZ);
    let acc = imu_rotation.conjugate() * specific_force_in_base
        + bias(WorldField::AccBiasX, WorldField::AccBiasY, WorldField::AccBiasZ);
    let orientation = world_from_base.rotation * imu_rotation;
    ImuReading {
        gyro: gyro.to_array(),
        acc: acc.to_array(),
        orientation: [orientation.w, orientation.x, orientation.y, orientation.z],
    }
}

fn base_pose(q: &[f64]) -> Pose {
    Pose::from_position_wxyz([q[0], q[1], q[2]], [q[3], q[4], q[5], q[6]]).unwrap_or(Pose::IDENTITY)
}
