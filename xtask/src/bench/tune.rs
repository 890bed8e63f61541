//! `cargo xtask bench tune`: robots with hidden effects record walks, `qv-residual` closes the loop on them, and the robots walk again.

use super::contest::{self, build, median};
use crate::workspace::Workspace;
use crate::{pipeline, process, programs};
use anyhow::{Context, Result, bail};
use clap::Args;
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Options of the benchmark.
#[derive(Args)]
pub struct Tune {
    /// One robot of each kind instead of ten, and no seeds and bumps
    #[arg(long)]
    quick: bool,
    /// A checkpoint.bin of `qv walk train` to start from; default: one is trained
    #[arg(long, value_name = "FILE.bin")]
    checkpoint: Option<PathBuf>,
    /// A robot file beside its URDF, which the checkpoint is of; default: the Go2
    #[arg(long, value_name = "FILE.toml")]
    robot: Option<PathBuf>,
}

/// Robots of each kind: half inside the catalogue of effects, half outside.
const ROBOTS: u64 = 5;
/// Robots that are tuned with more seeds, and those seeds.
const MORE_SEEDS: ([(&str, u64); 3], [u64; 2]) = ([("inside", 0), ("inside", 1), ("outside", 1)], [1, 2]);
/// Height of bumps \[m\].
const BUMPS: &str = "0.04";

/// A score of paths.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
struct Paths {
    position: f64,
    position_se: f64,
    fell: u64,
}

#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
struct Candidate {
    kind: String,
    error: f64,
    stays: bool,
}

/// What the example prints of a robot.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
struct Outcome {
    robot: String,
    engine: String,
    seed: u64,
    seconds: f64,
    candidates: Vec<Candidate>,
    before: Paths,
    after: Paths,
    control: Option<Paths>,
}

impl Outcome {
    /// Joint error that is left of the simulator's as it was: of the best candidate that stays.
    fn joints(&self) -> f64 {
        let staying = self.candidates.iter().filter(|c| c.stays).map(|c| c.error);
        staying.fold(f64::INFINITY, f64::min) / self.candidates.first().map_or(f64::NAN, |c| c.error)
    }

    fn paths(&self) -> f64 {
        self.after.position / self.before.position
    }

    /// Whether the path is longer after than before by more than two standard errors.
    fn is_worse(&self) -> bool {
        let noise = self.before.position_se.hypot(self.after.position_se);
        self.after.position - self.before.position > 2.0 * noise || self.after.fell > self.before.fell
    }
}

/// All results.
#[derive(Debug, Clone, Serialize)]
struct Results {
    robots: Vec<Outcome>,
    seeds: Vec<Outcome>,
    /// On bumps: replays on the bumps, and on a plane.
    bumps: Vec<[Outcome; 2]>,
}

/// Runs the benchmark, which has no gate. What the same program made of a robot before is not made again.
///
/// # Errors
/// Our side cannot be built, or prints something unexpected.
pub fn run(workspace: &Workspace, tune: &Tune) -> Result<bool> {
    let program = build(workspace, "close_the_loop", &["rapier"])?;
    let kept = contest::folder(workspace)?.join("tuned");
    let trained = match &tune.checkpoint {
        Some(file) => file.clone(),
        None => train(workspace, tune, "plane")?,
    };
    let one = |kind: &str, robot: u64, more: &[&str]| one(&program, &trained, tune, &kept, kind, robot, more);
    let count = if tune.quick { 1 } else { ROBOTS };
    let mut results = Results { robots: vec![], seeds: vec![], bumps: vec![] };
    for kind in ["inside", "outside"] {
        for robot in 0..count {
            results.robots.push(one(kind, robot, &[])?);
        }
    }
    if !tune.quick {
        for (kind, robot) in MORE_SEEDS.0 {
            for seed in MORE_SEEDS.1 {
                results.seeds.push(one(kind, robot, &["--seed", &seed.to_string()])?);
            }
        }
        let bumpy = train(workspace, tune, "bumps")?;
        for robot in 0..2 * ROBOTS {
            let on = |more: &[&str]| {
                let all: Vec<&str> = ["--bumps", BUMPS].iter().chain(more).copied().collect();
                self::one(&program, &bumpy, tune, &kept, "inside", robot, &all)
            };
            results.bumps.push([on(&[])?, on(&["--flat"])?]);
        }
    }
    notify(&results);
    contest::write(workspace, "tune.json", &results)?;
    Ok(true)
}

