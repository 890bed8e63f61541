//! The actuator's law fed with what was measured, against the torque that was measured: no simulation, no contact.
//!
//! `tau = strength (clip(kp s_p (q_des - q) + tau_ff) + kd s_d (dq_des - dq))`, commands late by the latency, through a
//! first-order lag, limited (qv-sim's actuator); times the scale of the torque sensor. It sees what motors do apart from what legs do.

use crate::problem::{Problem, Setting, Window};
use qv_core::JointSeries;
use qv_replay::run::Run;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Length of a bin of this comparison \[s\]: latencies of milliseconds show in what changes fast.
pub const BIN: f64 = 0.01;

/// What of a joint's actuator and sensors enters the law under a setting.
pub struct Law {
    joint: usize,
    strength: f64,
    kp: f64,
    kd: f64,
    limit: f64,
    position_limit: f64,
    knee: f64,
    zero: f64,
    lag: f64,
    latency: f64,
    seen_late: f64,
    torque_scale: f64,
    play: f64,
}

impl Law {
    /// That of a joint of the model.
    pub fn new(problem: &Problem, setting: &Setting, joint: usize) -> Self {
        let value = |pattern: &str| problem.joint_value(setting, pattern, joint);
        Self {
            joint,
            strength: value("actuator.*.strength"),
            kp: value("actuator.*.kp_scale"),
            kd: value("actuator.*.kd_scale"),
            limit: value("actuator.*.torque_limit"),
            position_limit: value("actuator.*.position_torque_limit"),
            knee: value("actuator.*.speed_knee"),
            zero: value("actuator.*.speed_zero"),
            lag: value("actuator.*.lag"),
            latency: value("actuator.*.command_latency"),
            seen_late: value("sensor.*.encoder_latency"),
            torque_scale: value("sensor.*.torque_scale"),
            play: value("actuator.*.backlash"),
        }
    }

    /// Torque that is asked for by the command and state of time `t`, of a motor that stood at `motor` before if there is play;
    /// it is moved along.
    fn demand(&self, c: &Channels, t: f64, alignment: Alignment, motor: &mut Option<f64>) -> f64 {
        let late = t - alignment.command - self.latency;
        let seen = t - alignment.state + self.seen_late;
        let (joint, dq) = (c.at(c.q, seen), c.at(c.dq, seen));
        let half = 0.5 * self.play;
        let q = if half > 0.0 { motor.unwrap_or(joint).max(joint - half).min(joint + half) } else { joint };
        *motor = Some(q);
        let held = |series: Option<&JointSeries>, fixed: f64| series.map_or(fixed, |s| s.hold(late)[c.column]);
        let p = self.kp * held(c.kp, c.fixed_kp) * (held(c.q_des, 0.0) - q) + held(c.tau_ff, 0.0);
        let d = self.kd * held(c.kd, c.fixed_kd) * (held(c.dq_des, 0.0) - dq);
        self.strength * (p.clamp(-self.position_limit, self.position_limit) + d)
    }

    /// What is left of a torque by the limits of the motor.
    fn limited(&self, c: &Channels, t: f64, torque: f64) -> f64 {
        let dq = c.at(c.dq, t + self.seen_late);
        let mut most = self.limit;
        if dq.abs() > self.knee && torque * dq > 0.0 {
            most *= 1.0 - ((dq.abs() - self.knee) / (self.zero - self.knee).max(1e-6)).clamp(0.0, 1.0);
        }
        torque.clamp(-most, most)
    }
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

    fn at(&self, series: &JointSeries, t: f64) -> f64 {
        let i = series.index_at(t).unwrap_or(0);
        let here = series.values[i * series.joints + self.column];
        if i + 1 >= series.len() {
            return here;
        }
        let next = series.values[(i + 1) * series.joints + self.column];
        here + (next - here) * ((t - series.time[i]) / (series.time[i + 1] - series.time[i])).clamp(0.0, 1.0)
    }
}

