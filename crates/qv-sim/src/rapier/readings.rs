//! Sensors of the second engine, from the motion that it remembers.

use super::options::{LONGEST_DELAY, RapierOptions};
use super::values::Values;
use crate::parameters::{JointField, WorldField};
use crate::{BaseKind, Model, SensorReading, State};
use glam::{DQuat, DVec3};
use qv_core::Pose;
use std::collections::VecDeque;

/// States after each of the last steps, the newest first, and the last step's torques and forces.
#[derive(Debug, Clone)]
pub(super) struct History {
    states: VecDeque<State>,
    /// How far encoders are ahead of their joints in each of the states, shape `[joints]`; empty where no spring is in between.
    ahead: VecDeque<Vec<f64>>,
    torque: Vec<f64>,
    force: Vec<f64>,
}

impl History {
    pub fn new(state: &State, model: &Model) -> Self {
        Self {
            states: VecDeque::from([state.clone()]),
            ahead: VecDeque::from([Vec::new()]),
            torque: vec![0.0; model.joints.len()],
            force: vec![0.0; model.geoms.len()],
        }
    }

    /// Remembers one step, and forgets what is older than any delay.
    pub fn push(&mut self, state: &State, values: &Values, timestep: f64, torque: Vec<f64>, force: Vec<f64>) {
        let kept = (LONGEST_DELAY / timestep).ceil() as usize + 2;
        self.states.push_front(state.clone());
        self.states.truncate(kept);
        let compliance = |joint: usize| values.joint(joint, JointField::SeriesCompliance);
        let is_sprung = (0..torque.len()).any(|joint| compliance(joint) > 0.0);
        let ahead = torque.iter().enumerate().filter(|_| is_sprung).map(|(joint, t)| compliance(joint) * t);
        self.ahead.push_front(ahead.collect());
        self.ahead.truncate(kept);
        self.torque = torque;
        self.force = force;
    }

    /// State `age` steps ago, between steps by interpolation; before the first one the first one.
    fn past(&self, age: f64) -> State {
        let at = |steps: usize| &self.states[steps.min(self.states.len() - 1)];
        let (young, old) = (at(age.floor() as usize), at(age.floor() as usize + 1));
        let mix = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + age.fract() * (b - a)).collect();
        State { q: mix(&young.q, &old.q), v: mix(&young.v, &old.v) }
    }

    /// How far the encoder of a joint was ahead of it `age` steps ago.
    fn past_ahead(&self, joint: usize, age: f64) -> f64 {
        let at = |steps: usize| self.ahead[steps.min(self.ahead.len() - 1)].get(joint).copied().unwrap_or(0.0);
        let (young, old) = (at(age.floor() as usize), at(age.floor() as usize + 1));
        young + age.fract() * (old - young)
    }

    /// What the sensors report now.
    pub fn read(&self, model: &Model, values: &Values, options: &RapierOptions) -> SensorReading {
        let (positions, dofs) = (model.nq() - model.joints.len(), model.base_dofs());
        let mut reading = SensorReading {
            q: Vec::new(),
            dq: Vec::new(),
            tau: Vec::new(),
            gyro: [0.0; 3],
            acc: [0.0; 3],
            imu_orientation: [1.0, 0.0, 0.0, 0.0],
            foot_force: self.force.iter().map(|f| f * values.world(WorldField::FootForceScale)).collect(),
            base_position: [0.0; 3],
            base_orientation: [1.0, 0.0, 0.0, 0.0],
        };
        for joint in 0..model.joints.len() {
            let age = values.joint(joint, JointField::EncoderLatency) / options.timestep;
            let (seen, ahead) = (self.past(age), self.past_ahead(joint, age));
            reading.q.push(seen.q[positions + joint] + values.joint(joint, JointField::EncoderBias) + ahead);
            reading.dq.push(seen.v[dofs + joint]);
            reading.tau.push(self.torque[joint] * values.joint(joint, JointField::TorqueScale));
        }
        if model.base == BaseKind::Floating {
            let reported = base(&self.past(values.world(WorldField::PoseDelay) / options.timestep));
            reading.base_position = reported.position.to_array();
            reading.base_orientation = reported.wxyz();
            self.read_imu(model, values, options, &mut reading);
        }
        reading
    }

    /// Accelerometer and gyroscope: the velocity of the IMU's own point, differenced over the last step.
    fn read_imu(&self, model: &Model, values: &Values, options: &RapierOptions, reading: &mut SensorReading) {
        use WorldField::*;
        let mounted = model.frame("imu").or(model.frame("imu_link")).filter(|frame| frame.link == Some(0));
        let base_from_imu = mounted.map_or(Pose::IDENTITY, |frame| frame.link_from_frame);
        let tilt = DQuat::from_rotation_y(values.world(TiltPitch)) * DQuat::from_rotation_x(values.world(TiltRoll));
        let (now, before) = (&self.states[0], &self.states[1.min(self.states.len() - 1)]);
        let imu_from_world = (base(now).rotation * base_from_imu.rotation * tilt).conjugate();
        let velocity = |state: &State| {
            let (rotation, v) = (base(state).rotation, &state.v);
            let turning = DVec3::new(v[3], v[4], v[5]);
            DVec3::new(v[0], v[1], v[2]) + rotation * turning.cross(base_from_imu.position)
        };
        // Before the first step nothing has accelerated yet.
        let acceleration = (velocity(now) - velocity(before)) / options.timestep;
        let acc = imu_from_world * (acceleration - DVec3::from_array(options.gravity));
        let turning = DVec3::new(now.v[3], now.v[4], now.v[5]);
        let gyro = (base_from_imu.rotation * tilt).conjugate() * turning;
        reading.acc = (acc + values.world3(AccBiasX, AccBiasY, AccBiasZ)).to_array();
        reading.gyro = (gyro + values.world3(GyroBiasX, GyroBiasY, GyroBiasZ)).to_array();
        let orientation = imu_from_world.conjugate();
        reading.imu_orientation = [orientation.w, orientation.x, orientation.y, orientation.z];
    }
}

fn base(state: &State) -> Pose {
    let q = &state.q;
    Pose::from_position_wxyz([q[0], q[1], q[2]], [q[3], q[4], q[5], q[6]]).unwrap_or(Pose::IDENTITY)
}
