//! Captures on disk: cameras with photographs, and points to begin with.

use crate::Failure;
use crate::outcome::about;
use crate::scene::{OpenCameras, document, find_cameras, find_file, folders_of};
use glam::DVec3;
use qv_splat::captures::{Capture, colmap_points};
use qv_splat::files::{Points, points};
use std::fs;
use std::path::{Path, PathBuf};

/// A capture with the folder that its paths are relative to.
pub struct OpenCapture {
    pub capture: Capture,
    pub folders: Vec<PathBuf>,
    /// Points to begin with, if there are any.
    pub points: Option<Points>,
    /// Whether its poses come from COLMAP.
    pub is_by_colmap: bool,
    /// What was taken off all positions, as of a map's coordinates \[m\].
    pub origin: Option<DVec3>,
}

/// Opens a `transforms.json`, a folder that holds one, a COLMAP project or an RGB-D folder.
pub fn open_capture(path: &Path) -> Result<OpenCapture, Failure> {
    let OpenCameras { mut capture, model } = find_cameras(path)?;
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(Path::new("")) };
    let (points, lost) = points_of(path, folder, model.as_deref())?;
    capture.lost.extend(lost);
    let origin = capture.move_near();
    if let (Some(_), Some(_)) = (origin, &points) {
        capture.lost.push("points to begin with, which lie too far from the origin for 32 bits".into());
    }
    Ok(OpenCapture {
        origin,
        capture,
        folders: folders_of(folder),
        points: points.filter(|points| !points.places.is_empty() && origin.is_none()),
        is_by_colmap: model.is_some() || is_by_colmap(path, folder),
    })
}

/// Whether a `transforms.json` was made from a COLMAP model: nerfstudio's and instant-ngp's converters write these keys, those of phones do not.
fn is_by_colmap(path: &Path, folder: &Path) -> bool {
    let file = if path.is_dir() { folder.join("transforms.json") } else { path.to_path_buf() };
    let Some(document) = file.is_file().then(|| document(&file).ok()).flatten() else { return false };
    let first = document.get("frames").and_then(|frames| frames.get(0));
    first.is_some_and(|frame| ["colmap_im_id", "sharpness"].iter().any(|key| frame.get(key).is_some()))
}

/// What `transforms.json` names as its points, `points.ply`, or the points of the COLMAP model; and what of them is of no use.
fn points_of(path: &Path, folder: &Path, model: Option<&Path>) -> Result<(Option<Points>, Option<String>), Failure> {
    let file = if path.is_dir() { folder.join("transforms.json") } else { path.to_path_buf() };
    let document = file.is_file().then(|| document(&file).ok()).flatten();
    let named = document.as_ref().and_then(|document| document.get("ply_file_path")?.as_str());
    let of_model = model.unwrap_or(folder);
    let usual = ["points3D.bin", "points3D.txt"].map(|name| of_model.join(name));
    let own = named.into_iter().chain(["points.ply"]).map(|name| folder.join(name));
    for path in own.chain(usual) {
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
        let found = find_file(&self.folders, path)?;
        fs::read(&found).map_err(|e| format!("{}: {e}", found.display()))
    }
}
