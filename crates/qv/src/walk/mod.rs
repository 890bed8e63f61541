//! `qv walk`: a robot learns to walk, and what it has learnt is looked at.

mod around;
#[cfg(test)]
mod example;
pub mod inputs;
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

pub const EXAMPLE: &str = "Example:\n  qv walk train --out out/walk            a Go2 learns to follow velocity commands, in a minute\n  \
    qv walk score out/walk/policy.onnx      how well, on fixed commands\n  \
    qv walk play out/walk/policy.onnx --out out/play   a recording for Foxglove and a page\n\n\
    policy.onnx takes what a robot's own sensors report, in SI units, and gives joint targets in radians; policy.toml beside it has\n\
    rate, gains and order. docs/walking.md describes the rest.\n\n\
    Exit codes: 0 done, 1 failed, 2 wrong usage, 3 the robot does not walk after its training.";

#[derive(clap::Args)]
pub struct Walk {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    /// Trains a policy: writes policy.onnx, policy.toml, checkpoint.bin, metrics.json and walk.html
    Train(Box<train::Train>),
    /// Runs a policy on fixed commands and prints its errors with their standard errors
    Score(score::ScoreArguments),
    /// Walks one robot under commands: replay.mcap for Foxglove, and a page
    Play(play::Play),
    /// A made-up robot with hidden effects walks under a policy: recordings as tables, for `qv tune`
    Record(record::Record),
    /// How far such a robot strays from the paths that its commands describe, under one policy or several
    Paths(paths::Paths),
    /// Runs somebody else's policy in our simulator, from a description of what it sees
    Roll(roll::Roll),
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
        }
    }
}
