//! `cargo xtask bench python`: steps of many Go2 from Python beside the same from Rust, and the time of an import.

use super::{build, last_line, median, write};
use crate::wheel;
use crate::workspace::Workspace;
use anyhow::{Result, bail};
use serde::{Deserialize, Serialize};
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
    /// Median of the ratios within a round.
    python_over_rust: f64,
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
    let ours = build(workspace, "bench_batch", &[])?;
    let script = workspace.workspace_root.join("fixtures/python/bench.py");
    let numbers = [how.environments, how.steps, 5].map(|n| n.to_string());
    let (mut rust, mut from_python, mut import) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..how.rounds {
        rust.push(last_line::<Sample>(Command::new(&ours).args(&numbers))?.seconds);
        let mut steps = Command::new(&python);
        steps.env("PYTHONDONTWRITEBYTECODE", "1").arg(&script).args(&numbers);
        from_python.push(last_line::<Sample>(&mut steps)?.seconds);
        import.push(last_line::<Sample>(Command::new(&python).args(["-c", IMPORT]))?.seconds);
    }
    let ratios = from_python.iter().zip(&rust).map(|(python, rust)| python / rust).collect();
    let figures = Figures {
        environments: how.environments,
        steps: how.steps,
        rust_s: median(rust),
        python_s: median(from_python),
        python_over_rust: median(ratios),
        import_ms: 1e3 * median(import),
    };
    println!(
        "{} environments, {} steps: Rust {:.4} s, Python {:.4} s, ratio {:.3}; import {:.1} ms",
        figures.environments,
        figures.steps,
        figures.rust_s,
        figures.python_s,
        figures.python_over_rust,
        figures.import_ms
    );
    write(workspace, "python.json", &figures)?;
    Ok(true)
}
