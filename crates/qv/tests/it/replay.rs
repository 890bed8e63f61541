//! `qv replay`: a robot that is the simulator itself, real recordings, and the files that come out.

use crate::bags::*;
use crate::facts::States;
use crate::skipped::skipped;
use qv_core::TriangleMesh;
use qv_go2::messages::*;
use qv_go2::model;
use qv_mesh::files::glb;
use qv_page::read;
use qv_recording::cdr;

use qv_recording::cdr::Value as Decoded;
use qv_recording::schema::Schema;
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, SimOptions, State, Terrain};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A Go2 of the simulator that stands and swings its joints a little, recorded as a robot would be. `latency` \[s\] is
/// that of its motors, `turn` a yaw that the IMU does not share with the poses.
fn simulated_bag(seconds: f64, latency: f64, turn: f64) -> Vec<Message> {
    let options = ModelOptions { base: BaseKind::Floating, armature: model::ARMATURE, ..Default::default() };
    let robot = Model::from_urdf(&model::urdf(), &options).unwrap();
    let options = SimOptions { max_command_latency: 0.02, ..Default::default() };
    let mut sim = Batch::<f64>::new(&robot, &Terrain::plane(), &options, 1).unwrap();
    for name in robot.joint_names() {
        sim.set_parameter(0, &format!("actuator.{name}.command_latency"), latency).unwrap();
    }
    let half = 0.5 * turn;
    let mut q = vec![0.3, -0.2, model::touching_height(&STAND) - 0.001, half.cos(), 0.0, 0.0, half.sin()];
    q.extend(STAND);
    sim.set_state(0, &State { q, v: vec![0.0; 18] }).unwrap();
    let mut messages = Vec::new();
    for k in 0..(500.0 * seconds) as u64 {
        let (t, time) = (k as f64 * 0.002, START + 2_000_000 * k);
        let seen = sim.sensors(0).unwrap();
        let spin = |wxyz: [f64; 4]| {
            let yaw = glam::DQuat::from_rotation_z(-turn);
            let r = yaw * glam::DQuat::from_xyzw(wxyz[1], wxyz[2], wxyz[3], wxyz[0]);
            [r.w, r.x, r.y, r.z]
        };
        let low_state = LowState {
            q: seen.q.clone().try_into().unwrap(),
            dq: seen.dq.clone().try_into().unwrap(),
            tau: seen.tau.clone().try_into().unwrap(),
            quaternion: spin(seen.imu_orientation),
            gyroscope: seen.gyro,
            // Before the first step nothing has been accelerated yet.
            accelerometer: if k == 0 { [0.0, 0.0, 9.81] } else { seen.acc },
            foot_force: [35.0; 4],
            tick: 2 * k as u32,
        };
        messages.push(Message { topic: "/lowstate", time, data: encode_low_state(&low_state) });
        let target =
            std::array::from_fn(|j| STAND[j] + 0.12 * (7.0 * t + 0.4 * (j % 3) as f64).sin() * (t / 0.5).min(1.0));
        let command = LowCmd { q: target, kp: [40.0; 12], kd: [1.0; 12], ..Default::default() };
        messages.push(Message { topic: "/lowcmd", time: time + 50_000, data: encode_low_cmd(&command) });
        if k % 10 == 0 {
            let data = encode_odometry(time, seen.base_position, seen.base_orientation);
            messages.push(Message { topic: "/Odometry", time, data });
        }
        let JointTargets { q, dq, kp, kd, tau } = JointTargets::of(&command);
        sim.set_command(0, &JointCommand { q: &q, dq: &dq, kp: &kp, kd: &kd, tau: &tau }).unwrap();
        sim.step_many(2);
    }
    messages
}

/// A command after the trip through 32-bit numbers.
struct JointTargets {
    q: Vec<f64>,
    dq: Vec<f64>,
    kp: Vec<f64>,
    kd: Vec<f64>,
    tau: Vec<f64>,
}

impl JointTargets {
    fn of(command: &LowCmd) -> Self {
        let narrow = |x: &[f64; 12]| x.iter().map(|&x| f64::from(x as f32)).collect();
        Self {
            q: narrow(&command.q),
            dq: narrow(&command.dq),
            kp: narrow(&command.kp),
            kd: narrow(&command.kd),
            tau: narrow(&command.tau),
        }
    }
}

