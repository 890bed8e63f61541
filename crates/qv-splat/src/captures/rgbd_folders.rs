//! Folders of RGB-D frames as TUM, Redwood and ScanNet have them.
//!
//! | folder | colour, depth | poses `world_from_camera` | depth unit | lens |
//! |---|---|---|---|---|
//! | TUM RGB-D (Sturm et al., 2012; cvg.cit.tum.de, *File formats*) | `rgb.txt`, `depth.txt`, or `associations.txt` | `groundtruth.txt`: time, x y z, qx qy qz qw | 1/5000 m | 525 px about (319.5, 239.5), which its authors recommend |
//! | Redwood (Choi et al., 2015; redwood-data.org) and Open3D | `color/`, `image/` or `rgb/`, `depth/` in the same order | `*traj*.log` or `*traj*.txt`: a line of numbers, then 4x4 | 1 mm | `*intrinsic*.json` of Open3D, else PrimeSense's 525 px |
//! | ScanNet (Dai et al., 2017), exported by SensReader | `color/ID.jpg`, `depth/ID.png` | `pose/ID.txt`, 4x4; -inf where tracking was lost | 1 mm | `intrinsic/intrinsic_color.txt`, `_depth.txt` |
//!
//! `camera-intrinsics.txt` (3x3, pixel centres at one half) beside the frames goes before what is usual for TUM and Redwood. The lenses of the data sets themselves count
//! pixels from the centre of the first one, so that one half is added to their principal points. Depth is taken along z.

use super::distortion::Distortion;
use super::{Attachments, Capture, CaptureCamera, DepthFile, Sizes, finish};
use crate::SplatError;
use crate::error::off;
use glam::{DMat3, DQuat, DVec3};
use qv_core::{Camera, Pose};
use serde_json::Value;
use std::collections::BTreeSet;

/// Longest time between a colour image and its depth, or a pose, that counts as the same time \[s\]: that of TUM's `associate.py`.
const SAME_TIME: f64 = 0.02;
/// Metres of a unit of TUM's depth, and of the others'.
const TUM_UNIT: f64 = 1.0 / 5000.0;
const MILLIMETRE: f64 = 1e-3;
/// Focal length and principal point of a PrimeSense or a Kinect as its driver states them, pixel centres at whole numbers \[px\].
const USUAL: [f64; 4] = [525.0, 525.0, 319.5, 239.5];
const USUAL_SIZE: [u32; 2] = [640, 480];
/// A lens that goes before the usual one.
const OWN_LENS: &str = "camera-intrinsics.txt";
/// Largest entry of R Rᵀ - 1 that passes as drift of a tracker.
const ORTHOGONAL: f64 = 1e-2;

/// The layouts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layout {
    /// Lists of images by time, poses by time.
    Tum,
    /// Folders of images, poses in one file.
    Redwood,
    /// Folders of images and of poses.
    ScanNet,
}

/// What a folder holds.
pub struct Folder<'a> {
    /// Paths of its files and of those in its folders, relative to it, with `/`.
    pub names: &'a BTreeSet<String>,
    /// The contents of a file of text.
    pub text: &'a mut dyn FnMut(&str) -> Result<String, SplatError>,
    /// The size of an image.
    pub sizes: Sizes<'a>,
}

impl Layout {
    /// The layout of a folder with these files; none where it is none of them.
    pub fn of(names: &BTreeSet<String>) -> Option<Self> {
        if names.contains("rgb.txt") || associations(names).is_some() {
            return Some(Self::Tum);
        }
        if names.iter().any(|name| name.starts_with("pose/") && name.ends_with(".txt")) {
            return Some(Self::ScanNet);
        }
        (colour_folder(names).is_some() && depth_folder(names).is_some()).then_some(Self::Redwood)
    }

    /// What people call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tum => "TUM RGB-D",
            Self::Redwood => "Redwood RGB-D",
            Self::ScanNet => "ScanNet",
        }
    }
}

