//! `cargo xtask test`: every test of the workspace, a summary, and where the time went.

mod counts;
mod programs;

use crate::{process, python, workspace::Workspace};
use anyhow::Result;
use counts::Counts;
use programs::{TestProgram, TestRun};
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Python environments under `fixtures`, and the variables through which tests find them.
const ENVIRONMENTS: [(&str, &str); 5] = [
    ("mcap", "QV_PYTHON"),
    ("mesh", "QV_PYTHON_MESH"),
    ("mujoco", "QV_PYTHON_MUJOCO"),
    ("onnx", "QV_PYTHON_ONNX"),
    ("splat", "QV_PYTHON_SPLAT"),
];

/// Tests that the summary lists, the slowest first.
const SLOWEST: usize = 10;

/// Which targets hold tests. Examples hold none; clippy compiles them.
const TARGETS: [&str; 3] = ["--lib", "--bins", "--tests"];

/// Wall and processor time of a program.
struct Cost {
    name: String,
    wall: Duration,
    cpu: Option<Duration>,
}

/// Runs all tests of all features, unit, integration and documentation; true when all passed. The last line is
/// `N passed, N failed, N skipped`; before it stand the skipped tests with reasons, the time of each program and the slowest tests.
///
/// # Errors
/// A test program does not build or cannot be started.
pub fn run(workspace: &Workspace, release: bool) -> Result<bool> {
    let which = ["--workspace", "--all-features"].map(String::from);
    run_packages(workspace, &which, release)
}

/// Runs the tests of the packages that `which` selects, as options of cargo.
///
/// # Errors
/// As [`run`].
pub fn run_packages(workspace: &Workspace, which: &[String], release: bool) -> Result<bool> {
    let root = &workspace.workspace_root;
    let release = if release { vec!["--release".to_string()] } else { vec![] };
    let common = [which, &["--locked".to_string()], &release].concat();
    let targets = TARGETS.map(String::from);
    // Cargo compiles while Python's packages are fetched.
    let (built, environment) = thread::scope(|scope| {
        let environment = scope.spawn(|| environments(workspace));
        let built = programs::build(root, &[&common[..], &targets].concat());
        (built, environment.join())
    });
    let programs = built?;
    let environment = environment.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    let (mut counts, mut costs, passed) = run_programs(programs, &environment)?;
    let documentation = run_documentation(workspace, &common)?;
    costs.push(Cost { name: "documentation".into(), wall: documentation.wall, cpu: None });
    let succeeded = passed && documentation.succeeded;
    counts.add(documentation.counts, "documentation");
    print_costs(&mut costs, &mut counts.durations);
    counts.reasons.iter().for_each(|reason| println!("skipped: {reason}"));
    println!("{} passed, {} failed, {} skipped", counts.passed, counts.failed, counts.skipped);
    Ok(succeeded)
}

/// The variables that lead tests to Python environments; makes those that are missing. Tests of one that cannot be made skip.
fn environments(workspace: &Workspace) -> Vec<(&'static str, PathBuf)> {
    let mut found = vec![];
    for (name, variable) in ENVIRONMENTS {
        if !workspace.workspace_root.join("fixtures").join(name).join("requirements.txt").is_file() {
            continue;
        }
        match python::environment(workspace, name) {
            Ok(python) => found.push((variable, python)),
            Err(error) => eprintln!("note: tests that read our files from Python ({name}) will skip: {error:#}"),
        }
    }
    found
}

/// Runs as many programs at a time as there are processors, and prints the output of each when it ends.
fn run_programs(
    mut programs: Vec<TestProgram>,
    environment: &[(&'static str, PathBuf)],
) -> Result<(Counts, Vec<Cost>, bool)> {
    // Integration tests take longest, and those of the highest crates, which cargo names last, among them.
    programs.reverse();
    programs.sort_by_key(|program| !program.is_integration);
    let at_once = thread::available_parallelism().map_or(1, usize::from);
    println!("running {} test programs, {at_once} at a time", programs.len());
    let next = AtomicUsize::new(0);
    let total = Mutex::new((Counts::default(), Vec::new(), true));
    let work = || -> Result<()> {
        while let Some(program) = programs.get(next.fetch_add(1, Ordering::Relaxed)) {
            let run = programs::run(program, environment)?;
            let mut total = total.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            println!("== {}, {}\n{}", program.name, describe(run.wall, run.cpu), run.output);
            total.2 &= run.succeeded;
            total.0.add(run.counts, &program.name);
            total.1.push(Cost { name: program.name.clone(), wall: run.wall, cpu: run.cpu });
        }
        Ok(())
    };
    thread::scope(|scope| {
        let workers: Vec<_> = (0..at_once).map(|_| scope.spawn(work)).collect();
        workers.into_iter().try_for_each(|worker| worker.join().unwrap_or_else(|p| std::panic::resume_unwind(p)))
    })?;
    Ok(total.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner))
}

/// Runs the examples in the documentation.
fn run_documentation(workspace: &Workspace, common: &[String]) -> Result<TestRun> {
    let mut cargo = process::cargo();
    cargo.current_dir(&workspace.workspace_root).args(["test", "--doc", "--no-fail-fast"]).args(common);
    let (clock, mut counts) = (Instant::now(), Counts::default());
    let succeeded = process::watch(&mut cargo, |line| counts.add_line(line, Duration::ZERO))?;
    // Examples run beside each other, so that lines show nothing of the time of one.
    counts.durations.clear();
    if !succeeded && counts.failed == 0 {
        counts.failed = 1;
        println!("the documentation's tests failed before a result was printed");
    }
    Ok(TestRun { counts, succeeded, wall: clock.elapsed(), cpu: None, output: String::new() })
}

fn describe(wall: Duration, cpu: Option<Duration>) -> String {
    let cpu = cpu.map_or(String::new(), |cpu| format!(", {:.1} CPU s", cpu.as_secs_f64()));
    format!("{:.1} s{cpu}", wall.as_secs_f64())
}

fn print_costs(costs: &mut [Cost], durations: &mut [(String, Duration)]) {
    costs.sort_by_key(|cost| std::cmp::Reverse(cost.cpu.unwrap_or(cost.wall)));
    println!("\ntime of each test program:");
    for cost in costs.iter() {
        println!("  {:<24} {}", cost.name, describe(cost.wall, cost.cpu));
    }
    durations.sort_by_key(|(_, took)| std::cmp::Reverse(*took));
    println!("the slowest tests:");
    for (name, took) in durations.iter().take(SLOWEST) {
        println!("  {:>6.1} s {name}", took.as_secs_f64());
    }
}
