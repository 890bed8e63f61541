//! Parameters of the simulator from windows of a log: maximum a posteriori by [`qv_fit::fit`], one lane of the simulator for each window and
//! point.
//!
//! Errors are in units of each channel's own spread, estimated from the errors themselves before each step. Windows have the tails of Student's
//! t: where a foot slips that did not, the window says little of the motors. Errors within a window hang together, so a window counts as one
//! observation of each channel. Deviations are by how windows differ (the sandwich).

use crate::ResidualError;
use crate::basis::{BasisTorque, SHAPES};
use crate::windows::{BASE_CHANNELS, Errors, Lane, Replayer, Window};
use qv_core::statistics::median;
use qv_fit::{Blocks, Loss, Options, Problem, Stopped};
use qv_policy::compensate::Compensator;
use qv_policy::velocity::TaskRobot;
use serde::{Deserialize, Serialize};

/// What a number of a fit means to the simulator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// One parameter, or several that share a value.
    Parameter,
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

/// Prior standard deviations. Torques are measured by [`TaskRobot::torque_scale`]: a foot's share of the weight on a lever as long as the
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

/// Coordinates that a short stretch of walking can tell: latency, strength and friction of all motors together, and of the ground.
///
/// # Errors
/// When the simulator lacks a parameter.
pub fn leading(replayer: &Replayer, prior: &Prior) -> Result<Vec<Coordinate>, ResidualError> {
    let batch = replayer.batch(1)?;
    let (robot, scale) = (replayer.robot, f64::from(replayer.robot.torque_scale()));
    let joints = |before: &str, after: &str| {
        robot.model.joint_names().iter().map(|n| format!("{before}.{n}.{after}")).collect::<Vec<_>>()
    };
    let feet = robot.feet.iter().map(|&g| format!("geom.{}.friction_scale", robot.model.geoms[g].name)).collect();
    let lists = [
        ("actuator.*.command_latency", joints("actuator", "command_latency"), prior.latency, replayer.longest_latency),
        ("actuator.*.strength", joints("actuator", "strength"), prior.strength, 1e9),
        ("joint.*.coulomb_friction", joints("joint", "coulomb_friction"), prior.coulomb * scale, 1e9),
        ("joint.*.viscous_friction", joints("joint", "viscous_friction"), prior.viscous * scale, 1e9),
        ("geom.*.friction_scale", feet, prior.friction, 1e9),
    ];
    let of = |(name, members, spread, most): (&str, Vec<String>, f64, f64)| {
        let ids = members.iter().map(|n| batch.parameter_index(n)).collect::<Result<Vec<_>, _>>()?;
        let info = &batch.catalogue()[ids[0]];
        let (neutral, least) = (info.neutral, info.clamped(f64::MIN).max(-1e9));
        Ok(Coordinate { name: name.into(), kind: Kind::Parameter, ids, neutral, spread, least, most, top: 0.0 })
    };
    lists.into_iter().map(of).collect()
}

/// What a point of the coordinates means to one lane.
pub fn lane_of(coordinates: &[Coordinate], point: &[f64], window: usize, joints: usize) -> Lane {
    let mut lane = Lane { window, parameters: Vec::new(), bias: vec![0.0; joints] };
    for (c, &x) in coordinates.iter().zip(point) {
        if x == c.neutral {
            continue;
        }
        let value = if c.kind == Kind::Limit { c.top * (1.0 - x) } else { x };
        if let Kind::Bias(j) = c.kind {
            lane.bias[j] = x;
        }
        lane.parameters.extend(c.ids.iter().map(|&id| (id, value)));
    }
    lane
}

/// Parameters of the simulator that a value of a coordinate means, by name; none for a torque's shape.
pub fn values_of(c: &Coordinate, x: f64, catalogue: &[qv_sim::ParameterInfo]) -> Vec<(String, f64)> {
    let value = if c.kind == Kind::Limit { c.top * (1.0 - x) } else { x };
    c.ids.iter().map(|&id| (catalogue[id].name.clone(), value)).collect()
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

/// A fit.
#[derive(Debug, Clone)]
pub struct Fit {
    /// Its coordinates.
    pub coordinates: Vec<Coordinate>,
    /// Maximum a posteriori.
    pub point: Vec<f64>,
    /// Standard deviations of the posterior (sandwich by windows).
    pub deviations: Vec<f64>,
    /// Cost at the neutral point and after each step.
    pub costs: Vec<f64>,
}

/// How a fit goes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FitSettings {
    /// Windows of a fit.
    pub windows: usize,
    /// Decisions of a window.
    pub length: usize,
    /// Most steps.
    pub steps: usize,
    /// The prior.
    pub prior: Prior,
}

impl Default for FitSettings {
    fn default() -> Self {
        Self { windows: 160, length: 20, steps: 8, prior: Prior::default() }
    }
}

/// Degrees of freedom of a window's tails.
const FREEDOM: f64 = 4.0;
/// Shares of a step that are tried beside the whole one.
const SHARES: [f64; 5] = [0.05, 0.12, 0.25, 0.5, 0.75];
/// A step that lowers the cost by less than this for each number is the last: a tenth of what one number may differ by chance, since 0.5 is one
/// standard deviation of one number.
const SETTLED: f64 = 0.05;
/// Lanes at once: more would not fit the cache and memory better.
const LANES: usize = 8192;

