//! `--params`: what a diagnosis found becomes the middle of what differs from robot to robot in training.

use crate::Failure;
use crate::open::{file_error, parameters_of};
use qv_policy::velocity::{Randomise, TaskRobot};
use qv_sim::{Batch, SimOptions, Terrain};
use serde_json::Value;
use std::fs;
use std::path::Path;

/// Share of a correction by which it may be wrong, where the diagnosis states no interval: the 15 to 20 % that its own checks on
/// sealed recordings have as 90 % intervals (docs/theory/diagnosis.md).
const UNSURE: f64 = 0.2;

/// Adds the parameters of a calibrated.toml to what is drawn: each within the interval that report.json beside it states, else
/// within a fifth of its correction. Returns how many.
pub fn around(file: &Path, robot: &TaskRobot, ground: &Terrain, randomise: &mut Randomise) -> Result<usize, Failure> {
    let named = parameters_of(Some(file), &robot.model, ground)?;
    let probe = Batch::<f32>::new(&robot.model, ground, &SimOptions::default(), 1)?;
    let widths = widths(&file.with_file_name("report.json"));
    for (name, value) in &named {
        let info = &probe.catalogue()[probe.parameter_index(name)?];
        let last = name.rsplit('.').next().unwrap_or(name);
        let stated = widths.iter().find(|(known, _)| known == last).map(|(_, width)| *width);
        let half = stated.unwrap_or(UNSURE * (value - info.neutral).abs());
        let range = [info.clamped(value - half), info.clamped(value + half)];
        if !range.iter().all(|x| x.is_finite()) {
            return Err(file_error(file, &format!("a finite `{name}`"), &format!("{value}")).into());
        }
        // What was found of one joint stands in place of what was assumed of all.
        randomise.parameters.insert(name.clone(), range);
        randomise.together.retain(|pattern, _| !means(pattern, name));
    }
    // Others of the same kind keep their ranges, but not the joints that were found: those come last and win.
    Ok(named.len())
}

fn means(pattern: &str, name: &str) -> bool {
    pattern.split_once('*').is_some_and(|(before, after)| name.starts_with(before) && name.ends_with(after))
}

/// Half widths of the 95 % intervals of a report's causes, by the last word of the parameter.
fn widths(report: &Path) -> Vec<(String, f64)> {
    let Ok(text) = fs::read_to_string(report) else { return Vec::new() };
    let Ok(report) = serde_json::from_str::<Value>(&text) else { return Vec::new() };
    let causes = report["causes"].as_array().cloned().unwrap_or_default();
    let parameters = causes.iter().flat_map(|c| c["parameters"].as_array().cloned().unwrap_or_default());
    parameters
        .filter_map(|p| {
            let name = p["name"].as_str()?.rsplit('.').next()?.to_owned();
            let ends = p["ci95"].as_array()?;
            let half = 0.5 * (ends.get(1)?.as_f64()? - ends.first()?.as_f64()?);
            (half.is_finite() && half >= 0.0).then_some((name, half))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_found_is_drawn_within_its_interval() {
        let folder = std::env::temp_dir().join(format!("qv-around-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let file = folder.join("calibrated.toml");
        fs::write(&file, "[parameters]\n\"actuator.*.command_latency\" = 0.010\n\"contact.friction\" = 0.5\n").unwrap();
        let report = r#"{"causes":[{"parameters":[{"name":"command_latency","value":0.01,"ci95":[0.009,0.0112]}]}]}"#;
        fs::write(folder.join("report.json"), report).unwrap();
        let robot = qv_go2::walk::robot().unwrap();
        let mut randomise = Randomise::robust("base");
        assert_eq!(around(&file, &robot, &Terrain::plane(), &mut randomise).unwrap(), 13);
        let [low, high] = randomise.parameters["actuator.RR_calf_joint.command_latency"];
        assert!((low - 0.0089).abs() < 1e-9 && (high - 0.0111).abs() < 1e-9);
        let [low, high] = randomise.parameters["contact.friction"];
        assert!((low - 0.44).abs() < 1e-9 && (high - 0.56).abs() < 1e-9, "a fifth of the correction from 0.8");
        assert!(randomise.together.is_empty(), "the assumed latency has given way");
        fs::remove_dir_all(&folder).unwrap();
    }
}
