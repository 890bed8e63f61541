//! `qv drift` on an arm of one joint: calibrated, the same on another day, and with a motor that answers late.

use crate::bags::{directory, qv};
use crate::facts::States;
use qv_core::random::SplitMix64;
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, SimOptions, Terrain};
use serde_json::Value;
use std::fs;
use std::path::Path;

const ARM: &str = r#"<robot name="arm"><link name="bench"/><link name="arm"><inertial><origin xyz="0 0 -0.2"/><mass value="0.8"/>
<inertia ixx="0.01" iyy="0.01" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="shoulder" type="revolute">
<parent link="bench"/><child link="arm"/><axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="50"/></joint></robot>"#;
const ABOUT: &str = "robot = \"arm.urdf\"\nbase = \"fixed\"\n[actuator]\nkind = \"pd\"\nkp = 12.0\nkd = 0.4\n";

/// A recording of the arm; `moves` is the size of its motion.
pub fn record(folder: &Path, lag: f64, seed: u64, moves: f64) {
    let model = Model::from_urdf(ARM, &ModelOptions { base: BaseKind::Fixed, ..Default::default() }).unwrap();
    let options = SimOptions { timestep: 0.001, ..Default::default() };
    let mut robot = Batch::<f64>::new(&model, &Terrain::none(), &options, 1).unwrap();
    robot.set_parameter(0, "actuator.shoulder.lag", lag).unwrap();
    let mut noise = SplitMix64::new(seed);
    let mut table = String::from("time,cmd_pos.shoulder,pos.shoulder\n");
    for tick in 0..8000 {
        let time = 0.001 * f64::from(tick);
        let command = moves * (0.6 * (2.1 * time).sin() + 0.2 * (7.3 * time).sin());
        let position = robot.state(0).unwrap().q[0] + noise.normal(1e-4);
        table += &format!("{time:.3},{command:.6},{position:.7}\n");
        let command = JointCommand { q: &[command], dq: &[0.0], kp: &[12.0], kd: &[0.4], tau: &[0.0] };
        robot.set_command(0, &command).unwrap();
        robot.step();
    }
    fs::create_dir_all(folder).unwrap();
    fs::write(folder.join("run.csv"), table).unwrap();
    fs::write(folder.join("run.toml"), ABOUT).unwrap();
    fs::write(folder.join("arm.urdf"), ARM).unwrap();
}

fn check(text: &str) -> Value {
    let all: Value = serde_json::from_str(text).unwrap_or_else(|e| panic!("{e}: {text}"));
    all["checks"][0].clone()
}

#[test]
fn a_changed_arm_is_reported_and_an_unchanged_one_is_not() {
    let folder = directory("drift");
    let at = |name: &str| folder.join(name).to_str().unwrap().to_string();
    for (name, lag, seed, moves) in
        [("monday", 0.004, 1, 1.0), ("tuesday", 0.004, 2, 1.0), ("late", 0.008, 3, 1.0), ("still", 0.004, 4, 0.0)]
    {
        record(&folder.join(name), lag, seed, moves);
    }
    let (code, _, err) = qv(&["diagnose", &at("monday"), "--out", &at("why"), "--quiet"]);
    assert!(code == 0 || code == 3, "{code}: {err}");
    let (baseline, out, xml) = (at("why"), at("drift"), at("drift.xml"));
    let drift = |run: &str| {
        let words = ["drift", run, "--baseline", &baseline, "--out", &out, "--junit", &xml, "--json", "--quiet"];
        qv(&words)
    };

    let (code, text, err) = drift(&at("tuesday"));
    assert_eq!((code, check(&text)["answer"].as_str()), (0, Some("same")), "{err}{}", check(&text)["sentence"]);
    let junit = fs::read_to_string(&xml).unwrap();
    assert!(junit.contains("failures=\"0\"") && junit.contains("testcase"), "{junit}");

    let (code, text, err) = drift(&at("late"));
    let late = check(&text);
    assert_eq!((code, late["answer"].as_str()), (4, Some("changed")), "{err}{}", late["sentence"]);
    let found = &late["parameters"][0];
    assert_eq!(found["effect"], "actuator_lag", "{}", late["sentence"]);
    assert!((found["difference"].as_f64().unwrap() - 0.004).abs() < 0.001, "{found}");
    let junit = fs::read_to_string(&xml).unwrap();
    assert!(junit.contains("failures=\"1\"") && junit.contains("<failure"), "{junit}");

    let (code, text, err) = drift(&at("still"));
    assert_eq!((code, check(&text)["answer"].as_str()), (3, Some("inconclusive")), "{err}{}", check(&text)["sentence"]);
    let shown = check(&text)["not_shown"].to_string();
    assert!(shown.contains("actuator_lag"), "{shown}");

    let history: Value = serde_json::from_str(&fs::read_to_string(folder.join("drift/drift.json")).unwrap()).unwrap();
    assert_eq!(history["checks"].as_array().unwrap().len(), 3, "each day is kept");
    let page = fs::read_to_string(folder.join("drift/drift.html")).unwrap();
    assert!(page.contains("inconclusive") && page.contains("changed") && page.contains("late"));

    // What was recorded over is no calibration any longer.
    record(&folder.join("monday"), 0.004, 9, 1.0);
    let (code, _, err) = drift(&at("tuesday"));
    assert!(code == 1 && err.contains("another file") && err.contains("--reference"), "{code}: {err}");
}

#[test]
fn corrections_are_tested_on_another_recording() {
    let folder = directory("validated");
    let at = |name: &str| folder.join(name).to_str().unwrap().to_string();
    record(&folder.join("slow"), 0.012, 7, 1.0);
    record(&folder.join("again"), 0.012, 8, 0.7);
    let (code, text, err) = qv(&["diagnose", &at("slow"), "--validate", &at("again"), "--out", &at("why"), "--quiet"]);
    assert_eq!(code, 0, "{err}");
    let read = |name: &str| -> Value {
        serde_json::from_str(&fs::read_to_string(folder.join("why").join(name)).unwrap()).unwrap()
    };
    let (report, other) = (read("report.json"), read("validation.json"));
    let closed = |gap: &Value| gap["closed"].as_f64().unwrap();
    assert!(closed(&report["gap"]) > 0.8 && closed(&other) > 0.8, "{} {other}", report["sentence"]);
    assert!(text.states("Other recordings"), "{text}");
}
