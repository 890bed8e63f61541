//! `cargo xtask bench sim`: simulation steps beside MuJoCo, in one interleaved run.

use super::contest::{build, last_line, median, write};
use crate::python;
use crate::workspace::Workspace;
use anyhow::{Result, bail};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::process::Command;

/// How to measure.
#[derive(clap::Args)]
pub struct Sim {
    /// Times that each contestant runs, all taking turns
    #[arg(long, default_value_t = 5)]
    rounds: usize,
    /// Seconds of each run
    #[arg(long, default_value_t = 2.0)]
    seconds: f64,
    /// Only this case
    #[arg(long, value_parser = CASES)]
    case: Option<String>,
    /// Fail when a goal is missed
    #[arg(long)]
    gate: bool,
}

const CASES: [&str; 3] = ["flat", "friction", "mesh"];

/// A way to run our simulator.
struct Variant {
    mode: &'static str,
    scalar: &'static str,
    threads: u32,
}

const VARIANTS: [Variant; 5] = [
    Variant { mode: "single", scalar: "f64", threads: 1 },
    Variant { mode: "single", scalar: "f32", threads: 1 },
    Variant { mode: "batch", scalar: "f64", threads: 1 },
    Variant { mode: "batch", scalar: "f32", threads: 1 },
    Variant { mode: "batch", scalar: "f32", threads: 2 },
];

/// Goals as multiples of MuJoCo on the same case: the best scalar on one thread counts.
const GOALS: [(&str, &str, f64); 4] =
    [("flat", "single", 4.0), ("flat", "batch", 10.0), ("friction", "batch", 6.0), ("mesh", "batch", 6.0)];
/// Goal of two threads as a multiple of one.
const TWO_THREADS: f64 = 1.9;

/// The line of JSON that each contestant prints.
#[derive(Debug, Clone, Deserialize)]
struct Sample {
    steps_per_second: f64,
    bytes_per_environment: u64,
}

/// One row of the table: medians over the rounds.
#[derive(Debug, Clone, Serialize)]
struct Row {
    case: String,
    engine: String,
    mode: String,
    scalar: String,
    threads: u32,
    steps_per_second: f64,
    times_mujoco: f64,
    bytes_per_environment: u64,
}

/// Runs the benchmark; false only when `gate` is asked for and a goal is missed.
///
/// # Errors
/// A contestant cannot be built, fails, or prints something unexpected.
pub fn run(workspace: &Workspace, sim: Sim) -> Result<bool> {
    let Sim { rounds, seconds, case, gate } = sim;
    if rounds == 0 || !seconds.is_finite() || seconds <= 0.0 {
        bail!("expected at least one round of positive seconds, found {rounds} rounds of {seconds} s");
    }
    let reference = python::environment(workspace, "mujoco")?;
    let ours = build(workspace, "bench_sim", &[])?;
    let mut rows = Vec::new();
    for name in CASES.into_iter().filter(|name| case.as_deref().is_none_or(|chosen| chosen == *name)) {
        rows.extend(one_case(workspace, &reference, &ours, name, rounds, seconds)?);
    }
    print_table(&rows);
    let met = print_goals(&rows);
    write(workspace, "sim.json", &rows)?;
    Ok(met || !gate)
}

/// All contestants in turn, round after round, so that a slow spell of the machine meets all of them.
fn one_case(
    workspace: &Workspace,
    python: &Path,
    ours: &Path,
    case: &str,
    rounds: usize,
    seconds: f64,
) -> Result<Vec<Row>> {
    let script = workspace.workspace_root.join("fixtures/mujoco/bench.py");
    let seconds = seconds.to_string();
    let mut reference = Vec::new();
    let mut samples: Vec<Vec<Sample>> = VARIANTS.iter().map(|_| Vec::new()).collect();
    for round in 0..rounds {
        eprintln!("{case}: round {} of {rounds}", round + 1);
        let mut mujoco = Command::new(python);
        mujoco.env("PYTHONDONTWRITEBYTECODE", "1").arg(&script).args(["--case", case, "--seconds", &seconds]);
        reference.push(sample(&mut mujoco)?);
        for (variant, taken) in VARIANTS.iter().zip(&mut samples) {
            let mut program = Command::new(ours);
            program.args(["--case", case, "--mode", variant.mode, "--seconds", &seconds]);
            program.args(["--scalar", variant.scalar, "--threads", &variant.threads.to_string()]);
            taken.push(sample(&mut program)?);
        }
    }
    let mut rows =
        vec![row(case, "mujoco", &Variant { mode: "single", scalar: "f64", threads: 1 }, &reference, &reference)];
    rows.extend(VARIANTS.iter().zip(&samples).map(|(variant, taken)| row(case, "qv-sim", variant, taken, &reference)));
    Ok(rows)
}

