//! The actuator's law fed with what was measured, against the torque that was measured: no simulation, no contact.
//!
//! The law is that of `qv_sim::Motor`, commands late by the latency, through a first-order lag; times the scale of the torque sensor. It sees
//! what motors do apart from what legs do. A spring between motor and joint does not enter: the encoder that was recorded is the one that the
//! motor's controller sees.

mod align;
mod past;
mod state_noise;

pub use align::align;
pub use past::{lagged, leads, slope};
pub use state_noise::{Reading, state_noise};

use crate::parameters::Overrides;
use crate::robot::Rollout;
use crate::window::{Start, Window};
use qv_core::JointSeries;
use qv_recording::Run;
use qv_sim::{ActsOn, JointField, Motor, MotorCommand, WorldField, drift_share, lag_gain};

/// Length of a bin of this comparison \[s\]: latencies of milliseconds show in what changes fast.
pub const BIN: f64 = 0.01;

/// What of a joint's actuator and sensors enters the law under a setting.
pub struct ActuatorModel {
    joint: usize,
    motor: Motor,
    lag: f64,
    latency: f64,
    seen_late: f64,
    torque_scale: f64,
    drift: f64,
    /// Time of the run at which its recording begins \[s\].
    run_start: f64,
    sag: f64,
    /// Scales of the torque sensors of all joints, where the supply sags.
    torque_scales: Vec<f64>,
}

impl ActuatorModel {
    /// That of a joint of the model.
    pub fn new(rollout: &Rollout, setting: &Overrides, joint: usize) -> Self {
        let value = |field: JointField| rollout.value_of(setting, ActsOn::Joint(joint, field));
        let motor = Motor {
            strength: value(JointField::Strength),
            strength_asymmetry: value(JointField::StrengthAsymmetry),
            kp_scale: value(JointField::KpScale),
            kd_scale: value(JointField::KdScale),
            torque_limit: value(JointField::TorqueLimit),
            position_torque_limit: value(JointField::PositionTorqueLimit),
            speed_knee: value(JointField::SpeedKnee),
            speed_zero: value(JointField::SpeedZero),
            backlash: value(JointField::Backlash),
        };
        let world = |field: WorldField| rollout.value_of(setting, ActsOn::World(field));
        let sag = world(WorldField::SupplySag);
        let scales = |joint: usize| rollout.value_of(setting, ActsOn::Joint(joint, JointField::TorqueScale));
        Self {
            joint,
            motor,
            drift: value(JointField::StrengthDrift),
            run_start: world(WorldField::RunStart),
            sag,
            torque_scales: if sag > 0.0 { (0..rollout.columns.len()).map(scales).collect() } else { Vec::new() },
            lag: value(JointField::Lag),
            latency: value(JointField::CommandLatency),
            seen_late: value(JointField::EncoderLatency),
            torque_scale: value(JointField::TorqueScale),
        }
    }

    /// Share of its torque that the motor gives at a time \[s\] of a window's run, by how long that has run and by what all motors draw.
    fn share(&self, rollout: &Rollout, (view, clock): (&Run, Clock), time: f64) -> f64 {
        if self.drift == 0.0 && self.sag == 0.0 {
            return 1.0;
        }
        let since = self.run_start + clock.since + (time - clock.time);
        let sagged = if self.sag > 0.0 { 1.0 - self.sag * self.power(rollout, view, time) } else { 1.0 };
        drift_share(self.drift, since) * sagged.max(0.0)
    }

    /// Mechanical power that all motors drew by the last row of torques before a time \[W\]; none where it was not measured.
    fn power(&self, rollout: &Rollout, view: &Run, time: f64) -> f64 {
        let m = &view.measured;
        let (Some(torque), Some(velocity)) = (&m.torque, &m.velocity) else { return 0.0 };
        let row = torque.time.partition_point(|&t| t < time);
        if row == 0 || velocity.is_empty() {
            return 0.0;
        }
        let place = RowInterpolation::new(velocity, torque.time[row - 1], row - 1);
        let of = |(&column, scale): (&usize, &f64)| torque.row(row - 1)[column] / scale * place.of(velocity, column);
        let drawn = rollout.columns.iter().zip(&self.torque_scales).map(of).filter(|power| power.is_finite());
        drawn.map(|power| power.max(0.0)).sum()
    }

