//! From the state of a robot to what a policy sees.

use super::description::{ClockForm, Description, HistoryLayout, HistoryOrder, HistoryStart, TermKind};
use glam::{DQuat, DVec3};
use std::collections::VecDeque;
use std::f64::consts::TAU;

/// The state of a robot at one moment, joints in the description's order.
#[derive(Debug, Clone, Copy)]
pub struct RobotState<'a> {
    /// Base in the world: x, y, z \[m\], quaternion w, x, y, z.
    pub base: [f64; 7],
    /// Velocity of the base: linear in the world \[m/s\], angular in the base \[rad/s\].
    pub velocity: [f64; 6],
    /// Joint angles \[rad\].
    pub joints: &'a [f64],
    /// Joint speeds \[rad/s\].
    pub speeds: &'a [f64],
    /// Commanded velocity: forward, left \[m/s\], counter-clockwise \[rad/s\].
    pub command: [f64; 3],
    /// The last action, clipped.
    pub last_action: &'a [f64],
    /// Actions taken so far.
    pub actions: usize,
}

/// Makes observations, and keeps the frames of their history.
#[derive(Debug, Clone)]
pub struct Observer<'a> {
    description: &'a Description,
    /// Oldest first.
    frames: VecDeque<Vec<f32>>,
}

impl<'a> Observer<'a> {
    /// An observer that has seen nothing.
    pub fn new(description: &'a Description) -> Self {
        Self { description, frames: VecDeque::new() }
    }

    /// What the policy sees now, shape `[observations]`. Every call is one more frame.
    pub fn observe(&mut self, seen: &RobotState) -> Vec<f32> {
        let frame = self.frame(seen);
        let Some(history) = &self.description.observation.history else { return frame };
        if self.frames.is_empty() {
            let before = match history.start {
                HistoryStart::Zeros => vec![0.0; frame.len()],
                HistoryStart::Repeat => frame.clone(),
            };
            self.frames.extend(vec![before; history.length]);
        }
        self.frames.pop_front();
        self.frames.push_back(frame);
        let mut order: Vec<&Vec<f32>> = self.frames.iter().collect();
        if history.order == HistoryOrder::NewestFirst {
            order.reverse();
        }
        match history.layout {
            HistoryLayout::Frame => order.into_iter().flatten().copied().collect(),
            HistoryLayout::Term => self.by_term(&order),
        }
    }

    fn by_term(&self, frames: &[&Vec<f32>]) -> Vec<f32> {
        let (mut out, mut from) = (Vec::with_capacity(self.description.observations()), 0);
        for term in &self.description.observation.terms {
            let to = from + term.kind.len(self.description.joints.len());
            frames.iter().for_each(|frame| out.extend(&frame[from..to]));
            from = to;
        }
        out
    }

    fn frame(&self, seen: &RobotState) -> Vec<f32> {
        let observation = &self.description.observation;
        let clip = observation.clip.unwrap_or(f64::INFINITY);
        let mut frame = Vec::with_capacity(self.description.frame());
        for term in &observation.terms {
            let numbers = self.numbers(&term.kind, seen);
            frame.extend(numbers.iter().enumerate().map(|(k, x)| (x * term.scale.at(k)).clamp(-clip, clip) as f32));
        }
        frame
    }

    fn numbers(&self, kind: &TermKind, seen: &RobotState) -> Vec<f64> {
        let [_, _, height, w, x, y, z] = seen.base;
        let base_from_world = DQuat::from_xyzw(x, y, z, w).conjugate();
        let [vx, vy, vz, wx, wy, wz] = seen.velocity;
        match kind {
            TermKind::LinearVelocity { at } => {
                let turning = DVec3::new(wx, wy, wz).cross(DVec3::from_array(*at));
                (base_from_world * DVec3::new(vx, vy, vz) + turning).to_array().to_vec()
            }
            TermKind::Gyro => vec![wx, wy, wz],
            TermKind::Gravity => (base_from_world * DVec3::NEG_Z).to_array().to_vec(),
            TermKind::Command => seen.command.to_vec(),
            TermKind::JointPositions => {
                seen.joints.iter().zip(&self.description.stand).map(|(q, stand)| q - stand).collect()
            }
            TermKind::JointVelocities => seen.speeds.to_vec(),
            TermKind::LastAction => seen.last_action.to_vec(),
            TermKind::Clock { frequency, offsets, form, standing } => {
                let [forward, left, turn] = seen.command;
                let stands = forward.hypot(left).hypot(turn) < 0.01;
                let time = seen.actions as f64 / self.description.rate;
                match standing {
                    Some(number) if stands => vec![*number; kind.len(0)],
                    _ => clock(*form, offsets, frequency * time),
                }
            }
            TermKind::Height => vec![height],
        }
    }
}

fn clock(form: ClockForm, offsets: &[f64], rounds: f64) -> Vec<f64> {
    let phases = || offsets.iter().map(|offset| (offset + rounds).rem_euclid(1.0));
    match form {
        ClockForm::Phase => phases().collect(),
        ClockForm::Sin => phases().map(|p| (TAU * p).sin()).collect(),
        ClockForm::SinCos => phases().map(|p| (TAU * p).sin()).chain(phases().map(|p| (TAU * p).cos())).collect(),
    }
}
