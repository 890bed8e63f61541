//! Output error of servos: recordings without torques as equations in positions, one for each joint.
//!
//! A row is the measured position less the simulated one ([`crate::servo`]), a column by what a unit of a deviation moves the simulated one (central
//! differences of whole simulations). The position loop is stable, so that errors do not grow, and whole recordings are compared.

use crate::HeldError;
use crate::balance::{Balance, Column, Equation, Kind, Robot, Signals, Term};
use crate::regressor::{INERTIAL, modelled, torque_regressor};
use crate::servo::{Drive, LoadForm, ServoJoint, Servos, shaped, simulate};
use crate::signal::{Grid, quantile};
use qv_recording::Run;
use qv_recording::run::ActuatorKind;
use rayon::prelude::*;

/// Rate of rows \[Hz\], longest step of a simulation \[s\].
const RATE: f64 = 25.0;
const STEP: f64 = 0.002;
const LEAST_ROWS: usize = 100;
/// Turn by which the slope of gravity is taken \[rad\].
const TURN: f64 = 0.05;
/// Quantile of its torques, and share of a limit that holds, to which a motor is limited for the column of its limit.
const USUAL: f64 = 0.95;
const SHOWN_CAP: f64 = 0.9;
/// Speed of Stribeck's friction as a share of the usual top speed.
const STRIBECK: f64 = 0.15;

/// Terms of a joint.
const OF_PATH: [Term; 19] = [
    Term::Coulomb,
    Term::Stribeck,
    Term::Viscous,
    Term::Drag,
    Term::Load,
    Term::Offset,
    Term::Armature,
    Term::Spring,
    Term::KpScale,
    Term::KdScale,
    Term::Strength,
    Term::CommandLatency,
    Term::Lag,
    Term::LawOffset,
    Term::Limit,
    Term::Smoothing,
    Term::Slew,
    Term::Cap,
    Term::StateLatency,
];

/// Whether a recording can be simulated joint by joint: positions and what its servos were asked for.
pub(crate) fn can_follow(run: &Run) -> bool {
    let has_gains = run.commands.kp.is_some() || run.actuator.kp.is_some();
    let is_servo = run.actuator.kind == ActuatorKind::Pd && run.commands.position.is_some() && has_gains;
    is_servo && run.measured.position.is_some()
}

/// Servos as a robot is stated; `top` are usual top speeds of its joints \[rad/s\].
pub(crate) fn servos(robot: &Robot, form: LoadForm, top: &[f64]) -> Servos {
    let names = robot.model.joint_names();
    let stated = |key: &str| names.iter().map(|n| robot.nominal(&format!("joint.{n}.{key}"))).collect();
    Servos {
        form,
        stribeck: stated("stribeck_friction"),
        load: vec![0.0; robot.joints()],
        offset: vec![0.0; robot.joints()],
        spring: stated("spring_stiffness"),
        drag: stated("quadratic_drag"),
        clip: vec![1.0; robot.joints()],
        smoothing: vec![0.0; robot.joints()],
        slew: vec![0.0; robot.joints()],
        cap: stated_caps(robot),
        late: vec![0.0; robot.joints()],
        top: top.to_vec(),
        inertial: vec![0.0; INERTIAL * robot.model.links.len()],
    }
}

/// Greatest torques as they are stated \[N m\], without bound where they are not.
fn stated_caps(robot: &Robot) -> Vec<f64> {
    let of = |name: &String| robot.nominal(&format!("actuator.{name}.torque_limit"));
    robot.model.joint_names().iter().map(of).map(|x| if x > 0.0 { x } else { f64::INFINITY }).collect()
}

/// Whether equations have columns of links.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Links {
    Known,
    Uncertain,
}

/// What a joint carries along its measured path, linear in the links' parameters; shape `[columns][instants]` each.
struct LoadRegressor {
    columns: Vec<usize>,
    force: Vec<Vec<f64>>,
    inertia: Vec<Vec<f64>>,
    slope: Vec<Vec<f64>>,
}

/// A recording as it is simulated; computed once.
pub(crate) struct Path {
    signals: Signals,
    carried: Vec<LoadRegressor>,
    substeps: usize,
    /// Commanded positions, speeds and torques at each step of the simulation, shape `[joints][3][steps]`.
    commands: Vec<[Vec<f64>; 3]>,
    /// Biases of encoders without which the signals are \[rad\], and gains; shape `[joints]`.
    bias: Vec<f64>,
    kp: Vec<f64>,
    kd: Vec<f64>,
    /// Rows among the instants.
    rows: Vec<usize>,
}