    /// Torque that is asked for by a command and a state, of a motor that stood at `motor` before if there is play; it is
    /// moved along.
    fn demand(&self, asked: &MotorCommand, state: &State, motor: &mut Option<f64>) -> f64 {
        let q = self.motor.within_play(motor.unwrap_or(state.q), state.q);
        *motor = Some(q);
        self.motor.demand(asked, q, state.dq)
    }
}

/// A time of a run \[s\], and how long its recording had been going on then \[s\].
#[derive(Clone, Copy)]
struct Clock {
    time: f64,
    since: f64,
}

impl Clock {
    fn of(start: &Start) -> Self {
        Self { time: start.time, since: start.since }
    }
}

/// Where a joint is measured to be.
#[derive(Clone, Copy)]
struct State {
    q: f64,
    dq: f64,
}

/// The recorded channels of one joint.
struct Channels<'a> {
    column: usize,
    q: &'a JointSeries,
    dq: &'a JointSeries,
    q_des: Option<&'a JointSeries>,
    dq_des: Option<&'a JointSeries>,
    tau_ff: Option<&'a JointSeries>,
    kp: Option<&'a JointSeries>,
    kd: Option<&'a JointSeries>,
    fixed_kp: f64,
    fixed_kd: f64,
}

impl<'a> Channels<'a> {
    fn new(run: &'a Run, column: usize) -> Option<Self> {
        let (c, m) = (&run.commands, &run.measured);
        let some = |s: &'a Option<JointSeries>| s.as_ref().filter(|s| !s.is_empty());
        Some(Self {
            column,
            q: some(&m.position)?,
            dq: some(&m.velocity)?,
            q_des: some(&c.position),
            dq_des: some(&c.velocity),
            tau_ff: some(&c.torque),
            kp: some(&c.kp),
            kd: some(&c.kd),
            fixed_kp: run.actuator.kp.unwrap_or(0.0),
            fixed_kd: run.actuator.kd.unwrap_or(0.0),
        })
    }

    /// The series of its commands, those that there are.
    fn commands(&self) -> [Option<&'a JointSeries>; 5] {
        [self.q_des, self.dq_des, self.tau_ff, self.kp, self.kd]
    }

    /// The command in force at a time, looked for near `row`, which is moved there.
    fn asked(&self, t: f64, row: &mut usize) -> MotorCommand {
        self.asked_in(|series| {
            *row = row_near(series, t, *row);
            *row
        })
    }

    /// The command in the row that `row` gives of each series that there is, in the order of [`Self::commands`].
    fn asked_in(&self, mut row: impl FnMut(&JointSeries) -> usize) -> MotorCommand {
        let absent = [0.0, 0.0, 0.0, self.fixed_kp, self.fixed_kd];
        let mut held = self.commands().into_iter().zip(absent).map(|(series, fixed)| match series {
            Some(series) => series.row(row(series))[self.column],
            None => fixed,
        });
        let mut next = || held.next().expect("five");
        MotorCommand { q: next(), dq: next(), tau: next(), kp: next(), kd: next() }
    }

    /// The state at a time, looked for near `row`, which is moved there.
    fn state(&self, t: f64, row: &mut usize) -> State {
        let q = RowInterpolation::new(self.q, t, *row);
        let dq = RowInterpolation::new(self.dq, t, q.row);
        *row = dq.row;
        State { q: q.of(self.q, self.column), dq: dq.of(self.dq, self.column) }
    }
}

/// Row that holds at a time.
fn row_at(series: &JointSeries, t: f64) -> usize {
    series.index_at(t).unwrap_or(0)
}

/// The same, looked for in one row and the next first: channels of a recorder mostly share their stamps, and what is asked for comes in order.
fn row_near(series: &JointSeries, t: f64, row: usize) -> usize {
    let is_in = |row: &usize| row + 1 < series.len() && series.time[*row] <= t && t < series.time[row + 1];
    [row, row + 1].into_iter().find(is_in).unwrap_or_else(|| row_at(series, t))
}

