//! Bad recordings: each an error (exit 1) or a named partial result (exit 3); nothing good is lost.

use crate::bags::*;
use crate::facts::States;
use mcap::Compression;
use qv_go2::messages::{LOW_STATE, encode_low_state};

#[test]
fn a_good_bag_is_done_whatever_its_compression() {
    let messages = walk(2.0);
    for (name, options) in [
        ("good_zstd", small_chunks(Some(Compression::Zstd))),
        ("good_lz4", small_chunks(Some(Compression::Lz4))),
        ("good_plain", small_chunks(None)),
        ("good_unchunked", mcap::WriteOptions::new().use_chunks(false)),
        ("good_unindexed", small_chunks(None).emit_message_indexes(false).emit_summary_records(false)),
    ] {
        let (code, report, err) = inspect(&bag(name, &write(&messages, options, &[])));
        assert_eq!(code, 0, "{name}: {err} {report:#}");
        assert_eq!(
            [count(&report, "/lowstate"), count(&report, "/lowcmd"), count(&report, "/Odometry")],
            [1000, 1000, 100]
        );
        assert_eq!(report["base"], "free");
        assert_eq!(report["faults"], serde_json::json!([]), "{name}");
        let pose = report["streams"].as_array().unwrap().iter().find(|s| s["name"] == "/Odometry").unwrap();
        assert_eq!(pose["clock"], "header");
    }
}

#[test]
fn a_cut_off_bag_gives_all_whole_messages() {
    let messages = walk(2.0);
    for (name, compression) in
        [("cut_zstd", Some(Compression::Zstd)), ("cut_lz4", Some(Compression::Lz4)), ("cut_plain", None)]
    {
        let bytes = write(&messages, small_chunks(compression), &[]);
        // Just behind the chunk that is then cut, so that the last one is there in part only.
        let cut = bytes.len() * 6 / 10;
        let (code, report, err) = inspect(&bag(name, &bytes[..cut]));
        assert_eq!(code, 3, "{name}: {err}");
        assert!(lost(&report).states("cut"), "{name}: {}", lost(&report));
        assert!(count(&report, "/lowstate") > 300, "{name}: {}", count(&report, "/lowstate"));
        assert!(count(&report, "/lowstate") < 1000);
    }
    // Uncompressed, the messages of the last, partial chunk can be counted: none may be missing.
    let bytes = write(&messages, small_chunks(None), &[]);
    let marker = encode_low_state(&state(0.8));
    let at = bytes.windows(marker.len()).position(|w| w == marker).expect("the message is there") + marker.len();
    let (code, report, _) = inspect(&bag("cut_exact", &bytes[..at + 10]));
    assert_eq!((code, count(&report, "/lowstate")), (3, 401));
}

#[test]
fn every_cut_ends_in_a_report_or_an_error() {
    let bytes = write(&walk(0.5), small_chunks(Some(Compression::Zstd)), &[]);
    for k in 0..24 {
        let (code, _, err) = inspect(&bag("every_cut", &bytes[..bytes.len() * k / 24]));
        assert!(code == 3 || (code == 1 && err.contains("expected")), "cut {k}: code {code}, {err}");
    }
}

#[test]
fn a_corrupt_chunk_costs_only_itself() {
    for (name, compression) in
        [("corrupt_zstd", Some(Compression::Zstd)), ("corrupt_lz4", Some(Compression::Lz4)), ("corrupt_plain", None)]
    {
        let mut bytes = write(&walk(2.0), small_chunks(compression), &[]);
        let middle = bytes.len() * 4 / 10;
        for byte in &mut bytes[middle..middle + 40] {
            *byte ^= 0x5a;
        }
        let (code, report, err) = inspect(&bag(name, &bytes));
        assert_eq!(code, 3, "{name}: {err}");
        let losses = report["lost"].as_array().unwrap();
        assert_eq!(losses.len(), 1, "{name}: {losses:?}");
        assert!(losses[0]["what"].as_str().unwrap().contains("chunk"), "{losses:?}");
        let span = losses[0]["span"].as_array().expect("the time range is named");
        let (from, to) = (span[0].as_u64().unwrap(), span[1].as_u64().unwrap());
        assert!(from > START && to < START + 2_000_000_000 && from < to, "{losses:?}");
        let missing = 1000 - count(&report, "/lowstate");
        let within = (to - from) / 2_000_000 + 2;
        assert!(missing > 0 && missing <= within, "{name}: {missing} of {within}");
        let faults = report["faults"].as_array().unwrap();
        assert!(faults.iter().any(|f| f["kind"] == "gap" && f["channel"] == "joint states"), "{faults:?}");
    }
}

