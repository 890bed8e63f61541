//! What recorded torques show of the commands: whose they are, their sign, unit, offset, gains and stamps.

use super::analysis::{Analysis, Check, Finding, cycles, number};
use super::law::{Law, Pairing, USED, fit, free_unit, judge};
use super::reading::CommandReading;
use super::samples::Samples;
use super::shape::Shape;
use crate::run::Run;
use qv_core::JointSeries;
use qv_core::statistics::median;

/// Delays that are tried \[s\].
const DELAYS: std::ops::RangeInclusive<i32> = -45..=60;
/// Torques follow a command at once: what acts this much before its stamp was stamped late \[s\].
const LATE: f64 = -0.004;
/// Cost of a law up to which it holds without doubt.
const HOLDS: f64 = 0.02;
/// Share of what is left that another reading may leave.
const BETTER: f64 = 0.25;
/// Least offset of a command \[rad\], and in standard errors.
const LEAST_OFFSET: [f64; 2] = [0.04, 6.0];
const DEGREES: f64 = 180.0 / std::f64::consts::PI;

/// `None` where the torques do not follow the law of the motors well enough.
pub(super) fn analyse(run: &Run) -> Option<Analysis> {
    let samples = Samples::of(run)?;
    let commands = run.commands.position.as_ref()?;
    let signed: Vec<bool> = (0..samples.joints).map(|j| has_both_signs(&samples, j)).collect();
    let delay = delay(&samples, commands, &signed);
    let shape = shape(run, &samples, delay, &signed);
    let shaped = shape.map(|shape| shape.of(commands));
    let at = samples.commands(shaped.as_ref().unwrap_or(commands), if shape.is_some() { 0.0 } else { delay });
    let usual = usual(&samples, &at, &signed);
    let mut laws: Vec<Option<JointLaw>> = (0..samples.joints)
        .map(|j| {
            signed[j].then(|| judge(&samples, &at, Pairing::own(j), 1.0, usual)).flatten().map(|l| JointLaw::own(j, l))
        })
        .collect();
    exchange(&samples, &at, usual, &mut laws);
    for joint in 0..samples.joints {
        laws[joint] = laws[joint].map(|own| of_unit(&samples, &at, joint, own, usual));
    }
    if laws.iter().flatten().filter(|l| l.law.left < USED).count() * 2 <= samples.joints {
        return None;
    }
    let mut found = CommandChannel::new(run, &samples, laws);
    found.reading.shape = shape;
    found.shape();
    found.feed_forward(&at);
    found.joints();
    found.delay(commands, delay);
    found.gains();
    Some(found.into_analysis(delay))
}

/// Factors on stiffness and damping that most joints have, where gains are stated.
fn usual(s: &Samples, at: &[f64], signed: &[bool]) -> Option<[f64; 2]> {
    let laws: Vec<Law> = (0..s.joints)
        .filter(|j| signed[*j] && s.states_gains)
        .filter_map(|j| fit(s, at, Pairing::own(j), 1.0).filter(|l| l.left < HOLDS))
        .collect();
    let middle = |f: fn(&Law) -> f64| median(&mut laws.iter().map(f).collect::<Vec<f64>>());
    (!laws.is_empty()).then(|| [middle(|l| l.stiffness), middle(|l| l.damping)])
}

/// A torque that never changes its sign is a magnitude, or a load that shows nothing.
fn has_both_signs(s: &Samples, joint: usize) -> bool {
    let all = || s.torque.iter().skip(joint).step_by(s.joints).filter(|x| x.is_finite());
    let largest = all().fold(0.0f64, |a, x| a.max(x.abs()));
    let least = all().fold(f64::INFINITY, |a, x| a.min(*x));
    let repeated = all().filter(|x| x.abs() < 0.02 * largest).count();
    // Gravity loads a joint one way; a magnitude bounces off zero.
    largest > 0.0 && (least < 0.0 || repeated == 0)
}

