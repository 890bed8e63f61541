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
    let mut capture = open_cameras(path)?;
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(Path::new("")) };
    // A model that is opened from within its folder has folders above it, too.
    let whole = fs::canonicalize(if folder.as_os_str().is_empty() { Path::new(".") } else { folder });
    let folder = whole.as_deref().unwrap_or(folder);
    let (points, lost) = points_of(path, folder)?;
    capture.lost.extend(lost);
    // COLMAP's images lie in a folder beside the model.
    let above = folder.ancestors().take(3).map(|above| above.join("images"));
    let folders = std::iter::once(folder.to_path_buf()).chain(above).collect();
    Ok(OpenCapture { capture, folders, points: points.filter(|points| !points.places.is_empty()) })
}

/// What `transforms.json` names as its points, `points.ply`, or the points of a COLMAP model where its cameras may be; and what of them is of no use.
fn points_of(path: &Path, folder: &Path) -> Result<(Option<Points>, Option<String>), Failure> {
    let file = if path.is_dir() { folder.join("transforms.json") } else { path.to_path_buf() };
    let document = fs::read(&file).ok().and_then(|bytes| serde_json::from_slice::<serde_json::Value>(&bytes).ok());
    let named = document.as_ref().and_then(|document| document.get("ply_file_path")?.as_str());
    let usual = [
        "points.ply",
        "points3D.bin",
        "sparse/0/points3D.bin",
        "sparse/points3D.bin",
        "points3D.txt",
        "sparse/0/points3D.txt",
    ];
    for place in named.into_iter().chain(usual) {
        let path = folder.join(place);
        let Ok(bytes) = fs::read(&path) else { continue };
        let points = match path.extension().and_then(|ending| ending.to_str()) {
            Some("ply") => points::read(&bytes),
            Some("bin") => colmap_points::read_binary(&bytes),
            _ => colmap_points::read_text(&String::from_utf8_lossy(&bytes)),
        };
        let points = points.map_err(|e| about(&path, e))?;
        let lost = (points.left_out > 0)
            .then(|| format!("{}: {} points that are not finite, or too far", path.display(), points.left_out));
        return Ok((Some(points), lost));
    }
    let lost = named.map(|name| format!("{}: expected points, found no such file", folder.join(name).display()));
    Ok((None, lost))
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
        let mut there = self.folders.iter().filter(|folder| folder.is_dir()).map(|folder| folder.join(plain));
        let first = there.next().unwrap_or_default();
        let others: Vec<String> = there.map(|place| format!(" nor at {}", place.display())).collect();
        Err(format!("none at {}{}", first.display(), others.concat()))
    }
}