/// A time between two rows of a series.
#[derive(Clone, Copy)]
struct RowInterpolation {
    row: usize,
    /// 0 at the row, 1 at the next.
    share: f64,
}

impl RowInterpolation {
    /// `row` is looked in first.
    fn new(series: &JointSeries, t: f64, row: usize) -> Self {
        let row = row_near(series, t, row);
        if row + 1 >= series.len() {
            return Self { row, share: 0.0 };
        }
        let share = ((t - series.time[row]) / (series.time[row + 1] - series.time[row])).clamp(0.0, 1.0);
        Self { row, share }
    }

    fn of(self, series: &JointSeries, column: usize) -> f64 {
        let here = series.row(self.row)[column];
        // Nothing comes after the last row.
        if self.row + 1 >= series.len() { here } else { here + (series.row(self.row + 1)[column] - here) * self.share }
    }
}

/// Bins of one joint in a window.
pub fn bins(rollout: &Rollout) -> usize {
    (rollout.cut.window / BIN).round() as usize
}

/// How the stamps of torques, states and commands lie: recorders stamp before or after a tick's work, and a torque is
/// that of the tick before or after the positions it is reported with.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Alignment {
    /// A torque at `t` follows the command in force at `t - command` \[s\].
    pub command: f64,
    /// A torque at `t` follows the state at `t - state` \[s\].
    pub state: f64,
}

/// Measured minus expected torque in each bin, one joint after the other, shape `[law joints, bins]` \[N m\].
pub fn residual(rollout: &Rollout, window: &Window, setting: &Overrides, alignment: Alignment) -> Vec<f64> {
    let of = |&j: &usize| of_joint(rollout, window, &ActuatorModel::new(rollout, setting, j), alignment);
    rollout.law_joints.iter().flat_map(of).collect()
}

/// Whether a setting changes the law of a joint.
pub fn concerns(rollout: &Rollout, setting: &Overrides, joint: usize) -> bool {
    setting.iter().any(|s| match rollout.acts_on(s.0) {
        ActsOn::Joint(of, field) => of == joint && is_of_law(field),
        ActsOn::World(field) => matches!(field, WorldField::SupplySag | WorldField::RunStart),
        _ => false,
    })
}

/// Whether the law knows a parameter of a joint: those of its motor and of what reports it, but for a spring, behind which the encoder sits,
/// and a bias, which the motor's controller sees.
fn is_of_law(field: JointField) -> bool {
    use JointField::*;
    match field {
        Strength | StrengthAsymmetry | StrengthDrift | KpScale | KdScale | TorqueLimit | PositionTorqueLimit
        | SpeedKnee | SpeedZero | Lag | CommandLatency | Backlash | EncoderLatency | TorqueScale => true,
        Armature
        | Viscous
        | Coulomb
        | EncoderBias
        | SeriesCompliance
        | ExternalTorque
        | StribeckFriction
        | StribeckSpeed
        | StribeckExponent
        | LoadMotor
        | LoadExternal
        | StribeckLoadMotor
        | StribeckLoadExternal
        | QuadraticLoadMotor
        | QuadraticLoadExternal
        | QuadraticDrag
        | ConstantTorque
        | SpringStiffness
        | SpringRest
        | SpringSlack => false,
    }
}

/// [`residual`] of one joint, shape `[bins]`.
pub fn of_joint(rollout: &Rollout, window: &Window, law: &ActuatorModel, alignment: Alignment) -> Vec<f64> {
    let column = rollout.columns[law.joint];
    let Some((channels, stamps)) = Channels::new(&window.view, column).zip(Stamps::new(rollout, window, law)) else {
        return vec![f64::NAN; bins(rollout)];
    };
    let mut rows = [0; 2];
    let read = |t: f64| {
        let (late, seen) = (t - alignment.command - law.latency, t - alignment.state + law.seen_late);
        (channels.asked(late, &mut rows[0]), channels.state(seen, &mut rows[1]))
    };
    let rows = Rows::new(rollout, window, law, stamps);
    left(law, &rows, stamps.times(window).map(read))
}

