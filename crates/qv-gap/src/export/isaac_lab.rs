//! The corrections as actuators for Isaac Lab: Python that a robot's configuration can import.

use super::advice::advice;
use super::calibrated::one_line;
use super::corrected::{CorrectionTarget, Entry, ModelCorrections, short};
use crate::report::Correction;
use qv_sim::Model;
use std::fmt::Write;

/// Actuators of `model` with the corrections, as Python text that defines `PHYSICS_DT` and `ACTUATORS` (Isaac Lab 2.3; 3.0
/// takes the same names). Joints of equal values share a group. What an actuator of Isaac Lab cannot say is a comment.
///
/// `kp` \[N m/rad\] and `kd` \[N m s/rad\] are the gains of the recording, shape `[joints]` in the model's order; empty when they
/// are not known: then stiffness and damping stay those of the robot's asset. `physics_dt` \[s\], positive, is the step that
/// delays are counted in.
pub fn to_isaac_lab(model: &Model, corrections: &[Correction], kp: &[f64], kd: &[f64], physics_dt: f64) -> String {
    let corrected = ModelCorrections::new(model, corrections);
    let gains = |j: usize| Some((*kp.get(j)?, *kd.get(j)?));
    let actuators: Vec<Actuator> =
        (0..model.joints.len()).map(|j| Actuator::new(&corrected, j, gains(j), physics_dt)).collect();
    let groups = grouped(&actuators);
    let mut text = header(&corrected, &actuators, physics_dt);
    text += "ACTUATORS = {\n";
    for (joints, name) in groups.iter().zip(names(model, &groups)) {
        text += &group(&corrected, &actuators[joints[0]], joints, &name);
    }
    text += "}\n";
    let lines = advice(&corrected, |e| is_said(e, &actuators, gains));
    if !lines.is_empty() {
        text += "\n# Not in the actuators above; the environment, or an actuator class of your own, can do it:\n";
        for line in lines {
            let _ = writeln!(text, "# - {}", one_line(&line));
        }
    }
    text
}

/// What Isaac Lab calls it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Class {
    Implicit,
    DcMotor,
    DelayedPd,
}

impl Class {
    fn name(self) -> &'static str {
        match self {
            Self::Implicit => "ImplicitActuatorCfg",
            Self::DcMotor => "DCMotorCfg",
            Self::DelayedPd => "DelayedPDActuatorCfg",
        }
    }
}

/// One joint's actuator; what is `None` stays as the robot's asset has it.
#[derive(Debug, Clone, PartialEq)]
struct Actuator {
    class: Class,
    stiffness: Option<f64>,
    damping: Option<f64>,
    armature: Option<f64>,
    coulomb: Option<f64>,
    viscous: Option<f64>,
    effort: Option<f64>,
    /// Of a DC motor: where its torque is zero.
    velocity: Option<f64>,
    /// Torque of a DC motor at rest, were it not limited.
    saturation: Option<f64>,
    /// Least and most steps of delay.
    delay: Option<(u32, u32)>,
}

impl Actuator {
    fn new(corrected: &ModelCorrections, j: usize, gains: Option<(f64, f64)>, physics_dt: f64) -> Self {
        let joint = &corrected.model.joints[j];
        let scale = |field: &str| corrected.joint(j, field).unwrap_or(1.0);
        let stated = |x: f64| Some(x).filter(|x| x.is_finite()).map(short);
        // A property that neither URDF nor diagnosis knows is left to the asset.
        let property =
            |field: &str, nominal: f64| corrected.joint(j, field).or(Some(nominal).filter(|x| *x != 0.0)).map(short);
        let latency = corrected.joint(j, "command_latency").filter(|x| *x > 0.0);
        let curve = dc_curve(corrected, j);
        let class = match (latency, curve) {
            (Some(_), _) => Class::DelayedPd,
            (None, Some(_)) => Class::DcMotor,
            (None, None) => Class::Implicit,
        };
        let curve = curve.filter(|_| class == Class::DcMotor);
        Self {
            class,
            stiffness: gains.map(|(kp, _)| short(kp * scale("kp_scale") * scale("strength"))),
            damping: gains.map(|(_, kd)| short(kd * scale("kd_scale") * scale("strength"))),
            armature: property("armature", joint.armature),
            coulomb: property("coulomb_friction", joint.coulomb_friction),
            viscous: property("viscous_friction", joint.viscous_friction),
            effort: stated(corrected.joint(j, "torque_limit").unwrap_or(joint.effort)),
            velocity: curve.map(|(_, zero)| short(zero)).or(stated(joint.velocity)),
            saturation: curve.map(|(saturation, _)| short(saturation)),
            delay: latency.map(|latency| steps(latency / physics_dt)),
        }
    }

