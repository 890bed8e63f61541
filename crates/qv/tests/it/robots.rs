//! Robots that are not built in: MJCF in place of a URDF, robot files, recordings that bring their robot.

use crate::bags::*;
use crate::facts::States;
use qv_sim::mjcf::MjcfModel;
use qv_sim::{BaseKind, Batch, JointCommand, ModelOptions, SimOptions, Terrain};
use std::fmt::Write;
use std::path::{Path, PathBuf};

const MJCF: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/mjcf");

/// A folder with a table of the biped of `fixtures/mjcf`, its base held, its joints driven to sines for 2 s.
fn biped(name: &str) -> PathBuf {
    let folder = directory(name);
    for file in ["biped.xml", "legs.xml"] {
        std::fs::copy(Path::new(MJCF).join(file), folder.join(file)).unwrap();
    }
    let include = |file: &str| std::fs::read_to_string(folder.join(file)).map_err(|e| e.to_string());
    let options = ModelOptions { base: BaseKind::Fixed, ..Default::default() };
    let robot = MjcfModel::read(&include("biped.xml").unwrap(), &options, &include).unwrap();
    let (model, stand) = (&robot.model, robot.stand.unwrap().joints);
    let mut sim = Batch::<f64>::new(model, &Terrain::plane(), &SimOptions::default(), 1).unwrap();
    let mut state = sim.state(0).unwrap();
    state.q.clone_from(&stand);
    state.v.iter_mut().for_each(|v| *v = 0.0);
    sim.set_state(0, &state).unwrap();
    let mut csv = String::from("time");
    for kind in ["pos", "vel", "cmd_pos"] {
        model.joint_names().iter().for_each(|joint| write!(csv, ",{kind}.{joint}").unwrap());
    }
    csv.push('\n');
    for k in 0..1000 {
        let t = 0.002 * f64::from(k);
        let target: Vec<f64> = stand.iter().enumerate().map(|(j, q)| q + 0.1 * (7.0 * t + j as f64).sin()).collect();
        let state = sim.state(0).unwrap();
        write!(csv, "{t}").unwrap();
        state.q.iter().chain(&state.v).chain(&target).for_each(|x| write!(csv, ",{x}").unwrap());
        csv.push('\n');
        let command = JointCommand { q: &target, dq: &[0.0; 6], kp: &[45.0; 6], kd: &[1.5; 6], tau: &[0.0; 6] };
        sim.set_command(0, &command).unwrap();
        sim.step_many(2);
    }
    std::fs::write(folder.join("run.csv"), csv).unwrap();
    let toml = "robot = \"biped.xml\"\nbase = \"fixed\"\n[actuator]\nkind = \"pd\"\nkp = 45.0\nkd = 1.5\n";
    std::fs::write(folder.join("run.toml"), toml).unwrap();
    folder
}

#[test]
fn a_table_may_name_an_mjcf_and_is_replayed_with_it() {
    let folder = biped("robots_mjcf");
    let (code, out, err) = qv(&["inspect", folder.to_str().unwrap()]);
    assert!(code == 0 && out.starts_with("MJCF base fixed, 6 joints"), "{out}{err}");
    let out = folder.join("out");
    let elsewhere = folder.join("biped.xml");
    for robot in [None, Some(elsewhere.to_str().unwrap())] {
        let mut arguments = vec!["replay", folder.to_str().unwrap(), "--json", "--out", out.to_str().unwrap()];
        arguments.extend(robot.iter().flat_map(|r| ["--robot", r]));
        let (code, said, err) = qv(&arguments);
        // The crate that the file has beside the robot is left out, which is reported.
        assert_eq!(code, 3, "{said}{err}");
        assert!(err.states("`crate`"), "{err}");
        let report: serde_json::Value = serde_json::from_str(&said).unwrap();
        let rms = report["windows"]["pos_rms_mean"].as_f64().unwrap_or_else(|| panic!("no windows in {report:#}"));
        assert!(rms < 1e-3, "{rms} rad");
    }
}

