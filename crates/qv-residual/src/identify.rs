//! Parameters of the simulator that a fit may move: names, ranges and priors.

use crate::ResidualError;
use crate::windows::{Lane, Replayer};
use qv_policy::shape_torques::SHAPES;
use qv_rollout::name_parts;
use qv_sim::Batch;
use serde::{Deserialize, Serialize};

/// What a number of a fit means to the simulator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// One parameter, or several that share a value.
    Parameter,
    /// A number of contacts: engines differ in it, and so does the step of a training. It is fitted and goes into no correction.
    Contact,
    /// Encoder bias of a joint.
    Bias(usize),
    /// Share by which the motor's torque is limited below the largest that the recordings ask for.
    Limit,
    /// Number of a shape of a joint's torque.
    Shape(usize),
}

/// One number of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Coordinate {
    /// Name: that of a parameter with `*` for those that share it, or of a torque's shape.
    pub name: String,
    kind: Kind,
    ids: Vec<usize>,
    /// Value at which the simulator is as it was.
    pub neutral: f64,
    /// Prior standard deviation about the neutral value.
    pub spread: f64,
    /// Least value.
    pub least: f64,
    /// Greatest value.
    pub most: f64,
    /// Largest torque that was asked for \[N m\], for a limit.
    top: f64,
}

impl Coordinate {
    /// What `x` means to its parameters.
    fn value(&self, x: f64) -> f64 {
        if self.kind == Kind::Limit { self.top * (1.0 - x) } else { x }
    }

    /// Its name with `*` in the place of a joint.
    fn shared_name(&self) -> String {
        match name_parts(&self.name)[..] {
            [before @ ("actuator" | "joint"), _, after] => format!("{before}.*.{after}"),
            _ => self.name.clone(),
        }
    }
}

/// Prior standard deviations. Torques are measured by [`qv_policy::velocity::TaskRobot::torque_scale`]: a foot's share of the weight on a lever as long as the
/// robot is high (11 N m for a Go2).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Prior {
    /// Latency of commands, shared \[s\].
    pub latency: f64,
    /// Lag of torques, shared \[s\].
    pub lag: f64,
    /// Delivered over demanded torque, each joint.
    pub strength: f64,
    /// Velocity gain, shared.
    pub kd_scale: f64,
    /// Coulomb friction, each joint, in torque scales.
    pub coulomb: f64,
    /// Viscous friction, each joint, in torque scales per rad/s.
    pub viscous: f64,
    /// Encoder bias, each joint \[rad\].
    pub bias: f64,
    /// Play, shared \[rad\].
    pub backlash: f64,
    /// Share by which torque is limited, each joint.
    pub limit: f64,
    /// Mass of the base, as a share of it.
    pub mass: f64,
    /// Shift of the base's centre of mass along x and y \[m\].
    pub com: f64,
    /// Friction of the ground, as a share of it.
    pub friction: f64,
    /// Time constant and damping ratio of contacts, as shares of them.
    pub contact: [f64; 2],
    /// Shapes of torques in the order of [`SHAPES`], in torque scales, radians and seconds.
    pub shapes: [f64; SHAPES.len()],
}

impl Default for Prior {
    fn default() -> Self {
        Self {
            // The ranges of the simulator's own catalogue, as two standard deviations.
            latency: 0.0125,
            lag: 0.0125,
            strength: 0.15,
            kd_scale: 0.15,
            coulomb: 0.05,
            viscous: 0.01,
            bias: 0.02,
            backlash: 0.01,
            limit: 0.2,
            mass: 0.15,
            com: 0.03,
            friction: 0.3,
            // As far as engines differ in what they call stiff.
            contact: [0.5, 0.3],
            shapes: [0.08, 0.1, 0.002, 0.1, 0.05, 0.3],
        }
    }
}