/// Rows of measured torque that the law is compared with.
#[derive(Clone, Copy, PartialEq)]
struct Stamps {
    first: usize,
    last: usize,
}

impl Stamps {
    fn new(rollout: &Rollout, window: &Window, law: &ActuatorModel) -> Option<Self> {
        let torque = window.view.measured.torque.as_ref()?;
        // Lags of up to a few time constants before the window matter, and on which side of its play the motor was.
        let past = if law.motor.backlash > 0.0 { rollout.cut.margin } else { 5.0 * law.lag };
        let first = torque.time.partition_point(|&t| t < window.start - past);
        let last = torque.time.partition_point(|&t| t <= window.start + rollout.cut.window);
        Some(Self { first, last: last.max(first) })
    }

    fn times(self, window: &Window) -> impl Iterator<Item = f64> {
        let torque = window.view.measured.torque.as_ref().expect("there are stamps of it");
        torque.time[self.first..self.last].iter().copied()
    }
}

/// Measured torques of one joint at their stamps, and the bins that they are in.
struct Rows {
    /// Stamp, torque, share of it that the motor can give, and bin: none where nothing was measured, and before the window.
    of: Vec<(f64, f64, f64, Option<usize>)>,
    /// Torques in each bin.
    counts: Vec<usize>,
}

impl Rows {
    fn new(rollout: &Rollout, window: &Window, law: &ActuatorModel, stamps: Stamps) -> Self {
        let column = rollout.columns[law.joint];
        let torque = window.view.measured.torque.as_ref().expect("there are stamps of it");
        let mut counts = vec![0; bins(rollout)];
        let clock = Clock { time: window.start, since: window.since };
        let row = |i: usize| {
            let (time, measured) = (torque.time[i], torque.row(i)[column]);
            let bin = (time - window.start) / BIN;
            let is_counted = bin >= 0.0 && (bin as usize) < counts.len() && measured.is_finite();
            let bin = is_counted.then_some(bin as usize);
            bin.into_iter().for_each(|bin| counts[bin] += 1);
            (time, measured, law.share(rollout, (&window.view, clock), time), bin)
        };
        Self { of: (stamps.first..stamps.last).map(row).collect(), counts }
    }
}

/// Mean of measured minus expected torque in each bin; `read` gives command and state at each of the stamps.
fn left(law: &ActuatorModel, rows: &Rows, read: impl Iterator<Item = (MotorCommand, State)>) -> Vec<f64> {
    let mut sums = vec![0.0; rows.counts.len()];
    let mut filter = Lag { time_constant: law.lag, state: None };
    let mut motor = None;
    // The sum of the bin that is being filled stays in a register.
    let (mut at, mut sum) = (0, 0.0);
    for (&(time, measured, share, bin), (asked, state)) in rows.of.iter().zip(read) {
        let lagged = filter.next(time, share * law.demand(&asked, &state, &mut motor));
        let expected = law.torque_scale * law.motor.limited(lagged, state.dq);
        let Some(bin) = bin else { continue };
        if bin != at {
            sums[at] = sum;
            (at, sum) = (bin, sums[bin]);
        }
        sum += measured - expected;
    }
    if let Some(last) = sums.get_mut(at) {
        *last = sum;
    }
    // A bin without a sample of its own, in a slow recording, has nothing to say.
    sums.iter().zip(&rows.counts).map(|(s, &n)| if n == 0 { 0.0 } else { s / n as f64 }).collect()
}

/// A first-order lag on uneven stamps.
struct Lag {
    time_constant: f64,
    state: Option<(f64, f64)>,
}

impl Lag {
    fn next(&mut self, time: f64, input: f64) -> f64 {
        let output = match self.state {
            Some((before, y)) if self.time_constant > 0.0 => {
                y + (input - y) * lag_gain(time - before, self.time_constant)
            }
            _ => input,
        };
        self.state = Some((time, output));
        output
    }
}