fn replay(run: &Path, out: &Path, more: &[&str]) -> (i32, Value, String) {
    let mut arguments = vec!["replay", run.to_str().unwrap(), "--out", out.to_str().unwrap(), "--json"];
    arguments.extend(more);
    let (code, text, err) = qv(&arguments);
    (code, serde_json::from_str(&text).unwrap_or(Value::Null), err)
}

fn number(value: &Value, pointer: &str) -> f64 {
    value.pointer(pointer).and_then(Value::as_f64).unwrap_or_else(|| panic!("no number at {pointer} in {value:#}"))
}

#[test]
fn the_simulator_replays_itself() {
    let path = bag("replay_self", &write(&simulated_bag(3.0, 0.0, 0.7), small_chunks(None), &[]));
    let out = path.with_file_name("out");
    let (code, report, err) = replay(&path, &out, &[]);
    assert_eq!(code, 0, "{err}");
    assert_eq!(report["format"], "qv-replay/1");
    assert_eq!(report["windows"]["count"], 9);
    // What is left comes from smoothing the start where a foot slips or lands, and from 32-bit recording.
    assert!(number(&report, "/windows/pos_rms_mean") < 1.8e-3, "{report:#}");
    assert!(number(&report, "/base/pos_mean") < 0.02, "{report:#}");
    let written: Value = serde_json::from_str(&fs::read_to_string(out.join("replay.json")).unwrap()).unwrap();
    assert_eq!(written, report, "--json says what the file says");
    let html = fs::read_to_string(out.join("replay.html")).unwrap();
    let text = read::without_scripts(&html);
    assert!(text.contains("FL_calf_joint") && text.contains("<svg") && !text.contains("NaN"));
    assert!(!html.contains("http:") && !text.contains("src="), "the page uses no network");
    let boards = read::boards(&html);
    assert_eq!((boards.len(), boards[1].choices[0].options.len()), (2, 12));
    assert_eq!(boards[1].choices[1].options, ["position", "velocity", "torque", "all"]);
}

#[test]
fn a_latency_is_seen_and_its_parameter_takes_it_away() {
    let path = bag("replay_latency", &write(&simulated_bag(3.0, 0.012, 0.0), small_chunks(None), &[]));
    let out = path.with_file_name("out");
    let (_, without, err) = replay(&path, &out, &[]);
    assert!(number(&without, "/windows/pos_rms_mean") > 2e-3, "{err} {without:#}");
    for lag in without.pointer("/lags/behind_simulation").and_then(Value::as_array).unwrap() {
        let lag = lag["lag"].as_f64().unwrap();
        assert!((lag - 0.012).abs() < 0.003, "{lag} of 0.012 s");
    }
    let parameters = path.with_file_name("calibrated.toml");
    fs::write(&parameters, "[parameters]\n\"actuator.*.command_latency\" = 0.012\n").unwrap();
    let (code, with, err) = replay(&path, &out, &["--params", parameters.to_str().unwrap()]);
    assert_eq!(code, 0, "{err}");
    let (before, after) = (number(&without, "/windows/pos_rms_mean"), number(&with, "/windows/pos_rms_mean"));
    assert!(after < 0.3 * before, "{after} of {before}");
    fs::write(&parameters, "\"actuator.*.latency\" = 0.012\n").unwrap();
    let (code, _, err) = replay(&path, &out, &["--params", parameters.to_str().unwrap()]);
    assert!(code == 1 && err.contains("actuator.*.latency"), "{err}");
    fs::write(&parameters, "\"contact.friction\" = \"low\"\n").unwrap();
    let (code, _, err) = replay(&path, &out, &["--params", parameters.to_str().unwrap()]);
    assert!(code == 1 && err.contains("calibrated.toml") && err.contains("contact.friction"), "{err}");
    fs::write(&parameters, "\"contact.friction_drop\" = 2\n").unwrap();
    let (code, with, err) = replay(&path, &out, &["--params", parameters.to_str().unwrap()]);
    let remarks = with["remarks"].as_array().unwrap().iter().filter_map(Value::as_str);
    assert!(
        code == 0 && remarks.clone().any(|t| t.states("friction_drop 2") && t.states("0.8 0 0.8")),
        "{err} {with:#}"
    );
}

