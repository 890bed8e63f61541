//! Recordings of other programs: LeRobot datasets, SAGE folders, CSV files of Unitree's LowState.

use crate::bags::*;
use crate::facts::States;
use qv_recording::foreign::lerobot::{Info, table};
use qv_recording::foreign::{Settings, Table};
use serde_json::json;
use std::fs;
use std::path::{Path, PathBuf};

const URDF: &str = "<robot name=\"arm\"><link name=\"base\"/><link name=\"upper\"/><link name=\"lower\"/></robot>";
const TOML: &str = "robot = \"arm.urdf\"\nbase = \"fixed\"\n[dataset]\nunit = \"deg\"\n";

fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/lerobot")
}

/// The one or two Parquet files of a version's dataset.
fn parquet(version: &str) -> Vec<String> {
    let folder = fixtures().join(version).join("data/chunk-000");
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|e| format!("data/chunk-000/{}", e.unwrap().file_name().display())).collect();
    names.sort();
    names
}

fn of_fixture(version: &str, toml: &str) -> Result<Table, String> {
    let root = fixtures().join(version);
    let info = Info::read(&fs::read_to_string(root.join("meta/info.json")).unwrap()).unwrap();
    let mut file = |name: &str| fs::read(root.join(name)).map_err(|e| e.to_string());
    table(&info, &parquet(version), &mut file, &Settings::of(toml).unwrap()).map_err(|e| e.to_string())
}

#[test]
fn both_versions_of_a_dataset_are_the_same_numbers() {
    for episode in 0..2 {
        let toml = format!("[dataset]\nunit = \"deg\"\nepisode = {episode}");
        let (two, three) = (of_fixture("v2", &toml).unwrap(), of_fixture("v3", &toml).unwrap());
        assert_eq!(two.csv, three.csv);
        let mut lines = two.csv.lines();
        let header = "time_s,pos.shoulder_pan,pos.elbow_flex,cmd_pos.shoulder_pan,cmd_pos.elbow_flex";
        assert_eq!(lines.next(), Some(header));
        let cells: Vec<f64> = lines.nth(5).unwrap().split(',').map(|cell| cell.parse().unwrap()).collect();
        let angle = 0.2 * std::f64::consts::PI;
        let action = [30.0 * angle.sin() + 10.0 * f64::from(episode), 20.0 * angle.cos()].map(f64::to_radians);
        let expected = [0.1, 0.98 * action[0], 0.98 * action[1], action[0], action[1]];
        assert!(cells.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{cells:?} {expected:?}");
        assert_eq!(two.csv.lines().count(), 41);
        assert!(three.remarks[0].contains(&format!("episode {episode} of 2")), "{:?}", three.remarks);
    }
    let error = of_fixture("v3", "[dataset]\nepisode = 7").unwrap_err();
    assert!(error.states("7 1 Parquet"), "{error}");
    let error = of_fixture("v3", "[dataset]\njoints = [\"a\"]").unwrap_err();
    assert!(error.states("joints 2"), "{error}");
    let left_out =
        of_fixture("v2", "[dataset]\njoints = [\"\", \"elbow\"]\n[dataset.joint.elbow]\nscale = 2\noffset = 1")
            .unwrap();
    assert!(left_out.csv.starts_with("time_s,pos.elbow,cmd_pos.elbow\n0,40.2"), "{}", &left_out.csv[..62]);
}

#[test]
fn damaged_parquet_files_are_errors() {
    let root = fixtures().join("v3");
    let info = Info::read(&fs::read_to_string(root.join("meta/info.json")).unwrap()).unwrap();
    let good = fs::read(root.join(&parquet("v3")[0])).unwrap();
    let read = |bytes: &[u8]| {
        let mut file = |_: &str| Ok(bytes.to_vec());
        table(&info, &["x.parquet".to_string()], &mut file, &Settings::default()).map_err(|e| e.to_string())
    };
    assert!(read(&good).is_ok());
    for length in (0..good.len()).step_by(61) {
        let error = read(&good[..length]).unwrap_err();
        assert!(error.states("x.parquet Parquet"), "{error}");
    }
    // Every bit that is turned gives a table or an error with words.
    for at in 0..good.len() {
        let mut bytes = good.clone();
        bytes[at] ^= 1 << (at % 8);
        if let Err(error) = read(&bytes) {
            assert!(error.contains("expected"), "{error}");
        }
    }
}

fn copied(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        if path.is_dir() { copied(&path, &target) } else { fs::copy(&path, &target).map(|_| ()).unwrap() }
    }
}