    /// Keyword arguments after the joints' names.
    fn arguments(&self) -> Vec<(&'static str, String)> {
        let or_none = |x: Option<f64>| x.map_or("None".into(), |x| x.to_string());
        let implicit = self.class == Class::Implicit;
        let mut all = vec![("stiffness", or_none(self.stiffness)), ("damping", or_none(self.damping))];
        let mut push = |name, value: Option<f64>| all.extend(value.map(|v| (name, v.to_string())));
        push("armature", self.armature);
        push("friction", self.coulomb);
        push("dynamic_friction", self.coulomb);
        push("viscous_friction", self.viscous);
        push(if implicit { "effort_limit_sim" } else { "effort_limit" }, self.effort);
        push(if implicit { "velocity_limit_sim" } else { "velocity_limit" }, self.velocity);
        push("saturation_effort", self.saturation);
        if let Some((least, most)) = self.delay {
            all.push(("min_delay", least.to_string()));
            all.push(("max_delay", most.to_string()));
        }
        all
    }
}

/// Torque at rest and speed without torque of the line through the knee (all of the torque) and its zero; only where the
/// diagnosis found one and a limit is known.
fn dc_curve(corrected: &ModelCorrections, j: usize) -> Option<(f64, f64)> {
    let joint = &corrected.model.joints[j];
    let (knee, zero) = (corrected.joint(j, "speed_knee"), corrected.joint(j, "speed_zero"));
    if knee.is_none() && zero.is_none() {
        return None;
    }
    let knee = knee.unwrap_or(joint.velocity);
    let zero = zero.unwrap_or(1.1 * joint.velocity);
    let effort = corrected.joint(j, "torque_limit").unwrap_or(joint.effort);
    let known = effort.is_finite() && zero.is_finite() && zero > knee && knee >= 0.0;
    known.then(|| (effort * zero / (zero - knee), zero))
}

/// Whole steps on both sides of a delay, or the one that it is close to.
fn steps(delay: f64) -> (u32, u32) {
    let near = delay.round();
    if (delay - near).abs() <= 0.1 { (near as u32, near as u32) } else { (delay.floor() as u32, delay.ceil() as u32) }
}

/// Joints of equal actuators, in the model's order.
fn grouped(actuators: &[Actuator]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (j, actuator) in actuators.iter().enumerate() {
        match groups.iter_mut().find(|g| actuators[g[0]] == *actuator) {
            Some(group) => group.push(j),
            None => groups.push(vec![j]),
        }
    }
    groups
}

/// A name for each group: what the names of its joints end in, or the one joint's, numbered where that says nothing.
fn names(model: &Model, groups: &[Vec<usize>]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for group in groups {
        let of = |j: usize| model.joints[j].name.as_str();
        let ending = group[1..].iter().fold(of(group[0]), |ending, &j| {
            let same = ending.chars().rev().zip(of(j).chars().rev()).take_while(|(a, b)| a == b);
            &ending[ending.len() - same.map(|(a, _)| a.len_utf8()).sum::<usize>()..]
        });
        let wanted = if groups.len() == 1 { "all" } else { ending.trim_matches(['_', '-', '.', ' ']) };
        let wanted = if wanted.is_empty() || wanted == "joint" { "joints" } else { wanted };
        let numbered = (2..).map(|k| format!("{wanted} {k}"));
        let free = std::iter::once(wanted.to_owned()).chain(numbered).find(|name| !names.contains(name));
        names.extend(free);
    }
    names
}

