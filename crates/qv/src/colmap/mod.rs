//! Poses of photographs by COLMAP, which runs as a Python package in a virtual environment that this makes.

mod again;

pub use again::poses_again;

use crate::Failure;
use crate::open::spinner;
use crate::scene::about;
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The program that calls COLMAP.
const PROGRAM: &str = include_str!("poses.py");
/// The package, in the version that it was tried with.
const PACKAGE: &str = "pycolmap==4.2.1";
/// Names that Python goes by.
const PYTHONS: [&str; 2] = ["python3", "python"];
/// Variable that names a virtual environment with pycolmap to use instead of one of our own.
const ENVIRONMENT: &str = "QV_COLMAP_VENV";

/// Share of the matches below which poses are doubted: right ones held 0.87 to 0.89, wrong ones 0.70.
const DOUBTFUL: f64 = 0.8;

/// What COLMAP made of the frames.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Placed {
    /// Frames that it was given.
    pub frames: usize,
    /// Frames with a pose in the largest model.
    pub placed: usize,
    /// Share of the verified matches that the model holds.
    pub held: f64,
}

impl Placed {
    /// Says so when a part of the poses may be wrong.
    pub fn doubt(&self, path: &Path) -> Option<String> {
        let held = 100.0 * self.held;
        let said = format!("{}: poses hold {held:.0} % of the matches only: a part may lie wrong", path.display());
        (self.held < DOUBTFUL).then_some(said)
    }
}

/// What is known of the cameras.
#[derive(Debug, Serialize)]
pub struct Given {
    /// The lenses.
    pub cameras: Vec<GivenCamera>,
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

/// Finds from where `images` were taken, and writes the model to `folder/sparse/0`. With nothing given all are of one unknown lens.
///
/// # Errors
/// Python or its package cannot be had, or COLMAP fails.
pub fn find(images: &Path, folder: &Path, given: Option<&Given>) -> Result<Placed, Failure> {
    let python = environment()?;
    let program = folder.join("poses.py");
    fs::write(&program, PROGRAM).map_err(|e| about(&program, format!("expected to write it, found {e}")))?;
    let cameras = folder.join("given.json");
    if let Some(given) = given {
        let written = fs::write(&cameras, serde_json::to_string(given)?);
        written.map_err(|e| about(&cameras, format!("expected to write it, found {e}")))?;
    }
    let mut command = Command::new(&python);
    command
        .arg("-u")
        .arg(&program)
        .arg(images)
        .arg(folder)
        .args(given.is_some().then_some(&cameras))
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let mut child = command.spawn().map_err(|e| about(&python, format!("expected Python, found {e}")))?;
    let (stdout, stderr) = (child.stdout.take(), child.stderr.take());
    // Read beside, so that neither of the two waits for the other.
    let errors = std::thread::spawn(move || {
        let mut text = String::new();
        stderr.map(|mut pipe| pipe.read_to_string(&mut text));
        text
    });
    let (sign, mut last) = (spinner("looking for poses"), String::new());
    for line in stdout.into_iter().flat_map(|pipe| BufReader::new(pipe).lines()).map_while(Result::ok) {
        sign.set_message(line.clone());
        last = line;
    }
    let status = child.wait().map_err(|e| about(&python, format!("expected it to end, found {e}")))?;
    sign.finish_and_clear();
    let errors = errors.join().unwrap_or_default();
    match serde_json::from_str(&last) {
        Ok(placed) if status.success() => Ok(placed),
        _ => {
            let why = errors.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("nothing said");
            Err(about(images, format!("expected poses from COLMAP, found {status}: {why}")))
        }
    }
}

/// Python of an environment that has the package; made if need be.
fn environment() -> Result<PathBuf, Failure> {
    let own = std::env::var_os(ENVIRONMENT).map(PathBuf::from);
    let folder = own.clone().unwrap_or_else(|| cache().join("colmap"));
    let python = folder.join(if cfg!(windows) { "Scripts/python.exe" } else { "bin/python" });
    if imports(&python) {
        return Ok(python);
    }
    if own.is_some() {
        return Err(about(
            &folder,
            format!("expected a virtual environment with {PACKAGE} ({ENVIRONMENT}), found none"),
        ));
    }
    let sign = spinner("making a Python environment for COLMAP (once; some 50 MB)");
    let base = PYTHONS.iter().find(|name| ends_well(Command::new(name).arg("--version")));
    let base = base.ok_or(
        "python3: expected it among the programs, found none; install it, or give a folder with a COLMAP model",
    )?;
    said_well(
        Command::new(base).args(["-m", "venv"]).arg(&folder),
        "a virtual environment (Debian has it in python3-venv)",
    )?;
    said_well(
        Command::new(&python).args(["-m", "pip", "install", "--quiet", PACKAGE]),
        "pycolmap from the package index",
    )?;
    sign.finish_and_clear();
    Ok(python)
}

/// Where programs keep what they can make again.
fn cache() -> PathBuf {
    let home = || std::env::var_os(if cfg!(windows) { "LOCALAPPDATA" } else { "HOME" }).map(PathBuf::from);
    let base = std::env::var_os("XDG_CACHE_HOME").map(PathBuf::from).or_else(|| home().map(|home| home.join(".cache")));
    base.unwrap_or_else(std::env::temp_dir).join("quadverse")
}

fn imports(python: &Path) -> bool {
    ends_well(Command::new(python).args(["-c", "import pycolmap; pycolmap.global_mapping"]))
}

fn ends_well(command: &mut Command) -> bool {
    command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}

fn said_well(command: &mut Command, expected: &str) -> Result<(), Failure> {
    let output = command.stdin(Stdio::null()).output().map_err(|e| format!("expected {expected}, found {e}"))?;
    if output.status.success() {
        return Ok(());
    }
    let errors = String::from_utf8_lossy(&output.stderr);
    let why = errors.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("nothing said");
    Err(format!("expected {expected}, found {}: {why}; a folder with a COLMAP model needs none of it", output.status)
        .into())
}
