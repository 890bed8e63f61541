//! Scenes of Gaussians and sets of cameras on disk.

use crate::Failure;
use crate::outcome::about;
use qv_splat::captures::rgbd_folders::{self, Folder, Layout};
use qv_splat::captures::{Capture, cameras_json, colmap, json, nerfstudio, pictures, rgbd};
use qv_splat::error_at;
use qv_splat::files::{Format, SplatFile, ply, read_named};
use std::collections::BTreeSet;
use std::fs;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

/// Endings that are tried when a capture names its images without one.
const ENDINGS: [&str; 4] = ["", ".png", ".jpg", ".jpeg"];

/// Largest file of cameras that is read, bytes.
const LARGEST_CAMERAS: u64 = 1 << 30;

/// Reads a scene of any format: a file. A PLY is read as it comes, so that no more than a mebibyte of it is in memory.
pub fn open_scene(path: &Path) -> Result<SplatFile, Failure> {
    let inside = path.join("meta.json");
    let path = if path.is_dir() && inside.is_file() { inside.as_path() } else { path };
    let expected = "expected a scene (PLY, SPZ, GLB, glTF or .splat)";
    let no_scene = |e: std::io::Error| about(path, format!("{expected}, found {e}"));
    let mut file = fs::File::open(path).map_err(no_scene)?;
    let length = file.metadata().map_err(no_scene)?.len();
    let mut head = Vec::new();
    file.by_ref().take(1 << 20).read_to_end(&mut head).map_err(no_scene)?;
    let scene = if is_plain_ply(&head) {
        ply::read_stream(&mut head.as_slice().chain(BufReader::new(file)), length)
    } else {
        file.read_to_end(&mut head).map_err(no_scene)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        read_named(&head, &name, &mut |name| {
            let beside = folder.join(name);
            fs::read(&beside).map_err(|e| format!("{}: {e}", beside.display()))
        })
    };
    let scene = scene.map_err(|e| about(path, e))?;
    scene.remarks.iter().for_each(|what| crate::progress::remark(&format!("{}: {what}", path.display())));
    Ok(scene)
}

/// Whether the beginning of a file is that of a PLY that can be read as it comes.
pub fn is_plain_ply(head: &[u8]) -> bool {
    head.starts_with(b"ply") && matches!(Format::of_content(head), Ok(Format::Ply) | Err(_))
}

/// Cameras as they were found.
pub struct OpenCameras {
    pub capture: Capture,
    /// The folder of the COLMAP model that they are of.
    pub model: Option<PathBuf>,
}

/// Reads cameras: a JSON file of nerfstudio or of our own, or a directory with a COLMAP model or RGB-D frames.
pub fn open_cameras(path: &Path) -> Result<Capture, Failure> {
    Ok(find_cameras(path)?.capture)
}

/// The same, with where they were found.
pub fn find_cameras(path: &Path) -> Result<OpenCameras, Failure> {
    let plain = |capture| Ok(OpenCameras { capture, model: None });
    if path.is_dir() {
        let names = names_of(path)?;
        if names.iter().any(|name| name.contains(".color.")) {
            let mut text = |name: &str| {
                fs::read_to_string(path.join(name)).map_err(|e| error_at(name, "a file of text", &e.to_string()))
            };
            return plain(rgbd::read(&names, &mut text).map_err(|e| about(path, e))?);
        }
        return open_folder(path);
    }
    let document = document(path)?;
    let capture = match document.get("format") {
        Some(_) => cameras_json::read_value(&document),
        None => {
            let folders = folders_of(path.parent().unwrap_or(Path::new("")));
            nerfstudio::read_with(&document, &mut |image| size_in(&folders, image))
        }
    };
    plain(capture.map_err(|e| about(path, e))?)
}