fn header(corrected: &ModelCorrections, actuators: &[Actuator], physics_dt: f64) -> String {
    let mut text = String::from(
        "\"\"\"Actuators for Isaac Lab (2.3) as a diagnosis of a recording corrects them.\n\n\
         ArticulationCfg(..., actuators=ACTUATORS). Friction is in N m, as from Isaac Sim 5 on; None stays as in the asset.\n\
         \"\"\"\n\n",
    );
    let mut classes: Vec<&str> = actuators.iter().map(|a| a.class.name()).collect();
    classes.sort_unstable();
    classes.dedup();
    if !classes.is_empty() {
        let _ = writeln!(text, "from isaaclab.actuators import {}\n", classes.join(", "));
    }
    if corrected.entries.is_empty() {
        text += "# The diagnosis corrects nothing: these are the gains of the recording and the limits of the model.\n";
    }
    let _ = writeln!(text, "# Physics step that delays are counted in [s]; SimulationCfg.dt has to be the same.");
    let _ = writeln!(text, "PHYSICS_DT = {physics_dt}\n");
    text
}

fn group(corrected: &ModelCorrections, actuator: &Actuator, joints: &[usize], name: &str) -> String {
    let expressions: Vec<String> =
        joints.iter().map(|&j| quoted(&expression(&corrected.model.joints[j].name))).collect();
    let mut text = format!("    {}: {}(\n", quoted(name), actuator.class.name());
    let _ = writeln!(text, "        joint_names_expr=[{}],", expressions.join(", "));
    let latency = latency_comment(corrected, joints);
    for (key, value) in actuator.arguments() {
        let comment = if key == "max_delay" { latency.as_str() } else { "" };
        let _ = writeln!(text, "        {key}={value},{comment}");
    }
    text + "    ),\n"
}

/// The delays that the steps stand for.
fn latency_comment(corrected: &ModelCorrections, joints: &[usize]) -> String {
    let found: Vec<f64> = joints.iter().filter_map(|&j| corrected.joint(j, "command_latency")).collect();
    let (low, high) = found.iter().fold((f64::INFINITY, 0.0f64), |(l, h), x| (l.min(*x), h.max(*x)));
    let [low, high] = [low, high].map(|x| format!("{:.1}", 1e3 * x));
    if low == high { format!("  # {low} ms") } else { format!("  # {low} to {high} ms") }
}

/// Whether the actuators say a correction.
fn is_said(entry: &Entry, actuators: &[Actuator], gains: impl Fn(usize) -> Option<(f64, f64)>) -> bool {
    let CorrectionTarget::Joint(j) = entry.part else { return false };
    let drives = gains(j).is_some_and(|(kp, kd)| kp != 0.0 || kd != 0.0);
    match entry.field {
        "armature" | "coulomb_friction" | "viscous_friction" | "torque_limit" => true,
        "strength" | "kp_scale" | "kd_scale" => drives,
        "speed_knee" | "speed_zero" => actuators[j].class == Class::DcMotor,
        "command_latency" => true,
        _ => false,
    }
}

/// A regular expression that only this name matches.
fn expression(name: &str) -> String {
    let mut out = String::new();
    for c in name.chars() {
        if ".^$*+?{}[]\\|()".contains(c) {
            out.push('\\');
        }
        out.push(c);
    }
    out
}

/// A Python string.
fn quoted(text: &str) -> String {
    let mut out = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => out.extend(['\\', c]),
            c if c.is_control() => {
                let _ = write!(out, "\\u{:04x}", u32::from(c));
            }
            c => out.push(c),
        }
    }
    out + "\""
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn delays_lie_between_whole_steps() {
        assert_eq!(steps(2.0), (2, 2));
        assert_eq!(steps(1.95), (2, 2));
        assert_eq!(steps(2.4), (2, 3));
        assert_eq!(steps(0.3), (0, 1));
        assert_eq!(steps(0.04), (0, 0));
    }

    #[test]
    fn names_are_matched_and_quoted_literally() {
        assert_eq!(quoted(&expression("a.b[0]")), "\"a\\\\.b\\\\[0\\\\]\"");
        assert_eq!(quoted("a\"\n"), "\"a\\\"\\u000a\"");
    }
}
