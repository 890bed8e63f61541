//! A Parquet file of a LeRobot dataset; and the same bytes, cut at a byte 255, as SAGE's two files and as a CSV of motors.
#![no_main]
use libfuzzer_sys::fuzz_target;
use qv_recording::foreign::motor_csv::Motors;
use qv_recording::foreign::{Settings, Table, lerobot, motor_csv, sage};
use qv_recording::read_table;

const INFO: &str = "{\"codebase_version\": \"v3.0\", \"total_episodes\": 2, \"features\": {\"observation.state\": \
    {\"names\": [\"shoulder_pan\", \"elbow_flex\"]}, \"action\": {}}}";

fn check(table: &Table) {
    // What was made is a table, whatever its numbers are.
    if let Ok(run) = read_table(table.csv.as_bytes(), "robot = \"x\"", None, None) {
        let position = run.measured.position.expect("a run has positions");
        assert!(position.time.windows(2).all(|w| w[1] > w[0]));
    }
}

fuzz_target!(|data: &[u8]| {
    let settings = Settings::default();
    let info = lerobot::Info::read(INFO).expect("our own description is good");
    let mut file = |_: &str| Ok(data.to_vec());
    if let Ok(table) = lerobot::table(&info, &["a.parquet".into()], &mut file, &settings) {
        check(&table);
    }
    let split = data.iter().position(|&b| b == 0xff).unwrap_or(data.len());
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (first, second) = (text(&data[..split]), text(data.get(split + 1..).unwrap_or(&[])));
    if let Ok(table) = sage::table(&first, Some(&second), Some("a\nb"), &settings) {
        check(&table);
    }
    let motors =
        Motors { joints: vec!["FR_hip_joint".into(), "FR_thigh_joint".into()], wire: Some(vec![1, 0]), first: None };
    if let Ok(table) = motor_csv::table(&first, &motors) {
        check(&table);
    }
    let _ = Settings::of(&first);
});