impl Path {
    /// Reads a recording.
    pub fn new(run: &Run, robot: &Robot) -> Result<Self, HeldError> {
        let signals = Signals::new(run, robot)?;
        let count = signals.time.len();
        let stride = (1.0 / (RATE * signals.step)).round().max(1.0) as usize;
        let rows: Vec<usize> = (0..count).step_by(stride).filter(|&k| signals.valid[k]).collect();
        if rows.len() < LEAST_ROWS {
            return Err(HeldError::Short(rows.len() as f64 / RATE, LEAST_ROWS as f64 / RATE));
        }
        let substeps = (signals.step / STEP).ceil().max(1.0) as usize;
        let fine = Grid { start: signals.time[0], step: signals.step / substeps as f64, count: count * substeps };
        let joints = robot.joints();
        Ok(Self {
            commands: (0..joints).map(|j| commands(run, robot.columns[j], &fine)).collect(),
            kp: (0..joints).map(|j| gain(run.commands.kp.as_ref(), run.actuator.kp, robot.columns[j])).collect(),
            kd: (0..joints).map(|j| gain(run.commands.kd.as_ref(), run.actuator.kd, robot.columns[j])).collect(),
            carried: carried(robot, &signals),
            bias: robot.bias.clone(),
            signals,
            substeps,
            rows,
        })
    }

    fn joint(&self, robot: &Robot, servos: &Servos, j: usize) -> ServoJoint {
        let drive = robot.drives[j];
        ServoJoint {
            coulomb: robot.coulomb[j],
            stribeck: servos.stribeck[j],
            viscous: robot.viscous[j],
            load: servos.load[j],
            offset: servos.offset[j],
            armature: robot.armature[j],
            spring: servos.spring[j],
            drag: servos.drag[j],
            kp: self.kp[j] * drive.kp,
            kd: self.kd[j] * drive.kd,
            strength: drive.strength,
            latency: drive.latency,
            lag: drive.lag,
            bias: robot.bias[j],
            smoothing: servos.smoothing[j],
            slew: servos.slew[j],
            late: servos.late[j],
            limit: robot.limit[j] * servos.clip[j],
            cap: servos.cap[j],
            turn: STRIBECK * servos.top[j],
            form: servos.form,
        }
    }

    /// Commanded positions of a joint after its firmware, at each step of the simulation.
    fn shaped(&self, j: usize, joint: &ServoJoint) -> Vec<f64> {
        shaped(&self.commands[j][0], joint, self.signals.step / self.substeps as f64)
    }

    /// Equations of some joints of one recording; columns of links are left out where these are known.
    pub fn balance(&self, robot: &Robot, servos: &Servos, (index, joints): (usize, &[usize]), links: Links) -> Balance {
        let equations = joints.par_iter().map(|&j| self.equation(robot, servos, j, links)).collect();
        Balance {
            time: self.rows.iter().map(|&k| self.signals.time[k]).collect(),
            run: vec![index; self.rows.len()],
            wide_time: Vec::new(),
            wide_run: Vec::new(),
            equations,
            spikes: self.signals.spikes,
        }
    }

    /// What a robot leaves of the positions of some joints \[rad\], shape `[joints][rows]`.
    pub fn left(&self, robot: &Robot, servos: &Servos, joints: &[usize]) -> Vec<Vec<f64>> {
        let of = |&j: &usize| self.residual(j, &Simulation::new(self, robot, servos, j).plain());
        joints.iter().map(of).collect()
    }

    /// Torque that a motor is asked for \[N m\]: quantiles over time, shape `[shares]`.
    pub fn torques(&self, robot: &Robot, servos: &Servos, (j, shares): (usize, &[f64])) -> Vec<f64> {
        let free = ServoJoint { cap: f64::INFINITY, ..self.joint(robot, servos, j) };
        let all = Simulation::new(self, robot, servos, j).torques(&free);
        shares.iter().map(|share| quantile(all.clone(), *share)).collect()
    }

