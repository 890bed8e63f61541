//! Torque balance of a recording: equations, one or two for each joint, whose rows are linear in everything that a robot may differ in.
//!
//! ```text
//! tau = Y(q, dq, ddq) pi + sum_k F_k(q, dq, ddq) phi_k + e         the balance of a joint
//! tau = clip(kp (c - q) + tau_ff) + kd (dc - dq) + e               the law of its motor, where commands and gains are known, too
//! ```
//!
//! Torque and all columns go through one low-pass filter and are sampled at 25 Hz (parallel filtering: Gautier, IEEE International Conference on
//! Robotics and Automation 1997; Janot, Vandanjon and Gautier, IEEE Transactions on Control Systems Technology 22, 2014). `y` is what the robot
//! as it is stated leaves, and a column is by what a unit of a deviation changes that.

use crate::HeldError;
use crate::regressor::{INERTIAL, modelled, torque_regressor};
use crate::servo::Servos;
use crate::signal::{Grid, Kernel, despike, quantile};
use qv_core::JointSeries;
use qv_recording::Run;
use qv_recording::run::ActuatorKind;
use qv_rollout::{Rollout, WindowOptions};
use qv_sim::{Model, Terrain};
use std::collections::HashMap;

/// Rate of rows \[Hz\], and bandwidth of their filter.
const RATE: f64 = 25.0;
const BANDWIDTH: f64 = 10.0;
/// The same of the rows that say whether a size depends on the bandwidth.
const WIDE_RATE: f64 = 100.0;
/// Bandwidth of positions and torques before anything is computed of them \[Hz\].
const LIGHT: f64 = 40.0;
/// Highest rate at which regressors are computed \[Hz\].
const WORK_RATE: f64 = 200.0;
/// Widths of the transitions of Coulomb and Stribeck friction as shares of a joint's usual top speed.
const TRANSITIONS: [f64; 2] = [0.02, 0.15];
const LEAST_ROWS: usize = 100;
/// Share of torques that lie below the largest one.
const LARGEST: f64 = 0.98;

/// What differs in a joint; see [`TERMS`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Term {
    Coulomb,
    Stribeck,
    Viscous,
    Drag,
    Load,
    Offset,
    Armature,
    Spring,
    TorqueScale,
    StateLatency,
    KpScale,
    KdScale,
    Strength,
    CommandLatency,
    Lag,
    LawOffset,
    Limit,
    /// Low-pass filter of commanded positions, and limit of their rate: firmware between command and motor.
    Smoothing,
    Slew,
    /// Greatest torque of a servo's motor.
    Cap,
}

/// All terms, in the order of their places.
pub(crate) const TERMS: [Term; 20] = [
    Term::Coulomb,
    Term::Stribeck,
    Term::Viscous,
    Term::Drag,
    Term::Load,
    Term::Offset,
    Term::Armature,
    Term::Spring,
    Term::TorqueScale,
    Term::StateLatency,
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
];

/// Terms of the balance of a joint: the first ten.
const OF_BALANCE: &[Term] = TERMS.split_at(10).0;
/// Terms of the law of its motor.
const OF_LAW: [Term; 9] = [
    Term::KpScale,
    Term::KdScale,
    Term::Strength,
    Term::CommandLatency,
    Term::Lag,
    Term::LawOffset,
    Term::Limit,
    Term::TorqueScale,
    Term::StateLatency,
];

/// A column of an equation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Column {
    /// Of a joint.
    Joint(usize, Term),
    /// An inertial parameter of a link.
    Link(usize, usize),
}

/// Which of a joint's equations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Balance,
    Law,
    /// Of positions, where no torque is recorded: see `path`.
    Path,
}

/// An equation with its rows.
#[derive(Clone)]
pub(crate) struct Equation {
    pub joint: usize,
    pub kind: Kind,
    pub columns: Vec<Column>,
    /// Shape `[columns + 1][rows]`; the last is `y`.
    pub values: Vec<Vec<f64>>,
    /// The same of the rows of the wider band.
    pub wide: Vec<Vec<f64>>,
    /// Torque of the modelled robot \[N m\], shape `[rows]`.
    pub modelled: Vec<f64>,
}