/// The capture of a folder of a layout. Frames without a pose or without depth are left out, and named in `lost`; the lens that is taken
/// where none is stated is reported.
///
/// # Errors
/// What all frames need is missing or off: poses, lens, images.
pub fn read(layout: Layout, folder: &mut Folder) -> Result<Capture, SplatError> {
    let mut lost = vec![];
    let frames = match layout {
        Layout::Tum => tum(folder, &mut lost)?,
        Layout::Redwood => redwood(folder)?,
        Layout::ScanNet => scannet(folder, &mut lost)?,
    };
    let place = format!("{} folder", layout.name());
    let Some(first) = frames.first() else {
        let found = lost.first().cloned().unwrap_or_else(|| "none".into());
        return Err(off(place, "frames with colour and a pose", found));
    };
    let mut sizes = |path: &str| (folder.sizes)(path).map_err(|found| off(path, "an image", found));
    let size = sizes(&first.colour)?;
    let depth_size = frames.iter().find_map(|frame| frame.depth.as_deref()).map(sizes).transpose()?;
    let (colour, depth, remarks) = lenses(layout, folder, size, depth_size)?;
    let unit = if layout == Layout::Tum { TUM_UNIT } else { MILLIMETRE };
    let camera = |frame: Frame| {
        let camera = Camera { camera_from_world: frame.camera_from_world, ..colour };
        let depth = frame.depth.map(|path| DepthFile {
            path,
            metres_per_unit: unit,
            camera: Some(Camera { camera_from_world: frame.camera_from_world, ..depth.unwrap_or(colour) }),
        });
        let attachments = Attachments { depth, ..Default::default() };
        let (name, image) = (String::new(), Some(frame.colour));
        CaptureCamera { name, camera, distortion: Distortion::default(), image, attachments }
    };
    Ok(Capture { lost, remarks, ..finish(frames.into_iter().map(camera).collect(), &place)? })
}

/// A frame before its lens is known.
struct Frame {
    colour: String,
    depth: Option<String>,
    camera_from_world: Pose,
}

fn associations(names: &BTreeSet<String>) -> Option<&str> {
    ["associations.txt", "associate.txt", "association.txt"].into_iter().find(|name| names.contains(*name))
}

/// The folder whose name, or its end, is one of these; the first by name.
fn folder_named<'a>(names: &'a BTreeSet<String>, known: &[&str]) -> Option<&'a str> {
    let folders = names.iter().filter_map(|name| name.split_once('/')).map(|(folder, _)| folder);
    let is_known = |folder: &&str| {
        let last = folder.to_ascii_lowercase();
        known.iter().any(|one| last == *one || last.ends_with(&format!("-{one}")))
    };
    folders.clone().find(is_known)
}

fn colour_folder(names: &BTreeSet<String>) -> Option<&str> {
    folder_named(names, &["color", "colour", "rgb", "image", "images"])
}

fn depth_folder(names: &BTreeSet<String>) -> Option<&str> {
    folder_named(names, &["depth", "depth-clean", "depth-simulated", "depths"])
}

/// Rows of words, without comments.
fn rows(text: &str) -> impl Iterator<Item = (usize, Vec<&str>)> {
    let lines = text.lines().enumerate().map(|(at, line)| (at + 1, line.split('#').next().unwrap_or_default()));
    lines
        .map(|(at, line)| (at, line.split([' ', '\t', ',']).filter(|w| !w.is_empty()).map(str::trim).collect()))
        .filter(|(_, words): &(usize, Vec<&str>)| words.iter().any(|word| !word.is_empty()))
}

/// The numbers of words; `expected` says what they are.
fn numbers(words: &[&str], place: String, expected: &str) -> Result<Vec<f64>, SplatError> {
    let all: Option<Vec<f64>> = words.iter().map(|word| word.parse().ok()).collect();
    all.ok_or_else(|| off(place, expected, words.join(" ")))
}

/// Images of a list by their times, sorted.
fn listed(file: &str, text: &str) -> Result<Vec<(f64, String)>, SplatError> {
    let mut out = vec![];
    for (line, words) in rows(text) {
        let place = || format!("{file}, line {line}");
        let [time, path, ..] = words[..] else {
            return Err(off(place(), "a time and an image", words.join(" ")));
        };
        out.push((finite(numbers(&[time], place(), "a time")?[0], &place())?, path.replace('\\', "/")));
    }
    out.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(out)
}

