//! What recorded torques show of the commands: whose they are, their sign, unit, offset, gains and stamps.

use super::analysis::{Analysis, Check, Finding, cycles, number};
use super::law::{Law, Pairing, fit, free_unit};
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
/// Share of the torque's variance up to which the law holds without doubt, and up to which it is used.
const HOLDS: f64 = 0.02;
const USED: f64 = 0.3;
/// Share of what is left that another reading may leave.
const BETTER: f64 = 0.25;
/// Least offset of a command \[rad\], and in standard errors.
const LEAST_OFFSET: [f64; 2] = [0.04, 6.0];
const DEGREES: f64 = 180.0 / std::f64::consts::PI;

/// `None` where the torques do not follow the law of the motors well enough to tell.
pub(super) fn analyse(run: &Run) -> Option<Analysis> {
    let samples = Samples::of(run)?;
    let commands = run.commands.position.as_ref()?;
    let signed: Vec<bool> = (0..samples.joints).map(|j| has_both_signs(&samples, j)).collect();
    let delay = delay(&samples, commands, &signed);
    let at = samples.commands(commands, delay);
    let readings: Vec<Option<JointLaw>> =
        (0..samples.joints).map(|j| signed[j].then(|| joint_law(&samples, &at, j))?).collect();
    let mut laws = readings;
    exchange(&samples, &at, &mut laws);
    if laws.iter().flatten().filter(|l| l.law.left < USED).count() * 2 <= samples.joints {
        return None;
    }
    let mut found = Found::new(run, &samples, laws);
    found.feed_forward(&at);
    found.joints();
    found.shape(commands, delay);
    found.delay(commands, delay);
    found.gains();
    Some(found.into_analysis(delay))
}

/// A torque that never changes its sign is a magnitude, or a load that tells nothing.
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
    /// What its commands leave as they were logged.
    plain: f64,
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

fn joint_law(s: &Samples, at: &[f64], joint: usize) -> Option<JointLaw> {
    let own = Pairing::own(joint);
    let law = fit(s, at, own, 1.0)?;
    let plain = JointLaw { pairing: own, law, plain: law.left };
    if law.left < HOLDS {
        return Some(plain);
    }
    let units = [-1.0, 1.0 / DEGREES, -1.0 / DEGREES, DEGREES, 1e-3, 1e3].into_iter();
    let tried = |unit: f64| {
        let pairing = Pairing { unit, ..own };
        fit(s, at, pairing, 1.0).map(|law| JointLaw { pairing, law, plain: plain.law.left })
    };
    let best = units.filter_map(tried).min_by(|a, b| a.law.left.total_cmp(&b.law.left));
    let is_better = |l: &JointLaw| l.law.left < USED.min(BETTER * plain.law.left);
    // A factor that is no unit's must leave nothing to doubt.
    let free = free_unit(s, at, joint).filter(|u| !(0.6..1.6).contains(u)).and_then(tried);
    best.filter(is_better).or(free.filter(is_better)).or(Some(plain))
}