#[test]
fn replay_twice_gives_the_same_bytes() {
    let path = bag("replay_twice", &write(&simulated_bag(1.0, 0.0, 0.0), small_chunks(None), &[]));
    let read = |name: &str| {
        let out = path.with_file_name(name);
        assert_eq!(replay(&path, &out, &[]).0, 0);
        (fs::read(out.join("replay.mcap")).unwrap(), fs::read(out.join("replay.html")).unwrap())
    };
    assert!(read("first") == read("second"));
}

/// The elements of a field.
fn list<'v>(value: &'v Decoded, field: &str) -> &'v [Decoded] {
    match value.get(field) {
        Some(Decoded::Array(elements)) => elements,
        other => panic!("{field}: {other:?}"),
    }
}

fn field(value: &Decoded, path: &str) -> f64 {
    value.get(path).and_then(Decoded::as_f64).unwrap_or_else(|| panic!("{path} of {value:?}"))
}

/// Forces point up from the feet, slips are where feet are, errors are simulated minus recorded, and the layout names topics that are there.
#[test]
fn replay_mcap_shows_forces_slips_and_errors() {
    let path = directory("replay_scene");
    let fixture = path.join("fixture");
    let (code, _, err) = qv(&["fixture", "--out", fixture.to_str().unwrap(), "--seed", "1"]);
    assert_eq!(code, 0, "{err}");
    let (out, ice) = (path.join("out"), path.join("ice.toml"));
    fs::write(&ice, "\"contact.friction\" = 0.1\n").unwrap();
    let (code, ..) = replay(&fixture.join("run.mcap"), &out, &["--params", ice.to_str().unwrap()]);
    assert_eq!(code, 0);
    let bytes = fs::read(out.join("replay.mcap")).unwrap();
    let mut topics = std::collections::BTreeMap::<String, usize>::new();
    let (mut arrows, mut slips, mut error) = (0, 0, f64::NAN);
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let topic = message.channel.topic.clone();
        *topics.entry(topic.clone()).or_default() += 1;
        let wanted = topic == "/simulated/scene" || (topic == "/error/windows" && error.is_nan());
        if !wanted {
            continue;
        }
        let schema = message.channel.schema.as_ref().unwrap();
        let definition = std::str::from_utf8(&schema.data).unwrap();
        let value = cdr::decode(&Schema::parse(&schema.name, definition).unwrap(), &message.data).unwrap();
        if topic == "/error/windows" {
            let positions = value.get("position").unwrap();
            let Decoded::Array(positions) = positions else { panic!("{positions:?}") };
            error = positions[0].as_f64().unwrap();
            continue;
        }
        assert_eq!(schema.name, "foxglove_msgs/msg/SceneUpdate");
        for entity in list(&value, "entities") {
            for arrow in list(entity, "arrows") {
                let (length, lies) = (field(arrow, "shaft_length"), field(arrow, "pose.orientation.y"));
                assert!((0.0..2.0).contains(&length) && (lies + 0.5_f64.sqrt()).abs() < 1e-9, "it points up");
                arrows += 1;
            }
            for ball in list(entity, "spheres") {
                let height = field(ball, "pose.position.z");
                assert!(height.abs() < 0.1, "a foot that stands slips on the ground, {height}");
                slips += 1;
            }
        }
    }
    assert!(error.abs() < 0.2, "{error}");
    // Feet stand at nearly all of 20 pictures a second for 18 s, and a trot slips on ice.
    assert!(arrows > 500 && slips > 0 && slips < arrows / 4, "{arrows} forces, {slips} slips");
    for topic in ["/error/whole", "/error/windows", "/recorded/scene", "/recorded/foot_forces"] {
        assert!(topics.contains_key(topic), "{topics:?}");
    }
    let layout: Value = serde_json::from_str(&fs::read_to_string(out.join("replay.layout.json")).unwrap()).unwrap();
    let panels = layout["configById"].as_object().unwrap();
    assert_eq!(panels.len(), 4, "a scene and three joints");
    let shown = layout["layout"].to_string();
    assert!(panels.keys().all(|panel| shown.contains(panel.as_str())), "{shown}");
    let paths = panels.values().filter_map(|panel| panel["paths"].as_array()).flatten();
    let plotted: Vec<String> =
        paths.map(|path| path["value"].as_str().unwrap().split('.').next().unwrap().into()).collect();
    let drawn = panels["3D!scene"]["topics"].as_object().unwrap().keys().cloned();
    assert!(plotted.into_iter().chain(drawn).all(|topic| topics.contains_key(&topic)), "{topics:?}");
}

