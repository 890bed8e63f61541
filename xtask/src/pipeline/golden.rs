//! The figures of each stage against those of a run that was looked at: which stage moved first, and by how much.

use super::stages::{SEED, Size, Stage};
use anyhow::{Context, Result};
use clap::ValueEnum;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// One figure of a stage: a number within a tolerance, or a word.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// Name of the stage.
    pub stage: String,
    /// What it is.
    pub figure: String,
    /// Number, word or truth value.
    pub value: Value,
    /// How far a number may be off. The same program gives the same bits on any thread count; another processor's library of mathematics
    /// rounds otherwise, and training and walking amplify it: a fifth of the figure at most.
    pub tolerance: f64,
}

/// What a golden is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Of {
    /// All stages but the optional one.
    Stages,
    /// The optional stage `navigate`.
    Navigate,
}

impl Of {
    /// Golden and size by the name in the manifest.
    pub fn named(name: &str) -> Option<(Self, Size)> {
        let all = [Self::Stages, Self::Navigate].into_iter().flat_map(|of| [(of, Size::Small), (of, Size::Full)]);
        all.into_iter().find(|(of, size)| of.name(*size) == name)
    }

    fn name(self, size: Size) -> &'static str {
        match (self, size) {
            (Self::Stages, Size::Small) => "stages",
            (Self::Stages, Size::Full) => "stages_full",
            (Self::Navigate, Size::Small) => "navigate",
            (Self::Navigate, Size::Full) => "navigate_full",
        }
    }

    /// Its file beside the others.
    pub fn file(self, size: Size) -> String {
        format!("{}.json", self.name(size))
    }

    /// Whether it has figures of a stage.
    fn has(self, stage: Stage) -> bool {
        stage.is_optional() == (self == Self::Navigate)
    }
}

/// How a figure is taken from what a stage wrote.
struct Source {
    stage: Stage,
    figure: &'static str,
    file: &'static str,
    pointer: &'static str,
    /// Absolute, and relative to the value.
    tolerance: [f64; 2],
}

const fn source(
    stage: Stage,
    figure: &'static str,
    file: &'static str,
    pointer: &'static str,
    tolerance: [f64; 2],
) -> Source {
    Source { stage, figure, file, pointer, tolerance }
}

/// All but frictions, which are taken by label.
const SOURCES: [Source; 25] = [
    source(Stage::Yard, "focal length in pixels", "yard/transforms.json", "/fl_y", [1e-9, 0.0]),
    source(Stage::Recording, "seconds on tiles", "inspect/tiles.json", "/duration", [0.01, 0.0]),
    source(Stage::Recording, "seconds on gravel", "inspect/gravel.json", "/duration", [0.01, 0.0]),
    source(Stage::Reconstruct, "Gaussians", "reconstruct/metrics.json", "/gaussians", [0.0, 0.01]),
    source(Stage::Reconstruct, "PSNR held out in dB", "reconstruct/metrics.json", "/mean/psnr", [0.1, 0.0]),
    source(Stage::Mesh, "watertight", "mesh/mesh.json", "/watertight", [0.0, 0.0]),
    source(Stage::Mesh, "F1 at 2 cm", "mesh/mesh.json", "/likeness/0/f1", [0.005, 0.0]),
    source(Stage::Contact, "base error, posterior", "contact/contact.json", "/base_error/all/posterior", [0.0, 0.05]),
    source(Stage::Replay, "rms of joints in windows", "replay/replay.json", "/windows/pos_rms_mean", [0.0, 0.02]),
    source(Stage::Diagnose, "verdict", "diagnose/report.json", "/verdict", [0.0, 0.0]),
    source(Stage::Diagnose, "effect", "diagnose/report.json", "/causes/0/effect", [0.0, 0.0]),
    source(Stage::Diagnose, "its size", "diagnose/report.json", "/causes/0/parameters/0/value", [0.0, 0.03]),
    source(Stage::Diagnose, "closed share", "diagnose/report.json", "/gap/closed", [0.02, 0.0]),
    source(Stage::Again, "friction of tiles", "again/contact.json", "/regions/2/friction", [0.0, FRICTION]),
    source(Stage::Again, "base error, posterior", "again/contact.json", "/base_error/all/posterior", [0.0, 0.05]),
    source(Stage::Tune, "joints off in rad, as it was", "tune/tune.json", JOINTS_BEFORE, [0.0, 0.1]),
    source(Stage::Tune, "joints off in rad, parameters", "tune/tune.json", JOINTS_AFTER, [0.0, 0.15]),
    source(Stage::Paths, "metres off the path, before", "paths/paths.json", "/policies/0/paths/position", [0.0, 0.2]),
    source(Stage::Paths, "metres off the path, after", "paths/paths.json", "/policies/1/paths/position", [0.0, 0.2]),
    source(Stage::Navigate, "share reached, policy", RESULTS, "/rows/0/row/success", [0.0, 0.1]),
    source(Stage::Navigate, "success rate, expert", RESULTS, "/rows/1/row/success", [0.07, 0.0]),
    source(Stage::Navigate, "success rate, policy on a learned controller", WALKED, "/rows/0/row/success", [0.0, 0.15]),
    source(Stage::Navigate, "loss of the last round", "navigate/metrics.json", "/2/loss", [0.0, 0.05]),
    source(Stage::Navigate, "decisions", "navigate/metrics.json", "/2/frames", [0.0, 0.05]),
    source(Stage::Navigate, "who drives first", RESULTS, "/rows/0/name", [0.0, 0.0]),
];

