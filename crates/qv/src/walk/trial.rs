//! Whether a policy walks in a corrected simulator: falls and tracking on fixed commands, before and after.

use super::roll::{check_joints, opened, standing, upright};
use crate::Failure;
use glam::{DQuat, DVec3};
use qv_core::Pose;
use qv_gap::report::Correction;
use qv_page::escape;
use qv_policy::onnx::OnnxPolicy;
use qv_policy::roll::{Description, RollError, RollTrace, roll};
use qv_sim::{Batch, Model, SimOptions, Terrain};
use serde::Serialize;
use std::fmt::Write;
use std::path::Path;

/// Commanded velocities: forwards, to the left \[m/s\], turning \[rad/s\].
const COMMANDS: [[f64; 3]; 6] =
    [[0.5, 0.0, 0.0], [-0.3, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, -0.3, 0.0], [0.3, 0.0, 0.5], [0.3, 0.0, -0.5]];
/// How long each is asked for \[s\], and from when on tracking counts.
const SECONDS: f64 = 8.0;
const FROM: f64 = 2.0;
/// Cosine of the lean of the trunk below which the robot has fallen.
const FALLEN: f64 = 0.5;

/// A policy with what it sees.
pub struct TrialPolicy {
    policy: OnnxPolicy,
    description: Description,
}

/// What a policy did under one command.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrialWalk {
    /// Forwards, to the left \[m/s\], turning \[rad/s\].
    pub command: [f64; 3],
    /// When it fell \[s\]; `None` if it did not.
    pub fell: Option<f64>,
    /// Mean velocity in the trunk's heading from 2 s on, or until it fell; `None` if that was earlier.
    pub velocity: Option<[f64; 3]>,
}

/// The same commands in the nominal and in the corrected simulator.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Trial {
    /// Name of the policy.
    pub policy: String,
    /// As the model is.
    pub nominal: Vec<TrialWalk>,
    /// With the corrections of the diagnosis.
    pub corrected: Vec<TrialWalk>,
}

impl TrialPolicy {
    /// Reads a policy in ONNX and its description.
    ///
    /// # Errors
    /// When either cannot be read, or a joint of the description is none of the model's.
    pub fn open(policy: &Path, description: &Path, model: &Model) -> Result<Self, Failure> {
        let (policy, read) = opened(policy, description)?;
        check_joints(&read, description, model)?;
        Ok(Self { policy, description: read })
    }

    /// Rolls it on all commands, without and with corrections.
    ///
    /// # Errors
    /// When the simulator refuses a correction, or the policy gives no actions.
    pub fn trial(
        &mut self,
        (model, terrain): (&Model, &Terrain),
        corrections: &[Correction],
    ) -> Result<Trial, Failure> {
        let nominal = self.walks(model, terrain, &[])?;
        let corrected = self.walks(model, terrain, corrections)?;
        Ok(Trial { policy: self.description.name.clone(), nominal, corrected })
    }

    pub(super) fn walks(
        &mut self,
        model: &Model,
        terrain: &Terrain,
        corrections: &[Correction],
    ) -> Result<Vec<TrialWalk>, Failure> {
        let late = |name: &str| {
            let all = corrections.iter().filter(|c| c.parameter.ends_with(name)).map(|c| c.value);
            all.fold(0.0, f64::max)
        };
        let options = SimOptions {
            timestep: self.description.simulation.timestep,
            max_command_latency: late(".command_latency"),
            max_sensor_latency: late(".encoder_latency").max(late(".delay")),
            ..Default::default()
        };
        let ground = terrain.height_below(0.0, 0.0, 1e6).unwrap_or(0.0);
        let start = standing(model, &self.description, ground);
        // What pushed the robot once does not push it always.
        let steady: Vec<(String, f64)> = corrections
            .iter()
            .filter(|c| !c.parameter.starts_with("external."))
            .map(|c| (c.parameter.clone(), c.value))
            .collect();
        let mut all = Vec::new();
        for command in COMMANDS {
            let mut batch = Batch::<f64>::new(model, terrain, &options, 1)?;
            let policy = &mut self.policy;
            let rolled = roll(&mut batch, &self.description, &start, (command, SECONDS), &steady, |observation| {
                let mut action = Vec::new();
                policy.run(observation, &mut action).map(|()| action)
            });
            all.push(match rolled {
                Ok(rolled) => walked(command, &rolled),
                // The numbers of a robot that tumbles may run away.
                Err(RollError::RanAway { time }) => TrialWalk { command, fell: Some(time), velocity: None },
                Err(error) => return Err(error.into()),
            });
        }
        Ok(all)
    }
}