#[test]
fn what_cannot_be_replayed_is_an_error() {
    let out = directory("replay_errors").join("out");
    let without = |topic: &str| -> Vec<Message> { walk(1.0).into_iter().filter(|m| m.topic != topic).collect() };
    let path = bag("replay_no_commands", &write(&without("/lowcmd"), small_chunks(None), &[]));
    let (code, _, err) = replay(&path, &out, &[]);
    assert!(code == 1 && err.contains("commands"), "{err}");
    let path = bag("replay_window", &write(&walk(0.5), small_chunks(None), &[]));
    let corners = [[500.0, 0.0], [510.0, 0.0], [500.0, 10.0]].map(|[x, y]| glam::DVec3::new(x, y, 0.0));
    let far = TriangleMesh { vertices: corners.to_vec(), triangles: vec![[0, 1, 2]], ..Default::default() };
    let far_away = path.with_file_name("far_away.glb");
    fs::write(&far_away, glb::write(&far)).unwrap();
    for (more, expected, word) in [
        (["--window", "0"], 2, "window"),
        (["--window", "-1"], 2, "window"),
        (["--window", "nan"], 2, "window"),
        (["--window", "1e9"], 2, "window"),
        (["--terrain", "nowhere.glb"], 1, "nowhere.glb"),
        (["--terrain", far_away.to_str().unwrap()], 1, "ground below the robot"),
        (["--robot", "nowhere.urdf"], 1, "nowhere.urdf"),
        (["--params", "nowhere.toml"], 1, "nowhere.toml"),
    ] {
        let (code, _, err) = replay(&path, &out, &more);
        assert!(code == expected && err.contains(word), "{more:?}: {err}");
    }
}

#[test]
fn without_poses_legs_tell_where_the_robot_is() {
    let messages: Vec<Message> = simulated_bag(2.0, 0.0, 0.0).into_iter().filter(|m| m.topic != "/Odometry").collect();
    let path = bag("replay_no_pose", &write(&messages, small_chunks(None), &[]));
    let (code, found, err) = replay(&path, &path.with_file_name("out"), &[]);
    assert!(code == 3 && err.states("base"), "{err}");
    assert!(number(&found, "/windows/pos_rms_mean") < 5e-3 && found["base"].is_null(), "{found:#}");
}

#[test]
fn a_simulation_that_runs_away_is_not_a_match() {
    let path = bag("replay_runaway", &write(&simulated_bag(2.0, 0.0, 0.0), small_chunks(None), &[]));
    let directory = directory("replay_runaway_out");
    let params = directory.join("wild.toml");
    fs::write(&params, "\"actuator.*.kp_scale\" = 1e7\n\"actuator.*.torque_limit\" = 1e9\n").unwrap();
    let out = directory.join("out");
    let (code, _, err) = replay(&path, &out, &["--params", params.to_str().unwrap()]);
    assert!(code == 3 && err.states("away"), "{code}: {err}");
    let report: Value = serde_json::from_str(&fs::read_to_string(out.join("replay.json")).unwrap()).unwrap();
    assert!(report["pos_rms_mean"].is_null() && report["joints"][0]["pos_rms"].is_null(), "{report}");
    assert!(report["ran_away"].is_number() && !report["lost"].as_array().unwrap().is_empty(), "{report}");
}

#[test]
fn part_of_a_recording_is_replayed_and_named() {
    let bytes = write(&simulated_bag(2.0, 0.0, 0.0), small_chunks(None), &[]);
    let path = bag("replay_part", &bytes[..bytes.len() * 6 / 10]);
    let (code, report, err) = replay(&path, &path.with_file_name("out"), &[]);
    assert_eq!(code, 3, "{err}");
    assert!(err.states("cut"), "{err}");
    assert!(
        number(&report, "/windows/count") >= 2.0 && number(&report, "/windows/pos_rms_mean") < 1.5e-3,
        "{report:#}"
    );
}

