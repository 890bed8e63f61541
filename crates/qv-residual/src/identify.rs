//! Parameters of the simulator from windows of a log: maximum a posteriori by Gauss and Newton, the Jacobian by finite differences, one lane
//! of the simulator for each column.
//!
//! The model of an error is a normal one whose spread is each channel's own, estimated from the errors themselves (iterated reweighting), with
//! Huber's weights (1964, k = 1.345) for whole windows: where a foot slips that did not, the window says little of the motors. Errors within a
//! window hang together, so a window counts as one observation of each channel. The covariance is the sandwich of that (White 1982), by windows.

use crate::ResidualError;
use crate::basis::{BasisTorque, SHAPES};
use crate::windows::{Errors, Lane, Replayer, Window};
use nalgebra::{DMatrix, DVector};
use qv_core::statistics::median;
use qv_policy::compensate::Compensator;
use qv_policy::velocity::TaskRobot;
use rayon::prelude::*;
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

/// Huber's bound in units of the spread: 95 % efficiency for normal errors.
const HUBER: f64 = 1.345;
/// Lanes at once: more would not fit the cache and memory better.
const LANES: usize = 8192;

/// Spread of each channel: the median over windows of its root mean square, over what that is of a normal spread.
fn spreads(errors: &Errors) -> Vec<f64> {
    let of = |channel: usize| {
        let mean = |lane: usize| {
            let squares = errors.lane(lane).chunks_exact(errors.channels).map(|row| f64::from(row[channel]).powi(2));
            (squares.sum::<f64>() / errors.length as f64).sqrt()
        };
        let mut all: Vec<f64> = (0..errors.lanes).map(mean).collect();
        (median(&mut all) / 0.6745f64.sqrt()).max(1e-6)
    };
    (0..errors.channels).map(of).collect()
}

/// Mean squared whitened error of a lane over time, summed over channels, and its root mean over channels.
fn size(errors: &Errors, lane: usize, spreads: &[f64]) -> (f64, f64) {
    let rows = errors.lane(lane).chunks_exact(errors.channels);
    let each = |row: &[f32]| row.iter().zip(spreads).map(|(x, s)| (f64::from(*x) / s).powi(2)).sum::<f64>();
    let sum = rows.map(each).sum::<f64>() / errors.length as f64;
    (sum, (sum / errors.channels as f64).sqrt())
}