/// A recording as equations.
#[derive(Clone)]
pub(crate) struct Balance {
    /// Times of the rows \[s\], run after run.
    pub time: Vec<f64>,
    /// Run that each row is of.
    pub run: Vec<usize>,
    /// The same of the rows of the wider band.
    pub wide_time: Vec<f64>,
    pub wide_run: Vec<usize>,
    pub equations: Vec<Equation>,
    /// Single samples that jumped.
    pub spikes: usize,
}

/// What columns bend at, shape `[joints]` each.
#[derive(Clone)]
pub(crate) struct Bends {
    /// Speeds below which friction is another one \[rad/s\].
    pub coulomb: Vec<f64>,
    pub stribeck: Vec<f64>,
    /// Usual top speeds \[rad/s\].
    pub top: Vec<f64>,
    /// Torque that the recording hardly exceeds \[N m\]: where its motors are asked for more, it is their limit.
    pub limit: Vec<f64>,
}

/// By what a motor differs from its law, where that is not linear: factors, delay and time constant \[s\].
#[derive(Clone, Copy)]
pub(crate) struct Drive {
    pub kp: f64,
    pub kd: f64,
    pub strength: f64,
    pub latency: f64,
    pub lag: f64,
    /// By what states are reported late \[s\].
    pub observation: f64,
}

impl Drive {
    const STATED: Self = Self { kp: 1.0, kd: 1.0, strength: 1.0, latency: 0.0, lag: 0.0, observation: 0.0 };

    /// Whether it has a term.
    pub fn has(term: Term) -> bool {
        use Term::{CommandLatency, KdScale, KpScale, Lag, StateLatency, Strength};
        matches!(term, KpScale | KdScale | Strength | CommandLatency | Lag | StateLatency)
    }

    /// Adds a size of a term.
    pub fn add(&mut self, term: Term, size: f64) {
        match term {
            Term::KpScale => self.kp += size,
            Term::KdScale => self.kd += size,
            Term::Strength => self.strength += size,
            Term::CommandLatency => self.latency += size,
            Term::Lag => self.lag += size,
            Term::StateLatency => self.observation += size,
            _ => {}
        }
    }

    /// Whether it means something.
    pub fn is_sound(&self) -> bool {
        let is_within = |x: f64| (0.02..20.0).contains(&x);
        let is_time = |x: f64| (0.0..0.2).contains(&x);
        let factors = [self.kp, self.kd, self.strength];
        factors.into_iter().all(is_within) && [self.latency, self.lag, self.observation].into_iter().all(is_time)
    }
}

/// A robot as it is stated: model, and the parameters of its joints.
#[derive(Clone)]
pub(crate) struct Robot<'a> {
    pub model: &'a Model,
    /// Column of recordings for each joint.
    pub columns: Vec<usize>,
    /// Shape `[joints]` each.
    pub coulomb: Vec<f64>,
    pub viscous: Vec<f64>,
    pub armature: Vec<f64>,
    pub bias: Vec<f64>,
    pub limit: Vec<f64>,
    /// Parameters that are not neutral, by their places in the simulator's catalogue.
    pub stated: Vec<(usize, f64)>,
    /// Shape `[joints]`.
    pub drives: Vec<Drive>,
    /// Of servos that are simulated; none where torques are weighed.
    pub servos: Option<Servos>,
    /// Values of all parameters by name.
    values: HashMap<String, f64>,
}

