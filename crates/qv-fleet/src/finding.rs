//! What the report of one unit says, whichever command wrote it.

use crate::plan::Command;
use serde::Serialize;
use serde_json::Value;

/// Cause, scope, parameter and unit of a size.
pub type Key = (String, String, String, String);

/// A size that was found, with its uncertainty.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Size {
    /// Effect that it is of; `friction` of what `qv contact` finds, `tune` of what `qv tune` does.
    pub cause: String,
    /// `all`, or joints, legs, feet, a region, a label.
    pub scope: String,
    /// Which of the effect's parameters.
    pub parameter: String,
    /// In `unit`.
    pub value: f64,
    /// In `unit`.
    pub ci95: [f64; 2],
    /// Its unit; may be empty.
    pub unit: String,
}

impl Size {
    /// What sizes of several units are compared by.
    pub fn key(&self) -> Key {
        (self.cause.clone(), self.scope.clone(), self.parameter.clone(), self.unit.clone())
    }

    /// Half of its interval, as a standard deviation.
    pub fn deviation(&self) -> f64 {
        (self.ci95[1] - self.ci95[0]).abs() / (2.0 * 1.959_963_984_540_054)
    }
}

/// What a report says.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Finding {
    /// Such as `explained`.
    pub verdict: String,
    /// For people; may be empty.
    pub sentence: String,
    /// Effects that are accused.
    pub causes: Vec<String>,
    /// What is left of the gap after correction, in units of the null: by this recordings are compared. None without a diagnosis.
    pub gap_after: Option<f64>,
    /// How large they are.
    pub sizes: Vec<Size>,
}

/// Reads the report of a command. What it lacks is left out: a report of another version is no reason to fail.
pub fn read(command: Command, report: &Value) -> Finding {
    match command {
        Command::Diagnose | Command::Rehearse => diagnosis(report),
        Command::Contact => contact(report),
        Command::Tune => tune(report),
    }
}

fn text(value: &Value) -> String {
    value.as_str().unwrap_or_default().to_owned()
}

fn items(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

fn interval(value: &Value) -> Option<[f64; 2]> {
    Some([value[0].as_f64()?, value[1].as_f64()?])
}

/// What is a property of one recording, not of its robot: when something acted, in that recording's time.
const OF_A_RECORDING: [&str; 3] = ["start", "end", "duration"];

fn diagnosis(report: &Value) -> Finding {
    let causes = items(&report["causes"]);
    let size = |cause: &Value, parameter: &Value| {
        if OF_A_RECORDING.iter().any(|name| parameter["name"] == *name) {
            return None;
        }
        let scope: Vec<String> = items(&cause["scope"]).iter().map(text).collect();
        Some(Size {
            cause: text(&cause["effect"]),
            scope: scope.join(", "),
            parameter: text(&parameter["name"]),
            value: parameter["value"].as_f64()?,
            ci95: interval(&parameter["ci95"])?,
            unit: text(&parameter["unit"]),
        })
    };
    Finding {
        verdict: text(&report["verdict"]),
        sentence: text(&report["sentence"]),
        causes: causes.iter().map(|cause| text(&cause["effect"])).collect(),
        gap_after: report["gap"]["after"].as_f64(),
        sizes: causes.iter().flat_map(|c| items(&c["parameters"]).iter().filter_map(|p| size(c, p))).collect(),
    }
}

/// Frictions that the recordings reported; those that stayed with their priors are no measurement.
fn contact(report: &Value) -> Finding {
    let regions = items(&report["regions"]).iter().filter(|region| region["status"] == "refined");
    let size = |region: &Value| {
        Some(Size {
            cause: "friction".into(),
            scope: text(&region["label"]),
            parameter: "friction".into(),
            value: region["friction"].as_f64()?,
            ci95: interval(&region["posterior"]["interval95"])?,
            unit: String::new(),
        })
    };
    let sizes: Vec<Size> = regions.filter_map(size).collect();
    let verdict = if sizes.is_empty() { "priors kept" } else { "friction found" };
    Finding { verdict: verdict.into(), sentence: text(&report["sentence"]), sizes, ..Finding::default() }
}

/// Error of joints in recordings that no fit has seen, with the simulator as it was and with what was chosen.
fn tune(report: &Value) -> Finding {
    let candidates = items(&report["candidates"]);
    let chosen = report["chosen"].as_u64().and_then(|k| candidates.get(k as usize));
    let size = |name: &str, candidate: &Value| {
        let held = &candidate["held_out"];
        let (error, se) = (held["error"].as_f64()?, held["error_se"].as_f64()?);
        Some(Size {
            cause: "tune".into(),
            scope: "all".into(),
            parameter: name.into(),
            value: error,
            ci95: [error - 1.96 * se, error + 1.96 * se],
            unit: "rad".into(),
        })
    };
    let before = candidates.first().and_then(|c| size("error before", c));
    let after = chosen.and_then(|c| size("error after", c));
    Finding {
        verdict: if chosen.is_some() { "policy tuned" } else { "policy kept" }.into(),
        sentence: text(&report["why"]),
        sizes: before.into_iter().chain(after).collect(),
        ..Finding::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn reports_of_three_commands() {
        let report = json!({"verdict": "explained", "sentence": "late", "gap": {"after": 1.5}, "causes": [
            {"effect": "command_latency", "scope": ["all"], "parameters":
                [{"name": "command latency", "value": 8.0, "ci95": [7.0, 9.0], "unit": "ms"}, {"name": "odd"}]}]});
        let found = read(Command::Diagnose, &report);
        assert_eq!((found.verdict.as_str(), found.causes.len(), found.gap_after), ("explained", 1, Some(1.5)));
        assert_eq!(found.sizes.len(), 1, "what has no value is left out");
        assert!((found.sizes[0].deviation() - 0.5102).abs() < 1e-4);
        let report = json!({"regions": [
            {"label": "tile", "friction": 0.2, "status": "refined", "posterior": {"interval95": [0.1, 0.3]}},
            {"label": "grass", "friction": 0.5, "status": "kept", "posterior": {"interval95": [0.4, 0.6]}}]});
        let found = read(Command::Contact, &report);
        assert_eq!((found.sizes.len(), found.sizes[0].scope.as_str()), (1, "tile"));
        let report = json!({"why": "less", "chosen": 1, "candidates":
            [{"held_out": {"error": 0.02, "error_se": 0.001}}, {"held_out": {"error": 0.01, "error_se": 0.001}}]});
        let found = read(Command::Tune, &report);
        assert_eq!((found.verdict.as_str(), found.sizes[1].value), ("policy tuned", 0.01));
        assert_eq!(read(Command::Diagnose, &json!("nonsense")), Finding::default());
    }
}
