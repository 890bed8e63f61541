//! Recordings of every built-in robot, written here message by message, are read back to the right joints.

use crate::facts::States;
use qv_recording::cdr::Writer;
use qv_recording::mapping::Mapping;
use qv_recording::robots::{built_in, found_by_messages, names, parse};
use qv_recording::run::{Base, FaultKind, Robot};
use qv_recording::schema::{Arity, Element, Primitive, Schema};
use qv_recording::{BagFile, RecordingError, Run, read_bag_of};
use qv_rollout::HeldCommands;
use std::collections::BTreeMap;
use std::io::Cursor;

const START: u64 = 1_700_000_000_000_000_000;
/// Samples of each recording, 2 ms apart.
const SAMPLES: u64 = 200;

struct Message {
    topic: String,
    type_name: &'static str,
    time: u64,
    data: Vec<u8>,
}

/// A bag; without definitions if `bare`, so that the built-in ones count.
fn bag(messages: &[Message], bare: bool) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = mcap::WriteOptions::new().profile("ros2").create(Cursor::new(&mut bytes)).unwrap();
    let mut channels = BTreeMap::new();
    for (sequence, message) in messages.iter().enumerate() {
        let channel_id = *channels.entry(message.topic.clone()).or_insert_with(|| {
            let text = if bare { String::new() } else { definition(message.type_name) };
            let schema = writer.add_schema(message.type_name, "ros2msg", text.as_bytes()).unwrap();
            writer.add_channel(schema, &message.topic, "cdr", &BTreeMap::new()).unwrap()
        });
        let header = mcap::records::MessageHeader {
            channel_id,
            sequence: sequence as u32,
            log_time: message.time,
            publish_time: message.time,
        };
        writer.write_to_known_channel(&header, &message.data).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes
}

fn definition(type_name: &str) -> String {
    let own = names().filter_map(built_in).flat_map(|r| r.mapping.definitions).find(|(name, _)| name == type_name);
    let text = own.map(|(_, text)| text).or_else(|| qv_recording::definitions::standard(type_name));
    text.unwrap_or_else(|| panic!("no definition of {type_name}"))
}

fn read(bytes: &[u8], mappings: &[Mapping], namespace: Option<&str>) -> Result<Run, RecordingError> {
    read_bag_of([BagFile { name: "bag".into(), source: bytes }], mappings, namespace)
}

/// A message of fixed arrays alone, each number as `value` says for its path, such as `motor_state[3].q`.
fn message(type_name: &str, value: &dyn Fn(&str) -> f64) -> Vec<u8> {
    let schema = Schema::parse(type_name, &definition(type_name)).unwrap();
    let mut w = Writer::new();
    write(&schema, 0, "", value, &mut w);
    w.finish()
}

fn write(schema: &Schema, index: usize, prefix: &str, value: &dyn Fn(&str) -> f64, w: &mut Writer) {
    for field in &schema.types[index].fields {
        let (count, is_array) = match field.arity {
            Arity::One => (1, false),
            Arity::Array(n) => (n, true),
            Arity::Sequence(_) => panic!("{} is no fixed array", field.name),
        };
        for k in 0..count {
            let at = if is_array { format!("[{k}]") } else { String::new() };
            let path = format!("{prefix}{}{at}", field.name);
            match field.element {
                Element::Message(inner) => write(schema, inner, &format!("{path}."), value, w),
                Element::Primitive(primitive) => {
                    let x = value(&path);
                    match primitive {
                        Primitive::F32 => w.f32(x as f32),
                        Primitive::U8 => w.u8(x as u8),
                        Primitive::I8 => w.u8(x as i8 as u8),
                        Primitive::I16 => w.i16(x as i16),
                        Primitive::U16 => w.u16(x as u16),
                        Primitive::I32 => w.i32(x as i32),
                        Primitive::U32 => w.u32(x as u32),
                        other => panic!("{path}: {other:?} is not written here"),
                    };
                }
            }
        }
    }
}

