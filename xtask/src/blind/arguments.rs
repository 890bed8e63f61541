//! What the command line says of what to judge.

use super::decide;
use super::generate::Origin;
use anyhow::Result;
use clap::{ArgGroup, Args, FromArgMatches, Subcommand};
use std::path::PathBuf;

/// What to judge.
#[derive(Args)]
#[command(group(ArgGroup::new("what").required(true).args(["full", "subset", "reports_only", "contact"])))]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Blind {
    #[command(subcommand)]
    pub chore: Option<Chore>,
    /// All effects, ten recordings of each, with two at once, withheld ones and none
    #[arg(long)]
    pub full: bool,
    /// Six effects, one recording of each, with two withheld ones and two of none
    #[arg(long)]
    pub subset: bool,
    /// Only score the reports in DIR/NAME/report.json
    #[arg(long, value_name = "DIR", requires = "answers")]
    pub reports_only: Option<PathBuf>,
    /// N recordings on ground of four materials, for `qv contact`
    #[arg(long, value_name = "N")]
    pub contact: Option<usize>,
    /// Length of those, in seconds
    #[arg(long, default_value_t = 60.0, value_name = "SECONDS")]
    pub seconds: f64,
    /// Faults of the robot, or soft ground, in each of those
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub faults: usize,
    /// Answers to score them by
    #[arg(long, value_name = "FILE", requires = "reports_only")]
    pub answers: Option<PathBuf>,
    /// Recordings of each effect
    #[arg(long, value_name = "N")]
    pub per_effect: Option<usize>,
    /// Seed of the recordings
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// What makes the recordings: all three for the full set, rapier for the small one
    #[arg(long, value_enum, value_delimiter = ',', value_name = "NAMES")]
    pub origins: Vec<Origin>,
    /// The arms alone, all effects: the same as --full --origins arms
    #[arg(long, conflicts_with_all = ["origins", "subset", "contact"])]
    pub arms: bool,
    /// Engine of those of rapier's generator
    #[arg(long, default_value = "second", value_parser = ["second", "ours", "both"])]
    pub engine: String,
    /// Diagnoses at a time
    #[arg(long, default_value_t = 1, value_name = "N")]
    pub jobs: usize,
    /// Begin no diagnosis after so many minutes, and score what there is; another run goes on
    #[arg(long, value_name = "M")]
    pub minutes: Option<f64>,
    /// Leave the first N recordings out, in the order of their names: some method was developed on them
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub skip: usize,
    /// Also run the rivals over MuJoCo: plain least squares, mujoco.sysid
    #[arg(long)]
    pub baselines: bool,
    /// Write what was measured into docs/reference/results.md, between its markers, with this command and the commit
    #[arg(long)]
    pub write_docs: bool,
    /// Fail when a goal is missed
    #[arg(long)]
    pub gate: bool,
}

/// What needs no diagnosis.
#[derive(Subcommand)]
pub enum Chore {
    /// Score what a policy makes of evidence that is stored
    Decide(decide::Decide),
}

impl Blind {
    /// What the command line makes of `words`.
    pub fn of(words: &[&str]) -> Result<Self> {
        let command = Self::augment_args(clap::Command::new("blind").no_binary_name(true));
        Ok(Self::from_arg_matches(&command.try_get_matches_from(words)?)?)
    }
}
