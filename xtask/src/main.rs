//! Chores of the workspace. `cargo xtask --help` lists them.

mod advisories;
mod axe;
mod bench;
mod blind;
mod book;
mod dist;
mod fuzz;
mod golden;
mod guides;
mod kills;
mod outside;
mod pictures;
mod pipeline;
mod process;
mod programs;
mod python;
mod quick;
mod ros2;
mod test;
mod tidy;
mod wheel;
mod withheld;
mod workspace;

use anyhow::Result;
use clap::{Parser, Subcommand};
use std::process::ExitCode;
use workspace::Workspace;

/// Chores of the QuadVerse workspace.
#[derive(Parser)]
#[command(name = "cargo xtask")]
struct Arguments {
    #[command(subcommand)]
    chore: Chore,
}

#[derive(Subcommand)]
enum Chore {
    /// Run every test of the workspace and say how many passed
    Test {
        /// Build with optimisation
        #[arg(long)]
        release: bool,
    },
    /// Format, clippy and tests of the crates that changed
    Quick(quick::Quick),
    /// The main job on a made-up yard: photographs, recordings, scene, mesh, friction, replay, diagnosis, one page
    Pipeline(pipeline::Pipeline),
    /// Write docs/pictures/view.png (moving) and diagnosis.png (annotated) from the pipeline's pages (needs Chromium)
    Pictures(pictures::Pictures),
    /// Run axe-core on the pages that tests kept (needs node)
    Axe(axe::Axe),
    /// Check the links of docs/ and build them as a book in target/book (needs mdbook)
    Book,
    /// Check the invariants of docs/dev/ARCHITECTURE.md
    Tidy,
    /// Reference results: check against them, or write them anew
    #[command(subcommand)]
    Golden(golden::Golden),
    /// Run the commands of README.md and of the tutorials, and compare what they print with what the pages say
    Guides(guides::Guides),
    /// Measure speed
    #[command(subcommand)]
    Bench(bench::Bench),
    /// Judge the diagnosis on recordings whose answers are sealed
    Blind(blind::Blind),
    /// Diagnose recordings whose effect is taken out of the library: what is named then is false
    Withheld(withheld::Withheld),
    /// Build the wheel of the Python package, install it in an environment under target/, and run its tests
    Python(wheel::Python),
    /// Build what is given away: wheels and static programs for Linux, hashes, a list of what is inside; or check them
    Dist(dist::Dist),
    /// Build and run a program outside of the workspace from the packaged form of our crates
    Outside,
    /// Build and test the node for ROS 2, which no other build knows
    Ros2,
    /// Check what is linked against known advisories, where their database can be had (needs cargo-deny)
    Advisories,
    /// Kill commands that write results at random moments, and look whether the old or the new ones are there whole
    Kills {
        /// Kills of each command
        #[arg(long, default_value_t = 20)]
        each: u32,
    },
    /// Run the fuzz targets for a while (needs cargo-fuzz)
    Fuzz {
        /// Targets; default: all
        targets: Vec<String>,
        /// Seconds per target
        #[arg(long, default_value_t = 60)]
        seconds: u64,
    },
}

fn run(chore: Chore) -> Result<bool> {
    let workspace = Workspace::load()?;
    match chore {
        Chore::Test { release } => test::run(&workspace, release),
        Chore::Quick(quick) => quick::run(&workspace, &quick),
        Chore::Pipeline(pipeline) => pipeline::run(&workspace, &pipeline),
        Chore::Pictures(pictures) => pictures::run(&workspace, &pictures),
        Chore::Axe(axe) => axe::run(&workspace, &axe),
        Chore::Book => book::run(&workspace),
        Chore::Tidy => tidy::run(&workspace),
        Chore::Golden(golden) => golden::run(&workspace, golden),
        Chore::Guides(guides) => guides::run(&workspace, &guides),
        Chore::Bench(bench) => bench::run(&workspace, bench),
        Chore::Blind(blind) => blind::run(&workspace, &blind),
        Chore::Withheld(asked) => withheld::run(&workspace, &asked),
        Chore::Python(how) => wheel::run(&workspace, &how),
        Chore::Dist(how) => dist::run(&workspace, &how),
        Chore::Outside => outside::run(&workspace),
        Chore::Ros2 => ros2::run(&workspace),
        Chore::Advisories => advisories::run(&workspace),
        Chore::Kills { each } => kills::run(&workspace, each),
        Chore::Fuzz { targets, seconds } => fuzz::run(&workspace, seconds, &targets),
    }
}

fn main() -> ExitCode {
    match run(Arguments::parse().chore) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