/// The index in `name[3].rest`, when a path has that form.
fn element(path: &str, name: &str, rest: &str) -> Option<usize> {
    path.strip_prefix(name)?.strip_prefix('[')?.strip_suffix(rest)?.strip_suffix(']')?.parse().ok()
}

/// Position of motor `i` at sample `k`, within the limits of every robot here once it is laid between them.
fn motion(motor: usize, sample: u64) -> f64 {
    0.01 * motor as f64 + 0.2 * (0.05 * sample as f64 + motor as f64).sin()
}

/// A path of unitree_legged_msgs (`motorState[3].tauEst`) as the later packages have it.
fn in_later_words(path: &str) -> String {
    let path =
        path.chars().flat_map(|c| c.is_ascii_uppercase().then_some('_').into_iter().chain([c.to_ascii_lowercase()]));
    path.collect::<String>().replace("._", ".").replace("imu.", "imu_state.")
}

/// A robot that speaks `package` (unitree_go, unitree_hg, unitree_legged_msgs), below `namespace`.
fn unitree(package: &'static str, namespace: &str) -> Vec<Message> {
    let (cmd, state) = match package {
        "unitree_go" => ("unitree_go/msg/LowCmd", "unitree_go/msg/LowState"),
        "unitree_hg" => ("unitree_hg/msg/LowCmd", "unitree_hg/msg/LowState"),
        _ => ("unitree_legged_msgs/msg/LowCmd", "unitree_legged_msgs/msg/LowState"),
    };
    let mut all = Vec::new();
    for k in 0..SAMPLES {
        let time = START + 2_000_000 * k;
        let states = message(state, &|path| match in_later_words(path).as_str() {
            "imu_state.quaternion[0]" => 1.0,
            "imu_state.accelerometer[2]" => 9.81,
            "imu_state.gyroscope[1]" => 0.125,
            path => {
                let motor = element(path, "motor_state", ".q").map(|m| motion(m, k));
                let foot = || element(path, "foot_force", "").map(|foot| 10.0 + foot as f64);
                motor.or_else(foot).unwrap_or(0.0)
            }
        });
        let commands = message(cmd, &|path| {
            let path = in_later_words(path);
            let q = element(&path, "motor_cmd", ".q").map(|m| motion(m, k) + 0.05);
            let kp = || element(&path, "motor_cmd", ".kp").map(|m| 20.0 + m as f64);
            q.or_else(kp).unwrap_or(0.0)
        });
        all.push(Message { topic: format!("{namespace}/lowstate"), type_name: state, time, data: states });
        all.push(Message { topic: format!("{namespace}/lowcmd"), type_name: cmd, time: time + 1000, data: commands });
    }
    all
}

const LEGS_ON_WIRE: [&str; 12] = [
    "FR_hip_joint",
    "FR_thigh_joint",
    "FR_calf_joint",
    "FL_hip_joint",
    "FL_thigh_joint",
    "FL_calf_joint",
    "RR_hip_joint",
    "RR_thigh_joint",
    "RR_calf_joint",
    "RL_hip_joint",
    "RL_thigh_joint",
    "RL_calf_joint",
];

/// The order of the G1's motors, as Unitree numbers them.
const G1_ON_WIRE: [&str; 29] = [
    "left_hip_pitch_joint",
    "left_hip_roll_joint",
    "left_hip_yaw_joint",
    "left_knee_joint",
    "left_ankle_pitch_joint",
    "left_ankle_roll_joint",
    "right_hip_pitch_joint",
    "right_hip_roll_joint",
    "right_hip_yaw_joint",
    "right_knee_joint",
    "right_ankle_pitch_joint",
    "right_ankle_roll_joint",
    "waist_yaw_joint",
    "waist_roll_joint",
    "waist_pitch_joint",
    "left_shoulder_pitch_joint",
    "left_shoulder_roll_joint",
    "left_shoulder_yaw_joint",
    "left_elbow_joint",
    "left_wrist_roll_joint",
    "left_wrist_pitch_joint",
    "left_wrist_yaw_joint",
    "right_shoulder_pitch_joint",
    "right_shoulder_roll_joint",
    "right_shoulder_yaw_joint",
    "right_elbow_joint",
    "right_wrist_roll_joint",
    "right_wrist_pitch_joint",
    "right_wrist_yaw_joint",
];

