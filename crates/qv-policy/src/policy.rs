//! A trained policy: its network with the numbers around it, and the files that carry it to a robot.

use crate::PolicyError;
use crate::net::{Mlp, padded};
use crate::onnx::{Dense, PolicyGraph};
use crate::ppo::{Ppo, scale_rows};
use crate::score::{Decide, Score};
use crate::velocity::{Commands, Randomise, TaskRobot, TaskSettings, observation_parts};
use qv_core::Mismatch;
use serde::{Deserialize, Serialize};

/// A policy that can be run: observations in SI units to joint targets in radians.
#[derive(Debug, Clone)]
pub struct Policy {
    /// The network.
    pub actor: Mlp,
    /// Its numbers.
    pub parameters: Vec<f32>,
    /// Offset of the observations.
    pub offset: Vec<f32>,
    /// Scale of the observations.
    pub scale: Vec<f32>,
}

impl Policy {
    /// What a learner has learnt, without what only learning needs.
    pub fn of(ppo: &Ppo) -> Self {
        let (offset, scale) = ppo.observation_scaling();
        let parameters = ppo.parameters[..ppo.actor.len()].to_vec();
        Self { actor: ppo.actor.clone(), parameters, offset: offset.to_vec(), scale: scale.to_vec() }
    }

    /// The file `policy.onnx`: input `observation`, f32 `[n, 9 + 3 joints]` or, with a clock, two more, output `targets`, f32 `[n, joints]`, all scales inside.
    ///
    /// # Errors
    /// When a number is not finite.
    pub fn to_onnx(&self, robot: &TaskRobot) -> Result<Vec<u8>, PolicyError> {
        let plain = self.actor.unpadded(&self.parameters);
        let layers = Dense::of(&self.actor, &plain);
        let (lower, upper): (Vec<f32>, Vec<f32>) = (0..robot.joints()).map(|j| finite_limits(robot.limits(j))).unzip();
        let clock = if self.offset.len() > 9 + 3 * robot.joints() { 1.0 } else { 0.0 };
        let parts: Vec<&str> = observation_parts(clock).into_iter().map(|(what, _)| what).collect();
        let text = |key: &str, value: String| (key.to_owned(), value);
        let metadata = [
            text("robot", robot.name.clone()),
            text("joints", robot.model.joint_names().join(" ")),
            text("observation", parts.join("; ")),
        ];
        let graph = PolicyGraph {
            input: "observation",
            output: "targets",
            offset: &self.offset,
            scale: &self.scale,
            layers: &layers,
            output_scale: &robot.action_scale,
            output_offset: &robot.stand,
            lower: &lower,
            upper: &upper,
            metadata: &metadata,
        };
        Ok(graph.to_bytes()?)
    }
}

/// Joints without limits get ones that no target reaches.
fn finite_limits((low, high): (f32, f32)) -> (f32, f32) {
    (low.max(-1e6), high.min(1e6))
}

impl Decide for &Policy {
    fn decide(&mut self, rows: usize, observations: &[f32], actions: &mut [f32]) -> Result<(), PolicyError> {
        let (width, acts) = (padded(self.offset.len()), actions.len() / rows);
        let mut input = vec![0.0; rows * width];
        scale_rows(observations, &self.offset, &self.scale, &mut input);
        let mut tape = self.actor.tape(rows);
        let out = self.actor.forward(&self.parameters, rows, &input, &mut tape);
        for (row, out) in actions.chunks_exact_mut(acts).zip(out.chunks_exact(padded(acts))) {
            row.copy_from_slice(&out[..acts]);
        }
        Ok(())
    }
}

impl Decide for Policy {
    fn decide(&mut self, rows: usize, observations: &[f32], actions: &mut [f32]) -> Result<(), PolicyError> {
        (&mut &*self).decide(rows, observations, actions)
    }
}

/// Anyone's ONNX policy with our contract, as a decision.
#[cfg(feature = "onnx")]
pub struct OnnxDecision<'a> {
    /// The policy.
    pub policy: &'a mut crate::onnx::OnnxPolicy,
    /// The robot, whose stand and scale turn targets into actions.
    pub robot: &'a TaskRobot,
}

#[cfg(feature = "onnx")]
impl Decide for OnnxDecision<'_> {
    fn decide(&mut self, rows: usize, observations: &[f32], actions: &mut [f32]) -> Result<(), PolicyError> {
        let (width, joints) = (observations.len() / rows, self.robot.joints());
        let mut targets = Vec::new();
        for (row, observation) in actions.chunks_exact_mut(joints).zip(observations.chunks_exact(width)) {
            self.policy.run(observation, &mut targets)?;
            if targets.len() != joints {
                let (expected, found) = (format!("{joints} targets"), targets.len().to_string());
                return Err(PolicyError::Mismatch(Mismatch::new("policy.onnx", expected, found)));
            }
            for (j, action) in row.iter_mut().enumerate() {
                *action = (targets[j] - self.robot.stand[j]) / self.robot.action_scale[j];
            }
        }
        Ok(())
    }
}

#[cfg(feature = "onnx")]
impl Decide for &mut OnnxDecision<'_> {
    fn decide(&mut self, rows: usize, observations: &[f32], actions: &mut [f32]) -> Result<(), PolicyError> {
        (**self).decide(rows, observations, actions)
    }
}