/// Joints that fit another joint's commands, positions or torques better than their own, in whole cycles.
fn exchange(s: &Samples, at: &[f64], laws: &mut [Option<JointLaw>]) {
    let few = s.thinned(3);
    let few_at: Vec<f64> = at.chunks(s.joints).step_by(3).flatten().copied().collect();
    let doubtful: Vec<usize> =
        (0..s.joints).filter(|&j| laws[j].is_some_and(|l| l.law.left > HOLDS && l.pairing.unit == 1.0)).collect();
    if doubtful.len() < 2 {
        return;
    }
    // Commands of another, positions of another, both of another.
    for kind in 0..3 {
        let pairing = |joint: usize, other: usize| Pairing {
            command: if kind == 1 { joint } else { other },
            position: if kind == 0 { joint } else { other },
            torque: joint,
            unit: 1.0,
        };
        let best = |joint: usize| {
            let others = doubtful.iter().filter(|other| **other != joint);
            let fits = others.filter_map(|&other| {
                let law = fit(&few, &few_at, pairing(joint, other), 1.0)?;
                Some((other, law)).filter(|(_, l)| l.stiffness > 0.0)
            });
            let (other, law) = fits.min_by(|a, b| a.1.left.total_cmp(&b.1.left))?;
            (law.left < USED.min(BETTER * laws[joint]?.law.left)).then_some(other)
        };
        let follows: Vec<Option<usize>> =
            (0..s.joints).map(|j| doubtful.contains(&j).then(|| best(j)).flatten()).collect();
        for joint in cycles(follows).into_iter().enumerate().filter_map(|(j, other)| other.map(|o| (j, o))) {
            let pairing = pairing(joint.0, joint.1);
            if let (Some(law), Some(before)) = (fit(s, at, pairing, 1.0), laws[joint.0]) {
                laws[joint.0] = Some(JointLaw { pairing, law, plain: before.plain });
            }
        }
    }
}

struct Found<'a> {
    run: &'a Run,
    samples: &'a Samples,
    laws: Vec<Option<JointLaw>>,
    findings: Vec<Finding>,
    reading: CommandReading,
}

impl<'a> Found<'a> {
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
        let Law { offset, offset_error, .. } = found.law;
        let [least, errors] = LEAST_OFFSET;
        let is_clear = offset.abs() > least && offset.abs() > errors * offset_error;
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
        let of = |f: fn(&Law) -> f64| holding.iter().map(|(_, l)| f(&l.law)).collect::<Vec<f64>>();
        let (mut stiffness, mut damping) = (of(|l| l.stiffness), of(|l| l.damping));
        let spread = spread(&stiffness);
        let (kp, kd) = (median(&mut stiffness), median(&mut damping));
        let logs_damping = self.samples.kd.iter().any(|kd| *kd > 0.0);
        let near = |x: f64, y: f64| (x / y).ln().abs() < 0.25;
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
        } else if kp > 1.35 && spread < 1.1 && logs_damping && near(kd, kp) && holding.len() > 1 {
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
    fn shape(&mut self, commands: &JointSeries, delay: f64) {
        let is_plain =
            self.laws.iter().flatten().all(|l| l.pairing.unit == 1.0 && l.pairing.command == l.pairing.torque);
        let mut left_now: Vec<f64> = self.laws.iter().flatten().map(|l| l.law.left).collect();
        if !is_plain || left_now.is_empty() || median(&mut left_now) < 0.004 {
            return;
        }
        let few = self.samples.thinned(4);
        let forward = if self.reading.uses_feed_forward { 1.0 } else { 0.0 };
        let mean = |commands: &JointSeries, delay: f64| {
            let at = few.commands(commands, delay);
            let one = |j: usize| fit(&few, &at, Pairing::own(j), forward).map(|l| l.left.clamp(1e-4, 1.0).ln());
            let all: Vec<f64> = (0..few.joints).filter_map(one).collect();
            all.iter().sum::<f64>() / all.len().max(1) as f64
        };
        let tried = |shape: Shape| (mean(&shape.of(commands), 0.0), shape);
        let least = |all: Vec<(f64, Shape)>| all.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        let all = Shape::tried(fastest(commands)).into_iter().map(tried).collect();
        let Some(mut best) = least(all) else { return };
        for _ in 0..2 {
            best = least(best.1.around().into_iter().map(tried).chain([best]).collect()).unwrap_or(best);
        }
        let plain = mean(commands, delay).min(mean(commands, 0.0));
        if best.0 > plain + SHAPED.ln() {
            return;
        }
        self.reading.shape = Some(best.1);
        let what = format!("the motors follow them shaped by firmware: {}", best.1.words());
        self.report("commands", what, format!("[commands] {}", best.1.setting()));
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

/// Share of what commands leave as they were logged that shaped ones may leave.
const SHAPED: f64 = 0.4;

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
