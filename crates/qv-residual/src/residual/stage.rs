//! Lanes that replay a log decision by decision, each at a place of its own.

use crate::ResidualError;
use crate::windows::{Lane, Replayer, Window};
use qv_policy::compensate::SimulatedStates;
use qv_sim::{Batch, BatchCommand};

/// What a correction is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Acts {
    /// Added to joint targets.
    Position,
    /// Times the position gain, an added torque behind latency and lag.
    Torque,
}

pub(super) struct Stage<'a> {
    pub replayer: &'a Replayer<'a>,
    pub batch: Batch<f32>,
    pub q: Vec<f32>,
    pub v: Vec<f32>,
    pub torques: Vec<f32>,
    pub forces: Vec<f32>,
    /// Recorded targets in force, `[lanes][joints]`.
    pub asked: Vec<f32>,
    sent: Vec<f32>,
    added: Vec<f32>,
}

impl<'a> Stage<'a> {
    /// Lanes with the parameters of one.
    pub fn new(replayer: &'a Replayer<'a>, count: usize, lane: &Lane) -> Result<Self, ResidualError> {
        let mut batch = replayer.batch(count)?;
        for env in 0..count {
            lane.parameters.iter().try_for_each(|&(id, value)| batch.set_parameter_at(env, id, value))?;
        }
        let (joints, shapes) = (replayer.log.joints, replayer.robot.model.geoms.len());
        let zeros = |width: usize| vec![0.0; count * width];
        Ok(Self {
            replayer,
            batch,
            q: zeros(7 + joints),
            v: zeros(6 + joints),
            torques: zeros(joints),
            forces: zeros(3 * shapes),
            asked: zeros(joints),
            sent: zeros(joints),
            added: zeros(joints),
        })
    }

    pub fn look(&mut self) -> Result<(), ResidualError> {
        self.batch.read_positions(&mut self.q)?;
        self.batch.read_velocities(&mut self.v)?;
        self.batch.read_torques(&mut self.torques)?;
        Ok(self.batch.read_geom_forces(&mut self.forces)?)
    }

    pub fn seen(&self) -> SimulatedStates<'_> {
        SimulatedStates { q: &self.q, v: &self.v, torques: &self.torques, forces: &self.forces, targets: &self.asked }
    }

    /// Reads the recorded targets of a physics step; `at` shows each lane's place.
    pub fn ask(&mut self, substep: usize, at: impl Fn(usize) -> Window) {
        for (env, asked) in self.asked.chunks_exact_mut(self.replayer.log.joints).enumerate() {
            asked.copy_from_slice(self.replayer.targets(at(env), substep));
        }
    }

    /// One physics step under the targets last asked for, moved by so much `[lanes][joints]`.
    pub fn step(&mut self, moved: &[f32]) -> Result<(), ResidualError> {
        for ((sent, asked), moved) in self.sent.iter_mut().zip(&self.asked).zip(moved) {
            *sent = asked + moved;
        }
        let (kp, kd) = (&self.replayer.log.kp[..], &self.replayer.log.kd[..]);
        self.batch.set_commands(&BatchCommand { q: &self.sent, dq: None, kp, kd, tau: None })?;
        self.batch.step_parallel();
        Ok(())
    }

    /// Torques of corrections from the next step on.
    pub fn add(&mut self, corrections: &[f32]) -> Result<(), ResidualError> {
        let kp = self.replayer.log.kp.iter().cycle();
        self.added.iter_mut().zip(corrections).zip(kp).for_each(|((added, x), kp)| *added = x * kp);
        Ok(self.batch.set_added_torques(&self.added)?)
    }

    /// One decision under corrections that are held.
    pub fn decide(
        &mut self,
        acts: Acts,
        corrections: &[f32],
        at: impl Fn(usize) -> Window,
    ) -> Result<(), ResidualError> {
        let none = vec![0.0; corrections.len()];
        if acts == Acts::Torque {
            self.add(corrections)?;
        }
        for substep in 0..self.replayer.log.substeps {
            self.ask(substep, &at);
            self.step(if acts == Acts::Position { corrections } else { &none })?;
        }
        Ok(())
    }
}