#[test]
fn every_robot_of_unitree_is_read_to_the_right_joints() {
    let cases: [(&str, &str, &[&str]); 7] = [
        ("go2", "unitree_go", &LEGS_ON_WIRE),
        ("go1", "unitree_go", &LEGS_ON_WIRE),
        ("go1", "unitree_legged_msgs", &LEGS_ON_WIRE),
        ("b2", "unitree_go", &LEGS_ON_WIRE),
        ("a2", "unitree_go", &LEGS_ON_WIRE),
        ("a2", "unitree_hg", &LEGS_ON_WIRE),
        ("g1", "unitree_hg", &G1_ON_WIRE),
    ];
    for (name, package, on_wire) in cases {
        for bare in [false, true] {
            let bytes = bag(&unitree(package, ""), bare);
            let mapping = built_in(name).unwrap().mapping;
            let run = read(&bytes, &[mapping], None).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert_eq!((run.robot.clone(), run.base), (Robot::Named(name.into()), Base::Free));
            assert_eq!(run.joint_names.len(), on_wire.len(), "{name}");
            let (position, target) = (run.measured.position.unwrap(), run.commands.position.unwrap());
            let kp = run.commands.kp.unwrap();
            for (motor, joint) in on_wire.iter().enumerate() {
                let column = run.joint_names.iter().position(|n| n == joint).unwrap();
                let right = f64::from(motion(motor, 70) as f32);
                assert_eq!(position.row(70)[column], right, "{name}: {joint}");
                assert_eq!(target.row(70)[column], f64::from((motion(motor, 70) + 0.05) as f32), "{name}: {joint}");
                assert_eq!(kp.row(70)[column], 20.0 + motor as f64, "{name}: {joint}");
            }
            assert_eq!(run.measured.gyro.unwrap().row(3), [0.0, 0.125, 0.0]);
            assert_eq!(run.measured.orientation.unwrap().row(3), [1.0, 0.0, 0.0, 0.0]);
            if let Some(feet) = run.measured.foot_force {
                // On the wire FR, FL, RR, RL.
                assert_eq!((feet.row(0), run.foot_names.len()), (&[11.0, 10.0, 13.0, 12.0][..], 4), "{name}");
            }
        }
    }
}

#[test]
fn messages_tell_which_robot_it_is() {
    for (package, right) in [("unitree_go", "go2"), ("unitree_hg", "g1")] {
        let run = read(&bag(&unitree(package, ""), false), &found_by_messages(), None).unwrap();
        assert_eq!(run.robot, Robot::Named(right.into()));
    }
    // These could be of several robots; who reads them is named.
    let error = read(&bag(&unitree("unitree_legged_msgs", ""), false), &found_by_messages(), None).unwrap_err();
    assert!(error.to_string().states("`--robot go1`"), "{error}");
}

fn header(w: &mut Writer, time: u64) {
    w.time(time).string("");
}

fn names_of(w: &mut Writer, names: &[&str]) {
    w.u32(names.len() as u32);
    names.iter().for_each(|name| {
        w.string(name);
    });
}

fn joint_state(time: u64, names: &[&str], lists: [&[f64]; 3]) -> Vec<u8> {
    let mut w = Writer::new();
    header(&mut w, time);
    names_of(&mut w, names);
    lists.iter().for_each(|list| {
        w.f64_sequence(list);
    });
    w.finish()
}