#[test]
fn bytes_that_are_no_records_are_passed_over() {
    let bytes = write(&walk(2.0), small_chunks(Some(Compression::Zstd)), &[]);
    let mut broken = bytes.clone();
    // The length of the first chunk record: magic, header record, then the chunk's opcode.
    let header = u64::from_le_bytes(bytes[9..17].try_into().unwrap()) as usize;
    let chunk = 17 + header;
    assert_eq!(bytes[chunk], 6, "the first chunk starts here");
    broken[chunk + 1..chunk + 9].copy_from_slice(&u64::MAX.to_le_bytes());
    let (code, report, err) = inspect(&bag("resync", &broken));
    // The schemas were in the chunk that is gone; the file repeats them at its end, so the later chunks are not lost.
    assert_eq!(code, 3, "{err}");
    assert!(lost(&report).states("records"), "{}", lost(&report));
    assert!(count(&report, "/lowstate") > 800, "{report:#}");
}

#[test]
fn missing_topics_are_named() {
    let without = |topic: &str| -> Vec<Message> { walk(1.0).into_iter().filter(|m| m.topic != topic).collect() };
    let (code, report, _) = inspect(&bag("no_commands", &write(&without("/lowcmd"), small_chunks(None), &[])));
    assert_eq!(code, 3);
    assert_eq!(fault(&report, "missing")["channel"], "commands");
    let (code, report, _) = inspect(&bag("no_pose", &write(&without("/Odometry"), small_chunks(None), &[])));
    assert_eq!(code, 3);
    assert_eq!(fault(&report, "missing")["channel"], "base pose");
    let (code, _, err) = inspect(&bag("no_states", &write(&without("/lowstate"), small_chunks(None), &[])));
    assert_eq!(code, 1);
    assert!(err.contains("LowState") && err.states("/lowcmd unitree_go/msg/LowCmd 500"), "{err}");
}

#[test]
fn values_that_are_not_finite_become_gaps() {
    let mut messages = walk(1.0);
    for message in messages.iter_mut().filter(|m| m.topic == "/lowstate").skip(100).take(5) {
        let mut spoilt = state(0.2);
        spoilt.q[4] = f64::NAN;
        spoilt.dq[4] = f64::INFINITY;
        message.data = encode_low_state(&spoilt);
    }
    let (code, report, _) = inspect(&bag("nan", &write(&messages, small_chunks(None), &[])));
    assert_eq!(code, 3);
    let found = fault(&report, "not_finite");
    assert_eq!((found["count"].as_u64(), found["channel"].as_str()), (Some(10), Some("/lowstate")));
    assert!((found["time"].as_f64().unwrap() - 0.2).abs() < 1e-6);
    assert_eq!(count(&report, "/lowstate"), 500);
}

#[test]
fn stamps_out_of_order_or_repeated() {
    let mut messages = walk(1.0);
    let states: Vec<usize> = (0..messages.len()).filter(|&i| messages[i].topic == "/lowstate").collect();
    let (a, b) = (messages[states[50]].time, messages[states[51]].time);
    (messages[states[50]].time, messages[states[51]].time) = (b, a);
    messages[states[81]].time = messages[states[80]].time;
    let (code, report, _) = inspect(&bag("order", &write(&messages, small_chunks(None), &[])));
    assert_eq!(code, 3);
    assert_eq!(fault(&report, "out_of_order")["count"], 1);
    assert_eq!(fault(&report, "repeated_stamp")["count"], 1);
    assert!((fault(&report, "out_of_order")["time"].as_f64().unwrap() - 0.1).abs() < 1e-6);
}

#[test]
fn a_clock_that_is_set_is_joined_again() {
    let jumps = [
        ("clock_back", -3_600_000_000_000i64),
        ("clock_ahead", 7_200_000_000_000),
        ("clock_a_little_back", -600_000_000),
    ];
    for (name, jump) in jumps {
        let mut messages = walk(2.0);
        let half = messages.len() / 2;
        let half = half + messages[half..].iter().position(|m| m.topic == "/lowstate").unwrap();
        for message in &mut messages[half..] {
            message.time = message.time.wrapping_add_signed(jump);
        }
        // One that was logged before is written after.
        let late = messages[..half].iter().rposition(|m| m.topic == "/lowcmd").unwrap();
        let late = messages.remove(late);
        messages.insert(half, late);
        let (code, report, _) = inspect(&bag(name, &write(&messages, small_chunks(None), &[])));
        assert_eq!(code, 3);
        let found = fault(&report, "clock_jump");
        let hours = jump as f64 * 1e-9;
        assert!(found["detail"].as_str().unwrap().contains(&format!("{hours:+.3}")), "{found}");
        assert!((found["time"].as_f64().unwrap() - 1.0).abs() < 0.01, "{found}");
        assert!((report["duration"].as_f64().unwrap() - 1.998).abs() < 0.005, "{report:#}");
        assert!(report["faults"].as_array().unwrap().iter().all(|f| f["kind"] != "gap"), "{report:#}");
    }
}

