//! Databases that compute, and files that unpack to more than anybody has.

use super::bounded;
use crate::bags::{bag, directory, small_chunks, walk, write};
use rusqlite::Connection;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

const TOPICS: &str = "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,
    offered_qos_profiles TEXT); INSERT INTO topics VALUES (1, '/joint_states', 'sensor_msgs/msg/JointState', 'cdr', '');";

fn database(folder: &Path, name: &str, messages: &str) -> PathBuf {
    let path = folder.join(name);
    let database = Connection::open(&path).unwrap();
    database.execute_batch(&format!("{TOPICS} {messages}")).unwrap();
    path
}

#[test]
fn databases_hold_what_they_store() {
    let folder = directory("hostile_db3");
    let start = "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER";
    let rows = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 200)
        INSERT INTO messages(topic_id, timestamp) SELECT 1, i FROM n;";
    let cases = [
        ("zeros.db3", format!("{start}, data BLOB AS (zeroblob(900000000))); {rows}")),
        (
            "replaced.db3",
            format!("{start}, data BLOB AS (replace(hex(zeroblob(9000)), '0', hex(zeroblob(9000))))); {rows}"),
        ),
        (
            "default.db3",
            format!("{start}); {rows} ALTER TABLE messages ADD data BLOB DEFAULT x'{}';", "00".repeat(50_000)),
        ),
        (
            "view.db3",
            "CREATE VIEW messages(id, topic_id, timestamp, data) AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL
            SELECT i + 1 FROM n) SELECT i, 1, i, zeroblob(1000000) FROM n;"
                .into(),
        ),
    ];
    for (name, messages) in cases {
        let path = database(&folder, name, &messages);
        let (code, _, err) = bounded(&["inspect", path.to_str().unwrap()]);
        assert_eq!(code, 1, "{name}: {err}");
    }
}

#[test]
fn compressed_files_unpack_to_a_hundred_times_themselves() {
    let folder = directory("hostile_zstd");
    for (name, head) in [("bomb.db3.zstd", &b"SQLite format 3\0"[..]), ("bomb.mcap.zstd", b"\x89MCAP0\r\n")] {
        let path = folder.join(name);
        let mut packed = zstd::stream::write::Encoder::new(fs::File::create(&path).unwrap(), 1).unwrap();
        packed.write_all(head).unwrap();
        let zeros = vec![0u8; 1 << 20];
        (0..2000).for_each(|_| packed.write_all(&zeros).unwrap());
        packed.finish().unwrap();
        assert!(fs::metadata(&path).unwrap().len() < 1 << 20);
        let (code, _, err) = bounded(&["inspect", path.to_str().unwrap()]);
        assert_eq!(code, 1, "{err}");
    }
}

/// An MCAP of chunks, each of which claims and holds as many zeros.
fn chunks(count: usize, zeros: usize) -> Vec<u8> {
    let packed = zstd::encode_all(vec![0u8; zeros].as_slice(), 1).unwrap();
    let mut chunk = vec![0u8; 16];
    chunk.extend((zeros as u64).to_le_bytes());
    chunk.extend([0u8; 4]);
    chunk.extend(4u32.to_le_bytes());
    chunk.extend(b"zstd");
    chunk.extend((packed.len() as u64).to_le_bytes());
    chunk.extend(packed);
    let mut file = b"\x89MCAP0\r\n".to_vec();
    for _ in 0..count {
        file.push(6);
        file.extend((chunk.len() as u64).to_le_bytes());
        file.extend(&chunk);
    }
    file
}

#[test]
fn chunks_share_the_bytes_that_a_file_may_unpack_to() {
    let bytes = chunks(40, 1 << 27);
    assert!(bytes.len() < 1 << 20, "{}", bytes.len());
    let (code, _, _) = bounded(&["inspect", bag("hostile_chunks", &bytes).to_str().unwrap()]);
    assert_eq!(code, 1);
}

#[test]
fn a_good_bag_is_read_whole_within_the_limits() {
    let messages = walk(1.0);
    let plain = write(&messages, small_chunks(Some(mcap::Compression::Zstd)), &[]);
    let (code, out, err) = bounded(&["inspect", "--json", bag("hostile_good", &plain).to_str().unwrap()]);
    assert_eq!(code, 0, "{err}");
    let report: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(report["partial"], false, "{report:#}");
}