/// The reading of one joint's commands that fits its torques best.
#[derive(Debug, Clone, Copy)]
struct JointLaw {
    pairing: Pairing,
    law: Law,
}

impl JointLaw {
    fn own(joint: usize, law: Law) -> Self {
        Self { pairing: Pairing::own(joint), law }
    }
}

/// Mean of what is left of the torques, over joints, with any factor on the command.
fn left(s: &Samples, at: &[f64], signed: &[bool]) -> f64 {
    let one = |joint: usize| {
        let unit = free_unit(s, at, joint)?;
        fit(s, at, Pairing { unit, ..Pairing::own(joint) }, 1.0).map(|law| law.left.min(1.0))
    };
    let all: Vec<f64> = (0..s.joints).filter(|j| signed[*j]).filter_map(one).collect();
    // What fits at no delay says nothing of it.
    all.iter().map(|x| x.max(1e-4).ln()).sum::<f64>() / all.len().max(1) as f64
}

/// The delay of torques behind the stamps of their commands \[s\].
fn delay(s: &Samples, commands: &JointSeries, signed: &[bool]) -> f64 {
    let few = s.thinned(4);
    let of = |ms: i32| (left(&few, &few.commands(commands, 1e-3 * f64::from(ms)), signed), ms);
    let best = |all: Vec<(f64, i32)>| all.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).map_or(0, |(_, ms)| ms);
    let coarse = best(DELAYS.step_by(5).map(of).collect());
    let fine = best((coarse - 4..=coarse + 4).map(of).collect());
    // As good as at once is at once.
    let (at_once, there) = (of(0).0, of(fine).0);
    if there < at_once - 0.05 { 1e-3 * f64::from(fine) } else { 0.0 }
}

/// The reading of a joint's own commands in another unit or of the other sign, where it fits far better; else `own`.
fn of_unit(s: &Samples, at: &[f64], joint: usize, own: JointLaw, usual: Option<[f64; 2]>) -> JointLaw {
    let plain = Pairing::own(joint);
    if own.pairing != plain || own.law.cost() < HOLDS {
        return own;
    }
    let tried = |unit: f64| {
        let pairing = Pairing { unit, ..plain };
        judge(s, at, pairing, 1.0, usual).map(|law| JointLaw { pairing, law })
    };
    // What leaves the command out is no reading of it, unless it stands still.
    let none = tried(0.0).map_or(f64::INFINITY, |l| l.law.cost());
    let most = USED.min(BETTER * own.law.cost()).min(0.5 * none);
    let is_better = |l: &JointLaw| l.law.cost() < most && l.law.left < USED;
    let units = [-1.0, 1.0 / DEGREES, -1.0 / DEGREES, DEGREES, 1e-3, 1e3].into_iter();
    let best = units.filter_map(tried).min_by(|a, b| a.law.cost().total_cmp(&b.law.cost()));
    // A factor that is no unit's must leave nothing to doubt.
    let free = free_unit(s, at, joint).filter(|u| !(0.6..1.6).contains(u)).and_then(tried);
    best.filter(is_better).or(free.filter(|l| is_better(l) && l.law.cost() < HOLDS)).unwrap_or(own)
}