/// A policy to begin with: the default training.
fn train(workspace: &Workspace, tune: &Tune, ground: &str) -> Result<PathBuf> {
    let qv = programs::qv(workspace)?;
    let out = contest::folder(workspace)?.join(format!("tune_{ground}"));
    let mut command = Command::new(qv);
    command.args(["walk", "train", "--terrain", ground]);
    if tune.quick {
        command.args(["--iterations", "600"]);
    }
    if let Some(robot) = &tune.robot {
        command.arg("--robot").arg(robot);
    }
    process::run(command.arg("--out").arg(&out))?;
    Ok(out.join("checkpoint.bin"))
}

fn one(
    program: &Path,
    checkpoint: &Path,
    tune: &Tune,
    kept: &Path,
    kind: &str,
    robot: u64,
    more: &[&str],
) -> Result<Outcome> {
    let robot = robot.to_string();
    let words: Vec<String> = [kind, &robot, &robot].iter().chain(more).map(|w| w.to_string()).collect();
    let read: Vec<PathBuf> =
        [program, checkpoint].into_iter().chain(tune.robot.as_deref()).map(Path::to_path_buf).collect();
    let file = kept.join(format!("{:016x}.json", pipeline::hash(&words, &read)?));
    if let Ok(text) = fs::read_to_string(&file) {
        eprintln!("{} (kept)", words.join(" "));
        return serde_json::from_str(&text).with_context(|| format!("in {}", file.display()));
    }
    eprintln!("{}", words.join(" "));
    let mut command = Command::new(program);
    command.arg(checkpoint).args(&words);
    if let Some(file) = &tune.robot {
        command.arg("--robot").arg(file);
    }
    let found: Outcome = contest::last_line(&mut command)?;
    if found.candidates.is_empty() {
        bail!("{kind} {robot}: expected candidates, found none");
    }
    fs::create_dir_all(kept).with_context(|| format!("making {}", kept.display()))?;
    fs::write(&file, serde_json::to_string(&found)?).with_context(|| format!("writing {}", file.display()))?;
    Ok(found)
}

fn notify(results: &Results) {
    println!(
        "robot, engine: joint error left, path before and after [m], path left, control in the judging simulator [m], wall time [s]"
    );
    let row = |o: &Outcome| {
        let control = o.control.as_ref().map_or("-".into(), |c| format!("{:.3}", c.position));
        println!(
            "{:<28} {:<7} seed {}: {:.2}, {:.3} ± {:.3}, {:.3} ± {:.3}, {:.2}, {control}, {:.0}",
            o.robot,
            o.engine,
            o.seed,
            o.joints(),
            o.before.position,
            o.before.position_se,
            o.after.position,
            o.after.position_se,
            o.paths(),
            o.seconds
        );
    };
    results.robots.iter().chain(&results.seeds).for_each(row);
    let shares: Vec<f64> = results.robots.iter().map(Outcome::paths).collect();
    let (better, worse) =
        (shares.iter().filter(|s| **s < 1.0).count(), results.robots.iter().filter(|o| o.is_worse()).count());
    println!(
        "path left: median {:.2}, better on {better} of {}, worse by more than noise on {worse}",
        median(shares.clone()),
        shares.len()
    );
    if !results.bumps.is_empty() {
        println!("on bumps, first with replays on the bumps, then with replays on a plane:");
        results.bumps.iter().flatten().for_each(row);
        let better = results.bumps.iter().filter(|[bumps, flat]| bumps.after.position < flat.after.position).count();
        println!("replays on the bumps left the shorter path on {better} of {}", results.bumps.len());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(before: f64, after: f64, errors: &[(f64, bool)]) -> Outcome {
        let paths = |position| Paths { position, position_se: 0.01, fell: 0 };
        let candidate = |&(error, stays): &(f64, bool)| Candidate { kind: String::new(), error, stays };
        Outcome {
            robot: String::new(),
            engine: String::new(),
            seed: 0,
            seconds: 1.0,
            candidates: errors.iter().map(candidate).collect(),
            before: paths(before),
            after: paths(after),
            control: None,
        }
    }

    #[test]
    fn shares_and_what_is_worse() {
        let good = outcome(0.4, 0.1, &[(0.08, true), (0.02, true), (0.01, false)]);
        assert!((good.joints() - 0.25).abs() < 1e-12 && (good.paths() - 0.25).abs() < 1e-12 && !good.is_worse());
        assert!(!outcome(0.1, 0.11, &[]).is_worse(), "within noise");
        assert!(outcome(0.1, 0.2, &[]).is_worse());
    }
}