fn sample(command: &mut Command) -> Result<Sample> {
    let sample: Sample = last_line(command)?;
    if !(sample.steps_per_second.is_finite() && sample.steps_per_second > 0.0) {
        bail!("{command:?}: expected positive steps per second, found {}", sample.steps_per_second);
    }
    Ok(sample)
}

/// Ratios are taken round by round before their median is.
fn row(case: &str, engine: &str, variant: &Variant, taken: &[Sample], reference: &[Sample]) -> Row {
    let ratios = taken.iter().zip(reference).map(|(own, other)| own.steps_per_second / other.steps_per_second);
    Row {
        case: case.into(),
        engine: engine.into(),
        mode: variant.mode.into(),
        scalar: variant.scalar.into(),
        threads: variant.threads,
        steps_per_second: median(taken.iter().map(|sample| sample.steps_per_second).collect()),
        times_mujoco: median(ratios.collect()),
        bytes_per_environment: taken.iter().map(|sample| sample.bytes_per_environment).max().unwrap_or(0),
    }
}

fn print_table(rows: &[Row]) {
    println!("| case | engine | mode | scalar | threads | steps/s | x MuJoCo | bytes per environment |");
    println!("|---|---|---|---|---:|---:|---:|---:|");
    for row in rows {
        println!(
            "| {} | {} | {} | {} | {} | {:.0} | {:.2} | {} |",
            row.case,
            row.engine,
            row.mode,
            row.scalar,
            row.threads,
            row.steps_per_second,
            row.times_mujoco,
            row.bytes_per_environment
        );
    }
}

/// Best multiple of MuJoCo on a case.
fn best(rows: &[Row], case: &str, mode: &str, threads: u32) -> Option<f64> {
    let fits = |row: &&Row| row.engine == "qv-sim" && row.case == case && row.mode == mode && row.threads == threads;
    rows.iter().filter(fits).map(|row| row.times_mujoco).max_by(f64::total_cmp)
}

/// Prints each goal of a measured case; true when all are met.
fn print_goals(rows: &[Row]) -> bool {
    let mut all = true;
    let mut say = |what: String, found: f64, goal: f64| {
        all &= found >= goal;
        println!("{what}: {found:.2}, goal {goal}: {}", if found >= goal { "met" } else { "missed" });
    };
    for (case, mode, goal) in GOALS {
        if let Some(found) = best(rows, case, mode, 1) {
            say(format!("{case} {mode} x MuJoCo"), found, goal);
        }
    }
    for case in CASES {
        let speed = |threads: u32| {
            let fits =
                |row: &&Row| row.case == case && row.mode == "batch" && row.scalar == "f32" && row.threads == threads;
            rows.iter().find(fits).map(|row| row.steps_per_second)
        };
        if let (Some(one), Some(two)) = (speed(1), speed(2)) {
            say(format!("{case} two threads x one"), two / one, TWO_THREADS);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_are_taken_within_a_round() {
        let at = |speed: f64| Sample { steps_per_second: speed, bytes_per_environment: 7 };
        let variant = Variant { mode: "batch", scalar: "f32", threads: 1 };
        // The machine was twice as slow in the second round: the ratio is 10 all the same.
        let row = row("flat", "qv-sim", &variant, &[at(100.0), at(50.0)], &[at(10.0), at(5.0)]);
        assert_eq!(row.times_mujoco, 10.0);
        assert_eq!(best(std::slice::from_ref(&row), "flat", "batch", 1), Some(10.0));
        assert_eq!(best(&[row], "mesh", "batch", 1), None);
    }

    #[test]
    fn a_missed_goal_is_said() {
        let mut row = row(
            "friction",
            "qv-sim",
            &Variant { mode: "batch", scalar: "f64", threads: 1 },
            &[Sample { steps_per_second: 50.0, bytes_per_environment: 1 }],
            &[Sample { steps_per_second: 10.0, bytes_per_environment: 1 }],
        );
        assert!(!print_goals(std::slice::from_ref(&row)));
        row.times_mujoco = 6.5;
        assert!(print_goals(&[row]));
    }
}