/// Joints that fit another joint's commands, positions or torques better than their own, in whole cycles.
fn exchange(s: &Samples, at: &[f64], usual: Option<[f64; 2]>, laws: &mut [Option<JointLaw>]) {
    let few = s.thinned(3);
    let few_at: Vec<f64> = at.chunks(s.joints).step_by(3).flatten().copied().collect();
    let doubtful: Vec<usize> = (0..s.joints).filter(|&j| laws[j].is_some_and(|l| l.law.cost() > HOLDS)).collect();
    if doubtful.len() < 2 {
        return;
    }
    // Commands of another, positions of another, both of another.
    for kind in 0..3 {
        let is_open = |joint: usize| laws[joint].is_some_and(|l| l.pairing == Pairing::own(joint));
        let pairing = |joint: usize, other: usize| Pairing {
            command: if kind == 1 { joint } else { other },
            position: if kind == 0 { joint } else { other },
            torque: joint,
            unit: 1.0,
        };
        let best = |joint: usize| {
            let others = doubtful.iter().filter(|other| **other != joint);
            let fits = others.filter_map(|&other| {
                let law = judge(&few, &few_at, pairing(joint, other), 1.0, usual)?;
                Some((other, law)).filter(|(_, l)| l.stiffness > 0.0)
            });
            let (other, law) = fits.min_by(|a, b| a.1.cost().total_cmp(&b.1.cost()))?;
            (law.cost() < USED.min(BETTER * laws[joint]?.law.cost())).then_some(other)
        };
        let follows: Vec<Option<usize>> =
            (0..s.joints).map(|j| (doubtful.contains(&j) && is_open(j)).then(|| best(j)).flatten()).collect();
        for joint in cycles(follows).into_iter().enumerate().filter_map(|(j, other)| other.map(|o| (j, o))) {
            let pairing = pairing(joint.0, joint.1);
            if let Some(law) = judge(s, at, pairing, 1.0, usual) {
                laws[joint.0] = Some(JointLaw { pairing, law });
            }
        }
    }
}

struct CommandChannel<'a> {
    run: &'a Run,
    samples: &'a Samples,
    laws: Vec<Option<JointLaw>>,
    findings: Vec<Finding>,
    reading: CommandReading,
}

impl<'a> CommandChannel<'a> {
    fn new(run: &'a Run, samples: &'a Samples, laws: Vec<Option<JointLaw>>) -> Self {
        let reading = CommandReading::plain(samples.joints);
        Self { run, samples, laws, findings: Vec::new(), reading }
    }

    fn report(&mut self, channel: &str, what: String, line: String) {
        self.findings.push(Finding { channel: channel.into(), what, line });
    }

    /// Laws that hold, with their joints.
    fn holding(&self) -> Vec<(usize, JointLaw)> {
        let all = self.laws.iter().enumerate().filter_map(|(j, l)| Some((j, (*l)?)));
        all.filter(|(_, l)| l.law.left < USED).collect()
    }

    /// Order, unit and offset of each joint.
    fn joints(&mut self) {
        for (joint, found) in self.holding() {
            let name = self.run.joint_names[joint].clone();
            let channel = format!("commands {name}");
            let Pairing { command, position, unit, .. } = found.pairing;
            let other = |k: usize| self.run.joint_names[k].clone();
            match (command != joint, position != joint) {
                (true, false) => {
                    let other = other(command);
                    self.reading.joints[joint].of = command;
                    let what =
                        format!("the joint follows the commands of {other}: exchanged columns or names of joints");
                    self.report(&channel, what, format!("[joint.{name}] command_of = \"{other}\""));
                }
                (false, true) => {
                    let what = format!(
                        "its motor follows the positions of {}: exchanged columns or names of joints in the positions",
                        other(position)
                    );
                    self.report(&channel, what, String::new());
                }
                (true, true) => {
                    let what = format!(
                        "its torque is that of {}: exchanged columns or names of joints in the torques",
                        other(command)
                    );
                    self.report(&channel, what, String::new());
                }
                (false, false) if unit != 1.0 => self.unit(joint, found),
                _ => {}
            }
            self.offset(joint, found);
        }
    }

    fn unit(&mut self, joint: usize, found: JointLaw) {
        let name = self.run.joint_names[joint].clone();
        let unit = found.pairing.unit;
        if unit == -1.0 && found.law.stiffness < 0.0 {
            let what = "its positions have the other sign than its commands and torques".to_string();
            return self.report(&format!("commands {name}"), what, String::new());
        }
        let factor = 1.0 / unit;
        let word = if (unit.abs() * DEGREES - 1.0).abs() < 1e-9 {
            ": degrees"
        } else if unit == -1.0 {
            ": the sign is turned"
        } else if (unit - DEGREES).abs() < 1e-9 {
            ": the positions are in degrees"
        } else {
            ""
        };
        self.reading.joints[joint].scale = unit;
        let what = format!("they are {} times the positions{word}", number(factor));
        self.report(&format!("commands {name}"), what, format!("[joint.{name}] command_scale = {}", number(unit)));
    }