/// Coordinates of a robot's fit. `tops` are the largest torques that each joint was asked for \[N m\].
///
/// # Errors
/// When the simulator lacks a parameter.
pub fn coordinates(
    replayer: &Replayer,
    prior: &Prior,
    tops: &[f64],
    with_shapes: bool,
) -> Result<Vec<Coordinate>, ResidualError> {
    let batch = replayer.batch(1)?;
    let robot = replayer.robot;
    let scale = f64::from(robot.torque_scale());
    let names = robot.model.joint_names();
    let base = &robot.model.links[0].name;
    let mut all = Vec::new();
    let mut add =
        |name: String, members: Vec<String>, kind: Kind, spread: f64, top: f64| -> Result<(), ResidualError> {
            let ids = members.iter().map(|n| batch.parameter_index(n)).collect::<Result<Vec<_>, _>>()?;
            let info = &batch.catalogue()[ids[0]];
            let (neutral, least, most) = match kind {
                Kind::Limit => (0.0, 0.0, 0.8),
                _ => (info.neutral, info.clamped(f64::MIN).max(-1e9), 1e9),
            };
            all.push(Coordinate { name, kind, ids, neutral, spread, least, most, top });
            Ok(())
        };
    let shared = |field: &str| names.iter().map(|n| format!("actuator.{n}.{field}")).collect::<Vec<_>>();
    for (field, spread) in [
        ("command_latency", prior.latency),
        ("lag", prior.lag),
        ("kd_scale", prior.kd_scale),
        ("backlash", prior.backlash),
    ] {
        add(format!("actuator.*.{field}"), shared(field), Kind::Parameter, spread, 0.0)?;
    }
    for (j, name) in names.iter().enumerate() {
        let mut one = |parameter: String, kind, spread, top| add(parameter.clone(), vec![parameter], kind, spread, top);
        one(format!("actuator.{name}.strength"), Kind::Parameter, prior.strength, 0.0)?;
        one(format!("joint.{name}.coulomb_friction"), Kind::Parameter, prior.coulomb * scale, 0.0)?;
        one(format!("joint.{name}.viscous_friction"), Kind::Parameter, prior.viscous * scale, 0.0)?;
        one(format!("sensor.{name}.encoder_bias"), Kind::Bias(j), prior.bias, 0.0)?;
        one(format!("actuator.{name}.torque_limit"), Kind::Limit, prior.limit, tops[j])?;
    }
    let mut one = |parameter: String, spread| add(parameter.clone(), vec![parameter], Kind::Parameter, spread, 0.0);
    one(format!("link.{base}.mass_scale"), prior.mass)?;
    one(format!("link.{base}.com_x"), prior.com)?;
    one(format!("link.{base}.com_y"), prior.com)?;
    let feet = robot.feet.iter().map(|&g| format!("geom.{}.friction_scale", robot.model.geoms[g].name)).collect();
    add("geom.*.friction_scale".into(), feet, Kind::Parameter, prior.friction, 0.0)?;
    if let Some(latency) = all.first_mut() {
        latency.most = replayer.longest_latency;
    }
    if !with_shapes {
        // At the step of a training contacts are as soft as that allows.
        all.extend(contacts(&batch, prior)?);
    }
    if with_shapes {
        let units = [scale, 1.0, scale, 1.0 / scale, scale, scale];
        for (j, name) in names.iter().enumerate() {
            for (k, (shape, _)) in SHAPES.iter().enumerate() {
                // Frictions, drag and saturation only ever take power away.
                let least = if k < 4 { 0.0 } else { f64::NEG_INFINITY };
                all.push(Coordinate {
                    name: format!("{name}: {shape}"),
                    kind: Kind::Shape(j * SHAPES.len() + k),
                    ids: Vec::new(),
                    neutral: 0.0,
                    spread: prior.shapes[k] * units[k],
                    least,
                    most: f64::INFINITY,
                    top: 0.0,
                });
            }
        }
    }
    Ok(all)
}

/// Contacts in the ranges that a diagnosis draws them from.
fn contacts(batch: &Batch<f32>, prior: &Prior) -> Result<Vec<Coordinate>, ResidualError> {
    let ranges = [("contact.time_constant", [0.003, 0.016]), ("contact.damping_ratio", [0.4, 2.0])];
    let one = |((name, [least, most]), share): ((&str, [f64; 2]), f64)| {
        let id = batch.parameter_index(name)?;
        let neutral = batch.catalogue()[id].neutral;
        let (kind, ids, spread) = (Kind::Contact, vec![id], share * neutral);
        Ok(Coordinate { name: name.into(), kind, ids, neutral, spread, least, most, top: 0.0 })
    };
    ranges.into_iter().zip(prior.contact).map(one).collect()
}

