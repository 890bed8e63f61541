//! `cargo xtask bench python`: steps of many Go2 from Python beside the same from Rust, mjbatch and MuJoCo's rollout, and the time of an import. All
//! read one model, that of MuJoCo's goldens, whose feet collide.

use super::contest::{build, folder, last_line, median, write};
use crate::wheel;
use crate::workspace::Workspace;
use crate::{process, python};
use anyhow::{Result, bail};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::process::Command;

/// How to measure.
#[derive(clap::Args)]
pub struct Python {
    /// Environments
    #[arg(long, default_value_t = 4096)]
    environments: usize,
    /// Steps of each call
    #[arg(long, default_value_t = 20)]
    steps: usize,
    /// Times that both run, taking turns
    #[arg(long, default_value_t = 5)]
    rounds: usize,
}

#[derive(Deserialize)]
struct Sample {
    seconds: f64,
}

/// What was measured.
#[derive(Serialize)]
struct Figures {
    environments: usize,
    steps: usize,
    /// Medians over the rounds.
    rust_s: f64,
    python_s: f64,
    /// `mujoco.rollout` on all cores, in 64-bit numbers.
    mujoco_s: f64,
    /// mjbatch on all cores, which is MuJoCo in 64-bit numbers, too.
    mjbatch_s: f64,
    /// Median of the ratios within a round.
    python_over_rust: f64,
    /// Median of the ratios within a round: how many times as long MuJoCo takes.
    mujoco_over_python: f64,
    /// Median of the ratios within a round: how many times as long mjbatch takes.
    mjbatch_over_python: f64,
    /// Median, of the package alone, in a Python that has started.
    import_ms: f64,
}

/// Seconds of `import quadverse`, printed as JSON.
const IMPORT: &str = "import json, time; t = time.perf_counter(); import quadverse; \
    print(json.dumps({'seconds': time.perf_counter() - t}))";

/// Runs the benchmark.
///
/// # Errors
/// A contestant cannot be built, fails, or prints something unexpected.
pub fn run(workspace: &Workspace, how: &Python) -> Result<bool> {
    if how.rounds == 0 || how.steps == 0 || how.environments == 0 {
        bail!("expected at least one environment, step and round, found 0");
    }
    let python = wheel::installed(workspace, true)?;
    let reference = python::environment(workspace, "mujoco")?;
    let batched = python::environment(workspace, "mjbatch")?;
    let ours = build(workspace, "bench_batch", &[])?;
    let scripts = workspace.workspace_root.join("fixtures");
    let script = |program: &Path, name: &str| {
        let mut command = Command::new(program);
        command.env("PYTHONDONTWRITEBYTECODE", "1").arg(scripts.join(name));
        command
    };
    let model = folder(workspace)?.join("go2.xml");
    process::run(script(&reference, "mujoco/many.py").arg("--write").arg(&model))?;
    let numbers = [how.environments, how.steps, 5].map(|n| n.to_string());
    let seconds =
        |command: &mut Command| -> Result<f64> { Ok(last_line::<Sample>(command.args(&numbers).arg(&model))?.seconds) };
    let [mut rust, mut from_python, mut mujoco, mut mjbatch, mut import] = [const { Vec::new() }; 5];
    for _ in 0..how.rounds {
        rust.push(seconds(&mut Command::new(&ours))?);
        from_python.push(seconds(&mut script(&python, "python/bench.py"))?);
        mujoco.push(seconds(&mut script(&reference, "mujoco/many.py"))?);
        mjbatch.push(seconds(&mut script(&batched, "mjbatch/many.py"))?);
        import.push(last_line::<Sample>(Command::new(&python).args(["-c", IMPORT]))?.seconds);
    }
    let ratios = |of: &[f64], to: &[f64]| median(of.iter().zip(to).map(|(of, to)| of / to).collect());
    let figures = Figures {
        environments: how.environments,
        steps: how.steps,
        python_over_rust: ratios(&from_python, &rust),
        mujoco_over_python: ratios(&mujoco, &from_python),
        mjbatch_over_python: ratios(&mjbatch, &from_python),
        mjbatch_s: median(mjbatch),
        rust_s: median(rust),
        python_s: median(from_python),
        mujoco_s: median(mujoco),
        import_ms: 1e3 * median(import),
    };
    print(&figures);
    write(workspace, "python.json", &figures)?;
    Ok(true)
}

fn print(figures: &Figures) {
    let Figures { environments, steps, .. } = figures;
    println!("{environments} environments, {steps} steps, medians of the rounds");
    println!("{:<28} {:>9} {:>14}", "", "seconds", "steps/s");
    let rows = [
        ("Rust", figures.rust_s),
        ("Python", figures.python_s),
        ("mujoco.rollout (f64)", figures.mujoco_s),
        ("mjbatch (f64)", figures.mjbatch_s),
    ];
    for (name, seconds) in rows {
        println!("{name:<28} {seconds:>9.4} {:>14.0}", (environments * steps) as f64 / seconds);
    }
    let [of_rust, mujoco, mjbatch] =
        [figures.python_over_rust, figures.mujoco_over_python, figures.mjbatch_over_python];
    println!("Python / Rust {of_rust:.3}, MuJoCo / Python {mujoco:.2}, mjbatch / Python {mjbatch:.2}");
    println!("import quadverse {:.1} ms", figures.import_ms);
}
