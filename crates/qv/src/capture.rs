//! Captures on disk: cameras with photographs, and points to begin with.

use crate::Failure;
use crate::scene::{about, open_cameras};
use qv_splat::captures::{Capture, colmap_points};
use qv_splat::files::{Points, points};
use std::fs;
use std::path::{Path, PathBuf};

/// Endings that are tried when a capture names its images without one.
const ENDINGS: [&str; 4] = ["", ".png", ".jpg", ".jpeg"];

/// A capture with the folder that its paths are relative to.
pub struct OpenCapture {
    pub capture: Capture,
    pub folders: Vec<PathBuf>,
    /// Points to begin with, if there are any.
    pub points: Option<Points>,
}

/// Opens a `transforms.json`, a folder that holds one, a COLMAP project or an RGB-D folder.
pub fn open_capture(path: &Path) -> Result<OpenCapture, Failure> {
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(Path::new("")) };
    let capture = open_cameras(path)?;
    let points = points_of(folder)?;
    // COLMAP's images lie in a folder beside the model.
    let above = folder.ancestors().take(3).map(|above| above.join("images"));
    let folders = std::iter::once(folder.to_path_buf()).chain(above).collect();
    Ok(OpenCapture { capture, folders, points: points.filter(|points| !points.places.is_empty()) })
}

/// `points.ply`, or the points of a COLMAP model where its cameras may be.
fn points_of(folder: &Path) -> Result<Option<Points>, Failure> {
    for place in [
        "points.ply",
        "points3D.bin",
        "sparse/0/points3D.bin",
        "sparse/points3D.bin",
        "points3D.txt",
        "sparse/0/points3D.txt",
    ] {
        let path = folder.join(place);
        let Ok(bytes) = fs::read(&path) else { continue };
        let points = match path.extension().and_then(|ending| ending.to_str()) {
            Some("ply") => points::read(&bytes),
            Some("bin") => colmap_points::read_binary(&bytes),
            _ => colmap_points::read_text(&String::from_utf8_lossy(&bytes)),
        };
        return Ok(Some(points.map_err(|e| about(&path, e))?));
    }
    Ok(None)
}

impl OpenCapture {
    /// The contents of a file of the capture, or where it was looked for.
    pub fn read(&self, path: &str) -> Result<Vec<u8>, String> {
        let plain = path.trim_start_matches("./");
        for folder in &self.folders {
            for ending in ENDINGS {
                let candidate = folder.join(format!("{plain}{ending}"));
                if candidate.is_file() {
                    return fs::read(&candidate).map_err(|e| format!("{}: {e}", candidate.display()));
                }
            }
        }
        let first = self.folders.first().map(|folder| folder.join(plain).display().to_string());
        Err(format!("none at {}", first.unwrap_or_default()))
    }
}