/// The Python of an environment with the mcap packages, when the test runner made one.
fn python() -> Option<PathBuf> {
    let candidate = std::env::var_os("QV_PYTHON").map_or_else(|| PathBuf::from("python3"), PathBuf::from);
    let works = Command::new(&candidate).args(["-c", "import mcap, mcap_ros2.decoder"]).output();
    works.ok().filter(|o| o.status.success()).map(|_| candidate)
}

#[test]
fn python_reads_replay_mcap() {
    let Some(python) = python() else {
        skipped("no Python with mcap and mcap-ros2-support (cargo xtask test makes one)");
        return;
    };
    let path = bag("replay_python", &write(&simulated_bag(1.0, 0.0, 0.3), small_chunks(None), &[]));
    let out = path.with_file_name("out");
    assert_eq!(replay(&path, &out, &[]).0, 0);
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/mcap/read_replay.py");
    let output = Command::new(python).arg(script).arg(out.join("replay.mcap")).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(found["profile"], "ros2");
    for side in ["recorded", "simulated"] {
        let joints = &found["topics"][format!("/{side}/joint_states")];
        assert_eq!(
            (&joints["type"], &joints["count"]),
            (&"sensor_msgs/msg/JointState".into(), &500.into()),
            "{found:#}"
        );
        assert_eq!(joints["name"][2], "FL_calf_joint");
        assert_eq!((joints["stamp"].as_u64(), joints["log_time"].as_u64()), (Some(START), Some(START)));
        assert!((joints["position"][2].as_f64().unwrap() - STAND[2]).abs() < 0.05, "{joints}");
        let pose = &found["topics"][format!("/{side}/base_pose")];
        assert_eq!(pose["type"], "geometry_msgs/msg/PoseStamped");
        assert!((pose["pose"][0].as_f64().unwrap() - 0.3).abs() < 0.01, "{pose}");
        assert!((pose["pose"][6].as_f64().unwrap() - 0.15f64.sin()).abs() < 0.01, "{pose}");
    }
    assert_eq!(found["topics"]["/tf"]["count"], 1000);
    let scene = &found["topics"]["/simulated/scene"];
    assert_eq!((&scene["type"], &scene["entities"]), (&"foxglove_msgs/msg/SceneUpdate".into(), &4.into()), "{found:#}");
}

fn shared() -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    if path.exists() {
        return Some(path);
    }
    skipped("no ../shared beside the workspace");
    None
}

#[test]
fn practice_recordings() {
    let Some(shared) = shared() else { return };
    let out = directory("replay_practice");
    let error = |case: &str| {
        let (code, report, err) = replay(&shared.join("practice").join(case).join("run.mcap"), &out.join(case), &[]);
        assert_eq!(code, 0, "{case}: {err}");
        assert_eq!(report["windows"]["skipped"], 0);
        number(&report, "/windows/pos_rms_mean")
    };
    let nominal = error("case01");
    assert!(nominal < 4e-3, "case01: {nominal}");
    for case in ["case00", "case02", "case03", "case04"] {
        let found = error(case);
        println!("{case}: {:.2} mrad, nominal {:.2}", 1e3 * found, 1e3 * nominal);
        assert!(found > 1.8 * nominal, "{case}: {found}");
    }
}

#[test]
fn real_recordings() {
    let Some(shared) = shared() else { return };
    let out = directory("replay_real");
    let (code, report, err) = replay(&shared.join("real/go2_air"), &out.join("air"), &[]);
    assert_eq!(code, 0, "{err}");
    assert!(report["base"].is_null());
    assert!(report["joints"][0]["tau_rms"].is_null(), "torque was not measured");
    assert!(number(&report, "/windows/pos_rms_mean") < 0.04, "the legs swing free: {report:#}");
    assert_eq!(report.pointer("/lags/behind_command").and_then(Value::as_array).map(Vec::len), Some(12));
    for run in ["pendulum_sts3215/m535_kp32_sin_sin_1", "double_pendulum_acrobot/calm_01"] {
        let (code, report, err) = replay(&shared.join("real").join(run), &out.join("other"), &[]);
        assert_eq!(code, 0, "{run}: {err}");
        assert!(number(&report, "/windows/pos_rms_mean").is_finite());
    }
}