fn trajectory(time: u64, names: &[&str], points: &[&[f64]]) -> Vec<u8> {
    let mut w = Writer::new();
    header(&mut w, time);
    names_of(&mut w, names);
    w.u32(points.len() as u32);
    for positions in points {
        w.f64_sequence(positions).f64_sequence(&[]).f64_sequence(&[]).f64_sequence(&[]);
        w.i32(0).u32(0);
    }
    w.finish()
}

fn array(values: &[f64]) -> Vec<u8> {
    let mut w = Writer::new();
    w.u32(0).u32(0).f64_sequence(values);
    w.finish()
}

/// A target that an arm of three joints follows with kp 30 and kd 2, at sample `k`: target, position, speed, torque of joint `j`.
fn arm(j: usize, k: u64) -> [f64; 4] {
    let (t, j) = (0.002 * k as f64, j as f64);
    let target = 0.3 * (9.0 * t + j).sin();
    let position = 0.25 * (9.0 * t + j - 0.2).sin();
    let speed = 0.25 * 9.0 * (9.0 * t + j - 0.2).cos();
    [target, position, speed, 30.0 * (target - position) - 2.0 * speed]
}

/// Names of the states, in an order that changes, and of the commands.
const STATES: [[&str; 3]; 2] = [["shoulder", "elbow", "wrist"], ["wrist", "shoulder", "elbow"]];
const COMMANDS: [&str; 3] = ["wrist", "elbow", "shoulder"];

fn joint(name: &str) -> usize {
    STATES[0].iter().position(|n| *n == name).unwrap()
}

/// An arm behind ros2_control below `namespace`, with commands of one kind.
fn ros2(namespace: &str, kind: &'static str, topic: &str) -> Vec<Message> {
    let mut all = Vec::new();
    for k in 0..SAMPLES {
        let time = START + 2_000_000 * k;
        let names = STATES[(k % 2) as usize];
        let of = |what: usize| names.map(|name| arm(joint(name), k)[what]);
        let data = joint_state(time, &names, [&of(1), &of(2), &of(3)]);
        let states = format!("{namespace}/joint_states");
        all.push(Message { topic: states, type_name: "sensor_msgs/msg/JointState", time, data });
        let targets = COMMANDS.map(|name| arm(joint(name), k)[0]);
        let data = match kind {
            "sensor_msgs/msg/JointState" => joint_state(time, &COMMANDS, [&targets, &[], &[]]),
            "trajectory_msgs/msg/JointTrajectory" => trajectory(time, &COMMANDS, &[&targets]),
            _ => array(&targets),
        };
        all.push(Message { topic: format!("{namespace}{topic}"), type_name: kind, time, data });
    }
    all
}

#[test]
fn any_robot_behind_ros2_control_is_read_by_names() {
    let own = parse(
        "arm.toml",
        "like = \"ros2_control\"\nname = \"arm\"\njoints = [\"shoulder\", \"elbow\", \"wrist\"]\non_wire = [2, 1, 0]\nkp = 30.0\nkd = [2.0, 2.0, 2.0]",
        &|_| Err("there is none".into()),
    );
    let own = vec![own.unwrap().mapping];
    let cases = [
        ("sensor_msgs/msg/JointState", "/joint_commands", found_by_messages()),
        ("sensor_msgs/msg/JointState", "/joint_targets", found_by_messages()),
        ("trajectory_msgs/msg/JointTrajectory", "/arm_controller/joint_trajectory", found_by_messages()),
        ("std_msgs/msg/Float64MultiArray", "/forward_position_controller/commands", own),
    ];
    for (kind, topic, mappings) in cases {
        for (namespace, bare) in [("", false), ("", true), ("/left", false)] {
            let run = read(&bag(&ros2(namespace, kind, topic), bare), &mappings, None);
            let run = run.unwrap_or_else(|e| panic!("{kind}: {e}"));
            assert_eq!((run.joint_names.join(" "), run.base), ("shoulder elbow wrist".into(), Base::Fixed), "{kind}");
            let m = &run.measured;
            let (position, torque) = (m.position.as_ref().unwrap(), m.torque.as_ref().unwrap());
            let target = run.commands.position.as_ref().unwrap_or_else(|| panic!("{kind}: {:?}", run.faults));
            let (kp, kd) = (run.commands.kp.as_ref().unwrap(), run.commands.kd.as_ref().unwrap());
            for (j, k) in (0..3).flat_map(|j| [(j, 20), (j, 21)]) {
                let [q_des, q, _, tau] = arm(j, k);
                let row = k as usize;
                let found = [target.row(row)[j], position.row(row)[j], torque.row(row)[j]];
                assert_eq!(found, [q_des, q, tau], "{kind}");
                assert!(
                    (kp.row(0)[j] - 30.0).abs() < 1e-6 && (kd.row(0)[j] - 2.0).abs() < 1e-6,
                    "{kind}: {kp:?} {kd:?}"
                );
            }
            assert!(run.lost.is_empty() && run.faults.iter().all(|f| !f.kind.is_partial()), "{kind}: {:?}", run.faults);
        }
    }
}