impl<'a> Robot<'a> {
    pub fn new(run: &Run, model: &'a Model, given: &[(String, f64)]) -> Result<Self, HeldError> {
        let rollout = Rollout::new(run, model, &Terrain::none(), given, WindowOptions::default())?;
        let of = |kind: &str, key: &str| -> Vec<f64> {
            let value = |name: &String| {
                rollout.parameter(&format!("{kind}.{name}.{key}")).map_or(0.0, |id| rollout.nominal[id])
            };
            model.joint_names().iter().map(value).collect()
        };
        Ok(Self {
            model,
            coulomb: of("joint", "coulomb_friction"),
            viscous: of("joint", "viscous_friction"),
            armature: of("joint", "armature"),
            bias: of("sensor", "encoder_bias"),
            limit: of("actuator", "position_torque_limit"),
            stated: rollout.stated,
            values: rollout.catalogue.iter().zip(&rollout.nominal).map(|(p, x)| (p.name.clone(), *x)).collect(),
            servos: None,
            drives: vec![Drive::STATED; rollout.columns.len()],
            columns: rollout.columns,
        })
    }

    pub fn joints(&self) -> usize {
        self.columns.len()
    }

    /// Value of a parameter as it is stated; 0 of one that is not there.
    pub fn nominal(&self, name: &str) -> f64 {
        self.values.get(name).copied().unwrap_or(0.0)
    }
}

/// Whether torques of a recording can be weighed, or what its motors were asked for.
pub(crate) fn has_torques(run: &Run) -> bool {
    let is_told = run.commands.position.is_some() && (run.commands.kp.is_some() || run.actuator.kp.is_some());
    torques(run).is_some() || (run.actuator.kind == ActuatorKind::Pd && is_told)
}

/// Torques of a recording that can be weighed: measured ones, else those that a torque-controlled robot was reported.
pub(crate) fn torques(run: &Run) -> Option<&JointSeries> {
    let commanded = run.commands.torque.as_ref().filter(|_| run.actuator.kind == ActuatorKind::Torque);
    run.measured.torque.as_ref().or(commanded).filter(|s| !s.is_empty())
}

/// Signals of a recording on a grid of at most 200 Hz.
pub(crate) struct Signals {
    pub time: Vec<f64>,
    pub step: f64,
    pub valid: Vec<bool>,
    /// Shape `[joints][instants]`.
    pub q: Vec<Vec<f64>>,
    pub v: Vec<Vec<f64>>,
    pub a: Vec<Vec<f64>>,
    torque: Vec<Option<Vec<f64>>>,
    law: Vec<Option<Law>>,
    pub spikes: usize,
}

/// What a motor is asked for, by parts; shape `[instants]`.
struct Law {
    position: Vec<f64>,
    damping: Vec<f64>,
    whole: Vec<f64>,
    /// By what a unit of strength changes it.
    of_strength: Vec<f64>,
    /// Change per second of the part that comes of commands, and of that which comes of states.
    of_commands: Vec<f64>,
    of_states: Vec<f64>,
}

impl Signals {
    pub fn new(run: &Run, robot: &Robot) -> Result<Self, HeldError> {
        let position =
            run.measured.position.as_ref().ok_or_else(|| HeldError::recording("recording", "no positions"))?;
        let grid = Grid::of(position).ok_or_else(|| HeldError::recording("recording", "fewer than 50 samples"))?;
        let stride = ((1.0 / grid.step) / WORK_RATE).floor().max(1.0) as usize;
        let kernel = Kernel::new(LIGHT, grid.step);
        let places: Vec<usize> = (0..grid.count).step_by(stride).collect();
        let torques = torques(run);
        let mut all = Self {
            time: places.iter().map(|&k| grid.time(k)).collect(),
            step: grid.step * stride as f64,
            valid: vec![true; places.len()],
            q: Vec::new(),
            v: Vec::new(),
            a: Vec::new(),
            torque: Vec::new(),
            law: Vec::new(),
            spikes: 0,
        };
        for j in 0..robot.joints() {
            let column = robot.columns[j];
            let read = grid.interpolate(position, column, robot.drives[j].observation);
            let (mut q, valid) = read
                .ok_or_else(|| HeldError::recording(&run.joint_names[column], "most of its positions are missing"))?;
            all.spikes += despike(&mut q);
            all.mask(&valid, &places, kernel.reach());
            let torque = torques.and_then(|s| all.torque_of(run, s, &grid, column, (&kernel, &places)));
            let law =
                law_of(run, robot, &grid, j, &q, (&kernel, &places)).filter(|_| torque.is_some() || torques.is_none());
            q.iter_mut().for_each(|x| *x -= robot.bias[j]);
            all.q.push(kernel.apply(&q, &places, 0));
            all.v.push(kernel.apply(&q, &places, 1));
            all.a.push(kernel.apply(&q, &places, 2));
            all.torque.push(torque);
            all.law.push(law);
        }
        Ok(all)
    }