    fn residual(&self, j: usize, simulated: &[f64]) -> Vec<f64> {
        let q = &self.signals.q[j];
        self.rows.iter().zip(simulated).map(|(&k, x)| q[k] + self.bias[j] - x).collect()
    }

    fn equation(&self, robot: &Robot, servos: &Servos, j: usize, links: Links) -> Equation {
        let simulation = Simulation::new(self, robot, servos, j);
        let plain = simulation.plain();
        let usual = simulation.usual_torque();
        let (mut columns, mut values) = (Vec::new(), Vec::new());
        for term in OF_PATH {
            columns.push(Column::Joint(j, term));
            let by = reach(term, &simulation.joint, usual, (servos.top[j], self.signals.step));
            // Gains are moved in proportion, and counted in what is stated.
            let scale = match term {
                Term::KpScale => robot.drives[j].kp,
                Term::KdScale => robot.drives[j].kd,
                _ => 1.0,
            };
            let slope = if term == Term::Cap {
                simulation.slope_of_cap(&plain)
            } else {
                simulation.slope_of_term(term, by, &plain)
            };
            values.push(slope.into_iter().map(|x| x / scale).collect());
        }
        let carried = if links == Links::Known { 0 } else { self.carried[j].columns.len() };
        for k in 0..carried {
            let place = self.carried[j].columns[k];
            columns.push(Column::Link(place / INERTIAL, place % INERTIAL));
            values.push(simulation.slope_of_link(k, usual));
        }
        values.push(self.residual(j, &plain));
        let (v, a, drive) = (&self.signals.v[j], &self.signals.a[j], &simulation.joint);
        let torque =
            |&k: &usize| simulation.load[0][k] + (simulation.load[1][k] + drive.armature) * a[k] + drive.viscous * v[k];
        let count = values.len();
        Equation {
            joint: j,
            kind: Kind::Path,
            columns,
            values,
            wide: vec![Vec::new(); count],
            modelled: self.rows.iter().map(torque).collect(),
        }
    }
}

/// A joint about which a recording is simulated.
struct Simulation<'a> {
    path: &'a Path,
    place: usize,
    joint: ServoJoint,
    /// Gravity and coupling, inertia, and slope of gravity along the path, shape `[3][instants]`.
    load: [Vec<f64>; 3],
    commands: Vec<f64>,
}

impl<'a> Simulation<'a> {
    fn new(path: &'a Path, robot: &Robot, servos: &Servos, place: usize) -> Self {
        let (carried, pi) = (&path.carried[place], links(robot, servos));
        let load = [&carried.force, &carried.inertia, &carried.slope];
        let joint = path.joint(robot, servos, place);
        Self {
            path,
            place,
            load: load.map(|of| sum(&carried.columns, of, &pi, path.signals.time.len())),
            commands: path.shaped(place, &joint),
            joint,
        }
    }

    fn carried(&self) -> [&[f64]; 3] {
        [0, 1, 2].map(|k| &self.load[k][..])
    }

    /// Positions at the rows \[rad\].
    fn run(&self, joint: &ServoJoint, commands: &[f64], load: [&[f64]; 3]) -> Vec<f64> {
        let (all, _) = self.all(joint, commands, load);
        self.path.rows.iter().map(|&k| all[k]).collect()
    }

    /// Positions at all instants \[rad\], and torques that the motor is asked for \[N m\].
    fn all(
        &self,
        joint: &ServoJoint,
        commands: &[f64],
        [carried, inertia, slope]: [&[f64]; 3],
    ) -> (Vec<f64>, Vec<f64>) {
        let (path, j) = (self.path, self.place);
        // The path is measured with the bias that is stated; what it is beyond moves the encoder alone.
        let q = &path.signals.q[j];
        let drive = Drive {
            step: path.signals.step,
            substeps: path.substeps,
            path: q,
            carried,
            inertia,
            slope,
            commands: [commands, &path.commands[j][1], &path.commands[j][2]],
            start: [q[0] + path.bias[j] - joint.bias, path.signals.v[j][0]],
        };
        simulate(joint, &drive)
    }

    fn plain(&self) -> Vec<f64> {
        self.run(&self.joint, &self.commands, self.carried())
    }

    /// Torque that the joint usually carries \[N m\].
    fn usual_torque(&self) -> f64 {
        let all = self.load[0].iter().map(|x| x.abs()).collect();
        quantile(all, 0.9).max(0.2 * self.joint.kp * 0.01).max(1e-3)
    }