/// The document of a JSON file of cameras.
pub fn document(path: &Path) -> Result<serde_json::Value, Failure> {
    let bytes = contents(path)?;
    json::parse(&bytes, "cameras").map_err(|e| {
        let expected = "expected cameras in JSON, or a folder with transforms.json, a COLMAP model or RGB-D frames";
        about(path, format!("{expected}, found {e}"))
    })
}

/// Width and height of an image in one of the folders.
pub fn size_in(folders: &[PathBuf], image: &str) -> Result<[u32; 2], String> {
    let path = find_file(folders, image)?;
    let file = fs::File::open(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    pictures::size(BufReader::new(file)).map_err(|e| format!("{}: {e}", path.display()))
}

/// A directory with a COLMAP model, `transforms.json`, or frames of RGB-D.
fn open_folder(directory: &Path) -> Result<OpenCameras, Failure> {
    let models = models_in(directory);
    if !models.is_empty() {
        return largest(directory, &models);
    }
    let nerfstudio = directory.join("transforms.json");
    if nerfstudio.is_file() {
        return find_cameras(&nerfstudio);
    }
    if let Some((layout, names)) = rgbd_layout(directory) {
        let folders = [directory.to_path_buf()];
        let capture = rgbd_folders::read(
            layout,
            &mut Folder {
                names: &names,
                text: &mut |name| {
                    fs::read_to_string(directory.join(name))
                        .map_err(|e| error_at(name, "a file of text", &e.to_string()))
                },
                sizes: &mut |image| size_in(&folders, image),
            },
        );
        return Ok(OpenCameras { capture: capture.map_err(|e| about(directory, e))?, model: None });
    }
    Err(about(
        directory,
        "expected a COLMAP model (cameras and images, .bin or .txt), transforms.json or RGB-D frames \
         (7-Scenes, TUM, Redwood, ScanNet), found none of them",
    ))
}

/// The layout of RGB-D frames in a directory, with its files.
pub fn rgbd_layout(directory: &Path) -> Option<(Layout, BTreeSet<String>)> {
    let mut names = BTreeSet::new();
    for name in names_of(directory).ok()? {
        let path = directory.join(&name);
        match path.is_dir() {
            true => names.extend(names_of(&path).unwrap_or_default().iter().map(|inner| format!("{name}/{inner}"))),
            false => {
                names.insert(name);
            }
        }
    }
    Layout::of(&names).map(|layout| (layout, names))
}

/// Folders with COLMAP models: the directory itself, else those where COLMAP puts them, which are several when it could not join all images.
fn models_in(directory: &Path) -> Vec<PathBuf> {
    let has_model = |place: &PathBuf| ["images.bin", "images.txt"].iter().any(|name| place.join(name).is_file());
    if has_model(&directory.to_path_buf()) {
        return vec![directory.to_path_buf()];
    }
    for place in ["sparse", "colmap/sparse", ""].map(|name| directory.join(name)) {
        let mut inside: Vec<PathBuf> =
            names_of(&place).unwrap_or_default().iter().map(|name| place.join(name)).filter(has_model).collect();
        inside.sort();
        inside.extend(Some(place).filter(has_model));
        if !inside.is_empty() {
            return inside;
        }
    }
    vec![]
}

/// The model with the most images, the first of several; the others are reported.
fn largest(directory: &Path, models: &[PathBuf]) -> Result<OpenCameras, Failure> {
    let mut read = vec![];
    let mut lost = vec![];
    for model in models {
        match open_model(model) {
            Ok(capture) => read.push((capture, model)),
            Err(error) if models.len() > 1 => lost.push(error.to_string()),
            Err(error) => return Err(error),
        }
    }
    let sizes: Vec<usize> = read.iter().map(|(capture, _)| capture.cameras.len()).collect();
    let Some(best) = (0..sizes.len()).rev().max_by_key(|index| sizes[*index]) else {
        return Err(lost.swap_remove(0).into());
    };
    let shown = |index: usize| {
        let model = read[index].1;
        format!("{} ({} images)", model.strip_prefix(directory).unwrap_or(model).display(), sizes[index])
    };
    let others: Vec<String> = (0..sizes.len()).filter(|index| *index != best).map(shown).collect();
    let remarks =
        format!("of {} COLMAP models the largest is read, {}; not {}", sizes.len(), shown(best), others.join(", "));
    let (mut capture, model) = read.swap_remove(best);
    capture.lost.extend(lost);
    if !others.is_empty() {
        capture.remarks.push(remarks);
    }
    Ok(OpenCameras { capture, model: Some(model.clone()) })
}

fn open_model(place: &Path) -> Result<Capture, Failure> {
    let capture = if place.join("images.bin").is_file() {
        let (cameras, images) = (contents(&place.join("cameras.bin"))?, contents(&place.join("images.bin"))?);
        colmap::read_binary(&cameras, &images)
    } else {
        let text = |name: &str| {
            let path = place.join(name);
            String::from_utf8(contents(&path)?).map_err(|e| about(&path, format!("expected text, found {e}")))
        };
        let (cameras, images) = (text("cameras.txt")?, text("images.txt")?);
        colmap::read_text(&cameras, &images)
    };
    capture.map_err(|e| about(place, e))
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

/// Where the files of a capture in `folder` are looked for.
pub fn folders_of(folder: &Path) -> Vec<PathBuf> {
    // A model that is opened from within its folder has folders above it, too.
    let whole = fs::canonicalize(if folder.as_os_str().is_empty() { Path::new(".") } else { folder });
    let folder = whole.as_deref().unwrap_or(folder);
    // COLMAP's images lie in a folder beside the model.
    let above = folder.ancestors().take(3).map(|above| above.join("images"));
    std::iter::once(folder.to_path_buf()).chain(above).collect()
}

/// A file of a capture as it is named, else with backslashes as slashes, an ending that was left out, letters of the other case; a path from
/// another machine by its last parts.
///
/// # Errors
/// Where it was looked for, in words.
pub fn find_file(folders: &[PathBuf], path: &str) -> Result<PathBuf, String> {
    let slashed = path.replace('\\', "/");
    let names = [path.trim_start_matches("./"), slashed.trim_start_matches("./")];
    let is_absolute = slashed.starts_with('/') || slashed.as_bytes().get(1) == Some(&b':');
    let tails = || slashed.match_indices('/').map(|(at, _)| &slashed[at + 1..]);
    let tails: Vec<&str> = if is_absolute { tails().collect() } else { vec![] };
    for name in names.iter().take(if names[0] == names[1] { 1 } else { 2 }).chain(&tails) {
        for folder in folders {
            let there = ENDINGS.iter().map(|ending| folder.join(format!("{name}{ending}"))).find(|c| c.is_file());
            if let Some(found) =
                there.or_else(|| ENDINGS.iter().find_map(|e| other_case(folder, &format!("{name}{e}"))))
            {
                return Ok(found);
            }
        }
    }
    let mut there = folders.iter().filter(|folder| folder.is_dir()).map(|folder| folder.join(names[1]));
    let first = there.next().unwrap_or_default();
    let others: Vec<String> = there.map(|place| format!(" nor at {}", place.display())).collect();
    Err(format!("none at {}{}", first.display(), others.concat()))
}

/// The one file whose path differs from `name` in upper and lower case alone.
fn other_case(folder: &Path, name: &str) -> Option<PathBuf> {
    let mut place = folder.to_path_buf();
    for part in name.split('/') {
        if part == ".." || place.join(part).exists() {
            place.push(part);
            continue;
        }
        let entries = fs::read_dir(&place).ok()?.flatten().map(|entry| entry.file_name());
        let mut alike = entries.filter(|entry| entry.to_string_lossy().eq_ignore_ascii_case(part));
        match (alike.next(), alike.next()) {
            (Some(one), None) => place.push(one),
            _ => return None,
        }
    }
    place.is_file().then_some(place)
}