#[test]
fn a_dataset_is_inspected() {
    for version in ["v2", "v3"] {
        let folder = directory(&format!("lerobot_{version}"));
        copied(&fixtures().join(version), &folder);
        let (code, _, err) = inspect(&folder);
        assert!(code == 1 && err.contains("run.toml") && err.states("robot"), "{err}");
        fs::write(folder.join("run.toml"), TOML).unwrap();
        fs::write(folder.join("arm.urdf"), URDF).unwrap();
        let file = folder.join(&parquet(version)[0]);
        for path in [&folder, &file] {
            let (code, report, err) = inspect(path);
            assert_eq!(code, 0, "{err} {report:#}");
            assert_eq!(report["joints"], json!(["shoulder_pan", "elbow_flex"]));
            assert!((report["duration"].as_f64().unwrap() - 0.78).abs() < 1e-6, "{report:#}");
        }
    }
}

#[test]
fn a_folder_of_sage_and_a_csv_of_lowstate_are_inspected() {
    let folder = directory("sage");
    let (mut state, mut control) = ("type,timestamp,positions\n".to_string(), "type,timestamp,positions\n".to_string());
    for k in 0..100 {
        let x = (0.1 * f64::from(k)).sin();
        state += &format!("StateMotor,{},\"[{x}, {x}]\"\n", 20_000 * k);
        control += &format!("Control,{},\"[{x}, {x}]\"\n", 20_000 * k + 137);
    }
    for (name, text) in [
        ("state_motor.csv", &*state),
        ("control.csv", &*control),
        ("joint_list.txt", "hip\nknee\n"),
        ("run.toml", "robot = \"arm.urdf\""),
        ("arm.urdf", URDF),
    ] {
        fs::write(folder.join(name), text).unwrap();
    }
    let (code, report, err) = inspect(&folder);
    assert_eq!(code, 0, "{err} {report:#}");
    assert_eq!(report["joints"], json!(["hip", "knee"]));
    assert!((report["duration"].as_f64().unwrap() - 1.98).abs() < 1e-9, "{report:#}");

    let folder = directory("lowstate");
    let mut csv = "timestamp".to_string();
    (0..12).for_each(|k| {
        csv += &format!(",motor_state[{k}].q,motor_state[{k}].dq,motor_state[{k}].temperature,motor_cmd[{k}].q")
    });
    csv += ",imu_state.quaternion[0],imu_state.quaternion[1],imu_state.quaternion[2],imu_state.quaternion[3],crc\n";
    for row in 0..200 {
        csv += &format!("{:.3}", 0.002 * f64::from(row));
        let swing = 0.05 * (0.1 * f64::from(row)).sin();
        // The wire has FR first, whose hip is at -0.1 in the stand.
        (0..12).for_each(|k| {
            let stand = STAND[(k + 3) % 6 + k / 6 * 6];
            csv += &format!(",{:.6},{:.6},30,{stand}", stand + swing, 2.5 * (0.1 * f64::from(row)).cos())
        });
        csv += ",1,0,0,0,77\n";
    }
    fs::write(folder.join("lowstate.csv"), csv).unwrap();
    fs::write(folder.join("run.toml"), "robot = \"go2\"\n").unwrap();
    let (code, report, err) = inspect(&folder.join("lowstate.csv"));
    assert_eq!(code, 0, "{err} {report:#}");
    assert_eq!((report["joints"].as_array().unwrap().len(), report["base"].as_str()), (12, Some("free")));
    let channels = report["channels"].as_array().unwrap();
    assert!(
        channels.iter().any(|c| c["name"] == "orientation" || c["name"].as_str().unwrap_or("").contains("orientation")),
        "{report:#}"
    );
}
