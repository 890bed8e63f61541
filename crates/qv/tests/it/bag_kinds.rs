//! Bags as other recorders write them: sqlite3, compressed as a whole, renamed, of ROS 1.

use crate::bags::*;
use crate::facts::States;
use rusqlite::{Connection, params};
use std::collections::BTreeMap;
use std::path::Path;

/// Writes messages as rosbag2 of Humble does: without definitions, each message compressed if asked for.
fn write_database(path: &Path, messages: &[Message], compressed: bool, journal: &str) {
    let mut database = Connection::open(path).unwrap();
    database.pragma_update(None, "journal_mode", journal).unwrap();
    database
        .execute_batch(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, \
             serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);\
             CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, \
             data BLOB NOT NULL);",
        )
        .unwrap();
    let change = database.transaction().unwrap();
    let mut topics = BTreeMap::new();
    for message in messages {
        let next = 7 * (topics.len() as i64 + 1);
        let id = *topics.entry(message.topic).or_insert_with(|| {
            let row = params![next, message.topic, definition(message.topic).0, "cdr", ""];
            change.execute("INSERT INTO topics VALUES(?, ?, ?, ?, ?)", row).unwrap();
            next
        });
        let data = if compressed { zstd::encode_all(&message.data[..], 1).unwrap() } else { message.data.clone() };
        let row = params![id, message.time as i64, data];
        change.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", row).unwrap();
    }
    change.commit().unwrap();
}

/// Everything that is read, but for names: shortest decimals that are read back to the same bits.
fn run_of(bytes: &[u8]) -> String {
    let file = qv_recording::BagFile { name: "bag".into(), source: bytes };
    format!("{:?}", qv_recording::read_bag([file], &qv_go2::wire::mapping(None)).unwrap())
}

#[test]
fn a_bag_in_sqlite_gives_the_bits_of_one_in_mcap() {
    let messages = walk(20.0);
    let right = run_of(&write(&messages, small_chunks(None), &[]));
    let folder = directory("kinds_sqlite");
    for (name, compressed, journal) in
        [("plain.db3", false, "delete"), ("messages.db3", true, "delete"), ("log.db3", false, "wal")]
    {
        let path = folder.join(name);
        write_database(&path, &messages, compressed, journal);
        let bytes = std::fs::read(&path).unwrap();
        assert!(run_of(&bytes) == right, "{name}");
        if !compressed {
            let packed = zstd::encode_all(&bytes[..], 1).unwrap();
            assert!(run_of(&packed) == right, "{name}.zstd");
        }
    }
    let packed = zstd::encode_all(&write(&messages, small_chunks(None), &[])[..], 1).unwrap();
    assert!(run_of(&packed) == right, "mcap.zstd");
}

#[test]
fn damaged_databases_say_so() {
    let messages = walk(2.0);
    let path = directory("kinds_damaged").join("bag.db3");
    write_database(&path, &messages, false, "delete");
    let bytes = std::fs::read(&path).unwrap();
    let (code, report, err) = inspect(&path);
    assert_eq!((code, count(&report, "/lowstate")), (0, 1000), "{err}");
    for share in [1, 10, 50, 90] {
        std::fs::write(&path, &bytes[..bytes.len() * share / 100]).unwrap();
        let (code, report, err) = inspect(&path);
        assert!(code == 1 || code == 3, "{share} %: {code} {err}");
        let said = if code == 3 { lost(&report) } else { err };
        assert!(said.contains("sqlite3"), "{share} %: {said}");
    }
    let mut noise = bytes.clone();
    noise.iter_mut().skip(3000).step_by(997).for_each(|b| *b ^= 0x5a);
    std::fs::write(&path, &noise).unwrap();
    let (code, report, err) = inspect(&path);
    assert!(code != 0, "{report:#} {err}");
}

#[test]
fn parts_that_were_renamed_or_compressed_lose_nothing() {
    let messages = walk(3.0);
    let part =
        |k: usize| write(&messages[k * messages.len() / 3..(k + 1) * messages.len() / 3], small_chunks(None), &[]);
    let yaml = "rosbag2_bagfile_information:\n  relative_file_paths:\n    - walk_0.mcap\n    - walk_1.mcap\n    - walk_2.mcap\n";
    let cases: [(&str, [&str; 3]); 4] = [
        ("letters", ["morning.mcap", "dusk.mcap", "evening.mcap"]),
        ("numbers", ["lab_9.mcap", "lab_10.mcap", "lab_11.mcap"]),
        ("compressed", ["walk_0.mcap.zstd", "walk_1.mcap.zstd", "walk_2.mcap.zstd"]),
        ("one", ["walk_0.mcap", "Walk (1).mcap", "walk_2.mcap"]),
    ];
    for (what, names) in cases {
        for listed in [true, false] {
            let path = directory(&format!("kinds_{what}_{listed}"));
            for (k, name) in names.iter().enumerate() {
                let bytes = if name.ends_with("zstd") { zstd::encode_all(&part(k)[..], 1).unwrap() } else { part(k) };
                std::fs::write(path.join(name), bytes).unwrap();
            }
            if listed {
                std::fs::write(path.join("metadata.yaml"), yaml).unwrap();
            }
            let (code, report, err) = inspect(&path);
            assert_eq!((code, count(&report, "/lowstate")), (0, 1500), "{what}, {listed}: {err} {report:#}");
        }
    }
}

#[test]
fn a_bag_of_ros_1_names_what_converts_it() {
    let path = directory("kinds_ros_1").join("walk.bag");
    std::fs::write(&path, b"#ROSBAG V2.0\n\x45\0\0\0\x10\0\0\0bag_encryptor=").unwrap();
    let (code, _, err) = inspect(&path);
    assert!(code == 1 && err.states("ROS 1") && err.contains("rosbags-convert"), "{err}");
    let other = path.with_file_name("walk.txt");
    std::fs::write(&other, "hello").unwrap();
    let (code, _, err) = inspect(&other);
    assert!(code == 1 && err.contains(".db3"), "{err}");
}

/// Over Wi-Fi messages arrive in bursts, and those of a burst in any order: by the robot's own count they are in order, and nothing is lost.
#[test]
fn a_burst_that_is_logged_backwards_is_read_by_the_clock_of_its_sender() {
    let mut messages = walk(6.0);
    for message in &mut messages {
        let late = (message.time - START) % 20_000_000;
        let place = late / 2_000_000;
        let place = if message.topic == "/lowstate" { 9 - place } else { place };
        message.time += 20_000_000 - late + 20_000 * place;
    }
    messages.sort_by_key(|message| message.time);
    let path = bag("kinds_bursts", &write(&messages, small_chunks(None), &[]));
    let (code, report, err) = inspect(&path);
    assert_eq!((code, &report["partial"]), (0, &serde_json::json!(false)), "{report:#} {err}");
    let clock = |topic: &str| {
        let streams = report["streams"].as_array().unwrap();
        streams.iter().find(|s| s["name"] == topic).unwrap()["clock"].clone()
    };
    assert_eq!((clock("/lowstate"), clock("/lowcmd")), ("tick".into(), "log".into()), "{report:#}");
    let (_, screen, _) = qv(&["inspect", path.to_str().unwrap()]);
    assert!(screen.contains("sender (tick)") && !screen.contains("out of order"), "{screen}");
}
