//! A made-up robot with hidden effects, in the place of a real one.

use super::inputs::{ROOM, TerrainOption, as_trained, checkpoint_of, ground_of, of_mesh, policy_of, robot_of};
use crate::Failure;
use crate::fixture::label_and_value;
use qv_policy::policy::Policy;
use qv_policy::velocity::{Ground, TaskRobot, TaskSettings};
use qv_residual::hidden::{Engine, HiddenRobot};
use std::fmt::Write;
use std::path::Path;

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Effects {
    /// Effects that parameters describe: latency, lag, friction, strength
    Inside,
    /// Latency, lag and one effect that no parameter describes, by seed
    Outside,
    /// No effect
    Nothing,
}

/// Which robot, and where.
#[derive(clap::Args)]
pub struct MadeUp {
    /// Set the robot: go2, go1, a1, a2, anymal_c, or a URDF, MJCF or TOML file
    #[arg(long, default_value = "go2", value_name = "ROBOT", help_heading = "Input")]
    pub robot: String,
    #[command(flatten)]
    terrain: TerrainOption,
    /// Override the friction of a label (repeatable)
    #[arg(long, value_name = "LABEL=VALUE", value_parser = label_and_value, help_heading = "Input", hide_short_help = true)]
    friction: Vec<(String, f64)>,
    /// Require level ground around each start pose on a mesh
    #[arg(long, default_value_t = ROOM, value_name = "METRES", value_parser = crate::numbers::positive, help_heading = "Advanced", hide_short_help = true)]
    room: f64,
    /// Hide effects in the simulated robot
    #[arg(long, default_value = "inside", help_heading = "What to test")]
    effects: Effects,
    /// Draw effects, commands and noise from this seed
    #[arg(long, default_value_t = 0, value_name = "N", help_heading = "What to test")]
    pub seed: u64,
}

/// The robot and a policy of ours that moves it.
pub struct SimulatedWalk {
    pub robot: TaskRobot,
    pub ground: Ground,
    pub hidden: HiddenRobot,
    pub policy: Policy,
    pub task: TaskSettings,
}

impl MadeUp {
    /// Under a `policy.onnx` with policy.toml and checkpoint.bin beside it.
    pub fn under(&self, path: &Path) -> Result<SimulatedWalk, Failure> {
        let (_, file) = policy_of(path)?;
        let robot = as_trained(robot_of(&self.robot)?, &file, path)?;
        let start = checkpoint_of(path, &robot)?;
        let policy = start.best_policy(&robot)?;
        let ground = match Path::new(&self.terrain.name).extension() {
            None if self.friction.is_empty() => ground_of(&self.terrain.name, self.seed)?,
            _ => of_mesh(&self.terrain.name, &self.friction, self.room, self.seed)?,
        };
        let hidden = match self.effects {
            Effects::Inside => HiddenRobot::inside(&robot, Engine::Ours, self.seed),
            Effects::Outside => HiddenRobot::outside(&robot, Engine::Ours, self.seed),
            Effects::Nothing => HiddenRobot::nothing(Engine::Ours),
        };
        Ok(SimulatedWalk { robot, ground, hidden, policy, task: start.settings.task })
    }
}

impl SimulatedWalk {
    /// What is hidden, as a file.
    pub fn answer(&self) -> String {
        let mut text = String::from("# What is hidden in the robot that walked.\n[parameters]\n");
        self.hidden.parameters.iter().for_each(|(name, x)| _ = writeln!(text, "\"{name}\" = {x:?}"));
        self.hidden.outside.iter().for_each(|effect| _ = writeln!(text, "# beside them: {effect:?}"));
        text
    }
}
