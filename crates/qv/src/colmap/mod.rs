//! Poses of photographs by COLMAP, which runs as a Python package in a virtual environment that this makes.

mod again;

pub use again::{PoseChoice, better_poses, poses_again};

use crate::Failure;
use crate::outcome::about;
use crate::output::write_whole;
use crate::python::{Environment, said};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// The program that calls COLMAP.
const PROGRAM: &str = include_str!("poses.py");
const PYTHON: Environment = Environment {
    name: "colmap",
    packages: "pycolmap 4.2.1",
    requirements: include_str!("requirements.txt"),
    import: "import pycolmap; pycolmap.global_mapping",
    variable: "QV_COLMAP_VENV",
    purpose: "COLMAP, which looks for poses (50 MB)",
};

/// Share of the matches below which poses are doubted: right ones held 0.87 to 0.89, wrong ones 0.70.
const DOUBTFUL: f64 = 0.8;

/// What COLMAP made of the frames.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ColmapResult {
    /// Frames that it was given.
    pub frames: usize,
    /// Frames with a pose in the largest model.
    pub placed: usize,
    /// Share of the verified matches that the model holds.
    pub held: f64,
    /// Share of the verified matches that the given poses explain: those within 2 px of their epipolar lines.
    #[serde(default)]
    pub given_explain: Option<f64>,
    /// The same of the poses of the model; none where none was made.
    #[serde(default)]
    pub found_explain: Option<f64>,
}

impl ColmapResult {
    /// Says so when a part of the poses may be wrong.
    pub fn doubt(&self, path: &Path) -> Option<String> {
        let held = 100.0 * self.held;
        let said = format!("{}: poses hold {held:.0} % of the matches only: a part may lie wrong", path.display());
        (self.held < DOUBTFUL).then_some(said)
    }
}

/// What is known of the cameras.
#[derive(Debug, Serialize)]
pub struct CameraHints {
    /// The lenses.
    pub cameras: Vec<GivenCamera>,
    /// Poses `camera_from_world` by image: the first three rows of the matrix, row by row.
    pub poses: BTreeMap<String, Vec<f64>>,
    /// Poses are looked for only where the given ones do not explain nearly all verified matches.
    pub check: bool,
}

/// A lens to begin with, and which images it took, relative to the folder of images.
#[derive(Debug, Serialize)]
pub struct GivenCamera {
    /// COLMAP's name of the lens.
    pub model: String,
    /// Its parameters in COLMAP's order.
    pub params: Vec<f64>,
    /// Images.
    pub images: Vec<String>,
}

/// Whether COLMAP is there: nothing is made for it.
pub fn is_there() -> bool {
    PYTHON.is_there()
}

/// Finds from where `images` were taken, and writes the model to `folder/sparse/0`. With nothing given all are of one unknown lens.
///
/// # Errors
/// Python or its package cannot be had, or COLMAP fails.
pub fn find(images: &Path, folder: &Path, given: Option<&CameraHints>) -> Result<ColmapResult, Failure> {
    let lenses = folder.join("given.json");
    let mut arguments = vec![images, folder];
    if let Some(given) = given {
        write_whole(&lenses, serde_json::to_string(given)?.as_bytes())?;
        arguments.push(&lenses);
    }
    let wrong = |found: String| {
        let without = "a capture with a COLMAP model or other poses needs none of it";
        about(images, format!("expected poses from COLMAP, found {found}; {without}"))
    };
    let last = said(&PYTHON, PROGRAM, &folder.join("poses.py"), &arguments).map_err(|e| wrong(e.to_string()))?;
    serde_json::from_str(&last).map_err(|_| wrong(format!("{last:?}")))
}