/// One coordinate in the place of those that joints have each: what all joints share is found first. Biases and limits stay as they are.
pub fn shared(coordinates: &[Coordinate]) -> Vec<Coordinate> {
    let mut all: Vec<Coordinate> = Vec::new();
    for c in coordinates.iter().filter(|c| matches!(c.kind, Kind::Parameter | Kind::Contact)) {
        let name = c.shared_name();
        match all.iter_mut().find(|other| other.name == name) {
            Some(other) => other.ids.extend(&c.ids),
            None => all.push(Coordinate { name, ..c.clone() }),
        }
    }
    all
}

/// The point of `coordinates` at which each has its value from a point of [`shared`] ones, and the others are neutral.
pub fn expanded(coordinates: &[Coordinate], shared: &[Coordinate], point: &[f64]) -> Vec<f64> {
    let value = |c: &Coordinate| {
        let found = shared.iter().zip(point).find(|(s, _)| s.kind == c.kind && s.name == c.shared_name());
        found.map_or(c.neutral, |(_, x)| *x)
    };
    coordinates.iter().map(value).collect()
}

/// Parameters of the simulator at a point that are not neutral there: catalogue index and value.
pub fn values(coordinates: &[Coordinate], point: &[f64]) -> Vec<(usize, f64)> {
    let moved = coordinates.iter().zip(point).filter(|(c, x)| **x != c.neutral);
    moved.flat_map(|(c, &x)| c.ids.iter().map(move |&id| (id, c.value(x)))).collect()
}

/// What a point of the coordinates means to one lane.
pub fn lane_of(coordinates: &[Coordinate], point: &[f64], window: usize, joints: usize) -> Lane {
    let mut bias = vec![0.0; joints];
    for (c, &x) in coordinates.iter().zip(point) {
        if let Kind::Bias(j) = c.kind {
            bias[j] = x;
        }
    }
    Lane { window, parameters: values(coordinates, point), bias }
}

/// Corrections of the simulator that a value of a coordinate means, by name; none for a torque's shape and for contacts.
pub fn values_of(c: &Coordinate, x: f64, catalogue: &[qv_sim::ParameterInfo]) -> Vec<(String, f64)> {
    let ids = c.ids.iter().filter(|_| c.kind != Kind::Contact);
    ids.map(|&id| (catalogue[id].name.clone(), c.value(x))).collect()
}

/// Numbers of the torque's shapes at a point, `[joints][shapes]`; empty where the coordinates have none.
pub fn shapes_of(coordinates: &[Coordinate], point: &[f64], joints: usize) -> Vec<f32> {
    let mut numbers = vec![0.0; joints * SHAPES.len()];
    let mut any = false;
    for (c, &x) in coordinates.iter().zip(point) {
        if let Kind::Shape(at) = c.kind {
            numbers[at] = x as f32;
            any = true;
        }
    }
    if any { numbers } else { Vec::new() }
}

/// How a fit goes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FitSettings {
    /// Windows of a fit; in rollouts at most as many as a diagnosis has.
    pub windows: usize,
    /// Decisions of a window in the training's simulator, where torques are fitted.
    pub length: usize,
    /// Most steps of each fit.
    pub steps: usize,
    /// The prior.
    pub prior: Prior,
}

impl Default for FitSettings {
    fn default() -> Self {
        Self { windows: 160, length: 20, steps: 8, prior: Prior::default() }
    }
}

/// Largest torques that the recordings ask of each joint \[N m\]: of PD at measured states.
pub fn tops(replayer: &Replayer) -> Vec<f64> {
    let log = replayer.log;
    let mut tops = vec![0.0f64; log.joints];
    for stretch in &log.stretches {
        for k in 0..stretch.decisions(log.joints) {
            let (q, v) = stretch.state(log.joints, k);
            let targets = &stretch.targets[k * log.substeps * log.joints..];
            for j in 0..log.joints {
                let torque = log.kp[j] * (targets[j] - q[7 + j]) - log.kd[j] * v[6 + j];
                tops[j] = tops[j].max(f64::from(torque.abs()));
            }
        }
    }
    tops
}
