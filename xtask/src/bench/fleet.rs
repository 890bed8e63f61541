//! `cargo xtask bench fleet`: what `qv fleet` costs for each unit, with made-up recordings and a command that does nothing.

use super::contest::{self, folder, write};
use crate::process;
use crate::workspace::Workspace;
use anyhow::{Context, Result};
use clap::Args;
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

/// Options of the benchmark.
#[derive(Args)]
pub struct Fleet {
    /// Recordings, each of which is a unit
    #[arg(long, default_value_t = 1000, value_name = "N")]
    units: usize,
    /// Units at once; overhead is reported for one processor
    #[arg(long, default_value_t = 1, value_name = "N")]
    jobs: usize,
    /// Length of each recording, in seconds
    #[arg(long, default_value_t = 20.0, value_name = "SECONDS")]
    seconds: f64,
    /// Builds as `cargo test` does, in place of a release
    #[arg(long)]
    dev: bool,
    /// Fails where a unit costs more than the goal
    #[arg(long)]
    gate: bool,
}

/// Most that a unit may cost \[s\].
const GOAL: f64 = 0.2;
/// Samples of a second.
const RATE: f64 = 100.0;
/// Robots among which the recordings are.
const ROBOTS: usize = 10;

const TOML: &str = "robot = \"robot.urdf\"\nbase = \"fixed\"\n[actuator]\nkind = \"pd\"\nkp = 10.0\nkd = 0.5\n";
const URDF: &str = "<robot name=\"shaft\"><link name=\"a\"/><link name=\"b\"><inertial><mass value=\"0.5\"/>\
    <inertia ixx=\"0.002\" iyy=\"0.002\" izz=\"0.001\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link>\
    <joint name=\"shaft\" type=\"revolute\"><parent link=\"a\"/><child link=\"b\"/><axis xyz=\"0 1 0\"/>\
    <limit lower=\"-9\" upper=\"9\" effort=\"50\" velocity=\"50\"/></joint></robot>";

/// What `qv fleet run --json` says.
#[derive(Debug, Deserialize)]
struct FleetRun {
    done: usize,
    core_hours: f64,
}

#[derive(Debug, Serialize)]
struct Results {
    units: usize,
    jobs: usize,
    profile: &'static str,
    plan_seconds: f64,
    run_seconds: f64,
    again_seconds: f64,
    gather_seconds: f64,
    /// Time of a job for each unit, all that it took.
    unit_seconds: f64,
    core_hours: f64,
}

/// Measures; false only when a gate is asked for and the goal is missed.
///
/// # Errors
/// `qv` cannot be built or fails.
pub fn run(workspace: &Workspace, options: &Fleet) -> Result<bool> {
    let profile = if options.dev { "dev" } else { "release" };
    process::run(process::cargo().args(["build", "--package", "quadverse", "--locked", "--profile", profile]))?;
    let qv = workspace.target_directory.join(if options.dev { "debug" } else { "release" }).join("qv");
    let place = folder(workspace)?.join("fleet");
    if place.exists() {
        fs::remove_dir_all(&place).with_context(|| format!("removing {}", place.display()))?;
    }
    let (lab, fleet) = (place.join("lab"), place.join("fleet"));
    (0..options.units).try_for_each(|k| recording(&lab, k, options.seconds))?;
    let timed = |words: &[&str], paths: &[&Path]| -> Result<(f64, String)> {
        let begun = Instant::now();
        let text = process::output(Command::new(&qv).arg("fleet").args(words).args(paths))?;
        Ok((begun.elapsed().as_secs_f64(), text))
    };
    let jobs = options.jobs.to_string();
    let (plan_seconds, _) = timed(&["plan", "--command", "rehearse", "--out"], &[&fleet, &lab])?;
    let (run_seconds, text) = timed(&["run", "--json", "--jobs", &jobs], &[&fleet])?;
    let ran: FleetRun = contest::parse(&text)?;
    anyhow::ensure!(ran.done == options.units, "expected {} units done, found {}", options.units, ran.done);
    let (again_seconds, _) = timed(&["run", "--json", "--jobs", &jobs], &[&fleet])?;
    let (gather_seconds, _) = timed(&["gather"], &[&fleet])?;
    let all = (plan_seconds + gather_seconds + run_seconds * options.jobs as f64) / options.units as f64;
    println!(
        "{} units, {} at once, {profile}: plan {plan_seconds:.1} s, run {run_seconds:.1} s, run again {again_seconds:.2} s, \
         gather {gather_seconds:.2} s\n{all:.4} s a unit, of plan, run and gather (goal {GOAL}); {:.4} core-hours in children",
        options.units, options.jobs, ran.core_hours
    );
    let results = Results {
        units: options.units,
        jobs: options.jobs,
        profile,
        plan_seconds,
        run_seconds,
        again_seconds,
        gather_seconds,
        unit_seconds: all,
        core_hours: ran.core_hours,
    };
    write(workspace, "fleet.json", &results)?;
    Ok(!options.gate || all <= GOAL)
}

/// A table of a shaft that swings; each differs from the others in its phase.
fn recording(lab: &Path, number: usize, seconds: f64) -> Result<()> {
    let folder: PathBuf = lab.join(format!("robot{}", number % ROBOTS)).join(format!("run{number:05}"));
    fs::create_dir_all(&folder).with_context(|| format!("making {}", folder.display()))?;
    let mut text = String::from("time,cmd_pos.shaft,pos.shaft\n");
    for k in 0..(seconds * RATE) as usize {
        let t = k as f64 / RATE;
        let [now, late] = [0.0, 0.01].map(|d| 0.3 * (3.0 * (t - d) + 0.01 * number as f64).sin());
        let _ = writeln!(text, "{t:.3},{now:.5},{late:.6}");
    }
    for (name, text) in [("run.csv", text.as_str()), ("run.toml", TOML), ("robot.urdf", URDF)] {
        fs::write(folder.join(name), text).with_context(|| format!("writing {name} into {}", folder.display()))?;
    }
    Ok(())
}
