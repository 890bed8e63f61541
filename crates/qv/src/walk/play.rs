//! `qv walk play`.

use super::inputs::{TerrainOption, as_trained, command, ground_of, policy_of, robot_of, urdf_of};
use crate::open::write_error;
use crate::output::{make_folder, write_whole};
use crate::{Failure, Outcome, say};
use qv_policy::play::play;
use qv_policy::policy::OnnxDecision;
use qv_policy::velocity::{TaskSettings, VelocityTask};
use serde_json::json;
use std::path::PathBuf;

/// Commands that pages show: from when \[s\], and vx, vy \[m/s\], wz \[rad/s\].
pub const SHOWN: [(f32, [f32; 3]); 5] = [
    (0.0, [0.0, 0.0, 0.0]),
    (1.0, [0.5, 0.0, 0.0]),
    (4.0, [0.8, 0.0, 0.6]),
    (7.0, [0.0, 0.3, 0.0]),
    (10.0, [0.0, 0.0, 0.0]),
];

#[derive(clap::Args)]
pub struct Play {
    /// Policy of `qv walk train` (policy.onnx, with policy.toml beside it)
    policy: PathBuf,
    /// Set the robot: go2, go1, a1, a2, anymal_c, or a URDF, MJCF or TOML file
    #[arg(long, default_value = "go2", value_name = "ROBOT", help_heading = "Input")]
    robot: String,
    #[command(flatten)]
    terrain: TerrainOption,
    /// Command a velocity [m/s, m/s, rad/s; repeatable]
    ///
    /// Commands are held equally long. Default: forwards, a curve, sideways, standing.
    #[arg(long, value_name = "VX,VY,WZ", value_parser = command, allow_hyphen_values = true, help_heading = "What to test")]
    command: Vec<[f32; 3]>,
    /// Set the length of the walk
    #[arg(long, default_value_t = 12.0, value_name = "SECONDS", value_parser = hour, help_heading = "What to test")]
    seconds: f64,
    /// Set the random seed
    #[arg(long, default_value_t = 0, value_name = "N", help_heading = "Advanced", hide_short_help = true)]
    seed: u64,
    /// Write the results into this directory [created if missing]
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    out: PathBuf,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

/// Every decision is kept in memory: an hour is enough to look at.
fn hour(text: &str) -> Result<f64, String> {
    crate::numbers::within(text, 0.02, 3600.0)
}

impl Play {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        let (mut policy, file) = policy_of(&self.policy)?;
        let robot = as_trained(robot_of(&self.robot)?, &file, &self.policy)?;
        let substeps = (1.0 / (f64::from(file.rate) * file.timestep)).round() as usize;
        let settings =
            TaskSettings { rate: file.rate, clock: file.clock, substeps, episode: 1e4, ..Default::default() };
        let mut task = VelocityTask::new(robot.clone(), ground_of(&self.terrain.name, self.seed)?, settings, 1)?;
        let seconds = self.seconds as f32;
        let each = seconds / self.command.len().max(1) as f32;
        let commands: Vec<(f32, [f32; 3])> = match self.command.is_empty() {
            true => SHOWN.to_vec(),
            false => self.command.iter().enumerate().map(|(k, &c)| (k as f32 * each, c)).collect(),
        };
        let played =
            play(OnnxDecision { policy: &mut policy, robot: &robot }, &mut task, &commands, seconds, self.seed)?;
        make_folder(&self.out).map_err(|e| write_error(&self.out, &e))?;
        let title = format!("{} on {}", file.robot, self.terrain.name);
        write_whole(&self.out.join("play.json"), format!("{}\n", serde_json::to_string(&played)?).as_bytes())?;
        let page = super::page::page(&title, &[], None, &played, &file);
        write_whole(&self.out.join("walk.html"), page.as_bytes())?;
        super::recording::write_recording(&self.out.join("replay.mcap"), &played, &urdf_of(&self.robot)?)?;
        let fell = played.fell.map(|step| step as f32 / played.rate);
        if self.json {
            say(&format!(
                "{}\n",
                json!({"format": "qv-walk-play/1", "seconds": seconds, "fell_at_s": fell, "out": self.out})
            ))?;
            return Ok(Outcome::Done);
        }
        let how = match fell {
            Some(time) => format!("it fell after {time:.1} s"),
            None => format!("it walked for {seconds:.1} s"),
        };
        say(&format!("{how}; written to {}\n", self.out.display()))?;
        Ok(Outcome::Done)
    }
}
