//! Big bags are streamed: peak memory stays below four times the decoded run.

use crate::bags::*;
use crate::skipped::skipped;
use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};
use qv_go2::messages::*;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

/// Writes `seconds` of a walk with an image-like filler beside it that brings the file to `bytes`, message by message.
fn write_big(path: &Path, seconds: f64, bytes: usize) {
    let options = WriteOptions::new().profile("ros2").compression(None).chunk_size(Some(1 << 20));
    let mut writer = Writer::with_options(BufWriter::new(File::create(path).unwrap()), options).unwrap();
    let mut channels = BTreeMap::new();
    for (topic, name, text) in [
        ("/lowstate", LOW_STATE_TYPE, LOW_STATE),
        ("/lowcmd", LOW_CMD_TYPE, LOW_CMD),
        ("/Odometry", ODOMETRY_TYPE, ODOMETRY),
        ("/camera", "sensor_msgs/msg/CompressedImage", "string format\nuint8[] data\n"),
    ] {
        let schema = writer.add_schema(name, "ros2msg", text.as_bytes()).unwrap();
        channels.insert(topic, writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap());
    }
    let ticks = (500.0 * seconds) as u64;
    let mut noise = 1u64;
    let filler: Vec<u8> = (0..10 * bytes / ticks as usize)
        .map(|_| {
            noise = noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (noise >> 56) as u8
        })
        .collect();
    let mut put = |topic: &str, time: u64, data: &[u8]| {
        let header = MessageHeader { channel_id: channels[topic], sequence: 0, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, data).unwrap();
    };
    for k in 0..ticks {
        let (t, time) = (k as f64 * 0.002, START + 2_000_000 * k);
        put("/lowstate", time, &encode_low_state(&state(t)));
        put("/lowcmd", time, &encode_low_cmd(&command(t)));
        if k % 10 == 0 {
            put("/Odometry", time, &encode_odometry(time, [0.0, 0.0, 0.3], [1.0, 0.0, 0.0, 0.0]));
            put("/camera", time, &filler);
        }
    }
    writer.finish().unwrap();
}

/// Peak memory of `qv inspect` on a bag [bytes], as the kernel counts it, with the bytes of the decoded run.
fn peak_memory(path: &Path) -> (u64, u64) {
    let out: PathBuf = path.with_extension("json");
    let mut child = Command::new(env!("CARGO_BIN_EXE_qv"))
        .args(["inspect", "--json", path.to_str().unwrap()])
        .stdout(File::create(&out).unwrap())
        .spawn()
        .unwrap();
    let status = format!("/proc/{}/status", child.id());
    let mut peak = 0;
    // The high-water mark only rises: the last reading before the end is the peak, but for what comes after it.
    while child.try_wait().unwrap().is_none() {
        if let Ok(text) = std::fs::read_to_string(&status) {
            let line = text.lines().find(|l| l.starts_with("VmHWM:"));
            let kilobytes = line.and_then(|l| l.split_whitespace().nth(1)).and_then(|n| n.parse::<u64>().ok());
            peak = peak.max(1024 * kilobytes.unwrap_or(0));
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    assert!(child.wait().unwrap().success());
    let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(out).unwrap()).unwrap();
    assert_eq!(report["partial"], false, "{report:#}");
    (peak, report["decoded_bytes"].as_u64().unwrap())
}

fn check(name: &str, seconds: f64, bytes: usize) {
    if !Path::new("/proc/self/status").exists() {
        skipped("this system has no /proc to read peak memory from");
        return;
    }
    let path = directory(name).join("run.mcap");
    write_big(&path, seconds, bytes);
    let size = std::fs::metadata(&path).unwrap().len();
    assert!(size >= bytes as u64, "the bag is as big as meant");
    let (peak, decoded) = peak_memory(&path);
    std::fs::remove_file(&path).unwrap();
    println!(
        "{:.0} MB bag, {:.1} MB decoded, {:.1} MB peak",
        size as f64 / 1e6,
        decoded as f64 / 1e6,
        peak as f64 / 1e6
    );
    assert!(peak > 0 && peak < 4 * decoded, "peak {peak} bytes, decoded run {decoded}");
}

#[test]
fn a_200_mb_bag_is_streamed() {
    check("bag_200_mb", 30.0, 200_000_000);
}

#[test]
#[ignore = "writes and reads 2 GB; run with --ignored"]
fn a_2_gb_bag_is_streamed() {
    check("bag_2_gb", 120.0, 2_000_000_000);
}
