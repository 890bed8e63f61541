//! The file of a learned compensator: sizes and weights.

use super::inputs::{position_inputs, position_scaling, torque_inputs, torque_scaling};
use crate::ResidualError;
use qv_policy::net::{Mlp, padded};
use qv_policy::onnx::{self, PolicyGraph};
use qv_policy::velocity::TaskRobot;
use serde::{Deserialize, Serialize};

/// What a net acts on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NetKind {
    /// All joint targets from the state of the robot.
    Position,
    /// Each joint's torque from that joint alone, with shared weights.
    Torque,
}

/// A net between policy and simulator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResidualNet {
    /// What it acts on.
    pub kind: NetKind,
    /// Robot that it was trained for.
    pub robot: String,
    /// Joint names, in order.
    pub joints: Vec<String>,
    /// Numbers of the input, the hidden layers and the output. ELU stands between layers.
    pub sizes: Vec<usize>,
    /// Layer by layer: weights `[outputs][inputs]`, then biases `[outputs]`.
    pub weights: Vec<f32>,
    /// Largest correction \[rad\]; for torques it is multiplied by the joint's position gain.
    pub clip: f32,
}

impl ResidualNet {
    /// From a net's flat, padded numbers.
    pub fn new(kind: NetKind, robot: &TaskRobot, net: &Mlp, parameters: &[f32], clip: f32) -> Self {
        let sizes = std::iter::once(net.inputs()).chain(net.layers.iter().map(|l| l.outputs)).collect();
        let parts = net.layers.iter().map(|l| l.unpadded(parameters));
        let weights = parts.flat_map(|(weights, bias)| weights.into_iter().chain(bias)).collect();
        Self { kind, robot: robot.name.clone(), joints: robot.model.joint_names().to_vec(), sizes, weights, clip }
    }

    /// Whether it fits a robot, its numbers are finite and as many as the sizes ask for.
    ///
    /// # Errors
    /// Names what does not fit.
    pub fn check(&self, robot: &TaskRobot, kind: NetKind) -> Result<(), ResidualError> {
        let bad = |what: &str, expected: String, found: String| {
            Err(ResidualError::input(format!("net: {what}"), expected, found))
        };
        let names = robot.model.joint_names();
        if self.kind != kind {
            return bad("kind", format!("{kind:?}"), format!("{:?}", self.kind));
        }
        if self.robot != robot.name || self.joints != names {
            let expected = format!("{} with joints {}", robot.name, names.join(" "));
            return bad("robot", expected, format!("{} with joints {}", self.robot, self.joints.join(" ")));
        }
        let [inputs, outputs] = match kind {
            NetKind::Position => [position_inputs(robot), robot.joints()],
            NetKind::Torque => [torque_inputs(robot), 1],
        };
        let ends = [self.sizes.first(), self.sizes.last()];
        let within = self.sizes.len() >= 2 && self.sizes.iter().all(|s| (1..=4096).contains(s));
        if !within || ends != [Some(&inputs), Some(&outputs)] {
            return bad("sizes", format!("{inputs}, layers of 1 to 4096, {outputs}"), format!("{:?}", self.sizes));
        }
        let expected: usize = self.sizes.windows(2).map(|pair| (pair[0] + 1) * pair[1]).sum();
        if self.weights.len() != expected {
            return bad("weights", format!("{expected} numbers"), self.weights.len().to_string());
        }
        if let Some(k) = self.weights.iter().position(|w| !w.is_finite()) {
            return bad(&format!("weight {k}"), "a finite number".into(), self.weights[k].to_string());
        }
        if !(self.clip > 0.0 && self.clip <= 10.0) {
            return bad("clip", "more than 0, at most 10 rad".into(), self.clip.to_string());
        }
        Ok(())
    }

    /// The net and its flat, padded numbers; after [`ResidualNet::check`].
    pub(super) fn layers(&self) -> (Mlp, Vec<f32>) {
        let net = Mlp::new(&self.sizes);
        let mut parameters = vec![0.0; net.len()];
        let mut numbers = self.weights.iter();
        let mut next = || *numbers.next().expect("checked");
        for layer in &net.layers {
            let width = padded(layer.outputs);
            for o in 0..layer.outputs {
                (0..layer.inputs).for_each(|i| parameters[layer.start + i * width + o] = next());
            }
            let bias = layer.start + padded(layer.inputs) * width;
            (0..layer.outputs).for_each(|o| parameters[bias + o] = next());
        }
        (net, parameters)
    }

    /// As an ONNX graph with input `state` and output `correction`, both unscaled, see [`crate::compensation::Compensation::to_onnx`]; `more` is
    /// kept in the file as text.
    ///
    /// # Errors
    /// When the net is another robot's.
    pub fn to_onnx(&self, robot: &TaskRobot, more: &[(String, String)]) -> Result<Vec<u8>, ResidualError> {
        self.check(robot, self.kind)?;
        let (net, parameters) = self.layers();
        let plain = net.unpadded(&parameters);
        let layers = onnx::Dense::of(&net, &plain);
        let (offset, scale) = match self.kind {
            NetKind::Position => position_scaling(robot),
            NetKind::Torque => torque_scaling(robot),
        };
        let outputs = net.outputs();
        let text = |key: &str, value: String| (key.to_owned(), value);
        let mut metadata = vec![text("robot", self.robot.clone()), text("joints", self.joints.join(" "))];
        metadata.extend_from_slice(more);
        let graph = PolicyGraph {
            input: "state",
            output: "correction",
            offset: &offset,
            scale: &scale,
            layers: &layers,
            output_scale: &vec![super::UNIT; outputs],
            output_offset: &vec![0.0; outputs],
            lower: &vec![-self.clip; outputs],
            upper: &vec![self.clip; outputs],
            metadata: &metadata,
        };
        Ok(graph.to_bytes().map_err(qv_policy::PolicyError::from)?)
    }
}
