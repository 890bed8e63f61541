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
    /// Directory of a fleet, which all machines see under this path
    #[arg(value_name = "F")]
    folder: PathBuf,
    /// The program, as those machines find it
    #[arg(long, default_value = "qv", value_name = "PATH")]
    program: String,
    /// Memory that a unit may have, in MiB
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u64).range(1..))]
    memory: Option<u64>,
    /// Seconds that a unit may take
    #[arg(long, value_name = "S", value_parser = positive)]
    timeout: Option<f64>,
    /// How often a unit is started again that was killed
    #[arg(long, default_value_t = 0, value_name = "K", value_parser = clap::value_parser!(u32).range(0..=100))]
    retries: u32,
    /// Processors of a unit
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    cpus: u32,
}

#[derive(clap::Args)]
pub struct Slurm {
    #[command(flatten)]
    common: Common,
    /// Units of one task: clusters limit the length of an array
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
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