/// Bins of one joint in a window.
pub fn bins(problem: &Problem) -> usize {
    (problem.cut.window / BIN).round() as usize
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

/// Offsets \[ticks\] of commands and states that recorders are known to have, the natural one first.
const OFFSETS: [f64; 3] = [0.0, -0.5, 0.5];
/// Latencies \[s\] that are thought of beside an offset, and by what factor less they must leave than none: an offset and a latency of a tick
/// may make what another offset makes alone.
const LONGEST_LATENCY: f64 = 0.025;
const LATENCY_COSTS: f64 = 1.1;

/// The alignment, of those within a tick, that leaves the least torque unexplained in `windows`. Each joint may have a latency of its own
/// of a tick or more beside it, known or not: half a tick of that is not taken for the recorder's.
pub fn align(problem: &Problem, windows: &[&Window]) -> Alignment {
    let Some(first) = windows.first() else { return Alignment::default() };
    let tick = first.view.measured.position.as_ref().map_or(0.0, |p| qv_replay::median_interval(&p.time));
    let some: Vec<&Window> = windows.iter().step_by((windows.len() / 12).max(1)).copied().collect();
    let latencies = if tick > 0.0 { ((LONGEST_LATENCY / tick - 1.0) * 2.0).clamp(0.0, 48.0) as usize } else { 0 };
    // In half ticks: what an alignment and a latency make together is the same number however it is divided among them.
    let latencies: Vec<i64> = std::iter::once(0).chain((0..=latencies as i64).map(|k| 2 + k)).collect();
    let mut known: BTreeMap<[i64; 2], Vec<f64>> = BTreeMap::new();
    let mut best: Option<(f64, Alignment)> = None;
    for command in OFFSETS {
        for state in OFFSETS.map(|s| -s) {
            let halves = [command, state].map(|x| (2.0 * x) as i64);
            let of_command = latencies.iter().map(|&l| [halves[0] + l, halves[1]]);
            let of_state = latencies.iter().map(|&l| [halves[0], halves[1] - l]);
            let mut least = vec![f64::INFINITY; problem.law_joints.len()];
            for offsets in of_command.chain(of_state) {
                let losses = known
                    .entry(offsets)
                    .or_insert_with(|| losses(problem, &some, offsets.map(|h| 0.5 * h as f64 * tick)));
                let cost = if offsets == halves { 1.0 } else { LATENCY_COSTS };
                least.iter_mut().zip(losses).for_each(|(least, loss)| *least = least.min(cost * *loss));
            }
            let loss: f64 = least.iter().filter(|x| x.is_finite()).sum();
            // The first of equals: none where there is nothing to tell them apart.
            if best.is_none_or(|(least, _)| loss < 0.98 * least) {
                best = Some((loss, Alignment { command: command * tick, state: state * tick }));
            }
        }
    }
    best.map_or_else(Alignment::default, |(_, alignment)| alignment)
}

/// Sum of squares that the law of each joint leaves at offsets of commands and states \[s\], without latencies of its own.
fn losses(problem: &Problem, windows: &[&Window], [command, state]: [f64; 2]) -> Vec<f64> {
    let of_joint = |&joint: &usize| {
        let law = Law { latency: 0.0, seen_late: 0.0, ..Law::new(problem, &Setting::new(), joint) };
        let of_window = |w: &&Window| -> f64 {
            of_joint(problem, w, &law, Alignment { command, state }).iter().map(|x| x * x).sum()
        };
        windows.iter().map(of_window).filter(|x| x.is_finite()).sum()
    };
    problem.law_joints.par_iter().map(of_joint).collect()
}

/// Measured minus expected torque in each bin, one joint after the other, shape `[law joints, bins]` \[N m\].
pub fn residual(problem: &Problem, window: &Window, setting: &Setting, alignment: Alignment) -> Vec<f64> {
    let of = |&j: &usize| of_joint(problem, window, &Law::new(problem, setting, j), alignment);
    problem.law_joints.iter().flat_map(of).collect()
}

/// Whether a setting changes the law of a joint.
pub fn concerns(problem: &Problem, setting: &Setting, joint: usize) -> bool {
    let name = &problem.model.joint_names()[joint];
    let about = |id: usize| {
        let (of, rest) = problem.catalogue[id].name.split_once('.').unwrap_or(("", ""));
        let field = rest.strip_prefix(name.as_str()).and_then(|f| f.strip_prefix('.'));
        match (of, field) {
            ("actuator", Some(_)) => true,
            ("sensor", Some(field)) => field != "encoder_bias",
            _ => false,
        }
    };
    setting.iter().any(|s| about(s.0))
}

/// [`residual`] of one joint, shape `[bins]`.
pub fn of_joint(problem: &Problem, window: &Window, law: &Law, alignment: Alignment) -> Vec<f64> {
    let (count, column) = (bins(problem), problem.columns[law.joint]);
    let nothing = || vec![f64::NAN; count];
    let Some(channels) = Channels::new(&window.view, column) else { return nothing() };
    let Some(torque) = window.view.measured.torque.as_ref() else { return nothing() };
    let (mut sums, mut counts) = (vec![0.0; count], vec![0usize; count]);
    let mut filter = Lag { time_constant: law.lag, state: None };
    let mut motor = None;
    // Lags of up to a few time constants before the window matter, and on which side of its play the motor was.
    let past = if law.play > 0.0 { problem.cut.margin } else { 5.0 * law.lag };
    let first = torque.time.partition_point(|&t| t < window.start - past);
    for i in first..torque.len() {
        let t = torque.time[i];
        if t > window.start + problem.cut.window {
            break;
        }
        let lagged = filter.next(t, law.demand(&channels, t, alignment, &mut motor));
        let expected = law.torque_scale * law.limited(&channels, t - alignment.state, lagged);
        let bin = (t - window.start) / BIN;
        let measured = torque.values[i * torque.joints + column];
        if bin >= 0.0 && (bin as usize) < count && measured.is_finite() {
            sums[bin as usize] += measured - expected;
            counts[bin as usize] += 1;
        }
    }
    // A bin without a sample of its own, in a slow recording, has nothing to say.
    sums.iter().zip(counts).map(|(s, n)| if n == 0 { 0.0 } else { s / n as f64 }).collect()
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
                y + (input - y) * (1.0 - (-(time - before) / self.time_constant).exp())
            }
            _ => input,
        };
        self.state = Some((time, output));
        output
    }
}
