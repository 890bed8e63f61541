//! `cargo xtask bench`: speed beside a pinned reference, in one interleaved run.

pub mod contest;
mod fleet;
mod navigate;
mod python;
mod raster;
mod reconstruct;
mod sim;
mod tune;
mod walk;

use crate::workspace::Workspace;
use anyhow::Result;
use clap::Subcommand;

/// What to measure.
#[derive(Subcommand)]
pub enum Bench {
    /// Simulation steps per second, beside MuJoCo on one thread
    Sim(sim::Sim),
    /// Images per second of the rasteriser, beside gsplat where there is one, and on the CPU
    Raster(raster::Raster),
    /// Scenes that `qv reconstruct` learns, beside gsplat's where there is one
    Reconstruct(reconstruct::Reconstruct),
    /// Time that a policy takes to learn to walk, and the learner beside rsl_rl's
    Walk(walk::Walk),
    /// What pictures, driving and learning of the visual navigation cost
    Navigate(navigate::Navigate),
    /// How much less robots with hidden effects stray from their paths after `qv tune`
    Tune(tune::Tune),
    /// Steps of many robots from Python beside the same from Rust
    Python(python::Python),
    /// What `qv fleet` costs for each unit
    Fleet(fleet::Fleet),
}

/// Runs a benchmark; false only when a gate is asked for and a goal is missed.
///
/// # Errors
/// A contestant cannot be built, fails, or prints something unexpected.
pub fn run(workspace: &Workspace, what: Bench) -> Result<bool> {
    match what {
        Bench::Sim(sim) => sim::run(workspace, sim),
        Bench::Raster(raster) => raster::run(workspace, &raster),
        Bench::Reconstruct(what) => reconstruct::run(workspace, &what),
        Bench::Walk(walk) => walk::run(workspace, &walk),
        Bench::Navigate(navigate) => navigate::run(workspace, &navigate),
        Bench::Tune(tune) => tune::run(workspace, &tune),
        Bench::Python(python) => python::run(workspace, &python),
        Bench::Fleet(fleet) => fleet::run(workspace, &fleet),
    }
}