    /// Takes out what rests on samples that are not there.
    fn mask(&mut self, valid: &[bool], places: &[usize], reach: usize) {
        let mut bad = vec![0usize; valid.len() + 1];
        valid.iter().enumerate().for_each(|(k, v)| bad[k + 1] = bad[k] + usize::from(!v));
        for (out, &place) in self.valid.iter_mut().zip(places) {
            let (from, until) = (place.saturating_sub(reach), (place + reach + 1).min(valid.len()));
            let is_inside = place >= reach && place + reach < valid.len();
            *out &= is_inside && bad[until] == bad[from];
        }
    }

    fn torque_of(
        &mut self,
        run: &Run,
        series: &JointSeries,
        grid: &Grid,
        column: usize,
        (kernel, places): (&Kernel, &[usize]),
    ) -> Option<Vec<f64>> {
        let is_measured = run.measured.torque.is_some();
        let values = if is_measured {
            let (mut values, valid) = grid.interpolate(series, column, 0.0)?;
            self.spikes += despike(&mut values);
            self.mask(&valid, places, kernel.reach());
            values
        } else {
            grid.hold(series, column, 0.0)
        };
        let is_alive = values.iter().any(|x| (x - values[0]).abs() > 1e-9);
        is_alive.then(|| kernel.apply(&values, places, 0))
    }
}

/// The law of a joint's motor where commands and gains are known; `q` are positions on the grid as they were measured.
fn law_of(
    run: &Run,
    robot: &Robot,
    grid: &Grid,
    joint: usize,
    q: &[f64],
    (kernel, places): (&Kernel, &[usize]),
) -> Option<Law> {
    let (commands, column) = (&run.commands, robot.columns[joint]);
    let position = commands.position.as_ref().filter(|_| run.actuator.kind == ActuatorKind::Pd)?;
    let drive = robot.drives[joint];
    let held = |s: &JointSeries| grid.hold(s, column, drive.latency);
    let series = |s: &Option<JointSeries>, constant: f64| s.as_ref().map_or(vec![constant; grid.count], &held);
    let kp = commands.kp.as_ref().map(&held).or(run.actuator.kp.map(|k| vec![k; grid.count]))?;
    let kp: Vec<f64> = kp.iter().map(|k| k * drive.kp).collect();
    let kd: Vec<f64> = series(&commands.kd, run.actuator.kd.unwrap_or(0.0)).iter().map(|k| k * drive.kd).collect();
    let (target, speed, ahead) = (held(position), series(&commands.velocity, 0.0), series(&commands.torque, 0.0));
    let all: Vec<usize> = (0..grid.count).collect();
    let v = kernel.apply(q, &all, 1);
    let limit = robot.limit[joint];
    let is_clipped = |k: usize| (kp[k] * (target[k] - q[k]) + ahead[k]).abs() > limit;
    let asked = |k: usize| (kp[k] * (target[k] - q[k]) + ahead[k]).clamp(-limit, limit) + kd[k] * (speed[k] - v[k]);
    // What the lag makes of a series, exact for inputs that are held for a step.
    let share = qv_sim::lag_gain(grid.step, drive.lag);
    let smooth = |of: &dyn Fn(usize) -> f64, derivative: usize| {
        let mut lagged = drive.strength * of(0);
        let series: Vec<f64> = all
            .iter()
            .map(|&k| {
                lagged += share * (drive.strength * of(k) - lagged);
                lagged
            })
            .collect();
        kernel.apply(&series, places, derivative)
    };
    let free = |k: usize| if is_clipped(k) { 0.0 } else { 1.0 };
    Some(Law {
        position: smooth(&|k| free(k) * kp[k] * (target[k] - q[k]) / drive.kp, 0),
        damping: smooth(&|k| kd[k] * (speed[k] - v[k]) / drive.kd, 0),
        whole: smooth(&asked, 0),
        of_strength: smooth(&|k| asked(k) / drive.strength, 0),
        of_commands: smooth(&|k| kp[k] * target[k] + ahead[k] + kd[k] * speed[k], 1),
        of_states: smooth(&|k| kp[k] * q[k] + kd[k] * v[k], 1),
    })
}

