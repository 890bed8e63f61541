//! Bags made for tests: a Go2 that swings its legs, and every way to spoil the recording of it.
#![allow(dead_code)]

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions, Writer};
use qv_go2::messages::*;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Start of all test bags \[ns\].
pub const START: u64 = 1_700_000_000_000_000_000;

/// A message to be written.
pub struct Message {
    pub topic: &'static str,
    pub time: u64,
    pub data: Vec<u8>,
}

/// Stand pose, our joint order.
pub const STAND: [f64; 12] = [0.1, 0.8, -1.5, -0.1, 0.8, -1.5, 0.1, 1.0, -1.5, -0.1, 1.0, -1.5];

pub fn state(t: f64) -> LowState {
    let q = std::array::from_fn(|j| STAND[j] + 0.1 * (6.0 * t + j as f64).sin());
    let dq = std::array::from_fn(|j| 0.6 * (6.0 * t + j as f64).cos());
    LowState {
        q,
        dq,
        quaternion: [1.0, 0.0, 0.0, 0.0],
        accelerometer: [0.0, 0.0, 9.81],
        foot_force: [40.0; 4],
        tick: (1000.0 * t).round() as u32,
        ..Default::default()
    }
}

pub fn command(t: f64) -> LowCmd {
    let q = std::array::from_fn(|j| STAND[j] + 0.1 * (6.0 * t + 0.05 + j as f64).sin());
    LowCmd { q, kp: [40.0; 12], kd: [1.0; 12], ..Default::default() }
}

/// Messages of `seconds` at 500 / 500 / 50 Hz.
pub fn walk(seconds: f64) -> Vec<Message> {
    let mut messages = Vec::new();
    for k in 0..(500.0 * seconds) as u64 {
        let (t, time) = (k as f64 * 0.002, START + 2_000_000 * k);
        messages.push(Message { topic: "/lowstate", time, data: encode_low_state(&state(t)) });
        messages.push(Message { topic: "/lowcmd", time: time + 50_000, data: encode_low_cmd(&command(t)) });
        if k % 10 == 0 {
            let data = encode_odometry(time, [0.1 * t, 0.0, 0.3], [1.0, 0.0, 0.0, 0.0]);
            messages.push(Message { topic: "/Odometry", time, data });
        }
    }
    messages
}

pub fn definition(topic: &str) -> (&'static str, &'static str) {
    match topic {
        "/lowstate" => (LOW_STATE_TYPE, LOW_STATE),
        "/lowcmd" => (LOW_CMD_TYPE, LOW_CMD),
        "/Odometry" => (ODOMETRY_TYPE, ODOMETRY),
        _ => (
            "sensor_msgs/msg/CompressedImage",
            "std_msgs/Header header\nstring format\nuint8[] data\n===\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n",
        ),
    }
}

/// Writes messages as rosbag2 does, with other definitions where `changed` names a topic.
pub fn write(messages: &[Message], options: WriteOptions, changed: &[(&str, &str, &str)]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = Writer::with_options(Cursor::new(&mut bytes), options.profile("ros2")).unwrap();
    let mut channels = BTreeMap::new();
    for (sequence, message) in messages.iter().enumerate() {
        let channel = *channels.entry(message.topic).or_insert_with(|| {
            let (mut name, mut text) = definition(message.topic);
            if let Some((_, n, t)) = changed.iter().find(|(topic, _, _)| *topic == message.topic) {
                (name, text) = (n, t);
            }
            let schema = writer.add_schema(name, "ros2msg", text.as_bytes()).unwrap();
            writer.add_channel(schema, message.topic, "cdr", &BTreeMap::new()).unwrap()
        });
        let header = MessageHeader {
            channel_id: channel,
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

pub fn small_chunks(compression: Option<Compression>) -> WriteOptions {
    WriteOptions::new().compression(compression).chunk_size(Some(200_000))
}

/// A directory for one test, emptied.
pub fn directory(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&path);
    std::fs::create_dir_all(&path).unwrap();
    path
}

/// Writes a bag into a directory of its own and returns its path.
pub fn bag(name: &str, bytes: &[u8]) -> PathBuf {
    let path = directory(name).join("run.mcap");
    std::fs::write(&path, bytes).unwrap();
    path
}

/// Runs `qv` and returns its exit code, standard output and standard error.
pub fn qv(arguments: &[&str]) -> (i32, String, String) {
    let output: Output = Command::new(env!("CARGO_BIN_EXE_qv")).args(arguments).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code().expect("qv ends by itself"), text(&output.stdout), text(&output.stderr))
}

/// `qv inspect --json` of a path.
pub fn inspect(path: &Path) -> (i32, serde_json::Value, String) {
    let (code, out, err) = qv(&["inspect", "--json", path.to_str().unwrap()]);
    (code, serde_json::from_str(&out).unwrap_or(serde_json::Value::Null), err)
}

/// Count of messages on a topic.
pub fn count(report: &serde_json::Value, topic: &str) -> u64 {
    let streams = report["streams"].as_array().expect("a report with streams");
    streams.iter().find(|s| s["name"] == topic).map_or(0, |s| s["count"].as_u64().unwrap())
}

/// The first fault of a kind.
pub fn fault(report: &serde_json::Value, kind: &str) -> serde_json::Value {
    let faults = report["faults"].as_array().expect("a report with faults");
    faults.iter().find(|f| f["kind"] == kind).unwrap_or_else(|| panic!("no fault {kind} in {faults:#?}")).clone()
}

/// All that was lost, as text.
pub fn lost(report: &serde_json::Value) -> String {
    report["lost"].to_string()
}
