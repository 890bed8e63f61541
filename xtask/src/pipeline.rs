//! `cargo xtask pipeline`: the main job on a made-up recording, stage by stage. A stage runs when its inputs have changed since it
//! last ran, or its outputs have.

use crate::{process, workspace::Workspace};
use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

/// Seed of the recording.
const SEED: u64 = 1;

/// What to run.
#[derive(Args)]
pub struct Pipeline {
    /// Run this stage alone, on what earlier ones left
    #[arg(long, value_name = "STAGE", conflicts_with = "from")]
    only: Option<Stage>,
    /// Run this stage and all later ones, whether or not something changed
    #[arg(long, value_name = "STAGE")]
    from: Option<Stage>,
    /// Folder for what the stages write; default target/pipeline
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// The stages, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
enum Stage {
    /// Makes up a recording, its ground and its truth
    Recording,
    /// Says what is in the recording
    Inspect,
    /// Replays the recording in the simulator
    Replay,
    /// Says what makes the two differ
    Diagnose,
}

impl Stage {
    fn name(self) -> &'static str {
        match self {
            Self::Recording => "recording",
            Self::Inspect => "inspect",
            Self::Replay => "replay",
            Self::Diagnose => "diagnose",
        }
    }

    /// Files that it reads, relative to the pipeline's folder.
    fn inputs(self) -> &'static [&'static str] {
        match self {
            Self::Recording => &[],
            Self::Inspect => &["recording/run.mcap"],
            Self::Replay | Self::Diagnose => &["recording/run.mcap", "recording/terrain.glb"],
        }
    }

    /// Files that it writes, relative to the pipeline's folder.
    fn outputs(self) -> &'static [&'static str] {
        match self {
            Self::Recording => &["recording/run.mcap", "recording/terrain.glb", "recording/truth.json"],
            Self::Inspect => &["inspect/inspect.json"],
            Self::Replay => &["replay/replay.json", "replay/replay.mcap", "replay/replay.html"],
            Self::Diagnose => &["diagnose/report.json", "diagnose/report.html", "diagnose/calibrated.toml"],
        }
    }

    /// Arguments for `qv`, run in the pipeline's folder.
    fn arguments(self) -> Vec<String> {
        let words = match self {
            Self::Recording => format!("fixture --seed {SEED} --out recording"),
            Self::Inspect => "inspect recording/run.mcap --json".into(),
            Self::Replay => "replay recording/run.mcap --terrain recording/terrain.glb --out replay --json".into(),
            Self::Diagnose => {
                "diagnose recording/run.mcap --terrain recording/terrain.glb --out diagnose --json".into()
            }
        };
        words.split(' ').map(String::from).collect()
    }
}

/// What a stage leaves beside its outputs: contents that it was run on, and what it wrote.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Stamp {
    inputs: u64,
    outputs: u64,
}

/// Runs the stages that need it; true when all ended well.
///
/// # Errors
/// `qv` does not build, or a stage fails or lacks what an earlier one writes.
pub fn run(workspace: &Workspace, pipeline: &Pipeline) -> Result<bool> {
    let folder = match &pipeline.out {
        Some(out) => std::path::absolute(out).with_context(|| format!("in {}", out.display()))?,
        None => workspace.target_directory.join("pipeline"),
    };
    let qv = build(workspace)?;
    for stage in Stage::value_variants() {
        let forced = pipeline.from.is_some_and(|from| *stage >= from) || pipeline.only == Some(*stage);
        if pipeline.only.is_none_or(|only| only == *stage) {
            run_stage(*stage, &qv, &folder, forced)?;
        }
    }
    conclude(&folder)?;
    Ok(true)
}

/// Builds `qv` with optimisation and returns the program.
///
/// # Errors
/// It does not build.
pub fn build(workspace: &Workspace) -> Result<PathBuf> {
    let mut cargo = process::cargo();
    cargo.current_dir(&workspace.workspace_root).args(["build", "--release", "--locked", "--package", "qv"]);
    process::run(cargo.args(["--target-dir"]).arg(&workspace.target_directory))?;
    Ok(workspace.target_directory.join("release").join(format!("qv{}", std::env::consts::EXE_SUFFIX)))
}

fn run_stage(stage: Stage, qv: &Path, folder: &Path, forced: bool) -> Result<()> {
    let own = folder.join(stage.name());
    let stamp_file = own.join("stamp.json");
    let mut read: Vec<PathBuf> = vec![qv.to_path_buf()];
    read.extend(stage.inputs().iter().map(|file| folder.join(file)));
    if let Some(missing) = read.iter().find(|file| !file.is_file()) {
        bail!("stage {}: expected {}, found nothing; run the stages before it", stage.name(), missing.display());
    }
    let written: Vec<PathBuf> = stage.outputs().iter().map(|file| folder.join(file)).collect();
    let inputs = hash(&stage.arguments(), &read)?;
    let stored = fs::read_to_string(&stamp_file).ok().and_then(|text| serde_json::from_str::<Stamp>(&text).ok());
    let fresh =
        written.iter().all(|file| file.is_file()) && stored == Some(Stamp { inputs, outputs: hash(&[], &written)? });
    if fresh && !forced {
        println!("{:<10} unchanged", stage.name());
        return Ok(());
    }
    if own.exists() {
        fs::remove_dir_all(&own).with_context(|| format!("removing {}", own.display()))?;
    }
    fs::create_dir_all(&own).with_context(|| format!("making {}", own.display()))?;
    let clock = Instant::now();
    let said = process::output(Command::new(qv).current_dir(folder).args(stage.arguments()))?;
    if stage == Stage::Inspect {
        fs::write(&written[0], said).with_context(|| format!("writing {}", written[0].display()))?;
    }
    let outputs = hash(&[], &written)?;
    fs::write(&stamp_file, serde_json::to_string(&Stamp { inputs, outputs })?)
        .with_context(|| format!("writing {}", stamp_file.display()))?;
    println!("{:<10} {:.2} s", stage.name(), clock.elapsed().as_secs_f64());
    Ok(())
}

