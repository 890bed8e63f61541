//! `qv effects`, `qv params`, and what is said of misspelt names.

use crate::bags::*;
use crate::facts::States;
use serde_json::Value;
use std::fs;

fn json(arguments: &[&str]) -> Value {
    let (code, out, err) = qv(arguments);
    assert_eq!(code, 0, "{err}");
    serde_json::from_str(&out).unwrap()
}

#[test]
fn effects_are_listed_with_unit_and_range() {
    let all = json(&["effects", "--json"]);
    let effects = all["effects"].as_array().unwrap();
    let of = |name: &str| effects.iter().find(|e| e["name"] == name).unwrap_or_else(|| panic!("no {name}"));
    assert_eq!(of("command_latency")["unit"], "s");
    let limit = |name: &str, place: &str| of(name)[place][1].as_f64().unwrap();
    // Drives of arms are slower than those of robots that walk.
    assert!(limit("actuator_lag", "held") > limit("actuator_lag", "walking"), "{all:#}");
    assert_eq!(of("ground_friction")["held"], Value::Null);
    assert_eq!(of("series_compliance")["walking"], Value::Null, "it is looked for in held robots alone");
    assert_eq!(of("camera_blur")["group"], "camera");
    assert!(effects.iter().all(|e| e["about"].as_str().is_some_and(|s| !s.is_empty())), "{all:#}");
    let (code, table, _) = qv(&["effects"]);
    assert_eq!(code, 0);
    let line = table.lines().find(|l| l.starts_with("ground_friction")).unwrap();
    assert!(line.contains("contact") && line.states("0.05 0.05 1.2"), "{line}");
    assert_eq!(table.lines().filter(|l| !l.is_empty()).count(), effects.len() + 2);
}

#[test]
fn parameters_of_a_robot_are_listed() {
    let all = json(&["params", "go2", "--json"]);
    let parameters = all["parameters"].as_array().unwrap();
    let lag = parameters.iter().find(|p| p["name"] == "actuator.FL_calf_joint.lag").unwrap();
    assert_eq!((&lag["unit"], lag["neutral"].as_f64()), (&Value::from("s"), Some(0.0)));
    let (code, table, _) = qv(&["params", "go2"]);
    assert_eq!((code, table.lines().count()), (0, parameters.len() + 1));
    let (code, _, err) = qv(&["params", "no_such.urdf"]);
    assert!(code == 1 && err.contains("no_such.urdf"), "{err}");
}

#[test]
fn misspelt_names_get_the_nearest() {
    let bag = bag("names_bag", &write(&walk(2.0), small_chunks(None), &[]));
    let folder = directory("names");
    let out = folder.join("out");
    let diagnose = |more: &[&str]| {
        let start = ["diagnose", bag.to_str().unwrap(), "--out", out.to_str().unwrap()];
        let (code, _, err) = qv(&[&start[..], more].concat());
        assert_eq!(code, 1, "{err}");
        err
    };
    let err = diagnose(&["--without", "ground_frictoin"]);
    assert!(err.states("\"ground_frictoin\" ground_friction"), "{err}");
    let params = folder.join("params.toml");
    for (name, nearest) in [
        ("actuator.FL_calf_joint.lagg", "actuator.FL_calf_joint.lag"),
        ("joint.*.armatur", "joint.*.armature"),
        ("joint.FL_claf_joint.armature", "joint.FL_calf_joint.armature"),
    ] {
        fs::write(&params, format!("[parameters]\n\"{name}\" = 0.01\n")).unwrap();
        let err = diagnose(&["--params", params.to_str().unwrap()]);
        let expected = format!("params.toml': unknown parameter \"{name}\"\nhint: did you mean '{nearest}'?");
        assert!(err.contains(&expected), "{err}");
    }
    let library = folder.join("library.toml");
    let text = "[[effect]]\nname = 'wind'\ninterface = 'contact'\nscope = 'world'\nunit = 'N'\nrange = [0, 9]\n\
        tolerance = 0.1\nlevels = [1]\n[[effect.axis]]\nname = 'x'\nmoves = { 'external.forse_x' = 1.0 }\n";
    fs::write(&library, text).unwrap();
    let err = diagnose(&["--library", library.to_str().unwrap()]);
    assert!(err.states("\"external.forse_x\" external.force_x"), "{err}");
}