fn finite(number: f64, place: &str) -> Result<f64, SplatError> {
    if number.is_finite() { Ok(number) } else { Err(off(place, "a finite number", number)) }
}

fn tum(folder: &mut Folder, lost: &mut Vec<String>) -> Result<Vec<Frame>, SplatError> {
    const POSES: &str = "groundtruth.txt";
    let expected = "groundtruth.txt with times and poses";
    if !folder.names.contains(POSES) {
        return Err(off("TUM RGB-D folder", expected, "no such file"));
    }
    let poses = timed_poses(POSES, &(folder.text)(POSES)?)?;
    let pairs = match associations(folder.names) {
        Some(file) => associated(file, &(folder.text)(file)?)?,
        None => {
            let colours = listed("rgb.txt", &(folder.text)("rgb.txt")?)?;
            let is_there = folder.names.contains("depth.txt");
            let depths = if is_there { listed("depth.txt", &(folder.text)("depth.txt")?)? } else { vec![] };
            let depth_at = |time: f64| nearest(&depths, time).map(|at| depths[at].1.clone());
            colours.into_iter().map(|(time, path)| (time, path, depth_at(time))).collect()
        }
    };
    let (mut frames, mut unposed, mut flat) = (vec![], vec![], vec![]);
    for (time, colour, depth) in pairs {
        let Some(pose) = pose_at(&poses, time) else {
            unposed.push(colour);
            continue;
        };
        if depth.is_none() {
            flat.push(colour.clone());
        }
        frames.push(Frame { colour, depth, camera_from_world: pose.inverse() });
    }
    lost.extend(some_of(&unposed, &format!("without a pose within {SAME_TIME} s in {POSES}")));
    lost.extend(some_of(&flat, &format!("without depth within {SAME_TIME} s in depth.txt")));
    Ok(frames)
}

/// A line about frames that are lost.
fn some_of(names: &[String], what: &str) -> Option<String> {
    let shown = names.iter().take(5).cloned().collect::<Vec<_>>().join(", ");
    let more = if names.len() > 5 { ", ..." } else { "" };
    (!names.is_empty()).then(|| format!("{} images {what}: {shown}{more}", names.len()))
}

/// The index of what is nearest in time, if it is near.
fn nearest<T>(sorted: &[(f64, T)], time: f64) -> Option<usize> {
    let after = sorted.partition_point(|one| one.0 < time);
    let near = [after.checked_sub(1), (after < sorted.len()).then_some(after)];
    let best =
        near.into_iter().flatten().min_by(|a, b| (sorted[*a].0 - time).abs().total_cmp(&(sorted[*b].0 - time).abs()));
    best.filter(|at| (sorted[*at].0 - time).abs() <= SAME_TIME)
}

/// The pose at a time, between the two beside it where both are near.
fn pose_at(sorted: &[(f64, Pose)], time: f64) -> Option<Pose> {
    let near = nearest(sorted, time)?;
    let after = sorted.partition_point(|one| one.0 < time);
    let (Some(before), Some(next)) = (after.checked_sub(1).map(|at| &sorted[at]), sorted.get(after)) else {
        return Some(sorted[near].1);
    };
    if time - before.0 > SAME_TIME || next.0 - time > SAME_TIME || next.0 <= before.0 {
        return Some(sorted[near].1);
    }
    let share = (time - before.0) / (next.0 - before.0);
    Some(Pose {
        position: before.1.position.lerp(next.1.position, share),
        rotation: before.1.rotation.slerp(next.1.rotation, share),
    })
}

/// `world_from_camera` by time.
fn timed_poses(file: &str, text: &str) -> Result<Vec<(f64, Pose)>, SplatError> {
    let expected = "time, x, y, z, qx, qy, qz, qw";
    let mut out = vec![];
    for (line, words) in rows(text) {
        let place = format!("{file}, line {line}");
        let all = numbers(&words, place.clone(), expected)?;
        let [time, x, y, z, qx, qy, qz, qw, ..] = all[..] else {
            return Err(off(place, expected, words.join(" ")));
        };
        // Where tracking was lost, there are NaNs.
        if let Some(pose) = Pose::from_position_wxyz([x, y, z], [qw, qx, qy, qz]).filter(|_| time.is_finite()) {
            out.push((time, pose));
        }
    }
    out.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(out)
}