/// Speeds that friction turns at, by those of `still`; largest torques of `runs`.
pub(crate) fn bends(still: &[Run], runs: &[Run], robot: &Robot) -> Result<Bends, HeldError> {
    let signals = |runs: &[Run]| runs.iter().map(|run| Signals::new(run, robot)).collect::<Result<Vec<Signals>, _>>();
    let (still, runs) = (signals(still)?, signals(runs)?);
    let fastest = |j: usize| quantile(still.iter().flat_map(|s| s.v[j].iter().map(|v| v.abs())).collect(), 0.95);
    let top: Vec<f64> = (0..robot.joints()).map(|j| fastest(j).max(1e-3)).collect();
    let of = |share: f64| -> Vec<f64> { top.iter().map(|v| share * v).collect() };
    let largest = |j: usize| {
        let all: Vec<f64> = runs.iter().filter_map(|s| s.torque[j].as_ref()).flatten().map(|x| x.abs()).collect();
        if all.is_empty() { f64::INFINITY } else { quantile(all, LARGEST) }
    };
    Ok(Bends {
        top: top.clone(),
        coulomb: of(TRANSITIONS[0]),
        stribeck: of(TRANSITIONS[1]),
        limit: (0..robot.joints()).map(largest).collect(),
    })
}

impl Balance {
    /// The equations of some recordings of one robot.
    pub fn new(runs: &[Run], robot: &Robot, bends: &Bends) -> Result<Self, HeldError> {
        let mut all: Option<Self> = None;
        for (index, run) in runs.iter().enumerate() {
            let own = Self::of_run(run, robot, bends, index)?;
            all = Some(match all {
                None => own,
                Some(before) => before.joined(own),
            });
        }
        all.ok_or_else(|| HeldError::recording("recordings", "there is none"))
    }

    /// Two recordings of one robot as one.
    pub fn joined(mut self, other: Self) -> Self {
        self.time.extend(other.time);
        self.run.extend(other.run);
        self.wide_time.extend(other.wide_time);
        self.wide_run.extend(other.wide_run);
        self.spikes += other.spikes;
        self.equations.retain(|e| other.equations.iter().any(|o| o.joint == e.joint && o.kind == e.kind));
        for own in &mut self.equations {
            let Some(more) = other.equations.iter().find(|o| o.joint == own.joint && o.kind == own.kind) else {
                continue;
            };
            own.values.iter_mut().zip(&more.values).for_each(|(a, b)| a.extend(b));
            own.modelled.extend(&more.modelled);
            own.wide.iter_mut().zip(&more.wide).for_each(|(a, b)| a.extend(b));
        }
        self
    }

    fn of_run(run: &Run, robot: &Robot, bends: &Bends, index: usize) -> Result<Self, HeldError> {
        let signals = Signals::new(run, robot)?;
        let narrow = Kernel::new(BANDWIDTH, signals.step);
        let every = |rate: f64, reach: usize| -> Vec<usize> {
            let stride = (1.0 / (rate * signals.step)).round().max(1.0) as usize;
            let is_whole = |k: usize| {
                k >= reach && k + reach < signals.time.len() && signals.valid[k - reach..=k + reach].iter().all(|v| *v)
            };
            (0..signals.time.len()).step_by(stride).filter(|&k| is_whole(k)).collect()
        };
        let (rows, wide) = (every(RATE, narrow.reach()), every(WIDE_RATE, 0));
        if rows.len() < LEAST_ROWS {
            let reason =
                format!("{} s can be weighed, and {} are needed", rows.len() as f64 / RATE, LEAST_ROWS as f64 / RATE);
            return Err(HeldError::recording("recording", reason));
        }
        let raw = raw_equations(&signals, robot, bends);
        let equations = raw.into_iter().map(|raw| raw.filtered(&narrow, &rows, &wide)).collect();
        let times = |places: &[usize]| places.iter().map(|&k| signals.time[k]).collect();
        Ok(Self {
            time: times(&rows),
            run: vec![index; rows.len()],
            wide_time: times(&wide),
            wide_run: vec![index; wide.len()],
            equations,
            spikes: signals.spikes,
        })
    }
}