fn walked(command: [f64; 3], rolled: &RollTrace) -> TrialWalk {
    let fell = rolled.base.iter().position(|base| upright(base) < FALLEN).map(|k| rolled.time[k]);
    let until = fell.unwrap_or(f64::INFINITY);
    let counted: Vec<usize> =
        (0..rolled.time.len()).filter(|&k| rolled.time[k] >= FROM && rolled.time[k] < until).collect();
    let velocity = match counted[..] {
        [first, .., last] => {
            let mut moved = [0.0; 3];
            for k in first..last {
                let [a, b] = [rolled.base[k], rolled.base[k + 1]];
                let (yaw, next) = (heading(&a), heading(&b));
                let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
                moved[0] += yaw.cos() * dx + yaw.sin() * dy;
                moved[1] += yaw.cos() * dy - yaw.sin() * dx;
                moved[2] +=
                    (next - yaw + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
            }
            let time = rolled.time[last] - rolled.time[first];
            Some(moved.map(|x| x / time))
        }
        _ => None,
    };
    TrialWalk { command, fell, velocity }
}

/// Falls, and mean error of velocity \[m/s\] of walks, one without a velocity counted as standing still.
pub(super) fn figures_of(walks: &[TrialWalk]) -> (usize, f64) {
    let error = |w: &TrialWalk| {
        let found = w.velocity.filter(|_| w.fell.is_none()).unwrap_or_default();
        (found[0] - w.command[0]).hypot(found[1] - w.command[1])
    };
    let falls = walks.iter().filter(|w| w.fell.is_some()).count();
    (falls, walks.iter().map(error).sum::<f64>() / walks.len().max(1) as f64)
}

fn heading(base: &[f64; 7]) -> f64 {
    let [x, y, z, qw, qx, qy, qz] = *base;
    Pose { position: DVec3::new(x, y, z), rotation: DQuat::from_xyzw(qx, qy, qz, qw) }.yaw()
}

impl Trial {
    /// Falls, and mean error of velocity \[m/s\] and of turning \[rad/s\] of those commands under which it stayed up in both.
    fn figures(&self) -> [(usize, f64, f64); 2] {
        let both: Vec<usize> = (0..self.nominal.len())
            .filter(|&k| self.nominal[k].fell.is_none() && self.corrected[k].fell.is_none())
            .collect();
        [&self.nominal, &self.corrected].map(|all| {
            let falls = all.iter().filter(|w| w.fell.is_some()).count();
            let errors = both.iter().filter_map(|&k| {
                let (found, asked) = (all[k].velocity?, all[k].command);
                Some(((found[0] - asked[0]).hypot(found[1] - asked[1]), (found[2] - asked[2]).abs()))
            });
            let (sum, turning, count) = errors.fold((0.0, 0.0, 0.0), |(s, t, n), (v, w)| (s + v, t + w, n + 1.0));
            (falls, sum / f64::max(count, 1.0), turning / f64::max(count, 1.0))
        })
    }

    /// One sentence.
    pub fn sentence(&self) -> String {
        let [before, after] = self.figures();
        let of = |f: (usize, f64, f64)| {
            format!("falls under {} of {} commands, is off by {:.2} m/s and {:.2} rad/s", f.0, COMMANDS.len(), f.1, f.2)
        };
        format!(
            "The policy {} {} in the nominal simulator; in the corrected one it {}.",
            self.policy,
            of(before),
            of(after)
        )
    }

    /// A section of the report's page.
    pub fn section(&self) -> String {
        let mut text = format!(
            "<h2>Does the policy walk?</h2><div class=\"card\"><p>{}</p><p class=\"soft small\">Each command for {SECONDS} s from a stand; \
             velocities from {FROM} s on, in the trunk's heading. Errors are of commands under which it stays up in both.</p>\
             <table><tr><th>command (m/s, m/s, rad/s)<th>nominal<th>corrected</tr>",
            escape(&self.sentence())
        );
        let cell = |w: &TrialWalk| match (w.fell, w.velocity) {
            (Some(time), _) => format!("falls at {time:.1} s"),
            (None, Some([x, y, turn])) => format!("{x:.2}, {y:.2}, {turn:.2}"),
            (None, None) => String::new(),
        };
        for (before, after) in self.nominal.iter().zip(&self.corrected) {
            let [x, y, turn] = before.command;
            let _ = write!(text, "<tr><td>{x}, {y}, {turn}<td>{}<td>{}</tr>", cell(before), cell(after));
        }
        text + "</table></div>"
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    /// A base that goes round a circle to the left, and falls at the end.
    fn circle(falls: bool) -> RollTrace {
        let mut rolled = RollTrace::default();
        for k in 0..400 {
            let time = 0.02 * f64::from(k);
            let yaw = 0.5 * time;
            // Radius 0.6 m: 0.3 m/s at 0.5 rad/s.
            let half = if falls && time > 6.0 { 0.8 } else { 0.0 };
            let q = [(0.5 * yaw).cos(), half, 0.0, (0.5 * yaw).sin()];
            rolled.time.push(time);
            rolled.base.push([0.6 * yaw.sin(), 0.6 * (1.0 - yaw.cos()), 0.3, q[0], q[1], q[2], q[3]]);
        }
        rolled
    }

    #[test]
    fn velocities_are_those_of_the_heading() {
        let found = walked([0.3, 0.0, 0.5], &circle(false));
        let [x, y, turn] = found.velocity.unwrap();
        assert!(found.fell.is_none() && (x - 0.3).abs() < 1e-3 && y.abs() < 2e-3 && (turn - 0.5).abs() < 1e-6);
        let fallen = walked([0.3, 0.0, 0.5], &circle(true));
        assert!((fallen.fell.unwrap() - 6.02).abs() < 0.03 && fallen.velocity.is_some());
    }

    #[test]
    fn a_fall_counts_and_its_errors_do_not() {
        let walked = |fell: Option<f64>| TrialWalk { command: [0.5, 0.0, 0.0], fell, velocity: Some([0.4, 0.0, 0.1]) };
        let trial = Trial {
            policy: "trot".into(),
            nominal: vec![walked(None), walked(None)],
            corrected: vec![walked(Some(1.0)), walked(None)],
        };
        let [before, after] = trial.figures();
        assert_eq!((before.0, after.0), (0, 1));
        assert!((before.1 - 0.1).abs() < 1e-9 && (after.2 - 0.1).abs() < 1e-9);
        assert!(trial.section().states("falls 1.0") && trial.sentence().states("falls 1"));
    }
}
