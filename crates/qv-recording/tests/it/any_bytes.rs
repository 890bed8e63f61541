//! Whatever bytes come, decoders answer with a result: the same entry points that `fuzz/` explores without end.

use crate::facts::States;
use proptest::prelude::*;
use qv_recording::cdr::decode;
use qv_recording::mapping::{Channel, ChannelFields, Mapping, MessageMapping, StreamMapping};
use qv_recording::plan::{FieldSelection, Plan};
use qv_recording::schema::Schema;
use qv_recording::{BagFile, read_bag, read_table};
use std::collections::BTreeMap;
use std::io::Cursor;

fn mapping() -> Mapping {
    let wanted = |path: &str| vec![FieldSelection { path: path.into(), elements: vec![0, 1] }];
    let channel = |channel, path: &str| ChannelFields { channel, fields: wanted(path) };
    let stream = |topic: &str, fields| StreamMapping {
        role: "test".into(),
        preferred_topic: topic.into(),
        messages: vec![MessageMapping { name: "p/msg/Arm".into(), names: None, fields }],
        ..Default::default()
    };
    Mapping {
        robot: "arm".into(),
        joint_names: vec!["a".into(), "b".into()],
        position_limits: vec![(-2.0, 2.0); 2],
        effort_limits: vec![5.0; 2],
        streams: vec![stream("/arm", vec![channel(Channel::Position, "q"), channel(Channel::Velocity, "motor[].dq")])],
        ..Default::default()
    }
}

const ARM: &str = "float64[] q\nMotor[2] motor\n===\nMSG: p/Motor\nfloat32 dq\nstring note\n";

fn arm_message(k: u32) -> Vec<u8> {
    let mut w = qv_recording::cdr::Writer::new();
    w.f64_sequence(&[0.1 * f64::from(k), -0.2]);
    w.f32(0.1).string("x").f32(0.2).string("");
    w.finish()
}

fn arm_bag(compression: Option<mcap::Compression>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let options = mcap::WriteOptions::new().compression(compression).chunk_size(Some(400));
    let mut writer = mcap::Writer::with_options(Cursor::new(&mut bytes), options).unwrap();
    let schema = writer.add_schema("p/msg/Arm", "ros2msg", ARM.as_bytes()).unwrap();
    let channel = writer.add_channel(schema, "/arm", "cdr", &BTreeMap::new()).unwrap();
    for k in 0..40 {
        let time = 1_000_000_000 + 10_000_000 * u64::from(k);
        let header =
            mcap::records::MessageHeader { channel_id: channel, sequence: k, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, &arm_message(k)).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes
}

fn read(bytes: &[u8]) -> Result<qv_recording::Run, qv_recording::RecordingError> {
    read_bag([BagFile { name: "test".into(), source: bytes }], &mapping())
}

/// No series of a run may hold an infinity or stamps that do not rise.
fn sound(run: &qv_recording::Run) {
    let position = run.measured.position.as_ref().expect("a run has positions");
    assert!(position.time.windows(2).all(|w| w[1] > w[0]) && position.time.iter().all(|t| t.is_finite()));
    assert!(!position.values.iter().any(|x| x.is_infinite()));
}

#[test]
fn another_robot_than_the_go2_is_read() {
    let run = read(&arm_bag(None)).unwrap();
    assert_eq!(run.measured.position.as_ref().unwrap().row(3), [0.1 * 3.0, -0.2]);
    assert_eq!(run.measured.velocity.as_ref().unwrap().row(3), [f64::from(0.1f32), f64::from(0.2f32)]);
    assert_eq!((run.epoch, run.lost.len()), (1_000_000_000, 0));
}

/// Found by fuzzing: a schema record that claims a name of 3 GB, and a position column without a joint.
#[test]
fn claims_and_empty_names() {
    let mut file = b"\x89MCAP0\r\n".to_vec();
    file.extend([3, 40, 0, 0, 0, 0, 0, 0, 0]);
    file.extend([0xc8; 40]);
    let error = read(&file).unwrap_err().to_string();
    assert!(error.states("lengths"), "{error}");
    let error = read_table(&b"time,pos.\n0,1\n"[..], "robot = \"x\"", None, None).unwrap_err().to_string();
    assert!(error.states("joint"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..Default::default() })]

    #[test]
    fn damaged_bags(at in prop::collection::vec((0usize..20_000, any::<u8>()), 1..20), cut in 0usize..20_000, zstd: bool) {
        let mut bytes = arm_bag(zstd.then_some(mcap::Compression::Zstd));
        for (place, value) in at {
            let place = place % bytes.len();
            bytes[place] = value;
        }
        bytes.truncate(bytes.len().saturating_sub(cut % 500));
        if let Ok(run) = read(&bytes) {
            sound(&run);
        }
    }

    #[test]
    fn random_bytes_after_the_magic(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        let mut file = b"\x89MCAP0\r\n".to_vec();
        file.extend(bytes);
        prop_assert!(read(&file).is_err());
    }

    #[test]
    fn messages_of_any_bytes(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let schema = Schema::parse("p/msg/Arm", ARM).unwrap();
        let plan = Plan::compile(&schema, &[FieldSelection { path: "motor[].dq".into(), elements: vec![1, 0] }]).unwrap();
        let mut message = vec![0, 1, 0, 0];
        message.extend(bytes);
        let tree = decode(&schema, &message);
        let mut out = [0.0; 2];
        // Whatever the tree reader accepts, the plan accepts, with the same number.
        if let Ok(tree) = tree {
            plan.read(&message, &mut out).unwrap();
            let Some(qv_recording::cdr::Value::Array(motors)) = tree.get("motor") else { panic!("motors are an array") };
            let first = motors[0].get("dq").and_then(|v| v.as_f64()).unwrap();
            prop_assert_eq!(first.to_bits(), out[1].to_bits());
        }
    }

    #[test]
    fn schemas_of_any_text(text in "[a-zA-Z0-9/_\\[\\]<= #\"\n]{0,300}") {
        if let Ok(schema) = Schema::parse("p/T", &text) {
            // What decodes from zeros must do so within the zeros.
            let _ = decode(&schema, &[0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
            prop_assert!(!schema.types.is_empty());
        }
    }

    #[test]
    fn tables_of_any_text(csv in "(time,pos\\.a,cmd_pos\\.a\n)?([0-9a-z.,\\-\"\n]{0,40}\n){0,6}", toml in "(robot = \"x\"\n)?[a-z0-9=\\.\\[\\]\" \n]{0,60}") {
        if let Ok(run) = read_table(csv.as_bytes(), &toml, None, None) {
            sound(&run);
        }
        if let Ok(run) = read_table(csv.as_bytes(), "robot = \"x\"", None, None) {
            sound(&run);
        }
    }
}