/// An equation before the filter.
struct Raw {
    joint: usize,
    kind: Kind,
    columns: Vec<Column>,
    /// Shape `[columns + 1][instants]`; the last is `y`.
    values: Vec<Vec<f64>>,
    modelled: Vec<f64>,
}

impl Raw {
    fn filtered(self, narrow: &Kernel, rows: &[usize], wide: &[usize]) -> Equation {
        let picked: Vec<Vec<f64>> = self.values.iter().map(|c| wide.iter().map(|&k| c[k]).collect()).collect();
        Equation {
            joint: self.joint,
            kind: self.kind,
            columns: self.columns,
            values: self.values.iter().map(|c| narrow.apply(c, rows, 0)).collect(),
            wide: picked,
            modelled: narrow.apply(&self.modelled, rows, 0),
        }
    }
}

fn raw_equations(signals: &Signals, robot: &Robot, bends: &Bends) -> Vec<Raw> {
    let (joints, links, count) = (robot.joints(), robot.model.links.len(), signals.time.len());
    // Inertial columns, shape [joints][links * 10][instants].
    let mut inertial = vec![vec![vec![0.0; count]; INERTIAL * links]; joints];
    for t in 0..count {
        let at = |of: &[Vec<f64>]| -> Vec<f64> { of.iter().map(|c| c[t]).collect() };
        let regressor = torque_regressor(robot.model, &at(&signals.q), &at(&signals.v), &at(&signals.a));
        for (own, row) in inertial.iter_mut().zip(&regressor) {
            own.iter_mut().zip(row).for_each(|(column, x)| column[t] = *x);
        }
    }
    let pi: Vec<f64> = (0..links).flat_map(|l| modelled(robot.model, l)).collect();
    let mut all = Vec::new();
    for (j, own) in inertial.into_iter().enumerate() {
        let mut carried = vec![0.0; count];
        own.iter().zip(&pi).for_each(|(c, p)| qv_fit::linear::add_scaled(&mut carried, *p, c));
        match (&signals.torque[j], &signals.law[j]) {
            (Some(torque), law) => {
                all.push(balance_of(signals, robot, bends, (j, torque), (own, carried)));
                all.extend(law.iter().map(|law| law_equation((j, bends.limit[j]), torque, law)));
            }
            (None, Some(law)) => {
                let mut balance = balance_of(signals, robot, bends, (j, &law.whole), (own, carried));
                take_law_for_torque(&mut balance, law);
                all.push(balance);
            }
            (None, None) => {}
        }
    }
    all
}

