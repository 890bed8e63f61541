//! `cargo xtask bench reconstruct CAPTURE...`: scenes that `qv reconstruct` learns beside those of gsplat's MCMC strategy.
//!
//! Both learn from the same photographs with the same masks, from the same points, over the same colour, with the same cap; one program
//! draws and scores what they made at the photographs that are held out. They take turns, seed by seed.

use super::contest::{build, folder, last_line, write};
use super::raster::rival;
use crate::process;
use crate::workspace::Workspace;
use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::process::Command;

/// How to measure.
#[derive(clap::Args)]
pub struct Reconstruct {
    /// Folders with transforms.json, or of RGB-D frames as 7-Scenes has them, and points.ply
    #[arg(required = true)]
    captures: Vec<PathBuf>,
    /// Steps
    #[arg(long, default_value_t = 7000)]
    iterations: u32,
    /// Most Gaussians
    #[arg(long, default_value_t = 300_000)]
    cap: usize,
    /// Seeds 0 to N - 1
    #[arg(long, value_name = "N", default_value_t = 3)]
    seeds: u32,
    /// Python with torch, CUDA and gsplat
    #[arg(long, default_value = "python3")]
    python: PathBuf,
    /// Options of `qv reconstruct` for ours, after `--`
    #[arg(last = true)]
    options: Vec<String>,
}

/// What `metrics.json` is read for.
#[derive(Debug, Deserialize)]
struct Metrics {
    train_s: f64,
}

/// What `train.py` prints.
#[derive(Debug, Deserialize)]
struct TrainerOutput {
    seconds: f64,
}

/// What `bench_reconstruct score` prints.
#[derive(Debug, Clone, Deserialize, Serialize)]
struct ScoreOutput {
    images: usize,
    gaussians: usize,
    psnr: f64,
    ssim: f64,
}

/// One scene that one of the two made.
#[derive(Debug, Clone, Serialize)]
struct Row {
    capture: String,
    seed: u32,
    by: &'static str,
    seconds: f64,
    scored: ScoreOutput,
}

/// Runs the benchmark, which has no gate.
///
/// # Errors
/// A contestant cannot be built, fails, or prints something unexpected.
pub fn run(workspace: &Workspace, what: &Reconstruct) -> Result<bool> {
    if what.seeds == 0 {
        bail!("--seeds: expected at least 1, found 0");
    }
    let helper = build(workspace, "bench_reconstruct", &[])?;
    let mut cargo = process::cargo();
    cargo.current_dir(&workspace.workspace_root).args(["build", "--release", "--package", "quadverse"]);
    process::run(cargo.args(["--features", "gpu"]))?;
    let ours = workspace.target_directory.join("release/qv");
    let peer = rival(workspace, &what.python, None)?;
    let script = workspace.workspace_root.join("fixtures/gsplat/train.py");
    let mut rows = vec![];
    for capture in &what.captures {
        let name = capture.file_name().context("expected a folder with a name")?.to_string_lossy().into_owned();
        let place = folder(workspace)?.join("reconstruct").join(&name);
        std::fs::create_dir_all(&place).with_context(|| format!("making {}", place.display()))?;
        let row = |by, seed, seconds, scene: &Path| -> Result<Row> {
            let scored = last_line(Command::new(&helper).arg("score").arg(capture).arg(scene))?;
            Ok(Row { capture: name.clone(), seed, by, seconds, scored })
        };
        for seed in 0..what.seeds {
            eprintln!("{name}, seed {seed}");
            if peer.is_some() {
                let (photographs, scene) = (place.join("photographs.bin"), place.join(format!("gsplat_{seed}.ply")));
                process::run(Command::new(&helper).arg("export").arg(capture).arg(&photographs))?;
                let mut python = Command::new(&what.python);
                python.env("PYTHONDONTWRITEBYTECODE", "1").arg(&script);
                python.arg("--capture").arg(&photographs).arg("--out").arg(&scene);
                let trained: TrainerOutput = last_line(with_options(&mut python, what, seed))?;
                rows.push(row("gsplat", seed, trained.seconds, &scene)?);
            }
            let out = place.join(format!("qv_{seed}"));
            let mut program = Command::new(&ours);
            program.arg("reconstruct").arg(capture).arg("--out").arg(&out).args(["--gpu", "--json", "--quiet"]);
            // Both learn from the poses of the capture, unless others are asked for.
            if !what.options.iter().any(|option| option == "--poses") {
                program.args(["--poses", "capture"]);
            }
            let metrics: Metrics = last_line(with_options(&mut program, what, seed).args(&what.options))?;
            rows.push(row("qv", seed, metrics.train_s, &out.join("scene.ply"))?);
        }
    }
    print_table(&rows, what);
    write(workspace, "reconstruct.json", &rows)?;
    Ok(true)
}

fn with_options<'a>(program: &'a mut Command, what: &Reconstruct, seed: u32) -> &'a mut Command {
    let (iterations, cap, seed) = (what.iterations.to_string(), what.cap.to_string(), seed.to_string());
    program.args(["--iterations", &iterations, "--cap", &cap, "--seed", &seed])
}

fn print_table(rows: &[Row], what: &Reconstruct) {
    println!("{} steps, {} seeds, means; every 8th image is held out", what.iterations, what.seeds);
    println!("| scene | by | Gaussians | PSNR, dB | SSIM | training, s |");
    println!("|---|---|---:|---:|---:|---:|");
    let mut known: Vec<(&str, &str)> = vec![];
    for row in rows {
        if !known.contains(&(&row.capture, row.by)) {
            known.push((&row.capture, row.by));
        }
    }
    for (capture, by) in known {
        let all: Vec<&Row> = rows.iter().filter(|row| row.capture == capture && row.by == by).collect();
        println!("{}", line(capture, by, &all));
    }
}

/// A row of the table: means, and the scores of each seed.
fn line(capture: &str, by: &str, all: &[&Row]) -> String {
    let mean = |of: fn(&Row) -> f64| all.iter().map(|row| of(row)).sum::<f64>() / all.len().max(1) as f64;
    let each: Vec<String> = all.iter().map(|row| format!("{:.2}", row.scored.psnr)).collect();
    format!(
        "| {capture} | {by} | {:.0}k | {:.2} ({}) | {:.4} | {:.1} |",
        mean(|row| row.scored.gaussians as f64 / 1e3),
        mean(|row| row.scored.psnr),
        each.join(", "),
        mean(|row| row.scored.ssim),
        mean(|row| row.seconds)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_has_means_and_each_seed() {
        let row = |seed: u32, psnr: f64| Row {
            capture: "fox".into(),
            seed,
            by: "qv",
            seconds: 10.0 + f64::from(seed),
            scored: ScoreOutput { images: 7, gaussians: 150_000, psnr, ssim: 0.9 },
        };
        let rows = [row(0, 31.0), row(1, 32.0)];
        let line = line("fox", "qv", &rows.iter().collect::<Vec<_>>());
        assert_eq!(line, "| fox | qv | 150k | 31.50 (31.00, 32.00) | 0.9000 | 10.5 |");
    }
}
