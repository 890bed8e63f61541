//! `qv report --reproduce`: an arm of one joint, diagnosed, and diagnosed again.

use crate::bags::{directory, qv};
use crate::drift::record;
use serde_json::{Value, json};
use std::fs;

#[test]
fn a_diagnosis_is_reproduced_bit_by_bit_and_what_differs_is_named() {
    let folder = directory("reproduce");
    let at = |name: &str| folder.join(name).to_str().unwrap().to_string();
    record(&folder.join("arm"), 0.008, 1, 1.0);
    let (code, _, err) = qv(&["diagnose", &at("arm"), "--out", &at("why"), "--seed", "7", "--json"]);
    assert!(code == 0 || code == 3, "{code}: {err}");
    let reproduce = || qv(&["report", "--reproduce", &at("why")]);

    let (code, text, err) = reproduce();
    assert_eq!(code, 0, "{text}{err}");
    assert!(text.contains("same bits"), "{text}");

    let file = folder.join("why/report.json");
    let text = fs::read_to_string(&file).unwrap();
    let mut report: Value = serde_json::from_str(&text).unwrap();
    report["gap"]["closed"] = json!(f64::from_bits(report["gap"]["closed"].as_f64().unwrap().to_bits() ^ 1));
    fs::write(&file, report.to_string()).unwrap();
    let (code, text, err) = qv(&["report", "--reproduce", &at("why"), "--json"]);
    assert_eq!(code, 4, "{text}{err}");
    let answer: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(answer["answer"], "different");
    let differences = answer["differences"].as_array().unwrap();
    assert!(differences.len() == 1 && differences[0].as_str().unwrap().starts_with("/gap/closed: "), "{text}");

    record(&folder.join("arm"), 0.008, 2, 1.0);
    let (code, _, err) = reproduce();
    assert!(code == 3 && err.contains("run.csv': it has changed"), "{code}: {err}");
    fs::remove_file(folder.join("arm/run.csv")).unwrap();
    let (code, _, err) = reproduce();
    assert!(code == 3 && err.contains("run.csv': no such file"), "{code}: {err}");
}

#[test]
fn what_is_no_diagnosis_is_refused() {
    let folder = directory("no-diagnosis");
    fs::write(folder.join("report.json"), r#"{"sentence": "", "provenance": {"arguments": ["replay", "a"]}}"#).unwrap();
    let (code, _, err) = qv(&["report", "--reproduce", folder.to_str().unwrap()]);
    assert!(code == 1 && err.contains("qv diagnose") && err.contains("report.json"), "{code}: {err}");
}
