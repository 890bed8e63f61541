//! `qv fleet`: a command on many recordings, each in a process of its own, and what all of them say together.

mod child;
mod find;
mod folder;
mod gather;
mod hash;
mod plan;
mod rehearse;
mod run;
mod scripts;
mod unit;

pub use child::end_with_parent;

use crate::{Failure, Outcome};

pub const EXAMPLE: &str = "Example:\n  qv fleet plan recordings --out out/fleet -- --terrain yard.glb\n  \
    qv fleet run out/fleet --jobs 4 --memory 4000 --timeout 1800\n  qv fleet gather out/fleet\n\n\
    A run that was stopped goes on when it is started again: what is done is not done twice.\n\n\
    Exit codes: 0 done, 1 failed, 2 wrong usage, 3 some units failed or ended with 3, 130 stopped.";

#[derive(clap::Args)]
pub struct Fleet {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// Finds recordings below folders, and writes what is to be done with them
    Plan(plan::Plan),
    /// Does what the plan says and is not done yet
    Run(run::Run),
    /// Puts what was found on one page
    Gather(gather::Gather),
    /// Prints a job array for Slurm
    Slurm(scripts::Slurm),
    /// Prints a workflow for Snakemake
    Snakemake(scripts::Snakemake),
    /// Stands in for a command in tests and benchmarks: looks at no recording and finds nothing
    #[command(hide = true)]
    Rehearse(rehearse::Rehearse),
}

impl Fleet {
    /// With `root`, the command that all others are in: it says which options they take.
    pub fn execute(&self, root: clap::Command) -> Result<Outcome, Failure> {
        match &self.what {
            What::Plan(command) => command.execute(root),
            What::Run(command) => command.execute(),
            What::Gather(command) => command.execute(),
            What::Slurm(command) => command.execute(),
            What::Snakemake(command) => command.execute(),
            What::Rehearse(command) => command.execute(),
        }
    }
}
