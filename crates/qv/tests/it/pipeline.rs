//! The stages of `cargo xtask pipeline` against their golden, fixtures/pipeline/golden/replay.json.

use crate::bags::{directory, qv};
use serde_json::Value;
use std::path::Path;

fn golden(name: &str) -> Value {
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/pipeline/golden").join(format!("{name}.json"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    serde_json::from_str(&text).unwrap()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("expected a number, found {value}"))
}

/// `found` within `tolerance` of `expected`, both by name.
fn close(what: &str, expected: f64, found: f64, tolerance: f64) {
    assert!((expected - found).abs() <= tolerance, "{what}: expected {expected} within {tolerance}, found {found}");
}

/// Every named figure of the golden is in the report's list under `key`, and no other.
fn close_by_name(what: &str, golden: &Value, list: &Value, key: &str, tolerance: impl Fn(f64) -> f64) {
    let (expected, found) = (golden.as_object().unwrap(), list.as_array().unwrap());
    assert!(!expected.is_empty() && expected.len() == found.len(), "{what}: {} of {}", found.len(), expected.len());
    for item in found {
        let name = item["name"].as_str().unwrap();
        let expected = number(&expected[name]);
        close(&format!("{what} of {name}"), expected, number(&item[key]), tolerance(expected));
    }
}

#[test]
fn the_pipeline_finds_what_its_golden_says() {
    let golden = golden("replay");
    let folder = directory("pipeline");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_string();
    let (code, _, err) = qv(&["fixture", "--seed", &golden["seed"].to_string(), "--out", &path("recording")]);
    assert_eq!(code, 0, "{err}");
    let (run, terrain) = (path("recording/run.mcap"), path("recording/terrain.glb"));
    let (code, said, err) = qv(&["inspect", &run, "--json"]);
    assert_eq!(code, 0, "{err}");
    let inspected: Value = serde_json::from_str(&said).unwrap();
    assert_eq!((inspected["faults"].to_string(), inspected["partial"].to_string()), ("[]".into(), "false".into()));
    let (code, said, err) = qv(&["replay", &run, "--terrain", &terrain, "--out", &path("replay"), "--json"]);
    assert_eq!(code, 0, "{err}");
    let report: Value = serde_json::from_str(&said).unwrap();
    let tolerance = |key: &str| number(&golden["tolerance"][key]);
    let (windows, whole) = (tolerance("windows_relative"), tolerance("whole_relative"));
    assert_eq!(report["windows"]["count"], golden["windows_count"]);
    let mean = number(&golden["windows_pos_rms_mean"]);
    close("windows", mean, number(&report["windows"]["pos_rms_mean"]), windows * mean);
    let by_joint = &report["windows"]["joints"];
    close_by_name("windows", &golden["windows_pos_rms"], by_joint, "pos_rms", |x| windows * x);
    let mean = number(&golden["whole_pos_rms_mean"]);
    close("whole run", mean, number(&report["pos_rms_mean"]), whole * mean);
    close_by_name("whole run", &golden["whole_pos_rms"], &report["joints"], "pos_rms", |x| whole * x);
    let lags = &report["lags"]["behind_simulation"];
    close_by_name("lag", &golden["lag_behind_simulation"], lags, "lag", |_| tolerance("lag_s"));
    close("base", number(&golden["base_pos_final"]), number(&report["base"]["pos_final"]), tolerance("base_m"));
}

/// With the truth as parameters, what remains is noise and the smoothing of the start.
#[test]
fn the_truth_explains_the_recording() {
    let folder = directory("pipeline_truth");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_string();
    let (code, _, err) = qv(&["fixture", "--seed", "2", "--out", &path("recording")]);
    assert_eq!(code, 0, "{err}");
    let truth: Value =
        serde_json::from_str(&std::fs::read_to_string(folder.join("recording/truth.json")).unwrap()).unwrap();
    let lines = truth["parameters"].as_object().unwrap().iter().map(|(name, value)| format!("\"{name}\" = {value}\n"));
    std::fs::write(folder.join("truth.toml"), lines.collect::<String>()).unwrap();
    let (run, terrain) = (path("recording/run.mcap"), path("recording/terrain.glb"));
    let mut arguments = vec!["replay", &run, "--terrain", &terrain, "--json", "--out"];
    let (out, parameters) = (path("replay"), path("truth.toml"));
    arguments.extend([out.as_str(), "--params", &parameters]);
    let (code, said, err) = qv(&arguments);
    assert_eq!(code, 0, "{err}");
    let report: Value = serde_json::from_str(&said).unwrap();
    let error = number(&report["windows"]["pos_rms_mean"]);
    assert!(error < 2.5e-3, "{error}");
}
