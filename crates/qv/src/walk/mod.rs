//! `qv walk`: a robot learns to walk, and what it has learnt is looked at.

mod around;
mod describe;
#[cfg(test)]
mod example;
pub mod inputs;
pub mod ladder;
mod made_up;
mod others;
mod page;
mod paths;
mod play;
mod record;
mod recording;
mod roll;
mod score;
mod train;
pub mod trial;

use crate::{Failure, Outcome};

pub const EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv walk train --out out/walk                       # train a Go2 on the plane\n\
     \x20 qv walk score out/walk/policy.onnx                 # velocity errors and gait\n\
     \x20 qv walk play out/walk/policy.onnx --out out/play   # a recording for Foxglove and a page\n\
     \n\
     policy.onnx maps proprioception in SI units to joint targets in radians; policy.toml states rate, gains and joint order.\n\
     Guide: docs/guide/walking.md.",
    "3 the trained policy does not walk"
);

#[derive(clap::Args)]
pub struct Walk {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    /// Train a locomotion policy (PPO)
    #[command(after_long_help = crate::usage::help_text!("Examples:\n\
     \x20 qv walk train --out out/walk\n\
     \x20 qv walk train --robust --terrain bumps --out out/walk\n\
     \x20 qv walk train --robot robot.urdf --params out/why/calibrated.toml --out out/walk\n\
     \n\
     Results: policy.onnx, policy.toml, checkpoint.bin, metrics.json, walk.html.", "3 the trained policy does not walk"))]
    Train(Box<train::Train>),
    /// Score a policy on fixed commands: velocity errors and gait
    #[command(after_long_help = crate::usage::help_text!("Examples:\n\
     \x20 qv walk score out/walk/policy.onnx\n\
     \x20 qv walk score others.onnx --description others.toml --params out/why/calibrated.toml"))]
    Score(score::ScoreArguments),
    /// Play a policy on one robot: replay.mcap for Foxglove, and a page
    #[command(after_long_help = crate::usage::help_text!("Examples:\n\
     \x20 qv walk play out/walk/policy.onnx --out out/play\n\
     \x20 qv walk play out/walk/policy.onnx --command 0.5,0,0 --command 0.5,0,1 --out out/play"))]
    Play(play::Play),
    /// Record a simulated robot with hidden effects, for `qv tune`
    #[command(after_long_help = crate::usage::help_text!("Examples:\n\
     \x20 qv walk record out/walk/policy.onnx --minutes 4 --out out/log\n\
     \x20 qv walk record out/walk/policy.onnx --effects outside --seed 3 --out out/log"))]
    Record(record::Record),
    /// Compare the path-tracking errors of policies
    #[command(after_long_help = crate::usage::help_text!("Examples:\n\
     \x20 qv walk paths out/walk/policy.onnx out/tuned/policy.onnx\n\
     \x20 qv walk paths out/walk/policy.onnx --walks 48 --out out/paths.json"))]
    Paths(paths::Paths),
    /// Run a policy of another trainer in the simulator
    #[command(after_long_help = crate::usage::help_text!("Examples:\n\
     \x20 qv walk describe rl_sar_go2 > go2.toml\n\
     \x20 qv walk roll policy.onnx --description go2.toml --robot go2 --command 0.5,0,0 --out out/roll"))]
    Roll(roll::Roll),
    /// Print an example of a policy description
    #[command(after_long_help = crate::usage::help_text!("Examples:\n\
     \x20 qv walk describe                       # list the examples\n\
     \x20 qv walk describe go2_rsl_rl > go2.toml\n\
     \n\
     Keys: docs/reference/policy_descriptions.md."))]
    Describe(describe::Describe),
}

impl Walk {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        match &self.command {
            Command::Train(command) => command.execute(),
            Command::Score(command) => command.execute(),
            Command::Play(command) => command.execute(),
            Command::Record(command) => command.execute(),
            Command::Paths(command) => command.execute(),
            Command::Roll(command) => command.execute(),
            Command::Describe(command) => command.execute(),
        }
    }
}
