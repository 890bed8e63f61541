//! The Go2 learns to follow velocity commands on the plane, and writes its policy:
//! `cargo run --release -p quadverse-policy --example train -- policy.onnx`.

use qv_policy::PolicyError;
use qv_policy::train::{TrainSettings, Training};
use qv_policy::velocity::Ground;
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let file = std::env::args().nth(1).ok_or("expected the name of a file for the policy, found none")?;
    let robot = qv_go2::walk::robot()?;
    let mut training = Training::new(&robot, &Ground::plane(), &TrainSettings::default())?;
    while training.ppo().iterations < 300 {
        let line = training.advance()?;
        if let Some(score) = line.score {
            let millions = line.samples as f64 / 1e6;
            let (v, w) = (score.velocity_error, score.turning_error);
            println!(
                "{millions:.2} million samples: {v:.3} m/s and {w:.3} rad/s off, {} of {} fell",
                score.fell, score.robots
            );
        }
    }
    let (_, policy) =
        training.best().ok_or(PolicyError::Text { what: "training".into(), reason: "no score".into() })?;
    std::fs::write(file, policy.to_onnx(&robot)?)?;
    Ok(())
}
