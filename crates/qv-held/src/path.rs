//! Output error of servos: recordings without torques as equations in positions, one for each joint.
//!
//! A row is the measured position less the simulated one ([`crate::servo`]), a column by what a unit of a deviation moves the simulated one (central
//! differences of whole simulations). The position loop is stable, so that errors do not grow, and whole recordings are compared.

use crate::HeldError;
use crate::balance::{Balance, Column, Equation, Kind, Robot, Signals, Term};
use crate::regressor::{INERTIAL, modelled, torque_regressor};
use crate::servo::{Drive, LoadForm, ServoJoint, Servos, simulate};
use crate::signal::{Grid, quantile};
use qv_recording::Run;
use qv_recording::run::ActuatorKind;

/// Rate of rows \[Hz\], longest step of a simulation \[s\].
const RATE: f64 = 25.0;
const STEP: f64 = 0.002;
const LEAST_ROWS: usize = 100;
/// Turn by which the slope of gravity is taken \[rad\].
const TURN: f64 = 0.05;
/// Speed of Stribeck's friction as a share of the usual top speed.
const STRIBECK: f64 = 0.15;

/// Terms of a joint; the last is what is reported late.
const OF_PATH: [Term; 13] = [
    Term::Coulomb,
    Term::Stribeck,
    Term::Viscous,
    Term::Load,
    Term::Offset,
    Term::Armature,
    Term::Spring,
    Term::KpScale,
    Term::Strength,
    Term::CommandLatency,
    Term::LawOffset,
    Term::Limit,
    Term::StateLatency,
];

/// Whether a recording can be simulated joint by joint: positions and what its servos were asked for.
pub(crate) fn can_follow(run: &Run) -> bool {
    let has_gains = run.commands.kp.is_some() || run.actuator.kp.is_some();
    let is_servo = run.actuator.kind == ActuatorKind::Pd && run.commands.position.is_some() && has_gains;
    is_servo && run.measured.position.is_some()
}

