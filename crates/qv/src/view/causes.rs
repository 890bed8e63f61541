//! Causes of a diagnosis: which links each moves, and when it shows most.

use super::motion::Motion;
use serde::Serialize;
use serde_json::Value;

/// A cause in the list that one clicks.
#[derive(Serialize)]
pub struct Cause {
    pub name: String,
    /// Sizes in words.
    pub size: String,
    pub scope: String,
    /// Links that are coloured.
    pub links: Vec<usize>,
    /// When correcting it changes most \[s\]; none where the report does not say.
    pub time: Option<f64>,
}

/// The causes of a report, or where it accuses nothing, what is near to one.
pub fn of(report: &Value, motion: Option<&Motion>) -> Vec<Cause> {
    let causes = report["causes"].as_array().into_iter().flatten();
    causes.map(|cause| one(cause, report, motion)).collect()
}

fn one(cause: &Value, report: &Value, motion: Option<&Motion>) -> Cause {
    let scope: Vec<String> = strings(&cause["scope"]);
    let sizes = cause["parameters"].as_array().into_iter().flatten().filter_map(|p| {
        let text = |key: &str| p[key].as_str().unwrap_or_default().replace('_', " ");
        Some(format!("{} {} {}", text("name"), qv_page::significant(p["value"].as_f64()?, 3), text("unit")))
    });
    Cause {
        name: cause["effect"].as_str().unwrap_or_default().replace('_', " "),
        size: sizes.collect::<Vec<_>>().join(", "),
        links: motion.map(|motion| motion.links(&scope)).unwrap_or_default(),
        time: shows_most(report, &scope),
        scope: scope.join(", "),
    }
}

fn strings(value: &Value) -> Vec<String> {
    value.as_array().into_iter().flatten().filter_map(|v| Some(v.as_str()?.to_owned())).collect()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().into_iter().flatten().map(|v| v.as_f64().unwrap_or(f64::NAN)).collect()
}

/// The window in which the errors of the joints in `scope` shrink most; of a scope without joints, in which all do.
fn shows_most(report: &Value, scope: &[String]) -> Option<f64> {
    let map = &report["heat_map"];
    let (joints, times) = (strings(&map["joints"]), numbers(&map["times"]));
    let is_meant = |joint: &String| scope.iter().any(|name| joint == name || joint.starts_with(&format!("{name}_")));
    let some = joints.iter().any(is_meant);
    let rows: Vec<usize> = (0..joints.len()).filter(|&j| !some || is_meant(&joints[j])).collect();
    let at = |key: &str, j: usize| numbers(&map[key][j]);
    let mut gain = vec![0.0; times.len()];
    for j in rows {
        let (before, after) = (at("before", j), at("after", j));
        let known = before.iter().zip(&after).map(|(b, a)| if (b - a).is_finite() { b - a } else { 0.0 });
        gain.iter_mut().zip(known).for_each(|(sum, x)| *sum += x);
    }
    let best = (0..times.len()).reduce(|a, b| if gain[b] > gain[a] { b } else { a })?;
    Some(times[best]).filter(|t| t.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_cause_shows_where_its_joints_gain_most() {
        let report = json!({
            "causes": [{"effect": "joint_friction", "scope": ["FL"], "parameters": [{"name": "coulomb", "value": 0.5, "unit": "N m"}]},
                {"effect": "command_latency", "scope": ["all"], "parameters": []}],
            "heat_map": {"joints": ["FL_hip", "FR_hip"], "times": [0.1, 0.4, 0.7],
                "before": [[1.0, 3.0, null], [1.0, 1.0, 9.0]], "after": [[1.0, 1.0, 0.0], [0.0, 1.0, 1.0]]}});
        let found = of(&report, None);
        assert_eq!((found[0].time, found[1].time), (Some(0.4), Some(0.7)));
        assert_eq!((found[0].name.as_str(), found[0].size.as_str()), ("joint friction", "coulomb 0.500 N m"));
        assert!(of(&json!({}), None).is_empty());
        assert_eq!(of(&json!({"causes": [{}]}), None)[0].time, None);
    }
}
