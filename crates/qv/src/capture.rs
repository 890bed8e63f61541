//! Captures on disk: cameras with photographs, and points to begin with.

use crate::Failure;
use crate::scene::{about, open_cameras};
use qv_splat::captures::{Capture, rgbd};
use qv_splat::error_at;
use qv_splat::files::{Points, points};
use std::fs;
use std::path::{Path, PathBuf};

/// Endings that are tried when a capture names its images without one.
const ENDINGS: [&str; 4] = ["", ".png", ".jpg", ".jpeg"];

/// A capture with the folder that its paths are relative to.
pub struct OpenCapture {
    pub capture: Capture,
    pub folders: Vec<PathBuf>,
    /// Points of `points.ply` beside it.
    pub points: Option<Points>,
}

/// Opens a `transforms.json`, a folder that holds one, a COLMAP project or an RGB-D folder.
pub fn open_capture(path: &Path) -> Result<OpenCapture, Failure> {
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(Path::new("")) };
    let names = names_of(folder)?;
    let capture = if path.is_dir() && names.iter().any(|name| name.contains(".color.")) {
        let mut text = |name: &str| {
            fs::read_to_string(folder.join(name)).map_err(|e| error_at(name, "a file of text", &e.to_string()))
        };
        rgbd::read(&names, &mut text).map_err(|e| about(path, e))?
    } else {
        open_cameras(path)?
    };
    let points_path = folder.join("points.ply");
    let points = match fs::read(&points_path) {
        Ok(bytes) => Some(points::read(&bytes).map_err(|e| about(&points_path, e))?),
        Err(_) => None,
    };
    // COLMAP's images lie in a folder beside the model.
    let above = folder.ancestors().take(3).map(|above| above.join("images"));
    let folders = std::iter::once(folder.to_path_buf()).chain(above).collect();
    Ok(OpenCapture { capture, folders, points: points.filter(|points| !points.places.is_empty()) })
}

fn names_of(folder: &Path) -> Result<Vec<String>, Failure> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let entries = fs::read_dir(folder).map_err(|e| about(folder, format!("expected a readable folder, found {e}")))?;
    Ok(entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect())
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