/// FNV-1a of words and of the contents of files: against stale results, not against forgers.
///
/// # Errors
/// A file cannot be read.
pub fn hash(words: &[String], files: &[PathBuf]) -> Result<u64> {
    let mut state = 0xcbf2_9ce4_8422_2325_u64;
    let mut add = |bytes: &[u8]| {
        // The length keeps "ab", "c" apart from "a", "bc".
        for byte in (bytes.len() as u64).to_le_bytes().iter().chain(bytes) {
            state = (state ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
        }
    };
    words.iter().for_each(|word| add(word.as_bytes()));
    for file in files.iter().filter(|file| file.is_file()) {
        add(&fs::read(file).with_context(|| format!("reading {}", file.display()))?);
    }
    Ok(state)
}

/// Says what was found and where it is, as far as the stages have come.
fn conclude(folder: &Path) -> Result<()> {
    let file = folder.join("replay/replay.json");
    if file.is_file() {
        let verdict = read_json(&file)?;
        let verdict = verdict["verdict"].as_str().with_context(|| format!("{}: expected a verdict", file.display()))?;
        // One sentence a line.
        println!("{}\n{}", verdict.replace(". ", ".\n"), folder.join("replay/replay.html").display());
    }
    let file = folder.join("diagnose/report.json");
    if file.is_file() {
        let report = read_json(&file)?;
        let sentence =
            report["sentence"].as_str().with_context(|| format!("{}: expected a sentence", file.display()))?;
        println!("{sentence}\n{}", folder.join("diagnose/report.html").display());
    }
    Ok(())
}

fn read_json(file: &Path) -> Result<Value> {
    let text = fs::read_to_string(file).with_context(|| format!("reading {}", file.display()))?;
    serde_json::from_str(&text).with_context(|| format!("in {}", file.display()))
}

/// Writes the golden `replay.json` into `out`: every number of the report that another machine must find, too.
///
/// Tolerances are wide enough for another processor's rounding, which a trot amplifies once feet land, and narrow beside
/// what any effect does (1.7 mrad with the truth, 11.5 with a latency of 8 ms).
///
/// # Errors
/// The pipeline fails, or its report has another shape.
pub fn write_golden(workspace: &Workspace, out: &Path) -> Result<()> {
    let folder = workspace.target_directory.join("pipeline-golden");
    run(workspace, &Pipeline { only: None, from: Some(Stage::Recording), out: Some(folder.clone()) })?;
    let report = read_json(&folder.join("replay/replay.json"))?;
    let figures = |list: &Value, key: &str| -> Result<Map<String, Value>> {
        let items = list.as_array().context("replay.json: expected a list")?;
        items.iter().map(|i| Ok((i["name"].as_str().context("a name")?.to_string(), i[key].clone()))).collect()
    };
    let golden = json!({
        "generator": "cargo xtask golden bless replay",
        "name": "replay",
        "seed": SEED,
        "options": {"stages": Stage::value_variants().iter().filter(|s| **s <= Stage::Replay).map(|s| s.arguments().join(" ")).collect::<Vec<_>>()},
        "tolerance": {"windows_relative": 0.02, "whole_relative": 0.1, "base_m": 0.05, "lag_s": 0.0005},
        "windows_count": report["windows"]["count"],
        "windows_pos_rms_mean": report["windows"]["pos_rms_mean"],
        "windows_pos_rms": figures(&report["windows"]["joints"], "pos_rms")?,
        "whole_pos_rms_mean": report["pos_rms_mean"],
        "whole_pos_rms": figures(&report["joints"], "pos_rms")?,
        "lag_behind_simulation": figures(&report["lags"]["behind_simulation"], "lag")?,
        "base_pos_final": report["base"]["pos_final"],
    });
    fs::create_dir_all(out).with_context(|| format!("making {}", out.display()))?;
    let file = out.join("replay.json");
    fs::write(&file, format!("{golden:#}\n")).with_context(|| format!("writing {}", file.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    /// What a stage reads, an earlier one writes.
    #[test]
    fn stages_fit_together() {
        let mut written: BTreeMap<&str, Stage> = BTreeMap::new();
        for &stage in Stage::value_variants() {
            for file in stage.inputs() {
                assert!(written.get(file).is_some_and(|by| *by < stage), "{file}");
            }
            for file in stage.outputs() {
                assert!(file.starts_with(stage.name()), "{file} lies in the stage's own folder, which it empties");
                written.insert(file, stage);
            }
        }
    }

    #[test]
    fn contents_and_their_borders_change_the_hash() {
        let words = |w: &[&str]| hash(&w.iter().map(|w| (*w).to_string()).collect::<Vec<_>>(), &[]).unwrap();
        assert_eq!(words(&["ab", "c"]), words(&["ab", "c"]));
        assert_ne!(words(&["ab", "c"]), words(&["a", "bc"]));
        assert_ne!(words(&["ab"]), words(&["ac"]));
    }
}
