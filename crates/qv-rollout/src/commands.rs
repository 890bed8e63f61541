//! The recorded commands as the simulator's actuators take them.

use crate::RolloutError;
use qv_core::JointSeries;
use qv_recording::gaps::hold;
use qv_recording::run::{ActuatorKind, Clock, GainSource, Run};
use qv_sim::JointCommand;

/// Commands of a run in the model's joint order, held between their stamps. Blank cells hold the value before them.
#[derive(Debug, Clone)]
pub struct HeldCommands {
    position: Option<JointSeries>,
    velocity: Option<JointSeries>,
    torque: Option<JointSeries>,
    kp: Option<JointSeries>,
    kd: Option<JointSeries>,
    fixed_kp: f64,
    fixed_kd: f64,
    joints: usize,
}

/// One command of all joints, shape `[n]` each.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Command {
    q: Vec<f64>,
    dq: Vec<f64>,
    kp: Vec<f64>,
    kd: Vec<f64>,
    tau: Vec<f64>,
}

impl Command {
    /// As the simulator takes it.
    pub fn view(&self) -> JointCommand<'_> {
        JointCommand { q: &self.q, dq: &self.dq, kp: &self.kp, kd: &self.kd, tau: &self.tau }
    }
}

impl HeldCommands {
    /// Commands of `run`, where joint `j` of the model is column `columns[j]`.
    ///
    /// # Errors
    /// When there are no commands that the actuator can follow: no positions or gains with `pd`, no torques with `torque`.
    pub fn new(run: &Run, columns: &[usize]) -> Result<Self, RolloutError> {
        let c = &run.commands;
        let prepared = |series: &Option<JointSeries>| series.as_ref().map(|s| filled(s, columns));
        let mut held = Self {
            position: prepared(&c.position),
            velocity: prepared(&c.velocity),
            torque: prepared(&c.torque),
            kp: prepared(&c.kp),
            kd: prepared(&c.kd),
            fixed_kp: run.actuator.kp.unwrap_or(0.0),
            fixed_kd: run.actuator.kd.unwrap_or(0.0),
            joints: columns.len(),
        };
        // Gains, and speeds of zero, seldom change: hours of them are one row.
        let others = [&mut held.velocity, &mut held.kp, &mut held.kd];
        others.into_iter().flatten().for_each(|series| shorten(series, held.position.as_ref()));
        if held.position.is_some() {
            held.torque.iter_mut().for_each(|series| shorten(series, held.position.as_ref()));
        }
        let missing = |expected: &str| Err(RolloutError::run("replay", expected, "none"));
        match run.actuator.kind {
            ActuatorKind::Torque => {
                if held.torque.is_none() {
                    return missing("commanded torques (cmd_tau)");
                }
                (held.kp, held.kd, held.fixed_kp, held.fixed_kd) = (None, None, 0.0, 0.0);
            }
            ActuatorKind::Pd => {
                if held.position.is_none() && held.torque.is_none() {
                    return missing("commands");
                }
                // Gains of zero are a decision to be written down, not what a forgotten line means.
                if run.actuator.gains.contains(&GainSource::Unknown) {
                    return missing(
                        "gains as numbers (`qv replay`, `diagnose`, `next` and `view` find those called unknown)",
                    );
                }
                if held.kp.is_none() && run.actuator.kp.is_none() {
                    let is_table = run.sources.iter().any(|s| s.clock == Clock::Column);
                    return missing(if is_table {
                        "a position gain kp, in the commands or in run.toml"
                    } else {
                        "a position gain kp, in the commands or as `kp` (and `kd`) of a robot file (--robot FILE.toml)"
                    });
                }
            }
        }
        Ok(held)
    }

    /// The command in force for the step that begins at `time` \[s\] and lasts `step`: one that is stamped before the
    /// middle of the step counts for all of it.
    pub fn at(&self, time: f64, step: f64, out: &mut Command) {
        let time = time + 0.5 * step;
        let fill = |series: &Option<JointSeries>, constant: f64, out: &mut Vec<f64>| {
            out.clear();
            match series {
                Some(series) => out.extend_from_slice(series.hold(time)),
                None => out.resize(self.joints, constant),
            }
        };
        fill(&self.position, 0.0, &mut out.q);
        fill(&self.velocity, 0.0, &mut out.dq);
        fill(&self.kp, self.fixed_kp, &mut out.kp);
        fill(&self.kd, self.fixed_kd, &mut out.kd);
        fill(&self.torque, 0.0, &mut out.tau);
    }

    /// Stamp \[s\] of the command that ends the one that [`Self::at`] gives: infinite where none follows.
    pub fn until(&self, time: f64, step: f64) -> f64 {
        let next = |series: &JointSeries| {
            let row = series.index_at(time + 0.5 * step).map_or(0, |row| row + 1);
            series.time.get(row).copied().unwrap_or(f64::INFINITY)
        };
        let all = [&self.position, &self.velocity, &self.kp, &self.kd, &self.torque];
        all.into_iter().flatten().map(next).fold(f64::INFINITY, f64::min)
    }

    /// The series that sets the pace, for gaps.
    pub fn pace(&self) -> Option<&JointSeries> {
        self.position.as_ref().or(self.torque.as_ref())
    }
}

/// Leaves one row of commands that are always the same, where those of positions have the same stamps: the next command is theirs.
fn shorten(series: &mut JointSeries, position: Option<&JointSeries>) {
    let first = series.values.get(..series.joints).unwrap_or_default().to_vec();
    let is_constant = || series.values.chunks_exact(series.joints.max(1)).all(|row| row == first);
    if position.is_some_and(|position| position.time == series.time) && is_constant() && !first.is_empty() {
        *series = JointSeries { time: vec![series.time[0]], values: first, joints: series.joints };
    }
}

/// Columns picked, and blanks filled with the value before (the first value before the first; 0 where there is none at all).
fn filled(series: &JointSeries, columns: &[usize]) -> JointSeries {
    let joints = columns.len();
    let mut values = Vec::with_capacity(series.len() * joints);
    for i in 0..series.len() {
        let row = series.row(i);
        values.extend(columns.iter().map(|&c| row[c]));
    }
    let mut picked = JointSeries { time: series.time.clone(), values, joints };
    hold(&mut picked);
    picked.values.iter_mut().filter(|x| !x.is_finite()).for_each(|x| *x = 0.0);
    picked
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_stays_until_it_is_said_to() {
        let series = |time: &[f64]| Some(JointSeries { time: time.to_vec(), values: time.to_vec(), joints: 1 });
        let held = HeldCommands {
            position: series(&[0.5, 0.7, 0.9]),
            velocity: None,
            torque: None,
            kp: series(&[0.6]),
            kd: None,
            fixed_kp: 0.0,
            fixed_kd: 1.0,
            joints: 1,
        };
        let (step, mut here, mut there) = (0.02, Command::default(), Command::default());
        for k in 0..60 {
            let time = 0.4 + 0.0113 * f64::from(k);
            held.at(time, step, &mut here);
            let until = held.until(time, step);
            held.at(until - 0.5 * step - 1e-9, step, &mut there);
            assert!(until == f64::INFINITY || here == there, "{time} until {until}");
            held.at(until, step, &mut there);
            assert!(until == f64::INFINITY || until <= 0.6 || here != there, "{time} until {until}");
        }
        assert_eq!(held.until(0.95, step), f64::INFINITY);
    }
}
