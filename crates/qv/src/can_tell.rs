//! `qv inspect --detectable`: the least sizes of effects that a recording shows, before anything is looked for in it.

use crate::Reading;
use crate::ground::{check_ground, terrain_of};
use crate::open::{find_gains, model_of};
use qv_gap::report::CanTell;
use qv_gap::{Options, can_tell};
use qv_open::diagnosis::gap_error;
use qv_recording::{RecordingError, Run};
use serde_json::json;
use std::fmt::Write;
use std::path::Path;

/// A recording, and how it is to be read.
pub struct RecordingRequest<'a> {
    pub run: &'a Run,
    pub path: &'a Path,
    pub reading: &'a Reading,
    pub terrain: &'a str,
}

impl RecordingRequest<'_> {
    /// As lines of a table, or as one line of JSON.
    pub fn answer(&self, as_json: bool) -> Result<String, RecordingError> {
        let model = model_of(self.run, self.path, self.reading.robot.as_deref())?;
        let terrain = terrain_of(self.terrain)?;
        check_ground(self.run, &terrain)?;
        let mut runs = [self.run.clone()];
        find_gains(&mut runs, &model, &terrain, &[])?;
        let sizes = can_tell(&runs, &model, &terrain, &Options::default()).map_err(gap_error)?;
        Ok(match as_json {
            true => format!("{}\n", json!({ "format": "qv-can-tell/1", "power": 0.9, "can_tell": sizes })),
            false => table(&sizes),
        })
    }
}

fn table(sizes: &[CanTell]) -> String {
    let head = ["effect", "size", "of all", "of one part", "largest looked for", "looks like"];
    let mut rows = vec![head.map(str::to_owned)];
    for one in sizes {
        if rows.iter().any(|r| r[0] == one.effect && r[1] == one.parameter) {
            continue;
        }
        let same = |c: &&CanTell| c.effect == one.effect && c.parameter == one.parameter;
        let (all, single): (Vec<&CanTell>, Vec<&CanTell>) =
            sizes.iter().filter(same).filter(|c| c.scope.len() == 1).partition(|c| c.scope == ["all"]);
        let furthest = one.range.iter().fold(0.0_f64, |most, limit| most.max(limit.abs()));
        rows.push([
            one.effect.clone(),
            one.parameter.clone(),
            span(&all, &one.unit),
            span(&single, &one.unit),
            format!("{} {}", short(furthest), one.unit),
            sizes.iter().find(same).map_or_else(String::new, |c| c.confusable_with.join(", ")),
        ]);
    }
    let width = |k: usize| rows.iter().map(|r| r[k].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..head.len()).map(width).collect();
    let mut text = String::from(
        "Least size that is found in nine of ten such recordings, if nothing else is wrong with the simulator.\n\
         A dash: not shown within what is looked for.\n\n",
    );
    for row in &rows {
        let cells: Vec<String> = row.iter().zip(&widths).map(|(cell, &w)| format!("{cell:<w$}")).collect();
        _ = writeln!(text, "{}", cells.join("  ").trim_end());
    }
    text
}

/// From the least to the largest least size, a dash where one of them is not shown.
fn span(of: &[&CanTell], unit: &str) -> String {
    let mut seen: Vec<f64> = of.iter().filter_map(|c| c.least_size).collect();
    seen.sort_by(f64::total_cmp);
    let (Some(least), Some(most)) = (seen.first(), seen.last()) else { return "-".into() };
    let most = if seen.len() < of.len() { "-".into() } else { short(*most) };
    if short(*least) == most { format!("{most} {unit}") } else { format!("{} to {most} {unit}", short(*least)) }
}

/// Two significant digits.
fn short(x: f64) -> String {
    let digits = if x == 0.0 { 1 } else { (1 - x.abs().log10().floor() as i32).max(0) as usize };
    format!("{x:.digits$}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    fn size(scope: &str, least_size: Option<f64>) -> CanTell {
        CanTell {
            effect: "motor_gain_kp".into(),
            scope: vec![scope.into()],
            parameter: "kp_scale".into(),
            unit: "1".into(),
            least_size,
            tolerance: 0.02,
            range: [-0.6, 0.6],
            confusable_with: vec!["motor_strength".into()],
        }
    }

    #[test]
    fn an_effect_has_a_line() {
        let text = table(&[size("all", Some(0.0512)), size("FL_hip", Some(0.12)), size("FR_hip", None)]);
        let line = text.lines().find(|l| l.starts_with("motor_gain_kp")).unwrap();
        assert!(
            line.states("0.051 0.051 1") && line.states("0.12 0.12 1") && line.ends_with("motor_strength"),
            "{line}"
        );
    }

    #[test]
    fn what_is_not_shown_is_a_dash() {
        assert_eq!(span(&[], "m"), "-");
        assert_eq!(span(&[&size("all", None)], "m"), "-");
    }
}