/// Times, colour and depth of `associations.txt`; whichever path speaks of depth is depth.
fn associated(file: &str, text: &str) -> Result<Vec<(f64, String, Option<String>)>, SplatError> {
    let mut out = vec![];
    for (line, words) in rows(text) {
        let place = || format!("{file}, line {line}");
        let [first, a, second, b, ..] = words[..] else {
            return Err(off(place(), "time, image, time, image", words.join(" ")));
        };
        let (time, colour, depth) = if a.contains("depth") { (second, b, a) } else { (first, a, b) };
        let time = finite(numbers(&[time], place(), "a time")?[0], &place())?;
        out.push((time, colour.replace('\\', "/"), Some(depth.replace('\\', "/"))));
    }
    Ok(out)
}

/// Images of a folder in the order of the numbers in their names, of which `00010.png` comes after `9.png`.
fn images_of(names: &BTreeSet<String>, folder: &str) -> Vec<String> {
    let inside = |name: &&String| {
        let ending = name.rsplit_once('.').map_or("", |(_, ending)| ending).to_ascii_lowercase();
        name.strip_prefix(folder).is_some_and(|rest| rest.starts_with('/'))
            && ["png", "jpg", "jpeg"].contains(&ending.as_str())
    };
    let mut out: Vec<String> = names.iter().filter(inside).cloned().collect();
    out.sort_by_cached_key(|name| (leading_number(name), name.clone()));
    out
}

/// The first number in a file's name.
fn leading_number(path: &str) -> Option<u64> {
    let name = path.rsplit('/').next().unwrap_or(path);
    let digits = name.trim_start_matches(|c: char| !c.is_ascii_digit());
    let end = digits.find(|c: char| !c.is_ascii_digit()).unwrap_or(digits.len());
    digits[..end].parse().ok()
}

fn redwood(folder: &mut Folder) -> Result<Vec<Frame>, SplatError> {
    let place = "Redwood RGB-D folder";
    let (Some(colour), Some(depth)) = (colour_folder(folder.names), depth_folder(folder.names)) else {
        return Err(off(place, "folders color and depth", "not both"));
    };
    let (colours, depths) = (images_of(folder.names, colour), images_of(folder.names, depth));
    if colours.len() != depths.len() {
        let found = format!("{} and {}", colours.len(), depths.len());
        return Err(off(place, format!("as many images in {colour} as in {depth}"), found));
    }
    let is_path = |name: &&String| {
        let last = name.rsplit('/').next().unwrap_or(name).to_ascii_lowercase();
        last.contains("traj") && (last.ends_with(".log") || last.ends_with(".txt"))
    };
    let Some(file) = folder.names.iter().find(is_path).cloned() else {
        return Err(off(place, "poses in trajectory.log", "no such file"));
    };
    let poses = trajectory(&file, &(folder.text)(&file)?)?;
    // As many poses as images are theirs in order; else the number before each says whose it is.
    let in_order = poses.len() == colours.len();
    let mut frames = vec![];
    for (at, (number, pose)) in poses.into_iter().enumerate() {
        let index = if in_order { at } else { number };
        let (Some(colour), Some(depth)) = (colours.get(index), depths.get(index)) else {
            return Err(off(&*file, format!("numbers of images below {}", colours.len()), index));
        };
        frames.push(Frame { colour: colour.clone(), depth: Some(depth.clone()), camera_from_world: pose.inverse() });
    }
    Ok(frames)
}