    fn offset(&mut self, joint: usize, found: JointLaw) {
        let Law { offset, offset_error, stated_offset, .. } = found.law;
        let [least, errors] = LEAST_OFFSET;
        // What firmware makes of commands that move is not all found.
        let is_sure = self.reading.shape.is_none() || found.law.left < HOLDS;
        let size = if offset * stated_offset > 0.0 { offset.abs().min(stated_offset.abs()) } else { 0.0 };
        let is_clear = is_sure && size > least && size > errors * offset_error;
        if !is_clear || found.pairing.position != joint {
            return;
        }
        let name = self.run.joint_names[joint].clone();
        self.reading.joints[joint].offset = offset;
        let what = format!(
            "they are off by a constant of {:.3} rad from those that the torques follow (± {:.3})",
            -offset,
            2.0 * offset_error
        );
        self.report(&format!("commands {name}"), what, format!("[joint.{name}] command_offset = {offset:.4}"));
    }

    /// Feed-forward torques that the motors do not follow.
    fn feed_forward(&mut self, at: &[f64]) {
        let s = self.samples;
        let moves = (0..s.joints).any(|j| deviation(s.forward.iter().skip(j).step_by(s.joints)) > 0.05);
        let with: f64 = self.laws.iter().flatten().map(|l| l.law.left).sum();
        let without: Vec<Option<Law>> = (0..s.joints).map(|j| fit(s, at, self.laws[j]?.pairing, 0.0)).collect();
        let without_sum: f64 = without.iter().flatten().map(|l| l.left).sum();
        if !moves || without_sum > BETTER * with {
            return;
        }
        for (own, without) in self.laws.iter_mut().zip(without) {
            if let (Some(own), Some(law)) = (own, without) {
                own.law = law;
            }
        }
        self.reading.uses_feed_forward = false;
        let what = "the motors do not follow the feed-forward torques".to_string();
        self.report("commands", what, "[commands] feed_forward = false".into());
    }

    fn delay(&mut self, commands: &JointSeries, delay: f64) {
        let period = crate::clean::median_interval(&commands.time);
        if delay > LATE.min(-0.6 * period) || self.reading.shape.is_some() {
            return;
        }
        self.reading.delay = delay;
        let what =
            format!("the torques follow them {:.0} ms before they are stamped: the stamps are late", -1e3 * delay);
        self.report("commands", what, format!("[commands] delay = {delay:.4}"));
    }

