//! Scenes of Gaussians and sets of cameras on disk.

use crate::Failure;
use qv_splat::captures::{Capture, cameras_json, colmap, nerfstudio, rgbd};
use qv_splat::error_at;
use qv_splat::files::{SplatFile, read_any};
use std::fs;
use std::path::Path;

/// Largest file of cameras that is read, bytes.
const LARGEST_CAMERAS: u64 = 1 << 30;

/// An error with the file that it is about.
pub fn about(path: &Path, error: impl std::fmt::Display) -> Failure {
    format!("{}: {error}", path.display()).into()
}

/// Reads a scene of any format.
pub fn open_scene(path: &Path) -> Result<SplatFile, Failure> {
    let bytes = fs::read(path).map_err(|e| about(path, format!("expected a PLY, SPZ or GLB file, found {e}")))?;
    read_any(&bytes).map_err(|e| about(path, e))
}

/// Reads cameras: a JSON file of nerfstudio or of our own, or a directory with a COLMAP model or RGB-D frames.
pub fn open_cameras(path: &Path) -> Result<Capture, Failure> {
    if path.is_dir() {
        let names = names_of(path)?;
        if names.iter().any(|name| name.contains(".color.")) {
            let mut text = |name: &str| {
                fs::read_to_string(path.join(name)).map_err(|e| error_at(name, "a file of text", &e.to_string()))
            };
            return rgbd::read(&names, &mut text).map_err(|e| about(path, e));
        }
        return open_colmap(path);
    }
    let expected = "expected cameras in JSON, or a folder with transforms.json, a COLMAP model or RGB-D frames";
    let no_json = |found: &dyn std::fmt::Display| about(path, format!("{expected}, found {found}"));
    let text = String::from_utf8(contents(path)?).map_err(|e| no_json(&e))?;
    let document: serde_json::Value = serde_json::from_str(&text).map_err(|e| no_json(&e))?;
    let capture = match document.get("format") {
        Some(_) => cameras_json::read_value(&document),
        None => nerfstudio::read_value(&document),
    };
    capture.map_err(|e| about(path, e))
}

/// A model in the directory itself, or where COLMAP puts the first one of a project.
fn open_colmap(directory: &Path) -> Result<Capture, Failure> {
    let places = [directory.to_path_buf(), directory.join("sparse/0"), directory.join("sparse")];
    for place in &places {
        if place.join("images.bin").is_file() {
            let (cameras, images) = (contents(&place.join("cameras.bin"))?, contents(&place.join("images.bin"))?);
            return colmap::read_binary(&cameras, &images).map_err(|e| about(place, e));
        }
        if place.join("images.txt").is_file() {
            let text = |name: &str| {
                let path = place.join(name);
                String::from_utf8(contents(&path)?).map_err(|e| about(&path, format!("expected text, found {e}")))
            };
            let (cameras, images) = (text("cameras.txt")?, text("images.txt")?);
            return colmap::read_text(&cameras, &images).map_err(|e| about(place, e));
        }
    }
    let nerfstudio = directory.join("transforms.json");
    if nerfstudio.is_file() {
        return open_cameras(&nerfstudio);
    }
    Err(about(
        directory,
        "expected a COLMAP model (cameras and images, .bin or .txt) or transforms.json, found neither",
    ))
}

fn names_of(folder: &Path) -> Result<Vec<String>, Failure> {
    let entries = fs::read_dir(folder).map_err(|e| about(folder, format!("expected a readable folder, found {e}")))?;
    Ok(entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect())
}

fn contents(path: &Path) -> Result<Vec<u8>, Failure> {
    let expected = |found: String| about(path, format!("expected a file of cameras, found {found}"));
    let length = fs::metadata(path).map_err(|e| expected(e.to_string()))?.len();
    if length > LARGEST_CAMERAS {
        return Err(about(path, format!("expected at most {LARGEST_CAMERAS} bytes of cameras, found {length}")));
    }
    fs::read(path).map_err(|e| expected(e.to_string()))
}