#[test]
fn what_is_wrong_with_an_mjcf_names_file_and_line() {
    let folder = biped("robots_bad_mjcf");
    let legs = std::fs::read_to_string(folder.join("legs.xml")).unwrap();
    std::fs::write(folder.join("legs.xml"), legs.replace("class=\"knee\"/>", "class=\"knees\"/>")).unwrap();
    let out = folder.join("out");
    let (code, _, err) = qv(&["replay", folder.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    assert_eq!(code, 1, "{err}");
    for word in ["biped.xml", "joint `a_knee`", "`knees`", "line 11 of `legs.xml`"] {
        assert!(err.contains(word), "expected {word} in {err}");
    }
}

#[test]
fn a_joint_that_the_model_has_is_not_said_to_be_absent() {
    let folder = biped("robots_blank_joint");
    let csv = std::fs::read_to_string(folder.join("run.csv")).unwrap();
    let header: Vec<&str> = csv.lines().next().unwrap().split(',').collect();
    let blank: Vec<usize> = (0..header.len()).filter(|i| header[*i].ends_with(".a_knee")).collect();
    assert_eq!(blank.len(), 3, "{header:?}");
    let row = |line: &str| {
        let cells = line.split(',').enumerate().map(|(i, cell)| if blank.contains(&i) { "" } else { cell });
        cells.collect::<Vec<_>>().join(",") + "\n"
    };
    let rows: String = csv.lines().skip(1).map(row).collect();
    std::fs::write(folder.join("run.csv"), header.join(",") + "\n" + &rows).unwrap();
    let out = folder.join("out");
    let (code, said, err) = qv(&["replay", folder.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    assert_eq!(code, 3, "{said}{err}");
    assert!(err.states("a_knee"), "{err}");
    assert!(!err.contains("none of that name"), "{err}");
}

#[test]
fn robots_are_listed_with_their_topics() {
    let (code, out, _) = qv(&["robots"]);
    assert_eq!(code, 0);
    for word in
        ["go2:", "go1:", "a2:", "b2:", "g1:", "ros2_control:", "/lowstate", "unitree_hg/msg/LowState", "/joint_states"]
    {
        assert!(out.contains(word), "expected {word} in {out}");
    }
    let (code, out, _) = qv(&["robots", "--json"]);
    let report: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!((code, report["robots"].as_array().unwrap().len()), (0, 6));
}

#[test]
fn a_robot_file_brings_mapping_and_model() {
    let messages = walk(2.0);
    let path = bag("robots_file", &write_bag(&messages));
    let folder = path.parent().unwrap();
    std::fs::write(folder.join("dog.urdf"), qv_go2::model::urdf()).unwrap();
    let file = folder.join("dog.toml");
    std::fs::write(&file, "like = \"b2\"\nname = \"dog\"\nurdf = \"dog.urdf\"\n").unwrap();
    let (path, out) = (path.to_str().unwrap(), folder.join("out"));
    let (code, said, err) = qv(&["inspect", path, "--robot", file.to_str().unwrap()]);
    assert!(said.starts_with("dog base free, 12 joints"), "{code} {said}{err}");
    let (code, said, err) = qv(&["replay", path, "--robot", file.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    assert!(code == 0 && said.states("windows 0.3"), "{code} {said}{err}");
    // What is like a robot whose model is built in has that model, whatever its name.
    let mine = folder.join("mine.toml");
    std::fs::write(&mine, "like = \"go2\"\nname = \"mine\"\n").unwrap();
    let replay = |robot: &Path| {
        qv(&["replay", path, "--json", "--robot", robot.to_str().unwrap(), "--out", out.to_str().unwrap()])
    };
    let (code, said, err) = replay(&mine);
    assert!(code == 0 && !said.contains("not in the model"), "{code} {said}{err}");
    std::fs::write(&mine, "like = \"go2\"\nname = \"mine\"\nfeet = [\"AA\", \"FR\", \"CC\", \"RR\"]\n").unwrap();
    let (code, said, err) = replay(&mine);
    assert!(code == 0 && said.states("AA CC"), "{code} {said}{err}");
    std::fs::write(&mine, "like = \"go2\"\nname = \"mine\"\nkp = -1\n").unwrap();
    let (code, _, err) = replay(&mine);
    assert!(code == 1 && err.contains("mine.toml") && err.contains("`kp`") && err.contains("-1"), "{code} {err}");
    // A built-in robot without a model says what to do.
    let (code, _, err) = qv(&["replay", path, "--robot", "b2", "--out", out.to_str().unwrap()]);
    assert!(code == 1 && err.states("\"b2\"") && err.states("urdf"), "{code} {err}");
    let (code, _, err) = qv(&["replay", path, "--robot", "nobody", "--out", out.to_str().unwrap()]);
    assert!(code == 1 && err.states("robots") && err.contains("nobody"), "{code} {err}");
    std::fs::write(&file, "like = \"b2\"\nname = \"dog\"\ncolour = 1\n").unwrap();
    let (code, _, err) = qv(&["inspect", path, "--robot", file.to_str().unwrap()]);
    assert!(code == 1 && err.contains("dog.toml") && err.contains("`colour`"), "{code} {err}");
}

fn write_bag(messages: &[Message]) -> Vec<u8> {
    write(messages, small_chunks(None), &[])
}