/// Servos as a robot is stated.
pub(crate) fn servos(robot: &Robot, form: LoadForm) -> Servos {
    let names = robot.model.joint_names();
    let stated = |key: &str| names.iter().map(|n| robot.nominal(&format!("joint.{n}.{key}"))).collect();
    Servos {
        form,
        stribeck: stated("stribeck_friction"),
        load: vec![0.0; robot.joints()],
        offset: vec![0.0; robot.joints()],
        spring: stated("spring_stiffness"),
        clip: vec![1.0; robot.joints()],
        inertial: vec![0.0; INERTIAL * robot.model.links.len()],
    }
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
    /// Gains and usual top speeds, shape `[joints]`.
    kp: Vec<f64>,
    kd: Vec<f64>,
    top: Vec<f64>,
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
            let (has, needs) = (rows.len() as f64 / RATE, LEAST_ROWS as f64 / RATE);
            return Err(HeldError::recording("recording", format!("{has} s can be compared, and {needs} are needed")));
        }
        let substeps = (signals.step / STEP).ceil().max(1.0) as usize;
        let fine = Grid { start: signals.time[0], step: signals.step / substeps as f64, count: count * substeps };
        let top = |j: usize| quantile(signals.v[j].iter().map(|v| v.abs()).collect(), 0.95).max(1e-3);
        let joints = robot.joints();
        Ok(Self {
            commands: (0..joints).map(|j| commands(run, robot.columns[j], &fine)).collect(),
            kp: (0..joints).map(|j| gain(run.commands.kp.as_ref(), run.actuator.kp, robot.columns[j])).collect(),
            kd: (0..joints).map(|j| gain(run.commands.kd.as_ref(), run.actuator.kd, robot.columns[j])).collect(),
            top: (0..joints).map(top).collect(),
            carried: carried(robot, &signals),
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
            kp: self.kp[j] * drive.kp,
            kd: self.kd[j] * drive.kd,
            strength: drive.strength,
            latency: drive.latency,
            bias: robot.bias[j],
            limit: robot.limit[j] * servos.clip[j],
            turn: STRIBECK * self.top[j],
            form: servos.form,
        }
    }

    /// Equations of one recording.
    pub fn balance(&self, robot: &Robot, servos: &Servos, index: usize) -> Balance {
        let equations = (0..robot.joints()).map(|j| self.equation(robot, servos, j)).collect();
        Balance {
            time: self.rows.iter().map(|&k| self.signals.time[k]).collect(),
            run: vec![index; self.rows.len()],
            wide_time: Vec::new(),
            wide_run: Vec::new(),
            equations,
            spikes: self.signals.spikes,
        }
    }

    fn equation(&self, robot: &Robot, servos: &Servos, j: usize) -> Equation {
        let joint = self.joint(robot, servos, j);
        let carried = &self.carried[j];
        let pi = links(robot, servos);
        let whole = |of: &[Vec<f64>]| sum(&carried.columns, of, &pi, self.signals.time.len());
        let (force, inertia, slope) = (whole(&carried.force), whole(&carried.inertia), whole(&carried.slope));
        // The path is measured with the bias that is stated; what it is beyond moves the encoder alone.
        let q = &self.signals.q[j];
        let run = |joint: &ServoJoint, force: &[f64], inertia: &[f64], slope: &[f64]| -> Vec<f64> {
            let drive = Drive {
                step: self.signals.step,
                substeps: self.substeps,
                path: q,
                carried: force,
                inertia,
                slope,
                commands: [0, 1, 2].map(|k| &self.commands[j][k][..]),
                start: [q[0], self.signals.v[j][0]],
            };
            let all = simulate(joint, &drive);
            self.rows.iter().map(|&k| all[k]).collect()
        };
        let plain = run(&joint, &force, &inertia, &slope);
        let usual = quantile(force.iter().map(|x| x.abs()).collect(), 0.9).max(0.2 * joint.kp * 0.01).max(1e-3);
        let (mut columns, mut values) = (Vec::new(), Vec::new());
        for term in OF_PATH {
            columns.push(Column::Joint(j, term));
            if term == Term::StateLatency {
                values.push(self.rows.iter().map(|&k| -self.signals.v[j][k]).collect());
                continue;
            }
            let by = reach(term, &joint, usual, self.top[j], self.signals.step);
            let at = |x: f64| run(&shifted(joint, term, x), &force, &inertia, &slope);
            // What cannot be negative is taken along one side.
            let low = if is_at_zero(term, &joint, by) { 0.0 } else { -by };
            values.push(slopes(&at(by), &if low == 0.0 { plain.clone() } else { at(low) }, by - low));
        }
        for (k, &place) in carried.columns.iter().enumerate() {
            let torque = carried.force[k].iter().zip(&carried.inertia[k]).zip(&self.signals.a[j]);
            let most = torque.map(|((f, m), a)| (f + m * a).abs()).fold(1e-9, f64::max);
            let by = 0.05 * usual / most;
            let moved = |x: f64| {
                let with =
                    |whole: &[f64], of: &[f64]| -> Vec<f64> { whole.iter().zip(of).map(|(w, o)| w + x * o).collect() };
                let inertia: Vec<f64> = with(&inertia, &carried.inertia[k]).iter().map(|m| m.max(0.0)).collect();
                run(&joint, &with(&force, &carried.force[k]), &inertia, &with(&slope, &carried.slope[k]))
            };
            columns.push(Column::Link(place / INERTIAL, place % INERTIAL));
            values.push(slopes(&moved(by), &moved(-by), 2.0 * by));
        }
        values.push(self.rows.iter().zip(&plain).map(|(&k, x)| q[k] + robot.bias[j] - x).collect());
        let torque = |&k: &usize| {
            force[k] + (inertia[k] + joint.armature) * self.signals.a[j][k] + joint.viscous * self.signals.v[j][k]
        };
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
fn reach(term: Term, joint: &ServoJoint, usual: f64, top: f64, step: f64) -> f64 {
    match term {
        Term::Coulomb | Term::Stribeck | Term::Offset => 0.05 * usual,
        Term::Viscous => 0.05 * usual / top,
        Term::Load | Term::KpScale | Term::KdScale | Term::Strength | Term::Limit => 0.03,
        Term::Armature => 0.1 * joint.armature.max(1e-3),
        Term::Spring => 0.1 * usual,
        Term::CommandLatency => 0.3 * step,
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
        _ => return false,
    };
    value < by
}

fn shifted(mut joint: ServoJoint, term: Term, by: f64) -> ServoJoint {
    match term {
        Term::Coulomb => joint.coulomb += by,
        Term::Stribeck => joint.stribeck += by,
        Term::Viscous => joint.viscous += by,
        Term::Load => joint.load += by,
        Term::Offset => joint.offset += by,
        Term::Armature => joint.armature += by,
        Term::Spring => joint.spring += by,
        Term::KpScale => joint.kp *= 1.0 + by,
        Term::KdScale => joint.kd *= 1.0 + by,
        Term::Limit => joint.limit *= 1.0 + by,
        Term::Strength => joint.strength += by,
        Term::CommandLatency => joint.latency += by,
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
