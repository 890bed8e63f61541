//! A few sealed recordings whose diagnoses are a golden: what is said of each, how far its size is off, what it closes.

use super::answers::Case;
use super::arguments::Blind;
use super::diagnosed;
use super::generate::{Origin, Set};
use super::score::{DiagnosisScore, score};
use crate::pipeline::{Figure, differences, read_golden};
use crate::workspace::Workspace;
use anyhow::{Context, Result};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// Seed of the recordings.
const SEED: u64 = 20;
/// One actuator, one joint, one sensor; nothing, and something that no library has.
const EFFECTS: [&str; 3] = ["command_latency", "joint_coulomb_friction", "imu_tilt"];
/// How far the error of a size, and a closed share, may move, as shares of themselves: another processor rounds otherwise.
const SIZE: f64 = 0.2;
const CLOSED: f64 = 0.03;

fn set() -> Set {
    Set { origin: Origin::Rapier, effects: EFFECTS.to_vec(), per_effect: 1, none: 1, withheld: 1, pairs: 0 }
}

/// Makes and diagnoses the recordings and compares with the golden; true when all agree.
///
/// # Errors
/// As [`super::run`], or the golden is missing.
pub fn check(workspace: &Workspace) -> Result<bool> {
    let (expected, found) = (read(&workspace.workspace_root)?, figures(workspace)?);
    let differences = differences(&expected, &found);
    match differences.is_empty() {
        true => println!("{} figures of sealed recordings are those of the golden", expected.len()),
        false => println!("sealed recordings:\n  {}", differences.join("\n  ")),
    }
    Ok(differences.is_empty())
}

/// Writes the golden into `out`.
///
/// # Errors
/// As [`super::run`].
pub fn write(workspace: &Workspace, out: &Path) -> Result<()> {
    fs::create_dir_all(out).with_context(|| format!("making {}", out.display()))?;
    let golden = json!({
        "generator": "cargo xtask golden bless blind",
        "name": "blind",
        "seed": SEED,
        "options": format!("{:?}", set()),
        "tolerance": "by figure; words are to be the same",
        "figures": figures(workspace)?,
    });
    let file = out.join("blind.json");
    fs::write(&file, format!("{golden:#}\n")).with_context(|| format!("writing {}", file.display()))
}

/// The golden.
///
/// # Errors
/// It is missing or malformed.
pub fn read(root: &Path) -> Result<Vec<Figure>> {
    read_golden(&root.join("fixtures/blind/golden/blind.json"))
}

fn figures(workspace: &Workspace) -> Result<Vec<Figure>> {
    let blind = Blind::of(&["--subset", "--seed", &SEED.to_string()])?;
    let (answers, reports) = diagnosed(workspace, &blind, &[set()], &workspace.target_directory.join("blind"))?;
    let mut all = Vec::new();
    for (name, answer) in &answers.recordings {
        all.extend(of(&score(name, answer, &reports.join(name))?));
    }
    all.sort_by(|a, b| (&a.stage, &a.figure).cmp(&(&b.stage, &b.figure)));
    Ok(all)
}

/// Figures of one recording, which goes by what is there: its name is random.
fn of(scored: &DiagnosisScore) -> Vec<Figure> {
    let there = match scored.case {
        Case::None => "no effect".to_string(),
        Case::Withheld => format!("out-of-library {}", scored.truth.join(" and ")),
        _ => scored.truth.join(" and "),
    };
    let figure = |figure: &str, value: Value, tolerance: f64| Figure {
        stage: there.clone(),
        figure: figure.into(),
        value,
        tolerance,
    };
    let mut all = vec![figure("said first", json!(scored.said), 0.0)];
    if scored.named {
        let largest = scored.errors.iter().copied().fold(0.0, f64::max);
        all.push(figure("error over range", json!(largest), SIZE * largest));
        all.extend(scored.closed.map(|closed| figure("closed share", json!(closed), CLOSED * closed)));
    }
    all.extend(scored.left_out.as_ref().map(|left_out| figure("said without it", json!(left_out.said), 0.0)));
    all
}