    /// Torques that a motor is asked for \[N m\], without their signs.
    fn torques(&self, joint: &ServoJoint) -> Vec<f64> {
        self.all(joint, &self.commands, self.carried()).1
    }

    /// By a lower limit of the motor, from the one that shows: above usual torques it does next to nothing.
    fn slope_of_cap(&self, plain: &[f64]) -> Vec<f64> {
        let joint = self.joint;
        let usual = quantile(self.torques(&joint), USUAL);
        let lower = ServoJoint { cap: usual.min(SHOWN_CAP * joint.cap), ..joint };
        let by = joint.cap - lower.cap;
        if !by.is_finite() || by <= 0.0 {
            return vec![0.0; plain.len()];
        }
        slopes(plain, &self.run(&lower, &self.commands, self.carried()), by)
    }

    fn slope_of_term(&self, term: Term, by: f64, plain: &[f64]) -> Vec<f64> {
        let load = self.carried();
        let at = |x: f64| {
            let joint = shifted(self.joint, term, x);
            if matches!(term, Term::Smoothing | Term::Slew) {
                self.run(&joint, &self.path.shaped(self.place, &joint), load)
            } else {
                self.run(&joint, &self.commands, load)
            }
        };
        // What cannot be negative is taken along one side.
        if is_at_zero(term, &self.joint, by) { slopes(&at(by), plain, by) } else { slopes(&at(by), &at(-by), 2.0 * by) }
    }

    /// By an inertial parameter of a link, by its place among those that the joint carries.
    fn slope_of_link(&self, k: usize, usual: f64) -> Vec<f64> {
        let carried = &self.path.carried[self.place];
        let torque = carried.force[k].iter().zip(&carried.inertia[k]).zip(&self.path.signals.a[self.place]);
        let most = torque.map(|((f, m), a)| (f + m * a).abs()).fold(1e-9, f64::max);
        let by = 0.05 * usual / most;
        let at = |x: f64| {
            let with =
                |whole: &[f64], of: &[f64]| -> Vec<f64> { whole.iter().zip(of).map(|(w, o)| w + x * o).collect() };
            let [force, inertia, slope] = [&carried.force[k], &carried.inertia[k], &carried.slope[k]];
            let inertia: Vec<f64> = with(&self.load[1], inertia).iter().map(|m| m.max(0.0)).collect();
            let (force, slope) = (with(&self.load[0], force), with(&self.load[2], slope));
            self.run(&self.joint, &self.commands, [&force, &inertia, &slope])
        };
        slopes(&at(by), &at(-by), 2.0 * by)
    }
}

/// Parameters of all links, shape `[links * 10]`.
fn links(robot: &Robot, servos: &Servos) -> Vec<f64> {
    let stated = (0..robot.model.links.len()).flat_map(|l| modelled(robot.model, l));
    stated.zip(&servos.inertial).map(|(a, b)| a + b).collect()
}

fn sum(columns: &[usize], of: &[Vec<f64>], pi: &[f64], count: usize) -> Vec<f64> {
    let mut all = vec![0.0; count];
    columns.iter().zip(of).for_each(|(&c, values)| qv_fit::linear::add_scaled(&mut all, pi[c], values));
    all
}

fn slopes(high: &[f64], low: &[f64], span: f64) -> Vec<f64> {
    high.iter().zip(low).map(|(a, b)| (a - b) / span).collect()
}

/// By how much a term is moved for its column.
fn reach(term: Term, joint: &ServoJoint, usual: f64, (top, step): (f64, f64)) -> f64 {
    match term {
        Term::Coulomb | Term::Stribeck | Term::Offset => 0.05 * usual,
        Term::Viscous => 0.05 * usual / top,
        Term::Drag => 0.05 * usual / (top * top),
        Term::Load | Term::KpScale | Term::KdScale | Term::Strength | Term::Limit => 0.03,
        Term::Armature => 0.1 * joint.armature.max(1e-3),
        Term::Spring => 0.1 * usual,
        Term::CommandLatency | Term::StateLatency | Term::Smoothing | Term::Lag => 0.3 * step,
        Term::Slew => 0.03 / top,
        _ => 1e-3,
    }
}

