//! `qv fleet slurm` and `qv fleet snakemake`: scripts that give units to a cluster.

use super::folder::Folder;
use crate::numbers::positive;
use crate::outcome::about;
use crate::{Failure, Outcome, say};
use qv_fleet::script::{self, Resources};
use std::path::PathBuf;

/// What both have.
#[derive(clap::Args)]
struct Common {
    /// Directory of the fleet, at the same path on all machines
    #[arg(value_name = "FLEET")]
    folder: PathBuf,
    /// Set the path of qv on those machines
    #[arg(long, default_value = "qv", value_name = "PATH", help_heading = "Input")]
    program: String,
    /// Limit the memory of a unit
    #[arg(long, value_name = "MIB", value_parser = clap::value_parser!(u64).range(1..), help_heading = "Advanced")]
    memory: Option<u64>,
    /// Limit the run time of a unit
    #[arg(long, value_name = "SECONDS", value_parser = positive, help_heading = "Advanced")]
    timeout: Option<f64>,
    /// Restart a killed unit up to K times
    #[arg(long, default_value_t = 0, value_name = "K", value_parser = clap::value_parser!(u32).range(0..=100), help_heading = "Advanced")]
    retries: u32,
    /// Request N processors per unit
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024), help_heading = "Advanced")]
    cpus: u32,
}

#[derive(clap::Args)]
pub struct Slurm {
    #[command(flatten)]
    common: Common,
    /// Run N units per task, for clusters that limit array length
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), help_heading = "Advanced")]
    units_per_task: u32,
}

#[derive(clap::Args)]
pub struct Snakemake {
    #[command(flatten)]
    common: Common,
}

impl Common {
    fn open(&self) -> Result<(Folder, String, Resources), Failure> {
        let folder = Folder::open_to_work(&self.folder)?;
        if folder.plan.units.is_empty() {
            return Err(about(&self.folder, "expected a plan with units, found none"));
        }
        let path = self.folder.canonicalize().map_err(|e| about(&self.folder, e.to_string()))?;
        let Self { memory, timeout, retries, cpus, .. } = *self;
        Ok((folder, path.display().to_string(), Resources { memory, timeout, retries, cpus }))
    }
}

impl Slurm {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        let (folder, path, resources) = self.common.open()?;
        say(&script::slurm(&folder.plan, &self.common.program, &path, self.units_per_task as usize, &resources))?;
        Ok(Outcome::Done)
    }
}

impl Snakemake {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        let (folder, path, resources) = self.common.open()?;
        say(&script::snakemake(&folder.plan, &self.common.program, &path, &resources))?;
        Ok(Outcome::Done)
    }
}
