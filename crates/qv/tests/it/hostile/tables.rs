//! Tables whose stamps are no seconds, whose headers are novels, and whose names move the cursor.

use super::bounded;
use crate::bags::directory;
use std::fs;
use std::path::PathBuf;
use std::process::Command;

const TOML: &str =
    "robot = \"robot.urdf\"\nbase = \"fixed\"\n[actuator]\nkind = \"pd\"\nkp = 10.0\nkd = 0.5\ntau_max = 5.0\n";

/// A table of one joint of an arm, which its motor swings every 2 ms of its own time as it would.
pub fn table(name: &str, joint: &str, rows: usize, step: f64) -> PathBuf {
    let folder = directory(name);
    let urdf = format!(
        "<robot name='arm'><link name='base'/><link name='arm'><inertial><origin xyz='0.1 0 0'/><mass value='1'/>\
         <inertia ixx='0.01' iyy='0.01' izz='0.01' ixy='0' ixz='0' iyz='0'/></inertial></link>\
         <joint name='{joint}' type='revolute'><parent link='base'/><child link='arm'/><axis xyz='0 1 0'/>\
         <limit effort='5' velocity='20' lower='-3' upper='3'/></joint></robot>"
    );
    let mut csv = format!("time,pos.{joint},vel.{joint},cmd_pos.{joint}\n");
    let (mut q, mut dq) = (0.0f64, 0.0f64);
    for k in 0..rows {
        let (time, phase) = (step * k as f64, 0.002 * k as f64 * 3.0);
        let command = 0.4 * phase.sin() + 0.2 * (3.7 * phase).sin();
        csv += &format!("{time:e},{q:.6},{dq:.6},{command:.6}\n");
        for _ in 0..4 {
            let torque = (10.0 * (command - q) - 0.5 * dq).clamp(-5.0, 5.0) + 9.81 * 0.1 * q.cos();
            dq += 0.0005 * torque / 0.02;
            q += 0.0005 * dq;
        }
    }
    fs::write(folder.join("robot.urdf"), urdf).unwrap();
    fs::write(folder.join("run.csv"), csv).unwrap();
    fs::write(folder.join("run.toml"), TOML).unwrap();
    folder
}

#[test]
fn stamps_that_are_no_seconds_are_refused() {
    for (name, step) in [("hostile_denormal", 5e-324), ("hostile_tiny", 1e-12)] {
        let folder = table(name, "j", 2000, step);
        let (out, run) = (folder.join("out"), folder.to_str().unwrap());
        for command in ["inspect", "replay", "diagnose"] {
            let mut arguments = vec![command, run];
            if command != "inspect" {
                arguments.extend(["--out", out.to_str().unwrap()]);
            }
            let (code, _, err) = bounded(&arguments);
            assert_eq!(code, 1, "{command}: {err}");
        }
    }
}

#[test]
fn headers_of_megabytes_are_not_printed() {
    let folder = table("hostile_header", "j", 100, 0.002);
    let long = "x".repeat(1 << 20);
    let many: String = (0..100_000).map(|k| format!(",pos.{k}")).collect();
    for header in [format!("{long},{long}"), format!("time{many}"), format!("time,pos.\u{1b}]0;title\u{7}{long}")] {
        fs::write(folder.join("run.csv"), format!("{header}\n1,2\n2,3\n")).unwrap();
        let (_, out, err) = bounded(&["inspect", folder.to_str().unwrap()]);
        assert!(out.len() + err.len() < 20_000, "{} and {} bytes", out.len(), err.len());
        assert!(!out.contains('\u{1b}') && !err.contains('\u{1b}') && !err.contains('\u{7}'), "{err:?}");
    }
}

/// Processor time of a replay of so many rows [s], as the shell counts it.
fn cost(rows: usize) -> f64 {
    let folder = table(&format!("hostile_rows_{rows}"), "j", rows, 0.002);
    let output = Command::new("sh")
        .args(["-c", "\"$0\" \"$@\" >&2; times", env!("CARGO_BIN_EXE_qv"), "replay", folder.to_str().unwrap(), "--out"])
        .arg(folder.join("out"))
        .output()
        .unwrap();
    assert!(folder.join("out/replay.json").is_file(), "{}", String::from_utf8_lossy(&output.stderr));
    fs::remove_dir_all(&folder).unwrap();
    // The second line has those of children: `0m1.234s 0m0.123s`.
    let said = String::from_utf8(output.stdout).unwrap();
    let seconds = |word: &str| {
        let (minutes, seconds) = word.trim_end_matches('s').split_once('m').unwrap();
        60.0 * minutes.parse::<f64>().unwrap() + seconds.parse::<f64>().unwrap()
    };
    said.lines().nth(1).unwrap().split_whitespace().map(seconds).sum()
}

#[test]
fn a_replay_takes_time_in_proportion_to_its_rows() {
    let (short, long) = (cost(20_000), cost(120_000));
    // Six times the rows. What is done once for each window and looks at all rows would make it twelve times and more.
    assert!(long < 10.0 * short, "{short} s and {long} s");
}