/// Huber's loss of a window, times its channels, and the weight of its squared error.
fn huber((sum, root): (f64, f64), channels: usize) -> (f64, f64) {
    if root <= HUBER {
        (0.5 * sum, 1.0)
    } else {
        (channels as f64 * (HUBER * root - 0.5 * HUBER * HUBER), HUBER / root)
    }
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

    fn prior(&self, point: &[f64]) -> f64 {
        0.5 * self.coordinates.iter().zip(point).map(|(c, x)| ((x - c.neutral) / c.spread).powi(2)).sum::<f64>()
    }

    /// Cost of each of `count` points from the errors `[windows][count]`.
    fn costs(&self, errors: &Errors, points: &[Vec<f64>], spreads: &[f64]) -> Vec<f64> {
        let of = |k: usize| {
            let windows = (0..self.windows.len()).map(|w| w * points.len() + k);
            let data: f64 = windows.map(|lane| huber(size(errors, lane, spreads), errors.channels).0).sum();
            data + self.prior(&points[k])
        };
        (0..points.len()).map(of).collect()
    }

    /// Runs the fit from a point; `tell` hears of each step and its cost.
    ///
    /// # Errors
    /// When the simulator refuses a number, or there are no windows.
    pub fn fit(&self, start: &[f64], mut tell: impl FnMut(usize, f64)) -> Result<Fit, ResidualError> {
        if self.windows.is_empty() {
            return Err(ResidualError::input("recordings", "windows to fit", "none"));
        }
        let count = self.coordinates.len();
        let mut point = start.to_vec();
        let mut costs = Vec::new();
        let mut deviations = self.coordinates.iter().map(|c| c.spread).collect::<Vec<_>>();
        for step in 0..self.settings.steps {
            let moves = self.moves(&point);
            let mut points = vec![point.clone(); count + 1];
            (0..count).for_each(|k| points[k + 1][k] += moves[k]);
            let errors = self.errors(&points)?;
            let here = self.here(&errors, count);
            let spreads = spreads(&here);
            let normal = self.normal(&errors, &moves, &spreads);
            deviations = self.deviations(&normal);
            let step_to = self.solve(&normal, &point);
            let shares = [0.0, 0.05, 0.12, 0.25, 0.5, 0.75, 1.0];
            let tries: Vec<Vec<f64>> = shares
                .iter()
                .map(|share| point.iter().zip(&step_to).map(|(x, to)| x + share * (to - x)).collect())
                .collect();
            let found = self.costs(&self.errors(&tries)?, &tries, &spreads);
            let best = (0..tries.len()).min_by(|&a, &b| found[a].total_cmp(&found[b])).unwrap_or(0);
            costs.push(found[best]);
            tell(step, found[best]);
            let gain = found[0] - found[best];
            point.clone_from(&tries[best]);
            // Less than a tenth of what one number may differ by chance: 0.5 is one standard deviation of one number.
            if best == 0 || gain < 0.05 * count as f64 {
                break;
            }
        }
        Ok(Fit { coordinates: self.coordinates.clone(), point, deviations, costs })
    }

    /// A third of each number's prior deviation, away from the nearer bound.
    fn moves(&self, point: &[f64]) -> Vec<f64> {
        let of =
            |(c, x): (&Coordinate, &f64)| if x + c.spread / 3.0 <= c.most { c.spread / 3.0 } else { -c.spread / 3.0 };
        self.coordinates.iter().zip(point).map(of).collect()
    }

    /// The errors at the point itself, one lane for each window.
    fn here(&self, errors: &Errors, count: usize) -> Errors {
        let values = (0..self.windows.len()).flat_map(|w| errors.lane(w * (count + 1)).to_vec()).collect();
        Errors { lanes: self.windows.len(), values, ..errors.clone() }
    }

    fn normal(&self, errors: &Errors, moves: &[f64], spreads: &[f64]) -> Normal {
        let count = moves.len();
        let one = |w: usize| {
            let base = errors.lane(w * (count + 1));
            let (_, weight) = huber(size(errors, w * (count + 1), spreads), errors.channels);
            let whitened = |k: usize, x: f32| f64::from(x) / spreads[k % errors.channels];
            let rows = base.len();
            let residual = DVector::from_iterator(rows, base.iter().enumerate().map(|(k, &x)| whitened(k, x)));
            let mut jacobian = DMatrix::zeros(rows, count);
            for c in 0..count {
                let moved = errors.lane(w * (count + 1) + 1 + c);
                for k in 0..rows {
                    jacobian[(k, c)] = whitened(k, moved[k] - base[k]) / moves[c];
                }
            }
            let share = weight / errors.length as f64;
            (jacobian.tr_mul(&jacobian) * share, jacobian.tr_mul(&residual) * share)
        };
        let parts: Vec<(DMatrix<f64>, DVector<f64>)> = (0..self.windows.len()).into_par_iter().map(one).collect();
        let mut normal = Normal {
            hessian: DMatrix::zeros(count, count),
            gradient: DVector::zeros(count),
            spread: DMatrix::zeros(count, count),
        };
        for (hessian, gradient) in &parts {
            normal.hessian += hessian;
            normal.gradient += gradient;
            normal.spread += gradient * gradient.transpose();
        }
        normal
    }

    /// Where Gauss and Newton's step leads from a point, within the bounds: what leaves them is held at the bound, and the rest solved again.
    fn solve(&self, normal: &Normal, point: &[f64]) -> Vec<f64> {
        let count = point.len();
        let mut hessian = normal.hessian.clone();
        let mut gradient = normal.gradient.clone();
        for (k, c) in self.coordinates.iter().enumerate() {
            hessian[(k, k)] += c.spread.powi(-2);
            gradient[k] += (point[k] - c.neutral) / c.spread.powi(2);
        }
        let mut held: Vec<Option<f64>> = vec![None; count];
        let mut to = point.to_vec();
        for _ in 0..8 {
            let free: Vec<usize> = (0..count).filter(|&k| held[k].is_none()).collect();
            let moved = |k: usize| held[k].map_or(0.0, |x| x - point[k]);
            let a = DMatrix::from_fn(free.len(), free.len(), |i, j| hessian[(free[i], free[j])]);
            let b = DVector::from_fn(free.len(), |i, _| {
                -gradient[free[i]] - (0..count).map(|k| hessian[(free[i], k)] * moved(k)).sum::<f64>()
            });
            let Some(solved) = a.cholesky().map(|c| c.solve(&b)) else { return point.to_vec() };
            for (i, &k) in free.iter().enumerate() {
                to[k] = point[k] + solved[i];
            }
            let mut again = false;
            for &k in &free {
                let c = &self.coordinates[k];
                if to[k] < c.least || to[k] > c.most {
                    held[k] = Some(to[k].clamp(c.least, c.most));
                    to[k] = to[k].clamp(c.least, c.most);
                    again = true;
                }
            }
            if !again {
                break;
            }
        }
        to.iter().zip(&self.coordinates).map(|(x, c)| x.clamp(c.least, c.most)).collect()
    }

    fn deviations(&self, normal: &Normal) -> Vec<f64> {
        let mut hessian = normal.hessian.clone();
        let mut spread = normal.spread.clone();
        for (k, c) in self.coordinates.iter().enumerate() {
            hessian[(k, k)] += c.spread.powi(-2);
            spread[(k, k)] += c.spread.powi(-2);
        }
        let Some(inverse) = hessian.cholesky().map(|c| c.inverse()) else {
            return self.coordinates.iter().map(|c| c.spread).collect();
        };
        let covariance = &inverse * spread * &inverse;
        (0..self.coordinates.len()).map(|k| covariance[(k, k)].max(0.0).sqrt()).collect()
    }
}

/// Sums over windows.
struct Normal {
    hessian: DMatrix<f64>,
    gradient: DVector<f64>,
    /// Sum of the windows' own gradients' outer products.
    spread: DMatrix<f64>,
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