/// Numbers and poses of a log: a line `first second count`, then four of a matrix.
fn trajectory(file: &str, text: &str) -> Result<Vec<(usize, Pose)>, SplatError> {
    let all: Vec<(usize, Vec<&str>)> = rows(text).collect();
    let mut out = vec![];
    for five in all.chunks(5) {
        let place = format!("{file}, line {}", five[0].0);
        let head = numbers(&five[0].1, place.clone(), "numbers of a frame")?;
        let words: Vec<&str> = five[1..].iter().flat_map(|(_, words)| words.iter().copied()).collect();
        if head.len() != 3 || five.len() != 5 || words.len() != 16 {
            let found = format!("{} numbers, then {}", head.len(), words.len());
            return Err(off(place, "3 numbers, then 4 lines of 4", found));
        }
        let matrix = numbers(&words, place.clone(), "4 lines of 4 numbers")?;
        let pose = rigid(&matrix).map_err(|found| off(&*place, "a rotation and a position", found))?;
        let number = head[0];
        if !(0.0..1e9).contains(&number) || number.fract() != 0.0 {
            return Err(off(place, "the number of a frame", number));
        }
        out.push((number as usize, pose));
    }
    Ok(out)
}

fn scannet(folder: &mut Folder, lost: &mut Vec<String>) -> Result<Vec<Frame>, SplatError> {
    let (mut frames, mut without) = (vec![], vec![]);
    for colour in images_of(folder.names, "color") {
        let stem = colour["color/".len()..].rsplit_once('.').map_or("", |(stem, _)| stem);
        let file = format!("pose/{stem}.txt");
        let matrix = match folder.names.contains(&file) {
            true => numbers(&(folder.text)(&file)?.split_whitespace().collect::<Vec<_>>(), file, "a 4x4 matrix").ok(),
            false => None,
        };
        match matrix.filter(|m| m.len() == 16).and_then(|m| rigid(&m).ok()) {
            Some(pose) => {
                let depth = Some(format!("depth/{stem}.png")).filter(|path| folder.names.contains(path));
                frames.push(Frame { colour, depth, camera_from_world: pose.inverse() });
            }
            None => without.push(colour),
        }
    }
    lost.extend(some_of(&without, "without a pose that is a rotation and a position in pose/"));
    Ok(frames)
}

/// `world_from_camera` of 16 numbers by rows.
fn rigid(m: &[f64]) -> Result<Pose, String> {
    let column = |k: usize| DVec3::new(m[k], m[4 + k], m[8 + k]);
    let rotation = DMat3::from_cols(column(0), column(1), column(2));
    let far = (rotation * rotation.transpose() - DMat3::IDENTITY).to_cols_array();
    let worst = far.iter().fold(0.0f64, |most, x| if x.is_nan() { f64::INFINITY } else { most.max(x.abs()) });
    if worst > ORTHOGONAL || rotation.determinant() < 0.0 || !column(3).is_finite() {
        return Err(format!("determinant {:.4}, R Rᵀ off by {worst:.4}", rotation.determinant()));
    }
    Ok(Pose { position: column(3), rotation: DQuat::from_mat3(&rotation).normalize() })
}

/// Lenses of colour and depth, and what was taken for granted.
fn lenses(
    layout: Layout,
    folder: &mut Folder,
    size: [u32; 2],
    depth_size: Option<[u32; 2]>,
) -> Result<(Camera, Option<Camera>, Vec<String>), SplatError> {
    if layout == Layout::ScanNet {
        let colour = scannet_lens(folder, "color", size)?;
        let depth = depth_size.map(|size| scannet_lens(folder, "depth", size)).transpose()?;
        return Ok((colour, depth, vec![]));
    }
    let file = folder.names.iter().find(|name| name.contains("intrinsic") && name.ends_with(".json")).cloned();
    let is_own = folder.names.contains(OWN_LENS);
    let (camera, remarks) = match (is_own, file) {
        (true, _) => {
            let k = numbers(&(folder.text)(OWN_LENS)?.split_whitespace().collect::<Vec<_>>(), OWN_LENS.into(), MATRIX)?;
            (lens(OWN_LENS, &k, 3, 0.0, size)?, vec![])
        }
        (false, Some(file)) if layout == Layout::Redwood => (open3d_lens(&file, &(folder.text)(&file)?, size)?, vec![]),
        _ => {
            let [fx, fy, cx, cy] = USUAL;
            if size != USUAL_SIZE {
                let expected = format!("the lens of images of {} x {} in {OWN_LENS}", size[0], size[1]);
                return Err(off(format!("{} folder", layout.name()), expected, "no such file"));
            }
            let k = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0];
            let remarks =
                format!("lens taken for granted: {fx} px about ({cx}, {cy}); {OWN_LENS} (3x3) states another");
            (lens(layout.name(), &k, 3, 0.5, size)?, vec![remarks])
        }
    };
    if let Some(found) = depth_size.filter(|depth| *depth != size) {
        let expected = format!("depth of {} x {} pixels as colour has", size[0], size[1]);
        return Err(off(format!("{} folder", layout.name()), expected, format!("{} x {}", found[0], found[1])));
    }
    Ok((camera, None, remarks))
}

