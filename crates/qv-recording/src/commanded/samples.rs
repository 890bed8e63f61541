//! Samples of a run for the law of its motors: torques, positions and speeds at one time, and the commands at each of several delays.

use crate::derive::joint_filter;
use crate::run::{ActuatorKind, Run};
use qv_core::JointSeries;

/// Samples that are compared, at most.
const MOST: usize = 1500;
/// Fewer show nothing.
const LEAST: usize = 200;

/// Samples of the torques that a law is fitted to; all of shape `[samples * joints]`.
pub(super) struct Samples {
    pub joints: usize,
    pub time: Vec<f64>,
    pub torque: Vec<f64>,
    pub position: Vec<f64>,
    pub velocity: Vec<f64>,
    /// Gains as they were logged; 1 where no position gain is stated, `states_gains` says which.
    pub kp: Vec<f64>,
    pub kd: Vec<f64>,
    pub states_gains: bool,
    /// Feed-forward torques as they were logged.
    pub forward: Vec<f64>,
}

impl Samples {
    /// `None` where positions are not commanded with gains, or no torques were measured.
    pub fn of(run: &Run) -> Option<Self> {
        let (m, joints) = (&run.measured, run.joint_names.len());
        let usable = |s: &&JointSeries| s.joints == joints && s.len() >= LEAST;
        let torque = m.torque.as_ref().filter(usable)?;
        let position = m.position.as_ref().filter(usable)?;
        let commands = run.commands.position.as_ref().filter(|c| c.joints == joints && !c.is_empty())?;
        if run.actuator.kind != ActuatorKind::Pd {
            return None;
        }
        let (from, to) = (commands.time[0].max(position.time[0]), *commands.time.last()?);
        let inside = |i: &usize| (from + 0.1..=to - 0.05).contains(&torque.time[*i]);
        let all: Vec<usize> = (0..torque.len()).filter(inside).collect();
        let rows: Vec<usize> = all.iter().copied().step_by(all.len().div_ceil(MOST).max(1)).collect();
        let states_gains = run.commands.kp.is_some() || run.actuator.kp.is_some();
        let mut samples = Self { joints, states_gains, ..Self::empty() };
        let filter = joint_filter(position);
        let velocity = m.velocity.as_ref().filter(|v| v.joints == joints && !v.is_empty());
        let (mut q, mut v) = (vec![0.0; joints], vec![0.0; joints]);
        for i in rows {
            let time = torque.time[i];
            position.interpolate(time, &mut q);
            match velocity {
                Some(velocity) => velocity.interpolate(time, &mut v),
                None => v.iter_mut().zip(filter.at(position, time)).for_each(|(v, s)| *v = s.slope),
            }
            samples.push(run, time, torque.row(i), &q, &v);
        }
        (samples.time.len() >= LEAST).then_some(samples)
    }

    fn empty() -> Self {
        let none = Vec::new;
        Self {
            joints: 0,
            time: none(),
            torque: none(),
            position: none(),
            velocity: none(),
            kp: none(),
            kd: none(),
            states_gains: false,
            forward: none(),
        }
    }

    fn push(&mut self, run: &Run, time: f64, torque: &[f64], q: &[f64], v: &[f64]) {
        let (c, joints) = (&run.commands, self.joints);
        let held = |series: &Option<JointSeries>, joint: usize| {
            series.as_ref().filter(|s| s.joints == joints && !s.is_empty()).map(|s| s.hold(time)[joint])
        };
        self.time.push(time);
        for joint in 0..joints {
            self.torque.push(torque[joint]);
            self.position.push(q[joint]);
            self.velocity.push(held(&c.velocity, joint).unwrap_or(0.0) - v[joint]);
            self.kp.push(held(&c.kp, joint).or(run.actuator.kp).unwrap_or(1.0));
            self.kd.push(held(&c.kd, joint).or(run.actuator.kd).unwrap_or(0.0));
            self.forward.push(held(&c.torque, joint).unwrap_or(0.0));
        }
    }

    /// Every `step`-th sample.
    pub fn thinned(&self, step: usize) -> Self {
        let few = |all: &[f64]| all.chunks(self.joints).step_by(step).flatten().copied().collect();
        Self {
            joints: self.joints,
            time: self.time.iter().step_by(step).copied().collect(),
            torque: few(&self.torque),
            position: few(&self.position),
            velocity: few(&self.velocity),
            kp: few(&self.kp),
            kd: few(&self.kd),
            states_gains: self.states_gains,
            forward: few(&self.forward),
        }
    }

    /// Commanded positions at the samples' times less a delay, shape `[samples * joints]`.
    pub fn commands(&self, commands: &JointSeries, delay: f64) -> Vec<f64> {
        let mut row = 0;
        let mut out = Vec::with_capacity(self.time.len() * self.joints);
        for time in &self.time {
            while row + 1 < commands.len() && commands.time[row + 1] <= time - delay {
                row += 1;
            }
            out.extend_from_slice(commands.row(row));
        }
        out
    }
}
