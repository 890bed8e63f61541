//! A robot learns to follow velocity commands on the plane, and writes its policy and the checkpoint of `qv tune`, for studies of many seeds:
//! `cargo run --release -p quadverse-policy --example train -- FOLDER [SEED [ITERATIONS [SETTINGS.toml [ROBOT]]]]`. The robot is the Go2, one of the
//! list by its name, or a URDF or MJCF of one file. The last line is JSON.

use cpu_time::ProcessTime;
use qv_policy::PolicyError;
use qv_policy::policy::PolicyFile;
use qv_policy::stand::StandReport;
use qv_policy::train::{TrainSettings, Training};
use qv_policy::velocity::{Ground, RobotFile, TaskRobot, known_robot};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let folder = Path::new(words.first().ok_or("expected a folder for the policy, found none")?);
    let mut settings = match words.get(3) {
        Some(file) => toml::from_str(&std::fs::read_to_string(file)?)?,
        None => TrainSettings::default(),
    };
    settings.seed = words.get(1).map_or(Ok(settings.seed), |word| word.parse())?;
    let iterations: u64 = words.get(2).map_or(Ok(ITERATIONS), |word| word.parse())?;
    let robot = match words.get(4) {
        Some(name) => robot(name)?,
        None => qv_go2::walk::robot()?,
    };
    println!(
        "{:?} kp {:?} stand {:?} mirror {:?}",
        StandReport::of(&robot)?,
        robot.kp,
        robot.stand,
        robot.mirror().err()
    );
    StandReport::of(&robot)?.check()?;
    let clock = ProcessTime::now();
    let mut training = Training::new(&robot, &Ground::plane(), &settings)?;
    while training.ppo().iterations < iterations {
        let line = training.advance()?;
        if let Some(score) = line.score {
            let (std, rate) = (line.iteration.std, line.iteration.rate);
            println!("{} std {std} rate {rate} {score:?} {:?}", training.ppo().iterations, line.figures);
        }
    }
    let seconds = clock.elapsed().as_secs_f64();
    let (score, policy) =
        training.best().ok_or(PolicyError::Text { what: "training".into(), reason: "no score".into() })?;
    std::fs::create_dir_all(folder)?;
    std::fs::write(folder.join("policy.onnx"), policy.to_onnx(&robot)?)?;
    std::fs::write(folder.join("last.onnx"), training.policy().to_onnx(&robot)?)?;
    let file = PolicyFile::new(&robot, &settings.task, "plane", Some(score.clone()));
    std::fs::write(folder.join("policy.toml"), file.to_text()?)?;
    std::fs::write(folder.join("checkpoint.bin"), training.checkpoint_now().to_bytes()?)?;
    println!("{}", serde_json::json!({ "seed": settings.seed, "cpu_seconds": seconds, "score": score }));
    Ok(())
}

fn robot(name: &str) -> Result<TaskRobot, Box<dyn Error>> {
    match known_robot(name) {
        Some((file, model)) => Ok(RobotFile::parse(file)?.robot(model)?),
        None => Ok(RobotFile::bare(name).robot(&std::fs::read_to_string(name)?)?),
    }
}

/// Those of a default training on the plane.
const ITERATIONS: u64 = 900;
