//! `calibrated.toml`: the corrections as the parameter file that a replay takes.

use crate::problem::library::{Effect, built_in};
use crate::report::{Cause, Correction, Report};
use std::fmt::Write;

/// The corrections of a report as TOML text: numbers under their parameter names in a table `parameters`, each with its
/// value before, unit and cause in a comment. `qv_rollout::parameters_from_toml` reads it back bit by bit.
/// Corrections that are not finite are named in a comment and left out.
pub fn to_toml(report: &Report) -> String {
    let library = built_in();
    let mut text = String::from("# Parameters of the simulator as a diagnosis of a recording corrects them.\n");
    let _ = writeln!(text, "# {}", one_line(&report.sentence));
    if report.corrections.is_empty() {
        text += "# There is nothing to correct.\n";
    }
    if !report.corrections_apply {
        let _ = writeln!(
            text,
            "# A finding, not a correction: in windows that no fit has seen the loss is {:.2} with it and {:.2} without.",
            report.gap.after, report.gap.before
        );
    }
    text += "\n[parameters]\n";
    for (i, c) in report.corrections.iter().enumerate() {
        // TOML takes no key twice; of two corrections of one parameter the later holds.
        let again = report.corrections[i + 1..].iter().any(|later| later.parameter == c.parameter);
        let cause = cause_of(c, &report.causes, &library).map_or(String::new(), |e| format!(", {e}"));
        let unit = if c.unit == "1" { "" } else { c.unit.as_str() };
        let nominal = format!("{} {unit}", c.nominal);
        let comment = format!("was {}{cause}", nominal.trim_end());
        if again || !c.value.is_finite() {
            let why = if again { "corrected again below" } else { "not a finite value" };
            let _ = writeln!(text, "# {} = {}: {why}", one_line(&c.parameter), c.value);
        } else {
            let applied = if report.corrections_apply { "" } else { "# " };
            let _ = writeln!(text, "{applied}{} = {:?} # {}", quoted(&c.parameter), c.value, one_line(&comment));
        }
    }
    text
}

/// The accused effect that moves a parameter: the one that states a value under this name, or whose entry in the library
/// moves a parameter of this name. A rectangle's edges and a push's times go with what is found in them.
pub(super) fn cause_of<'a>(correction: &Correction, causes: &'a [Cause], library: &[Effect]) -> Option<&'a str> {
    let parameter = correction.parameter.as_str();
    let found = |name: &str| causes.iter().find(|c| moves(c, name, library) && acts_on(c, parameter));
    let leaders: &[&str] = match parameter {
        p if p.starts_with("terrain.patch.") => &["terrain.patch.friction"],
        p if p.starts_with("external.") => {
            &["external.force_x", "external.force_y", "external.force_z", "external_torque"]
        }
        _ => &[],
    };
    let cause = found(parameter).or_else(|| leaders.iter().find_map(|name| found(name)))?;
    Some(&cause.effect)
}

fn moves(cause: &Cause, parameter: &str, library: &[Effect]) -> bool {
    let last_word = |name: &str| name.rsplit('.').next().map(str::to_owned);
    let field = last_word(parameter);
    let axes = library.iter().filter(|e| e.name == cause.effect).flat_map(|e| &e.axes);
    cause.parameters.iter().any(|p| last_word(&p.name) == field)
        || axes.flat_map(|a| a.moves.keys()).any(|name| last_word(name) == field)
}

/// Whether the scope of a cause holds a parameter. A leg's name is the start of the names of its joints and links.
fn acts_on(cause: &Cause, parameter: &str) -> bool {
    let in_scope = |s: &String| s == "all" || parameter.contains(s.as_str());
    let of_a_part = ["joint.", "actuator.", "link.", "geom.", "material."].iter().any(|p| parameter.starts_with(p));
    cause.scope.is_empty() || !of_a_part || cause.scope.iter().any(in_scope)
}

/// A TOML basic string.
fn quoted(text: &str) -> String {
    let mut out = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => out.extend(['\\', c]),
            c if c.is_control() => {
                let _ = write!(out, "\\u{:04X}", u32::from(c));
            }
            c => out.push(c),
        }
    }
    out + "\""
}

/// Text that stays within a comment.
pub(super) fn one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cause(effect: &str, scope: &[&str], parameter: &str) -> Cause {
        Cause {
            effect: effect.into(),
            score: 0.9,
            scope: scope.iter().map(|s| (*s).to_string()).collect(),
            parameters: vec![crate::report::ParameterEstimate {
                name: parameter.into(),
                value: 1.0,
                ci95: [0.0, 2.0],
                unit: "1".into(),
            }],
            closed_alone: 0.5,
            confusable_with: Vec::new(),
            separating_experiment: String::new(),
            by_recording: Vec::new(),
        }
    }

    #[test]
    fn causes_are_found_by_what_they_move() {
        let causes = [
            cause("joint_coulomb_friction", &["FL"], "coulomb_friction"),
            cause("torque_speed_limit", &["all"], "speed_knee"),
            cause("my_own", &["RR_calf_joint"], "lag"),
            cause("ground_friction", &["patch 1"], "friction"),
            cause("external_force", &[], "force_y"),
        ];
        let library = built_in();
        let of = |parameter: &str| {
            let c = Correction { parameter: parameter.into(), value: 1.0, nominal: 0.0, unit: "1".into() };
            cause_of(&c, &causes, &library)
        };
        assert_eq!(of("joint.FL_hip_joint.coulomb_friction"), Some("joint_coulomb_friction"));
        assert_eq!(of("joint.FR_hip_joint.coulomb_friction"), None);
        assert_eq!(of("actuator.FR_hip_joint.speed_zero"), Some("torque_speed_limit"));
        assert_eq!(of("actuator.RR_calf_joint.lag"), Some("my_own"));
        assert_eq!(of("actuator.RL_calf_joint.lag"), None);
        assert_eq!(of("terrain.patch.y_max"), Some("ground_friction"));
        assert_eq!(of("external.duration"), Some("external_force"));
        assert_eq!(of("terrain.height"), None);
    }

    #[test]
    fn keys_are_escaped() {
        assert_eq!(quoted("a\"b\\c\n"), "\"a\\\"b\\\\c\\u000A\"");
    }
}