#[test]
fn commands_that_cannot_be_read_rightly_are_named() {
    let of = |messages: &[Message]| read(&bag(messages, false), &found_by_messages(), None).unwrap();
    // Without names nobody knows their order.
    let run = of(&ros2("", "std_msgs/msg/Float64MultiArray", "/forward_position_controller/commands"));
    assert_eq!(run.commands.position, None);
    let said = run.faults.iter().map(|f| f.detail.clone()).collect::<String>();
    assert!(said.states("`joints`"), "{said}");
    // A path of several points is no command that is held.
    let mut path = ros2("", "trajectory_msgs/msg/JointTrajectory", "/joint_trajectory");
    for message in path.iter_mut().filter(|m| m.topic == "/joint_trajectory") {
        message.data = trajectory(message.time, &COMMANDS, &[&[0.0; 3], &[1.0; 3]]);
    }
    let said: String = of(&path).faults.iter().map(|f| f.detail.clone()).collect();
    assert!(said.states("`points`") && said.states("points 2"), "{said}");
    // No commands at all.
    let mut states = ros2("", "sensor_msgs/msg/JointState", "/joint_commands");
    states.retain(|m| m.topic == "/joint_states");
    let run = of(&states);
    let fault = run.faults.iter().find(|f| f.kind == FaultKind::Missing).unwrap();
    assert!(fault.detail.states("/joint_commands /effort_controller/commands"), "{}", fault.detail);
    // Of joints that no state has.
    let mut odd = ros2("", "sensor_msgs/msg/JointState", "/joint_commands");
    for message in odd.iter_mut().filter(|m| m.topic == "/joint_commands") {
        message.data = joint_state(message.time, &["elbow", "gripper"], [&[0.5, 0.1], &[], &[]]);
    }
    let run = of(&odd);
    assert!(run.remarks.iter().any(|t| t.contains("/joint_commands") && t.contains("gripper")), "{:?}", run.remarks);
    let target = run.commands.position.unwrap();
    assert!(target.row(0)[1] == 0.5 && target.row(0)[0].is_nan(), "{:?}", target.row(0));
}

#[test]
fn one_gain_holds_for_whatever_joints_the_messages_name() {
    let none = |_: &str| Err("there is none".to_owned());
    let own = parse("arm.toml", "like = \"ros2_control\"\nname = \"arm\"\nkp = 30", &none).unwrap().mapping;
    let bytes = bag(&ros2("", "sensor_msgs/msg/JointState", "/joint_commands"), false);
    let mut run = read(&bytes, &[own], None).unwrap();
    let gains = [&run.commands.kp, &run.commands.kd].map(|s| s.as_ref().unwrap().row(0).to_vec());
    assert_eq!(gains, [vec![30.0; 3], vec![0.0; 3]]);
    HeldCommands::new(&run, &[0, 1, 2]).unwrap();
    // Where there are none, the word is about files that a bag can have.
    run.commands.kp = None;
    let error = HeldCommands::new(&run, &[0, 1, 2]).unwrap_err().to_string();
    assert!(error.states("robot") && !error.contains("run.toml"), "{error}");
}

