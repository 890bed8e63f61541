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
pub use find::recordings;

use crate::{Failure, Outcome};

pub const EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv fleet plan recordings --out out/fleet -- --terrain yard.glb\n\
     \x20 qv fleet run out/fleet --jobs 4 --memory 4000 --timeout 1800\n\
     \x20 qv fleet gather out/fleet\n\
     \n\
     A stopped run resumes when it is started again; finished units are not repeated.",
    "3 some units failed or lost data"
);

#[derive(clap::Args)]
pub struct Fleet {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// Find recordings and write the plan
    #[command(after_long_help = crate::usage::help_text!("Examples:\n\
     \x20 qv fleet plan recordings --out out/fleet\n\
     \x20 qv fleet plan recordings --group --out out/fleet -- --terrain yard.glb"))]
    Plan(plan::Plan),
    /// Run the units that are not finished
    #[command(after_long_help = crate::usage::help_text!("Examples:\n\
     \x20 qv fleet run out/fleet --jobs 4 --memory 4000 --timeout 1800\n\
     \x20 qv fleet run out/fleet --unit 0-9", "3 some units failed or lost data"))]
    Run(run::Run),
    /// Summarize all results on one page
    #[command(after_long_help = crate::usage::help_text!("Examples:\n\
     \x20 qv fleet gather out/fleet"))]
    Gather(gather::Gather),
    /// Print a Slurm job array
    #[command(after_long_help = crate::usage::help_text!("Examples:\n\
     \x20 qv fleet slurm /shared/fleet --memory 4000 --timeout 1800 > fleet.sbatch"))]
    Slurm(scripts::Slurm),
    /// Print a Snakemake workflow
    #[command(after_long_help = crate::usage::help_text!("Examples:\n\
     \x20 qv fleet snakemake /shared/fleet > Snakefile"))]
    Snakemake(scripts::Snakemake),
    /// Stand in for a command in tests and benchmarks
    #[command(hide = true, after_long_help = crate::usage::help_text!("Examples:\n\
     \x20 qv fleet rehearse run.mcap --out out/unit"))]
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