const MATRIX: &str = "a matrix fx 0 cx, 0 fy cy, 0 0 1";

fn scannet_lens(folder: &mut Folder, of: &str, size: [u32; 2]) -> Result<Camera, SplatError> {
    let places = ["intrinsic/intrinsic_", "intrinsic_", "intrinsics_"].map(|head| format!("{head}{of}.txt"));
    let Some(file) = places.iter().find(|place| folder.names.contains(*place)) else {
        return Err(off("ScanNet folder", format!("the lens in {}", places[0]), "no such file"));
    };
    let k = numbers(&(folder.text)(file)?.split_whitespace().collect::<Vec<_>>(), file.clone(), MATRIX)?;
    lens(file, &k, if k.len() == 16 { 4 } else { 3 }, 0.5, size)
}

/// Open3D's `PinholeCameraIntrinsic`: `width`, `height`, `intrinsic_matrix` column by column.
fn open3d_lens(file: &str, text: &str, size: [u32; 2]) -> Result<Camera, SplatError> {
    let document = super::json::parse(text.as_bytes(), file)?;
    let matrix = document.get("intrinsic_matrix").and_then(Value::as_array);
    let k: Option<Vec<f64>> = matrix.and_then(|list| list.iter().map(Value::as_f64).collect());
    let k = k.filter(|k| k.len() == 9).ok_or_else(|| off(file, "intrinsic_matrix with 9 numbers", "none"))?;
    let side = |name: &str| document.get(name).and_then(Value::as_u64);
    let stated = [side("width"), side("height")];
    if stated != size.map(|side| Some(u64::from(side))) {
        let expected = format!("width and height {} and {} as the images have", size[0], size[1]);
        return Err(off(file, expected, format!("{stated:?}")));
    }
    let by_rows: Vec<f64> = (0..9).map(|at| k[3 * (at % 3) + at / 3]).collect();
    lens(file, &by_rows, 3, 0.5, size)
}