/// Spread of each of some channels in windows `[length][channels]`: the median of its root mean square, over what that is of a normal spread.
fn spreads(windows: &Blocks, channels: usize) -> Vec<f64> {
    let of = |channel: usize| {
        let mean = |window: &Vec<f64>| {
            let squares = window.iter().skip(channel).step_by(channels).map(|x| x * x);
            (squares.sum::<f64>() * channels as f64 / window.len() as f64).sqrt()
        };
        (median(&mut windows.iter().map(mean).collect::<Vec<_>>()) / 0.6745f64.sqrt()).max(1e-6)
    };
    (0..channels).map(of).collect()
}

/// Fits the coordinates to windows.
pub struct Fitter<'a> {
    /// Replays.
    pub replayer: &'a Replayer<'a>,
    /// Coordinates.
    pub coordinates: Vec<Coordinate>,
    /// Windows.
    pub windows: Vec<Window>,
    /// Settings.
    pub settings: &'a FitSettings,
}

impl Fitter<'_> {
    /// Errors of each window at each of some points, `[windows][points]`.
    fn errors(&self, points: &[Vec<f64>]) -> Result<Errors, ResidualError> {
        let (robot, joints) = (self.replayer.robot, self.replayer.log.joints);
        let each = (LANES / points.len()).max(1);
        let mut all = Errors::default();
        for (k, part) in self.windows.chunks(each).enumerate() {
            let lanes: Vec<Lane> = (0..part.len())
                .flat_map(|w| points.iter().map(move |p| (w, p)))
                .map(|(w, p)| lane_of(&self.coordinates, p, k * each + w, joints))
                .collect();
            let numbers: Vec<f32> = (0..part.len())
                .flat_map(|_| points.iter().flat_map(|p| shapes_of(&self.coordinates, p, joints)))
                .collect();
            let compensator = (!numbers.is_empty()).then(|| basis(robot, numbers));
            let found = self.replayer.replay(&self.windows, &lanes, self.settings.length, compensator)?;
            all.lanes += found.lanes;
            (all.length, all.channels) = (found.length, found.channels);
            all.values.extend(found.values);
        }
        Ok(all)
    }

    /// Errors of each window at each of some points in units of the channels' spreads, `[points][windows][length * channels]`.
    fn scaled(&self, points: &[Vec<f64>], spreads: &[f64]) -> Result<Vec<Blocks>, ResidualError> {
        let errors = self.errors(points)?;
        let of_window = |w: usize, p: usize| {
            let lane = errors.lane(w * points.len() + p).iter().enumerate();
            lane.map(|(k, x)| f64::from(*x) / spreads[k % spreads.len()]).collect()
        };
        Ok((0..points.len()).map(|p| (0..self.windows.len()).map(|w| of_window(w, p)).collect()).collect())
    }

    fn problem(&self, start: &[f64]) -> Problem {
        let all = &self.coordinates;
        Problem {
            low: all.iter().map(|c| c.least).collect(),
            high: all.iter().map(|c| c.most).collect(),
            prior: all.iter().map(|c| Some([c.neutral, c.spread])).collect(),
            ..Problem::new(start, &all.iter().map(|c| c.spread / 3.0).collect::<Vec<_>>())
        }
    }

    /// Runs the fit from a point; `tell` hears of each step and its cost.
    ///
    /// # Errors
    /// When the simulator refuses a number, or there are no windows.
    pub fn fit(&self, start: &[f64], mut tell: impl FnMut(usize, f64)) -> Result<Fit, ResidualError> {
        if self.windows.is_empty() {
            return Err(ResidualError::input("recordings", "windows to fit", "none"));
        }
        let channels = self.replayer.log.joints + BASE_CHANNELS;
        let loss = Loss { independent: 1.0 / self.settings.length as f64, ..Loss::student(FREEDOM) };
        let gain = SETTLED * self.coordinates.len() as f64;
        let (dampings, shares) = (vec![0.0], SHARES.to_vec());
        let options = Options { loss, rounds: 1, dampings, shares, fall: 0.0, gain, ..Options::default() };
        let mut problem = self.problem(start);
        let mut scales = spreads(&self.scaled(&[start.to_vec()], &vec![1.0; channels])?[0], channels);
        let mut fit = Fit {
            coordinates: self.coordinates.clone(),
            point: start.to_vec(),
            deviations: self.coordinates.iter().map(|c| c.spread).collect(),
            costs: Vec::new(),
        };
        for step in 0..self.settings.steps {
            let found = qv_fit::fit(&problem, &options, |points| self.scaled(points, &scales))?;
            let deviations = found.block_deviations();
            fit.costs.push(found.cost);
            tell(step, found.cost);
            // One window alone has no scatter: then the prior's stay.
            if deviations.iter().all(|d| d.is_finite()) {
                fit.deviations = deviations;
            }
            fit.point.clone_from(&found.values);
            problem.start = found.values;
            if found.stopped != Stopped::Rounds {
                break;
            }
            scales.iter_mut().zip(spreads(&found.residuals, channels)).for_each(|(s, more)| *s = (*s * more).max(1e-6));
        }
        Ok(fit)
    }
}

/// The shapes as a compensator, for a robot.
pub fn basis(robot: &TaskRobot, numbers: Vec<f32>) -> Box<dyn Compensator> {
    Box::new(BasisTorque { stand: robot.stand.clone(), most: vec![robot.torque_scale(); robot.joints()], numbers })
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