    /// Gains that are logged per degree, of a tenth, or not at all.
    fn gains(&mut self) {
        if !self.samples.states_gains {
            return;
        }
        let holding = self.holding();
        let sure: Vec<(usize, JointLaw)> = holding.iter().copied().filter(|(_, l)| l.law.left < HOLDS).collect();
        let holding = if sure.len() > 1 { sure } else { holding };
        let of = |f: fn(&Law) -> f64| holding.iter().map(|(_, l)| f(&l.law)).collect::<Vec<f64>>();
        let (mut stiffness, mut damping) = (of(|l| l.stiffness), of(|l| l.damping));
        let spread = spread(&stiffness);
        let (kp, kd) = (median(&mut stiffness), median(&mut damping));
        let logs_damping = self.samples.kd.iter().any(|kd| *kd > 0.0);
        let near = |x: f64, y: f64| (x / y).ln().abs() < 0.45;
        let factor = [DEGREES, 10.0, 0.1, 1.0 / DEGREES].into_iter().find(|f| near(kp, *f));
        if let Some(factor) = factor.filter(|_| spread < 1.3) {
            // Damping is found less well.
            let both = logs_damping && (kd / factor).ln().abs() < 0.7;
            self.reading.gain_scale = [factor, if both { factor } else { 1.0 }];
            let which = if both { "kp and kd" } else { "kp" };
            let word = if near(factor, DEGREES) { ", as gains per degree do" } else { "" };
            let what = format!("the torques are those of {} times the {which} that were logged{word}", number(factor));
            let keys = ["kp_scale", "kd_scale"].iter().take(if both { 2 } else { 1 });
            let keys: Vec<String> = keys.map(|k| format!("{k} = {}", number(factor))).collect();
            self.report("commands", what, format!("[commands] {}", keys.join(", ")));
        } else if kp > 1.35 && spread < 1.2 && logs_damping && near(kd, kp) && holding.len() > 1 {
            let what = format!(
                "torques of all joints are {kp:.3} times what gains and errors give: amperes, torque before or after a gear, or other gains \
                 than were logged"
            );
            self.report("torques", what, String::new());
        }
        let shows = |(j, l): &(usize, JointLaw)| {
            let speed = deviation(self.samples.velocity.iter().skip(*j).step_by(self.samples.joints));
            let torque = deviation(self.samples.torque.iter().skip(*j).step_by(self.samples.joints));
            let share = (l.law.damping * speed / torque).powi(2);
            l.law.damping > 0.0 && share > 0.003 && share > 2.0 * l.law.left
        };
        if !logs_damping && 2 * holding.iter().filter(|one| shows(one)).count() > holding.len() {
            self.reading.damping = Some(kd);
            let what = format!("kd was logged as 0, the torques are those of {kd:.3} N m s/rad");
            self.report("commands", what, format!("[commands] kd = {kd:.4}"));
        }
    }

    /// What firmware makes of the commands.
    fn shape(&mut self) {
        if let Some(shape) = self.reading.shape {
            let what = format!("the motors follow them shaped by firmware: {}", shape.words());
            self.report("commands", what, format!("[commands] {}", shape.setting()));
        }
    }

    fn into_analysis(self, delay: f64) -> Analysis {
        let checks = self.checks(delay);
        Analysis { findings: self.findings, checks, reading: self.reading }
    }

    fn checks(&self, delay: f64) -> Vec<Check> {
        let holding = self.holding();
        let range = |f: &dyn Fn(&JointLaw) -> f64, digits: usize| {
            let all = holding.iter().map(|(_, l)| f(l));
            let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
            format!("{low:.digits$} to {high:.digits$}")
        };
        let has = |words: &[&str]| self.findings.iter().any(|f| words.iter().any(|w| f.what.contains(w)));
        let check =
            |name: &str, found: String, words: &[&str]| Check { name: name.into(), found, is_ours: Some(!has(words)) };
        let gains = match self.samples.states_gains {
            true => format!(
                "torques are {} times kp, {} times kd",
                range(&|l| l.law.stiffness, 2),
                range(&|l| l.law.damping, 2)
            ),
            false => format!("not logged; kp {} N m/rad by the torques", range(&|l| l.law.stiffness, 1)),
        };
        let shape = self.reading.shape.map_or_else(|| "none".into(), Shape::words);
        vec![
            check(
                "order of commands",
                format!("by the torques of {} of {} joints", holding.len(), self.samples.joints),
                &["exchanged"],
            ),
            check(
                "sign and unit of commands",
                format!("factors {}", range(&|l| 1.0 / l.pairing.unit, 3)),
                &["times the positions", "other sign"],
            ),
            check("offsets of commands", format!("{} rad", range(&|l| -l.law.offset, 3)), &["by a constant"]),
            check("stamps of commands", format!("torques follow after {:.0} ms", 1e3 * delay), &["stamps are late"]),
            check("gains", gains, &["kp", "kd", "torques of all joints"]),
            check("shaping of commands by firmware", shape, &["shaped by firmware"]),
        ]
    }
}