#[test]
fn a_gap_and_drops_are_named_with_their_times() {
    let keep = |m: &Message| {
        let k = (m.time - START) / 2_000_000;
        !(m.topic == "/lowstate" && ((300..350).contains(&k) || k == 100 || k == 200))
    };
    let messages: Vec<Message> = walk(1.0).into_iter().filter(keep).collect();
    let (code, report, _) = inspect(&bag("gap", &write(&messages, small_chunks(None), &[])));
    assert_eq!(code, 0, "what was never recorded is not lost by reading");
    let gap = fault(&report, "gap");
    assert_eq!(gap["count"], 50);
    assert!((gap["time"].as_f64().unwrap() - 0.598).abs() < 1e-6);
    assert_eq!(fault(&report, "drop")["count"], 2);
}

#[test]
fn eleven_joints_are_not_a_go2() {
    let changed = LOW_STATE.replace("MotorState[20]", "MotorState[11]");
    let changed = [("/lowstate", "unitree_go/msg/LowState", changed.as_str())];
    let (code, _, err) = inspect(&bag("eleven", &write(&walk(0.2), small_chunks(None), &changed)));
    assert_eq!(code, 1);
    assert!(err.states("12") && err.states("11"), "{err}");
}

#[test]
fn another_robot_is_refused() {
    let changed = [
        ("/lowstate", "sensor_msgs/msg/JointState", "float64[] position\n"),
        ("/lowcmd", "std_msgs/msg/Float64MultiArray", "float64[] data\n"),
    ];
    let (code, _, err) = inspect(&bag("other_robot", &write(&walk(0.2), small_chunks(None), &changed)));
    assert_eq!(code, 1);
    assert!(err.states("/lowstate sensor_msgs/msg/JointState"), "{err}");
}

#[test]
fn a_schema_that_lies_is_named() {
    let changed = [("/lowcmd", "unitree_go/msg/LowCmd", "MotorCmd[20] motor_cmd\n")];
    let (code, report, _) = inspect(&bag("bad_schema", &write(&walk(0.2), small_chunks(None), &changed)));
    assert_eq!(code, 3);
    let detail = fault(&report, "wrong_robot")["detail"].to_string();
    assert!(detail.states("line 1") && detail.contains("MotorCmd[20]"), "{detail}");
}

#[test]
fn degrees_are_suspected() {
    let mut messages = walk(1.0);
    for (k, message) in messages.iter_mut().filter(|m| m.topic == "/lowstate").enumerate() {
        let mut spoilt = state(k as f64 * 0.002);
        spoilt.q = spoilt.q.map(f64::to_degrees);
        message.data = encode_low_state(&spoilt);
    }
    let (code, report, _) = inspect(&bag("degrees", &write(&messages, small_chunks(None), &[])));
    assert_eq!(code, 3);
    assert!(fault(&report, "degrees_suspected")["detail"].as_str().unwrap().states("radians"));
}

#[test]
fn empty_and_foreign_files() {
    let (code, _, err) = inspect(&bag("empty", b""));
    assert_eq!(code, 1);
    assert!(err.states("empty"), "{err}");
    let (code, _, err) = inspect(&bag("foreign", b"PK\x03\x04 and so on, a zip file"));
    assert_eq!(code, 1);
    assert!(err.states("MCAP"), "{err}");
    let (code, _, err) = inspect(&bag("no_database", b"SQLite format 3\0 and so on"));
    assert_eq!(code, 1);
    assert!(err.states("sqlite3"), "{err}");
    let (code, _, err) = qv(&["inspect", "no_such_file.mcap"]);
    assert!(code == 1 && err.contains("no_such_file.mcap"), "{err}");
    let (code, _, _) = qv(&["inspect"]);
    assert_eq!(code, 2);
    let (code, out, _) = qv(&["inspect", "--help"]);
    assert!(code == 0 && out.contains("Examples:"), "{out}");
}

#[test]
fn a_split_bag_is_one_run() {
    let messages = walk(2.0);
    let half = messages.len() / 2;
    let path = directory("split");
    for (k, part) in [&messages[..half], &messages[half..]].into_iter().enumerate() {
        std::fs::write(path.join(format!("walk_{k}.mcap")), write(part, small_chunks(Some(Compression::Zstd)), &[]))
            .unwrap();
    }
    let (code, report, err) = inspect(&path);
    assert_eq!((code, count(&report, "/lowstate")), (0, 1000), "{err}");
    let yaml = "rosbag2_bagfile_information:\n  relative_file_paths:\n    - walk_0.mcap\n    - walk_1.mcap\n    - walk_2.mcap\n";
    std::fs::write(path.join("metadata.yaml"), yaml).unwrap();
    let (code, report, _) = inspect(&path);
    assert_eq!((code, count(&report, "/lowstate")), (3, 1000));
    assert!(lost(&report).contains("walk_2.mcap"));
    let (code, _, err) = inspect(&directory("nothing_in_it"));
    assert!(code == 1 && err.contains(".mcap"), "{err}");
}
