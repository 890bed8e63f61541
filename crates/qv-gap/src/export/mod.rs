//! What a diagnosis leaves behind: the report for programs and for people, and the corrections for the simulators that
//! robots are trained in.

mod advice;
mod calibrated;
mod corrected;
mod html;
mod isaac_lab;
mod mjcf;
mod urdf;
mod xml;

pub use calibrated::to_toml;
pub use html::{to_html, words};
pub use isaac_lab::to_isaac_lab;
pub use mjcf::to_mjcf;
pub use urdf::to_urdf;

use crate::report::{Correction, Report};
use qv_sim::{BaseKind, Model};
use std::fmt::Write;

/// Physics step that `isaac_lab_actuators.py` counts delays in \[s\]: the usual one of legged robots in Isaac Lab.
pub(crate) const ISAAC_LAB_DT: f64 = 0.005;

/// What a URDF lacks of a robot that is not bolted down.
const FREE_BASE: &str = "base: a URDF has no free base, so that a reader may fix it to the world. Load it with a floating base \
                         (MuJoCo: <freejoint/>; Isaac Lab: fix_root_link=False).";

/// Gains of a recording's motors, `[joints]` in the model's order: zero for motors that take torques, empty when they are not known.
#[derive(Debug, Clone, Copy, Default)]
pub struct Gains<'a> {
    /// \[N m/rad\]
    pub kp: &'a [f64],
    /// \[N m s/rad\]
    pub kd: &'a [f64],
}

/// All files of a diagnosis by name: `report.json`, `report.html`, `calibrated.toml`, `mjcf_fragment.xml`,
/// `isaac_lab_actuators.py`, and `robot_calibrated.urdf` when the URDF that `model` was read from is given.
/// Where MuJoCo would read nothing from a fragment, `mjcf_by_hand.txt` takes its place and names every correction.
///
/// `title` names the recording; `notes` are said under the verdict of the page.
/// A URDF that cannot be edited is left out, and so is an MJCF fragment that would change nothing; notes on the page say why. `sections` are for [`to_html`].
pub fn files(
    report: &Report,
    model: &Model,
    urdf_text: Option<&str>,
    title: &str,
    notes: &[String],
    sections: &[String],
    gains: Gains,
) -> Vec<(String, Vec<u8>)> {
    let Gains { kp, kd } = gains;
    let corrections: &[Correction] = if report.corrections_apply { &report.corrections } else { &[] };
    let mut notes = notes.to_vec();
    let urdf = urdf_text.map(|text| to_urdf(text, model, corrections));
    if let Some(Err(error)) = &urdf {
        notes.push(format!("robot_calibrated.urdf was not written: {error}."));
    }
    let by_hand = mjcf::by_hand(model, corrections, kp, kd);
    notes.extend(by_hand.as_ref().map(|lines| without_fragment(report, lines)));
    let mut files = vec![
        ("report.json", to_json(report)),
        ("report.html", to_html(report, Some(model), title, &notes, sections)),
        ("calibrated.toml", to_toml(report)),
    ];
    match by_hand {
        None => files.push(("mjcf_fragment.xml", to_mjcf(model, corrections, kp, kd))),
        Some(lines) if lines.is_empty() => (),
        Some(lines) => files.push(("mjcf_by_hand.txt", by_hand_text(&lines))),
    }
    if let Some(Ok((text, mut unsaid))) = urdf {
        unsaid.extend((model.base == BaseKind::Floating).then(|| FREE_BASE.into()));
        files.push(("robot_calibrated.urdf", with_comment(text, &unsaid)));
    }
    files.push(("isaac_lab_actuators.py", to_isaac_lab(model, corrections, kp, kd, ISAAC_LAB_DT)));
    files.into_iter().map(|(name, text)| (name.to_owned(), text.into_bytes())).collect()
}

/// Why there is no `mjcf_fragment.xml`, and what to change by hand.
fn without_fragment(report: &Report, by_hand: &[String]) -> String {
    let why = if !report.corrections_apply {
        "no correction applies".into()
    } else if by_hand.is_empty() {
        "the diagnosis corrects nothing".into()
    } else {
        format!("a file that MuJoCo includes cannot change the following. By hand: {}", by_hand.join("; "))
    };
    format!("mjcf_fragment.xml was not written: {}.", why.trim_end_matches('.'))
}

/// `mjcf_by_hand.txt`: what the page says under [`without_fragment`], for who has the folder alone.
fn by_hand_text(lines: &[String]) -> String {
    let mut text = String::from(
        "A file that MuJoCo includes cannot state these corrections, so there is no mjcf_fragment.xml.\n\
         Change the MJCF of the robot, or the program that drives the simulation:\n\n",
    );
    for line in lines {
        let _ = writeln!(text, "- {line}");
    }
    text
}

/// `report.json`: the report field by field, indented. Numbers that are not finite are null.
pub fn to_json(report: &Report) -> String {
    // A report is plain data: its names are strings, so that nothing can fail.
    serde_json::to_string_pretty(report).map(|text| text + "\n").expect("plain data")
}

/// The URDF with what it cannot say in a comment at its end.
fn with_comment(mut text: String, unsaid: &[String]) -> String {
    if unsaid.is_empty() {
        return text;
    }
    if !text.ends_with('\n') {
        text.push('\n');
    }
    text += "<!-- What a URDF cannot say:\n";
    for line in unsaid {
        let _ = writeln!(text, "     - {}", mjcf::in_comment(line));
    }
    text + "-->\n"
}