/// Share of what commands leave as they were logged that shaped ones may leave, at the joints that show it best.
const SHAPED: f64 = 0.5;

/// What firmware makes of the commands, where the torques of a third of the joints show it.
fn shape(run: &Run, s: &Samples, delay: f64, signed: &[bool]) -> Option<Shape> {
    let commands = run.commands.position.as_ref()?;
    let few = s.thinned(3);
    let lefts = |few: &Samples, commands: &JointSeries, delay: f64| -> Vec<f64> {
        let at = few.commands(commands, delay);
        let one = |j: usize| fit(few, &at, Pairing::own(j), 1.0).map_or(0.0, |l| l.left.clamp(1e-5, 1.0).ln());
        (0..few.joints).map(|j| if signed[j] { one(j) } else { 0.0 }).collect()
    };
    let (at_once, late) = (lefts(&few, commands, 0.0), lefts(&few, commands, delay));
    let plain: Vec<f64> = at_once.iter().zip(&late).map(|(a, b)| a.min(*b)).collect();
    let best_third = |lefts: Vec<f64>| {
        let mut gains: Vec<f64> = lefts.iter().zip(&plain).map(|(a, b)| a - b).collect();
        gains.sort_by(f64::total_cmp);
        let third = gains.len().div_ceil(3);
        gains[..third].iter().sum::<f64>() / third as f64
    };
    let gain = |shape: Shape| (best_third(lefts(&few, &shape.of(commands), 0.0)), shape);
    let least = |all: Vec<(f64, Shape)>| all.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
    let mut best = least(Shape::tried(fastest(commands)).into_iter().map(gain).collect())?;
    if best.0 > 0.5 * SHAPED.ln() {
        return None;
    }
    for _ in 0..2 {
        best = least(best.1.around().into_iter().map(gain).chain([best]).collect())?;
    }
    // Torques that lag behind the whole law are an actuator's, unless the shape leaves far less.
    let lagging = |time: f64| {
        let shape = Shape::LowPass(time);
        let mut slow = run.clone();
        slow.measured.position = slow.measured.position.as_ref().map(|p| shape.of(p));
        slow.measured.velocity = slow.measured.velocity.as_ref().map(|v| shape.of(v));
        let samples = Samples::of(&slow)?.thinned(3);
        Some(best_third(lefts(&samples, &shape.of(commands), 0.0)))
    };
    let is_actuator = [0.5, 0.75, 1.0, 1.3]
        .iter()
        .filter_map(|by| lagging(by * best.1.time()?))
        .any(|left| left < best.0 - SHAPED.ln());
    (best.0 < SHAPED.ln() && !is_actuator).then_some(best.1)
}

fn spread(values: &[f64]) -> f64 {
    let (low, high) = values.iter().fold((f64::INFINITY, 0.0f64), |(l, h), x| (l.min(*x), h.max(*x)));
    if low > 0.0 { high / low } else { f64::INFINITY }
}

fn deviation<'a>(values: impl Iterator<Item = &'a f64>) -> f64 {
    let known: Vec<f64> = values.copied().filter(|x| x.is_finite()).collect();
    let mean = known.iter().sum::<f64>() / known.len().max(1) as f64;
    (known.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / known.len().max(1) as f64).sqrt()
}

/// Speed of commands that is hardly exceeded \[rad/s\].
fn fastest(commands: &JointSeries) -> f64 {
    let mut speeds = Vec::new();
    for i in (5..commands.len()).step_by(5) {
        let passed = commands.time[i] - commands.time[i - 5];
        let far = commands.row(i).iter().zip(commands.row(i - 5)).map(|(a, b)| (a - b).abs());
        speeds.push(far.filter(|x| x.is_finite()).fold(0.0, f64::max) / passed);
    }
    speeds.retain(|x| x.is_finite());
    speeds.sort_by(f64::total_cmp);
    speeds.get(95 * speeds.len() / 100).copied().unwrap_or(1.0)
}
