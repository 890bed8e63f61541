//! `qv walk score`.

use super::inputs::{as_trained, ground_of, policy_of, range, robot_of};
use crate::{Failure, Outcome, say};
use qv_policy::policy::OnnxDecision;
use qv_policy::score::{Score, score};
use qv_policy::velocity::{TaskSettings, VelocityTask};
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct ScoreArguments {
    /// policy.onnx of `qv walk train`, with policy.toml beside it
    policy: PathBuf,
    /// go2, or a TOML file that describes a robot beside its URDF
    #[arg(long, default_value = "go2", value_name = "go2|FILE.toml")]
    robot: String,
    /// Where it walks
    #[arg(long, default_value = "plane", value_name = "plane|bumps|levels|FILE.glb")]
    ground: String,
    /// Robots, each with its own command
    #[arg(long, default_value_t = 64, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    robots: u32,
    /// How long each walks, in seconds
    #[arg(long, default_value_t = 8.0, value_name = "SECONDS", value_parser = crate::numbers::positive)]
    seconds: f64,
    /// Commands forwards, in m/s; default: those of the training
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true)]
    vx: Option<[f32; 2]>,
    /// Commands to the left, in m/s
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true)]
    vy: Option<[f32; 2]>,
    /// Commands to turn, in rad/s
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true)]
    wz: Option<[f32; 2]>,
    /// Physics steps of a decision, and Newton iterations: finer than in training, to see that it does not matter
    #[arg(long, value_name = "N")]
    substeps: Option<usize>,
    /// Robots differ as in a training with --robust (friction, mass, gains, latency, encoders), and are pushed
    #[arg(long)]
    robust: bool,
    /// Seed of the commands
    #[arg(long, default_value_t = 0, value_name = "N")]
    seed: u64,
    /// JSON instead of a sentence
    #[arg(long)]
    json: bool,
}

impl ScoreArguments {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        let (mut policy, file) = policy_of(&self.policy)?;
        let robot = as_trained(robot_of(&self.robot)?, &file, &self.policy)?;
        let ground = ground_of(&self.ground, self.seed)?;
        let mut settings = TaskSettings { rate: file.rate, episode: 1e4, ..Default::default() };
        settings.substeps =
            self.substeps.unwrap_or_else(|| (1.0 / (f64::from(file.rate) * file.timestep)).round() as usize);
        if self.substeps.is_some() {
            settings.iterations = 30;
        }
        if self.robust {
            settings.randomise = qv_policy::velocity::Randomise::robust(&robot.model.links[0].name);
        }
        let mut commands = file.commands.clone();
        for (given, range) in [(self.vx, &mut commands.vx), (self.vy, &mut commands.vy), (self.wz, &mut commands.wz)] {
            *range = given.unwrap_or(*range);
        }
        let mut task = VelocityTask::new(robot.clone(), ground, settings, self.robots as usize)?;
        task.varied = self.robust;
        let decision = OnnxDecision { policy: &mut policy, robot: &robot };
        let found = score(decision, &mut task, &commands, self.seconds as f32, self.seed)?;
        match self.json {
            true => {
                let mut line = serde_json::to_value(&found)?;
                line["format"] = "qv-walk-score/1".into();
                say(&format!("{line}\n"))?
            }
            false => say(&format!("{}\n", sentence(&found)))?,
        }
        Ok(Outcome::Done)
    }
}

/// A score in words.
pub fn sentence(score: &Score) -> String {
    format!(
        "{} of {} robots fell. Velocity is off by {:.3} ± {:.3} m/s, turning by {:.3} ± {:.3} rad/s; a swing lasts {:.2} s and clears {:.1} cm.",
        score.fell,
        score.robots,
        score.velocity_error,
        score.velocity_error_se,
        score.turning_error,
        score.turning_error_se,
        score.swing_time,
        100.0 * score.swing_height
    )
}