/// Whether a parameter is so near to zero that no central difference fits.
fn is_at_zero(term: Term, joint: &ServoJoint, by: f64) -> bool {
    let value = match term {
        Term::Coulomb => joint.coulomb,
        Term::Stribeck => joint.stribeck,
        Term::Load => joint.load,
        Term::Armature => joint.armature,
        Term::CommandLatency => joint.latency,
        Term::StateLatency => joint.late,
        Term::Lag => joint.lag,
        Term::Drag => joint.drag,
        Term::Smoothing => joint.smoothing,
        Term::Slew => joint.slew,
        _ => return false,
    };
    value < by
}

fn shifted(mut joint: ServoJoint, term: Term, by: f64) -> ServoJoint {
    match term {
        Term::Coulomb => joint.coulomb += by,
        Term::Stribeck => joint.stribeck += by,
        Term::Viscous => joint.viscous += by,
        Term::Drag => joint.drag += by,
        Term::Load => joint.load += by,
        Term::Offset => joint.offset += by,
        Term::Armature => joint.armature += by,
        Term::Spring => joint.spring += by,
        Term::KpScale => joint.kp *= 1.0 + by,
        Term::KdScale => joint.kd *= 1.0 + by,
        Term::Limit => joint.limit *= 1.0 + by,
        Term::Smoothing => joint.smoothing += by,
        Term::Slew => joint.slew += by,
        Term::Strength => joint.strength += by,
        Term::CommandLatency => joint.latency += by,
        Term::StateLatency => joint.late += by,
        Term::Lag => joint.lag += by,
        Term::LawOffset => joint.bias += by,
        _ => {}
    }
    joint
}

fn gain(series: Option<&qv_core::JointSeries>, fixed: Option<f64>, column: usize) -> f64 {
    let recorded = series.and_then(|s| s.column(column).find(|x| x.is_finite()));
    recorded.or(fixed).unwrap_or(0.0)
}

fn commands(run: &Run, column: usize, fine: &Grid) -> [Vec<f64>; 3] {
    let all = [&run.commands.position, &run.commands.velocity, &run.commands.torque];
    all.map(|series| series.as_ref().map_or(vec![0.0; fine.count], |s| fine.hold(s, column, 0.0)))
}

/// What each joint carries along the measured path.
fn carried(robot: &Robot, signals: &Signals) -> Vec<LoadRegressor> {
    let (joints, width, count) = (robot.joints(), INERTIAL * robot.model.links.len(), signals.time.len());
    let mut all: Vec<[Vec<Vec<f64>>; 3]> = vec![[(); 3].map(|()| vec![vec![0.0; count]; width]); joints];
    let zeros = vec![0.0; joints];
    for t in 0..count {
        let at = |of: &[Vec<f64>]| -> Vec<f64> { of.iter().map(|c| c[t]).collect() };
        let (q, v, a) = (at(&signals.q), at(&signals.v), at(&signals.a));
        let moving = torque_regressor(robot.model, &q, &v, &a);
        let still = torque_regressor(robot.model, &q, &zeros, &zeros);
        for (j, own) in all.iter_mut().enumerate() {
            let mut unit = zeros.clone();
            unit[j] = 1.0;
            let pushed = torque_regressor(robot.model, &q, &zeros, &unit);
            let turned = |by: f64| {
                let mut q = q.clone();
                q[j] += by;
                torque_regressor(robot.model, &q, &zeros, &zeros)
            };
            let (high, low) = (turned(TURN), turned(-TURN));
            for c in 0..width {
                let inertia = pushed[j][c] - still[j][c];
                own[0][c][t] = moving[j][c] - inertia * a[j];
                own[1][c][t] = inertia;
                own[2][c][t] = (high[j][c] - low[j][c]) / (2.0 * TURN);
            }
        }
    }
    let kept = |[force, inertia, slope]: [Vec<Vec<f64>>; 3]| {
        let is_seen = |c: &usize| force[*c].iter().chain(&inertia[*c]).any(|x| x.abs() > 1e-12);
        let columns: Vec<usize> = (0..width).filter(is_seen).collect();
        let pick = |of: &[Vec<f64>]| columns.iter().map(|&c| of[c].clone()).collect();
        LoadRegressor { force: pick(&force), inertia: pick(&inertia), slope: pick(&slope), columns }
    };
    all.into_iter().map(kept).collect()
}