/// The lens of a matrix with rows of `stride` numbers; `centre` is where pixel centres of ours lie in its count.
fn lens(file: &str, k: &[f64], stride: usize, centre: f64, [width, height]: [u32; 2]) -> Result<Camera, SplatError> {
    if k.len() != stride * stride {
        return Err(off(file, MATRIX, format!("{} numbers", k.len())));
    }
    let at = |row: usize, column: usize| k[row * stride + column];
    let (fx, fy, cx, cy) = (at(0, 0), at(1, 1), at(0, 2) + centre, at(1, 2) + centre);
    // A lens of another resolution has its centre elsewhere.
    let inside = |centre: f64, side: u32| (0.2..0.8).contains(&(centre / f64::from(side)));
    let is_lens = fx > 0.0 && fy > 0.0 && [at(0, 1), at(1, 0), at(2, 0), at(2, 1)] == [0.0; 4] && at(2, 2) == 1.0;
    if !(is_lens && fx.is_finite() && fy.is_finite() && inside(cx, width) && inside(cy, height)) {
        let found = format!("fx {fx}, fy {fy}, centre {cx} {cy}");
        return Err(off(file, format!("{MATRIX} with the centre well inside {width} x {height}"), found));
    }
    Ok(Camera { fx, fy, cx, cy, width, height, camera_from_world: Pose::IDENTITY })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use std::collections::BTreeMap;

    const TURNED: &str = "0 -1 0 1\n1 0 0 2\n0 0 1 3\n0 0 0 1\n";

    /// Reads a folder of files with text; images have a size by their folder.
    fn open(files: &[(&str, &str)], sizes: &[(&str, [u32; 2])]) -> Result<Capture, SplatError> {
        let names: BTreeSet<String> = files.iter().map(|(name, _)| (*name).to_string()).collect();
        let contents: BTreeMap<&str, &str> = files.iter().copied().collect();
        let layout = Layout::of(&names).ok_or_else(|| off("folder", "a layout", "none"))?;
        let mut text = |name: &str| Ok(contents[name].to_string());
        let mut size_of = |path: &str| {
            let found = sizes.iter().find(|(head, _)| path.starts_with(head));
            found.map(|(_, size)| *size).ok_or_else(|| "no image".to_string())
        };
        read(layout, &mut Folder { names: &names, text: &mut text, sizes: &mut size_of })
    }

    const TUM: [(&str, &str); 7] = [
        ("rgb.txt", "# color images\n1.00 rgb/1.png\n1.10 rgb/2.png\n5.0 rgb/3.png\n"),
        ("depth.txt", "1.01 depth/1.png\n1.13 depth/2.png\n"),
        (
            "groundtruth.txt",
            "# t x y z qx qy qz qw\n0.99 0 0 0 0 0 0 1\n1.01 2 0 0 0 0 0.7071068 0.7071068\n1.1 1 2 3 0 0 0 1\n",
        ),
        ("rgb/1.png", ""),
        ("rgb/2.png", ""),
        ("depth/1.png", ""),
        ("depth/2.png", ""),
    ];

    #[test]
    fn a_tum_folder_is_joined_by_time() {
        let capture = open(&TUM, &[("", [640, 480])]).unwrap();
        let [a, b] = &capture.cameras[..] else { panic!("{capture:?}") };
        let pose = a.camera.camera_from_world.inverse();
        // Half way between two poses.
        assert!((pose.position - DVec3::X).length() < 1e-9, "{pose:?}");
        assert!((pose.rotation.to_scaled_axis() - DVec3::Z * std::f64::consts::FRAC_PI_4).length() < 1e-6);
        let c = &a.camera;
        assert_eq!([c.fx, c.fy, c.cx, c.cy], [525.0, 525.0, 320.0, 240.0]);
        let depth = a.attachments.depth.as_ref().unwrap();
        assert_eq!(
            (depth.path.as_str(), depth.metres_per_unit, b.attachments.depth.as_ref()),
            ("depth/1.png", 2e-4, None)
        );
        assert!(capture.remarks[0].states("granted 525"), "{:?}", capture.remarks);
        assert!(capture.lost[0].states("1 0.02 groundtruth.txt rgb/3.png"));
        assert!(capture.lost[1].states("1 0.02 depth.txt rgb/2.png"));
        let paired = [&TUM[2..], &[("associations.txt", "1.1 depth/2.png 1.0 rgb/1.png\n")]].concat();
        let capture = open(&paired, &[("", [640, 480])]).unwrap();
        assert_eq!(capture.cameras[0].image.as_deref(), Some("rgb/1.png"));
        let own = [&TUM[..], &[(OWN_LENS, "600 0 80 0 600 60 0 0 1")]].concat();
        let capture = open(&own, &[("", [160, 120])]).unwrap();
        assert_eq!((capture.cameras[0].camera.cx, capture.remarks.len()), (80.0, 0));
        let error = |files: &[(&str, &str)], size| open(files, &[("", size)]).unwrap_err().to_string();
        assert!(error(&TUM, [160, 120]).states("160 120 camera-intrinsics.txt"));
        assert!(error(&TUM[..2], [640, 480]).states("groundtruth.txt"));
        let bad = [&TUM[1..], &[("rgb.txt", "x rgb/1.png\n")]].concat();
        assert!(error(&bad, [640, 480]).states("rgb.txt 1"));
        let bad = [&TUM[..2], &[("groundtruth.txt", "1 2 3\n")]].concat();
        assert!(error(&bad, [640, 480]).states("groundtruth.txt 1"));
    }

    #[test]
    fn a_redwood_folder_is_joined_by_order() {
        let log = format!("0 0 1\n{TURNED}1 1 2\n{TURNED}");
        let mut files = vec![
            ("livingroom1-color/00000.jpg", ""),
            ("livingroom1-color/00001.jpg", ""),
            ("depth/0-7.png", ""),
            ("depth/1-9.png", ""),
            ("livingroom1-traj.txt", log.as_str()),
        ];
        let capture = open(&files, &[("", [640, 480])]).unwrap();
        let [_, b] = &capture.cameras[..] else { panic!("{capture:?}") };
        assert_eq!(
            b.attachments.depth.as_ref().map(|d| (d.path.as_str(), d.metres_per_unit)),
            Some(("depth/1-9.png", 1e-3))
        );
        let seen = b.camera.camera_from_world.transform_point(DVec3::new(1.0, 3.0, 3.0));
        assert!((seen - DVec3::X).length() < 1e-9, "{seen}");
        let lens = r#"{"width": 320, "height": 240, "intrinsic_matrix": [300, 0, 0, 0, 301, 0, 159.5, 119.5, 1]}"#;
        files.push(("camera_intrinsic.json", lens));
        let capture = open(&files, &[("", [320, 240])]).unwrap();
        let c = &capture.cameras[0].camera;
        assert_eq!(([c.fx, c.fy, c.cx, c.cy], capture.remarks.len()), ([300.0, 301.0, 160.0, 120.0], 0));
        let error = |files: &[(&str, &str)]| open(files, &[("", [640, 480])]).unwrap_err().to_string();
        assert!(error(&files).states("height 640 480"));
        assert!(error(&files[..4]).states("trajectory.log"));
        assert!(error(&[&files[..3], &files[4..5]].concat()).states("livingroom1-color"));
        let bad = [&files[..4], &[("a-traj.log", "0 0 1\n1 0 0 0\n")]].concat();
        assert!(error(&bad).states("a-traj.log 1 3 4 4"));
        let far = log.replacen("1 1 2", "7 7 2", 1);
        let bad = [&files[..4], &[("a-traj.log", &far[far.find('7').unwrap_or(0)..])]].concat();
        assert!(error(&bad).states("numbers 2 7"));
    }

    #[test]
    fn a_scannet_folder_has_two_lenses() {
        let lost = "-inf -inf -inf -inf\n-inf -inf -inf -inf\n-inf -inf -inf -inf\n-inf -inf -inf -inf\n";
        let files = [
            ("color/0.jpg", ""),
            ("color/10.jpg", ""),
            ("color/2.jpg", ""),
            ("depth/0.png", ""),
            ("depth/10.png", ""),
            ("depth/2.png", ""),
            ("pose/0.txt", TURNED),
            ("pose/2.txt", lost),
            ("pose/10.txt", TURNED),
            ("intrinsic/intrinsic_color.txt", "1170 0 647.75 0\n0 1168 483.5 0\n0 0 1 0\n0 0 0 1\n"),
            ("intrinsic/intrinsic_depth.txt", "578 0 319.5 0\n0 578 239.5 0\n0 0 1 0\n0 0 0 1\n"),
        ];
        let sizes = [("color", [1296, 968]), ("depth", [640, 480])];
        let capture = open(&files, &sizes).unwrap();
        let [a, b] = &capture.cameras[..] else { panic!("{capture:?}") };
        assert_eq!((a.name.as_str(), b.name.as_str(), a.camera.cx), ("0", "10", 648.25));
        let depth = a.attachments.depth.as_ref().and_then(|d| d.camera).unwrap();
        assert_eq!(
            ([depth.width, depth.height], depth.cx, depth.camera_from_world),
            ([640, 480], 320.0, a.camera.camera_from_world)
        );
        assert!(capture.lost[0].states("without 1"), "{:?}", capture.lost);
        let error = open(&files[..10], &sizes).unwrap_err().to_string();
        assert!(error.states("intrinsic/intrinsic_depth.txt"), "{error}");
        let error = open(&files, &[("color", [648, 484]), ("depth", [640, 480])]).unwrap_err().to_string();
        assert!(error.states("centre 648 484"), "{error}");
        assert!(open(&files[9..], &sizes).unwrap_err().to_string().states("layout"));
    }
}