const RESULTS: &str = "navigate/results.json";
const WALKED: &str = "navigate/walked.json";

const JOINTS_BEFORE: &str = "/candidates/0/held_out/error";
/// Of the parameters that were fitted, after the simulator as it was and what the diagnosis gave.
const JOINTS_AFTER: &str = "/candidates/2/held_out/error";

/// A friction may be off by this share.
const FRICTION: f64 = 0.05;

/// The figures of a finished run that a golden is of, in the order of the stages.
///
/// # Errors
/// A file of a stage is missing, or lacks a figure.
pub fn figures(folder: &Path, of: Of) -> Result<Vec<Figure>> {
    let mut out = vec![];
    for source in SOURCES.iter().filter(|source| of.has(source.stage)) {
        let report = read_json(&folder.join(source.file))?;
        let value = report
            .pointer(source.pointer)
            .with_context(|| format!("{}: expected {}, found none", source.file, source.pointer))?;
        let [absolute, relative] = source.tolerance;
        let tolerance = absolute + relative * value.as_f64().unwrap_or(0.0).abs();
        let (stage, figure) = (source.stage.name().into(), source.figure.into());
        out.push(Figure { stage, figure, value: value.clone(), tolerance });
    }
    if of == Of::Navigate {
        return Ok(out);
    }
    let contact = read_json(&folder.join("contact/contact.json"))?;
    let regions = contact["regions"].as_array().context("contact.json: expected regions")?;
    for region in regions {
        let label = region["label"].as_str().context("contact.json: expected the label of a region")?;
        let (stage, figure) = (Stage::Contact.name().into(), format!("friction of {label}"));
        let tolerance = FRICTION * region["friction"].as_f64().unwrap_or(0.0);
        out.push(Figure { stage, figure, value: region["friction"].clone(), tolerance });
    }
    let place = |figure: &Figure| Stage::value_variants().iter().position(|stage| stage.name() == figure.stage);
    out.sort_by_key(place);
    Ok(out)
}

/// What a golden holds and a run does not, or a run and no golden, in words, the first stage first; empty when they agree.
pub fn differences(golden: &[Figure], found: &[Figure]) -> Vec<String> {
    let is_known = |f: &&Figure| golden.iter().any(|g| g.stage == f.stage && g.figure == f.figure);
    let new = found.iter().filter(|f| !is_known(f));
    let new = new.map(|f| (f, format!("{}, {}: expected none, found {}", f.stage, f.figure, f.value)));
    let mut all: Vec<(&Figure, String)> = moved(golden, found).into_iter().chain(new).collect();
    let place = |figure: &Figure| Stage::value_variants().iter().position(|stage| stage.name() == figure.stage);
    all.sort_by_key(|(figure, _)| place(figure));
    all.into_iter().map(|(_, words)| words).collect()
}

/// Figures of the golden that a run lacks or has otherwise, in words.
fn moved<'a>(golden: &'a [Figure], found: &[Figure]) -> Vec<(&'a Figure, String)> {
    golden
        .iter()
        .filter_map(|expected| {
            let same = |f: &&Figure| f.stage == expected.stage && f.figure == expected.figure;
            let Some(found) = found.iter().find(same) else {
                let words = format!("{}, {}: expected {}, found none", expected.stage, expected.figure, expected.value);
                return Some((expected, words));
            };
            let away = match (expected.value.as_f64(), found.value.as_f64()) {
                (Some(a), Some(b)) if (a - b).abs() <= expected.tolerance => return None,
                (Some(a), Some(b)) => format!(", {:+.4} (allowed {:.4})", b - a, expected.tolerance),
                _ if expected.value == found.value => return None,
                _ => String::new(),
            };
            let Figure { stage, figure, value, .. } = expected;
            Some((expected, format!("{stage}, {figure}: expected {value}, found {}{away}", found.value)))
        })
        .collect()
}

/// The golden of the stages, or of the optional one.
///
/// # Errors
/// It is missing or malformed.
pub fn read(root: &Path, of: Of, size: Size) -> Result<Vec<Figure>> {
    read_file(&root.join("fixtures/pipeline/golden").join(of.file(size)))
}

/// The figures of a golden.
///
/// # Errors
/// The file is missing or malformed.
pub fn read_file(file: &Path) -> Result<Vec<Figure>> {
    let golden = read_json(file)?;
    serde_json::from_value(golden["figures"].clone()).with_context(|| format!("{}: figures", file.display()))
}

/// What the stages of a golden run, one call after another.
pub fn calls(of: Of, size: Size) -> Vec<String> {
    let stages = Stage::value_variants().iter().filter(|stage| of.has(**stage));
    stages.flat_map(|stage| stage.calls(size, false)).map(|call| call.arguments().join(" ")).collect()
}

/// Writes the golden of a finished run.
///
/// # Errors
/// The run lacks a figure, or the file cannot be written.
pub fn write(folder: &Path, of: Of, size: Size, file: &Path) -> Result<()> {
    let golden = json!({
        "generator": format!("cargo xtask golden bless {}", of.name(size)),
        "name": of.name(size),
        "seed": SEED,
        "options": {"stages": calls(of, size)},
        "tolerance": "by figure; words are to be the same",
        "figures": figures(folder, of)?,
    });
    fs::write(file, format!("{golden:#}\n")).with_context(|| format!("writing {}", file.display()))
}

/// The JSON of a file.
pub(super) fn read_json(file: &Path) -> Result<Value> {
    let text = fs::read_to_string(file).with_context(|| format!("reading {}", file.display()))?;
    serde_json::from_str(&text).with_context(|| format!("in {}", file.display()))
}
