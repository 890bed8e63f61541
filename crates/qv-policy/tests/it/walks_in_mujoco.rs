//! A policy that learnt in our simulator walks in MuJoCo as it does in ours: same commands, same time, nobody falls. Wants a Python with
//! MuJoCo and onnxruntime (`QV_PYTHON_ONNX`), and says that it skips without one.

use crate::short::{settings, trained};
use crate::skipped::skipped;
use qv_policy::policy::PolicyFile;
use qv_policy::score::score;
use qv_policy::velocity::{Ground, TaskSettings, VelocityTask};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Robots, each under a command of its own, and how long they walk \[s\].
const RUNS: usize = 64;
const SECONDS: f32 = 8.0;

/// A Python that has what `fixtures/mujoco/walk.py` imports.
fn python() -> Option<PathBuf> {
    let candidate = std::env::var_os("QV_PYTHON_ONNX").map_or_else(|| PathBuf::from("python3"), PathBuf::from);
    let works = Command::new(&candidate).args(["-c", "import mujoco, onnxruntime"]).output();
    works.ok().filter(|output| output.status.success()).map(|_| candidate)
}

#[test]
fn a_short_training_walks_in_mujoco() {
    let Some(python) = python() else {
        skipped("no Python with mujoco and onnxruntime (cargo xtask test makes one)");
        return;
    };
    let robot = qv_go2::walk::robot().unwrap();
    let trained = trained();
    // As MuJoCo walks: 1 ms, contacts solved to the end, and below with the same commands.
    let task = TaskSettings { substeps: 20, iterations: 30, episode: 1e4, ..settings().task };
    let mut judge = VelocityTask::new(robot.clone(), Ground::plane(), task.clone(), RUNS).unwrap();
    let ours = score(&trained.policy, &mut judge, &task.commands, SECONDS, 0).unwrap();

    let commands: Vec<[f32; 3]> = judge.walkers().iter().map(|walker| walker.command).collect();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("walks_in_mujoco");
    std::fs::create_dir_all(&folder).unwrap();
    let (policy, table) = (folder.join("policy.onnx"), folder.join("policy.toml"));
    std::fs::write(&policy, trained.policy.to_onnx(&robot).unwrap()).unwrap();
    let file = PolicyFile::new(&robot, &settings().task, "plane", Some(trained.score));
    std::fs::write(&table, file.to_text().unwrap()).unwrap();
    let same = folder.join("commands.json");
    std::fs::write(&same, serde_json::to_string(&commands).unwrap()).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/mujoco/walk.py");
    let mut command = Command::new(python);
    command.env("PYTHONDONTWRITEBYTECODE", "1").arg(script).args([&policy, &table]);
    command.arg("--commands").arg(&same).args(["--seconds", &SECONDS.to_string()]);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    println!("MuJoCo {found}\nours {ours:?}");

    assert_eq!(
        (found["runs"].as_u64(), found["falls"].as_u64(), ours.fell),
        (Some(RUNS as u64), Some(0), 0),
        "{found}"
    );
    let of = |key: &str| found[key].as_f64().unwrap() as f32;
    let (velocity, turning) = (of("mean_velocity_error"), of("mean_turning_error"));
    assert!((velocity - ours.velocity_error).abs() < 0.03, "velocity {velocity} and {} m/s", ours.velocity_error);
    assert!((turning - ours.turning_error).abs() < 0.05, "turning {turning} and {} rad/s", ours.turning_error);
}