#[test]
fn a_joint_that_a_message_names_twice_is_told() {
    let mut all = ros2("", "sensor_msgs/msg/JointState", "/joint_commands");
    for message in all.iter_mut().filter(|m| m.topic == "/joint_states") {
        message.data = joint_state(message.time, &["elbow", "wrist", "elbow"], [&[0.1, 0.2, 0.3], &[], &[]]);
    }
    let run = read(&bag(&all, false), &found_by_messages(), None).unwrap();
    assert_eq!(run.lost.len(), 1, "{:?}", run.lost);
    assert_eq!(run.lost[0].file, "/joint_states");
    assert!(run.lost[0].what.states("joint"), "{:?}", run.lost);
    assert_eq!(run.measured.position.unwrap().row(0), [0.3, 0.2]);
}

#[test]
fn two_robots_are_told_apart_by_namespace_or_refused() {
    let both = |a: Vec<Message>, b: Vec<Message>| {
        let mut all: Vec<Message> = a.into_iter().chain(b).collect();
        all.sort_by_key(|m| m.time);
        bag(&all, false)
    };
    let arms = |ns: &str| ros2(ns, "sensor_msgs/msg/JointState", "/joint_commands");
    let bytes = both(arms("/left"), arms("/right"));
    let error = read(&bytes, &found_by_messages(), None).unwrap_err().to_string();
    for word in ["/left/joint_states", "/right/joint_states", "--namespace"] {
        assert!(error.contains(word), "expected {word} in {error}");
    }
    let run = read(&bytes, &found_by_messages(), Some("/right")).unwrap();
    let used: Vec<&str> = run.sources.iter().filter(|s| s.used).map(|s| s.name.as_str()).collect();
    assert_eq!(used, ["/right/joint_states", "/right/joint_commands"]);
    let error = read(&bytes, &found_by_messages(), Some("/up")).unwrap_err().to_string();
    assert!(error.contains("`/up`") || error.contains("/up/"), "{error}");
    let dogs = both(unitree("unitree_go", "/a"), unitree("unitree_go", "/b"));
    let error = read(&dogs, &found_by_messages(), None).unwrap_err().to_string();
    assert!(error.states("/a/lowstate /b/lowstate"), "{error}");
    // One at the root is that robot; a copy at a lower rate is no other one.
    let run = read(&both(unitree("unitree_go", ""), unitree("unitree_go", "/b")), &found_by_messages(), None).unwrap();
    assert!(run.remarks.iter().any(|t| t.contains("/b/lowstate")), "{:?}", run.remarks);
    let run = read(&both(unitree("unitree_go", ""), unitree("unitree_go", "/lf")), &found_by_messages(), None).unwrap();
    assert!(run.remarks.is_empty(), "{:?}", run.remarks);
    let kinds = both(unitree("unitree_go", "/dog"), unitree("unitree_hg", "/man"));
    let error = read(&kinds, &found_by_messages(), None).unwrap_err().to_string();
    assert!(error.states("g1 /man/lowstate go2 /dog/lowstate"), "{error}");
    let run = read(&kinds, &found_by_messages(), Some("/dog")).unwrap();
    assert_eq!(run.robot, Robot::Named("go2".into()));
}

#[test]
fn a_recording_brings_its_robot() {
    let mut all = ros2("", "sensor_msgs/msg/JointState", "/joint_commands");
    let mut w = Writer::new();
    w.string("<robot name=\"arm\"/>");
    let (topic, type_name) = ("/robot_description".to_owned(), "std_msgs/msg/String");
    all.insert(0, Message { topic, type_name, time: START, data: w.finish() });
    let run = read(&bag(&all, false), &found_by_messages(), None).unwrap();
    assert_eq!(run.robot, Robot::Urdf("<robot name=\"arm\"/>".into()));
}