fn balance_of(
    signals: &Signals,
    robot: &Robot,
    bends: &Bends,
    (j, torque): (usize, &[f64]),
    (inertial, carried): (Vec<Vec<f64>>, Vec<f64>),
) -> Raw {
    let (v, a, q, count) = (&signals.v[j], &signals.a[j], &signals.q[j], torque.len());
    let turn = |t: usize| (v[t] / bends.coulomb[j]).tanh();
    let whole: Vec<f64> = (0..count)
        .map(|t| carried[t] + robot.armature[j] * a[t] + robot.viscous[j] * v[t] + robot.coulomb[j] * turn(t))
        .collect();
    let rate = differences(&whole, signals.step);
    let column = |term: Term| -> Vec<f64> {
        let at = |t: usize| match term {
            Term::Coulomb => turn(t),
            Term::Stribeck => turn(t) * (-v[t].abs() / bends.stribeck[j]).exp(),
            Term::Viscous => v[t],
            Term::Drag => v[t] * v[t].abs(),
            Term::Load => turn(t) * carried[t].abs(),
            Term::Armature => a[t],
            Term::Spring => q[t],
            Term::TorqueScale => whole[t],
            Term::StateLatency => rate[t],
            _ => 1.0,
        };
        (0..count).map(at).collect()
    };
    let mut columns: Vec<Column> = OF_BALANCE.iter().map(|&term| Column::Joint(j, term)).collect();
    let mut values: Vec<Vec<f64>> = OF_BALANCE.iter().map(|&term| column(term)).collect();
    for (k, c) in inertial.into_iter().enumerate().filter(|(_, c)| c.iter().any(|x| *x != 0.0)) {
        columns.push(Column::Link(k / INERTIAL, k % INERTIAL));
        values.push(c);
    }
    values.push(qv_fit::linear::minus(torque, &whole));
    Raw { joint: j, kind: Kind::Balance, columns, values, modelled: whole }
}

/// Where no torque was recorded, what the motor was asked for stands for it: a balance of both, with the columns of both. What is taken for torque
/// lacks what the motor gives beyond its law, hence the signs.
fn take_law_for_torque(balance: &mut Raw, law: &Law) {
    let negative = |values: &[f64]| values.iter().map(|x| -x).collect::<Vec<f64>>();
    let lagging: Vec<f64> = law.of_commands.iter().zip(&law.of_states).map(|(c, s)| c - s).collect();
    let scale = balance.columns.iter().position(|c| matches!(c, Column::Joint(_, Term::TorqueScale)));
    if let Some(at) = scale {
        balance.columns.remove(at);
        balance.values.remove(at);
    }
    let late = balance.columns.iter().position(|c| matches!(c, Column::Joint(_, Term::StateLatency)));
    if let Some(at) = late {
        qv_fit::linear::add_scaled(&mut balance.values[at], 1.0, &law.of_states);
    }
    let more = [
        (Term::KpScale, negative(&law.position)),
        (Term::KdScale, negative(&law.damping)),
        (Term::Strength, negative(&law.of_strength)),
        (Term::CommandLatency, law.of_commands.clone()),
        (Term::Lag, lagging),
    ];
    for (term, values) in more {
        balance.columns.push(Column::Joint(balance.joint, term));
        balance.values.insert(balance.values.len() - 1, values);
    }
}

fn law_equation((j, limit): (usize, f64), torque: &[f64], law: &Law) -> Raw {
    let column = |term: Term| -> Vec<f64> {
        match term {
            Term::KpScale => law.position.clone(),
            Term::KdScale => law.damping.clone(),
            Term::CommandLatency => law.of_commands.iter().map(|x| -x).collect(),
            Term::StateLatency => law.of_states.iter().map(|x| -x).collect(),
            Term::Lag => law.of_commands.iter().zip(&law.of_states).map(|(c, s)| s - c).collect(),
            Term::LawOffset => vec![1.0; torque.len()],
            Term::Strength => law.of_strength.clone(),
            Term::Limit => law.whole.iter().map(|x| x.clamp(-limit, limit) - x).collect(),
            _ => law.whole.clone(),
        }
    };
    let mut values: Vec<Vec<f64>> = OF_LAW.iter().map(|&term| column(term)).collect();
    values.push(qv_fit::linear::minus(torque, &law.whole));
    let columns = OF_LAW.iter().map(|&term| Column::Joint(j, term)).collect();
    Raw { joint: j, kind: Kind::Law, columns, values, modelled: law.whole.clone() }
}

/// Change per second, by central differences.
fn differences(values: &[f64], step: f64) -> Vec<f64> {
    let last = values.len() - 1;
    let at = |k: usize| {
        let (from, to) = (k.saturating_sub(1), (k + 1).min(last));
        (values[to] - values[from]) / (step * (to - from) as f64)
    };
    (0..values.len()).map(at).collect()
}