/// `policy.toml`: what runs a `policy.onnx` on a robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PolicyFile {
    /// Robot that it was trained for.
    pub robot: String,
    /// Hash of the robot's model (FNV-1a of its printed form): another number is another robot.
    pub model_hash: String,
    /// Decisions a second \[Hz\].
    pub rate: f32,
    /// Strides a second of the clock that the observation ends with \[Hz\]; 0: it has none, as in files of earlier versions.
    #[serde(default)]
    pub clock: f32,
    /// Joint names: the order of angles, speeds and targets.
    pub joints: Vec<String>,
    /// Position gains \[N m/rad\].
    pub kp: Vec<f32>,
    /// Velocity gains \[N m s/rad\].
    pub kd: Vec<f32>,
    /// Joint angles of the stand \[rad\].
    pub stand: Vec<f32>,
    /// Radians for an action of one.
    pub action_scale: Vec<f32>,
    /// Least targets \[rad\].
    pub lower: Vec<f32>,
    /// Greatest targets \[rad\].
    pub upper: Vec<f32>,
    /// Parts of the observation, in order.
    pub observation: Vec<String>,
    /// Physics step that it was trained at \[s\].
    pub timestep: f64,
    /// Ground that it was trained on.
    pub ground: String,
    /// Commands that it was trained under.
    pub commands: Commands,
    /// What differed from robot to robot in training.
    pub trained_under: Randomise,
    /// What it scored at the end of training.
    pub score: Option<Score>,
}

impl PolicyFile {
    /// For a robot and the task that it was trained on.
    pub fn new(robot: &TaskRobot, settings: &TaskSettings, ground: &str, score: Option<Score>) -> Self {
        let (lower, upper) = (0..robot.joints()).map(|j| finite_limits(robot.limits(j))).unzip();
        Self {
            robot: robot.name.clone(),
            model_hash: model_hash(robot),
            rate: settings.rate,
            clock: settings.clock,
            joints: robot.model.joint_names().to_vec(),
            kp: robot.kp.clone(),
            kd: robot.kd.clone(),
            stand: robot.stand.clone(),
            action_scale: robot.action_scale.clone(),
            lower,
            upper,
            observation: observation_parts(settings.clock).into_iter().map(|(what, _)| what.to_owned()).collect(),
            timestep: settings.timestep(),
            ground: ground.into(),
            commands: settings.commands.clone(),
            trained_under: settings.randomise.clone(),
            score,
        }
    }

    /// # Errors
    /// When the text is no such file; the line is reported.
    pub fn parse(text: &str) -> Result<Self, PolicyError> {
        toml::from_str(text).map_err(|e| PolicyError::Text { what: "policy.toml".into(), reason: e.to_string() })
    }

    /// The file's text.
    ///
    /// # Errors
    /// When a number has no form in TOML.
    pub fn to_text(&self) -> Result<String, PolicyError> {
        let body = toml::to_string(self);
        body.map_err(|e| PolicyError::Text { what: "policy.toml".into(), reason: e.to_string() })
    }

    /// # Errors
    /// When the policy is another robot's, or a number or length of the file means nothing.
    pub fn check(&self, robot: &TaskRobot) -> Result<(), PolicyError> {
        let mismatch =
            |expected: String, found: String| Err(PolicyError::Mismatch(Mismatch::new("policy.toml", expected, found)));
        let names = robot.model.joint_names();
        if self.robot != robot.name || self.joints != names {
            let expected = format!("a policy of {} with joints {}", robot.name, names.join(" "));
            return mismatch(expected, format!("one of {} with joints {}", self.robot, self.joints.join(" ")));
        }
        let lists = [
            ("kp", &self.kp, 0.0),
            ("kd", &self.kd, 0.0),
            ("stand", &self.stand, f32::NEG_INFINITY),
            ("action_scale", &self.action_scale, f32::MIN_POSITIVE),
            ("lower", &self.lower, f32::NEG_INFINITY),
            ("upper", &self.upper, f32::NEG_INFINITY),
        ];
        for (key, list, least) in lists {
            if list.len() != names.len() || list.iter().any(|x| !(x.is_finite() && *x >= least)) {
                let expected = format!("{} finite numbers of `{key}`, of at least {least}", names.len());
                return mismatch(expected, format!("{list:?}"));
            }
        }
        let clock = ("clock", f64::from(self.clock), 0.0, 500.0);
        let times = [clock, ("rate", f64::from(self.rate), 1.0, 1000.0), ("timestep", self.timestep, 1e-5, 0.1)];
        for (key, found, low, high) in times {
            if !(low..=high).contains(&found) {
                return mismatch(format!("`{key}` of {low} to {high}"), found.to_string());
            }
        }
        Ok(())
    }
}

/// FNV-1a (64 bits) of what the model is, printed: the same on every machine. How its file was read, in words, is no part of it.
pub fn model_hash(robot: &TaskRobot) -> String {
    let model = &robot.model;
    hash_of(&format!("{} {:?} {:?} {:?} {:?}", model.name, model.base, model.links, model.joints, model.geoms))
}

/// FNV-1a of a text.
pub(crate) fn hash_of(text: &str) -> String {
    let hash = text.bytes().fold(0xcbf2_9ce4_8422_2325u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3));
    format!("{hash:016x}")
}
