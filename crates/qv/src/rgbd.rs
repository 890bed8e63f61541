//! Depth images on disk: folders of RGB-D frames, and captures whose `transforms.json` names depth images.

use crate::Failure;
use crate::depth_unit;
use crate::outcome::about;
use crate::scene::{document, find_file, open_cameras, rgbd_layout};
use image::DynamicImage;
use indicatif::ProgressBar;
use qv_core::{Camera, Pose};
use qv_mesh::DepthFrame;
use qv_mesh::planes::RenderedFrame;
use qv_splat::captures::nerfstudio::DEPTH_KEYS;
use qv_splat::captures::pictures;
use qv_splat::captures::rgbd::{DEPTH_FOCAL, SIZE};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// Depth frames, and label images where there are some.
#[derive(Default)]
pub struct DepthCapture {
    pub frames: Vec<DepthFrame>,
    /// Label image of each frame, 0 none, 1 + label; empty when no frame has one.
    pub labels: Vec<Option<Vec<u8>>>,
    /// Picture of each frame, colours 0 to 1, shape `[height, width, 3]`, where it was drawn and is asked for.
    pub colours: Vec<Vec<f32>>,
    /// Name of each frame.
    pub names: Vec<String>,
    /// What could not be read, a line each.
    pub lost: Vec<String>,
}

/// Whether a folder holds depth images in one of the ways that [`open`] reads.
pub fn holds_depth(folder: &Path) -> bool {
    folder.is_dir() && (!depth_files(folder).is_empty() || has_depth_paths(folder) || rgbd_layout(folder).is_some())
}

/// Reads a folder: `frame-*.depth.png` (millimetres, 0 and 65535 none) with `frame-*.pose.txt` (`world_from_camera`, 4 x 4) and
/// `camera-intrinsics.txt` (3 x 3, 585 px about the middle of 640 x 480 without it) as the 7-Scenes and redkitchen have them, or `transforms.json` whose frames have
/// `depth_file_path` (16 bit, `depth_unit_scale_factor`, 0.001 when not given) and may have `label_file_path`; or the folders of TUM, Redwood and ScanNet.
///
/// # Errors
/// What all frames need is missing. Single frames that cannot be read are in `lost`.
pub fn open(folder: &Path, bar: &ProgressBar) -> Result<DepthCapture, Failure> {
    let mut capture = if has_depth_paths(folder) {
        open_transforms(folder, bar)
    } else if depth_files(folder).is_empty() && rgbd_layout(folder).is_some() {
        open_layout(folder, bar)
    } else {
        open_frames(folder, bar)
    }?;
    if let Some(remark) = depth_unit::agree(&mut capture.frames) {
        crate::progress::remark(&format!("{}: {remark}", folder.display()));
    }
    Ok(capture)
}

/// Depth of the folders of TUM, Redwood and ScanNet.
fn open_layout(folder: &Path, bar: &ProgressBar) -> Result<DepthCapture, Failure> {
    let capture = open_cameras(folder)?;
    let mut out = DepthCapture { lost: capture.lost, ..Default::default() };
    capture.remarks.iter().for_each(|what| crate::progress::remark(&format!("{}: {what}", folder.display())));
    bar.set_length(capture.cameras.len() as u64);
    let folders = [folder.to_path_buf()];
    for one in capture.cameras {
        bar.inc(1);
        let Some(file) = one.attachments.depth else { continue };
        let camera = file.camera.unwrap_or(one.camera);
        let read = || {
            let path = find_file(&folders, &file.path)?;
            let (depth, size) = depth_image(&path, file.metres_per_unit)?;
            if size != [camera.width, camera.height] {
                let expected = format!("expected {} x {} pixels as its lens has", camera.width, camera.height);
                return Err(about(&path, format!("{expected}, found {} x {}", size[0], size[1])));
            }
            Ok(DepthFrame { camera, depth, weight: vec![] })
        };
        match read() {
            Ok(frame) => out.push(one.name, frame, None),
            Err(error) => out.lost.push(error.to_string()),
        }
    }
    Ok(out)
}

fn depth_files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut out: Vec<PathBuf> = entries.filter(|path| path.to_string_lossy().ends_with(".depth.png")).collect();
    out.sort();
    out
}

fn transforms(folder: &Path) -> Option<Value> {
    document(&folder.join("transforms.json")).ok()
}

fn has_depth_paths(folder: &Path) -> bool {
    let frames = transforms(folder).and_then(|document| document.get("frames")?.as_array().cloned());
    frames.is_some_and(|frames| frames.iter().any(|frame| DEPTH_KEYS.iter().any(|key| frame.get(key).is_some())))
}

fn open_frames(folder: &Path, bar: &ProgressBar) -> Result<DepthCapture, Failure> {
    let path = folder.join("camera-intrinsics.txt");
    let k = if path.exists() { numbers(&path, 9)? } else { usual_lens() };
    let mut out = DepthCapture::default();
    let files = depth_files(folder);
    bar.set_length(files.len() as u64);
    for path in files {
        bar.inc(1);
        let name = path.to_string_lossy().trim_end_matches(".depth.png").to_string();
        let read = || -> Result<DepthFrame, Failure> {
            let (depth, [width, height]) = depth_image(&path, 0.001)?;
            check_lens(&k, [width, height]).map_err(|found| about(&path, found))?;
            let pose = PathBuf::from(format!("{name}.pose.txt"));
            let camera_from_world = pose_of(&numbers(&pose, 16)?).map_err(|found| about(&pose, found))?;
            let camera = Camera { fx: k[0], fy: k[4], cx: k[2], cy: k[5], width, height, camera_from_world };
            Ok(DepthFrame { camera, depth, weight: vec![] })
        };
        match read() {
            Ok(frame) => out.push(name, frame, None),
            Err(error) => out.lost.push(error.to_string()),
        }
    }
    keep_one_size(&mut out);
    Ok(out)
}

/// A folder has one lens: frames of another size than most have (the first of equally many) are left out.
fn keep_one_size(capture: &mut DepthCapture) {
    let size = |frame: &DepthFrame| [frame.camera.width, frame.camera.height];
    let sizes: Vec<[u32; 2]> = capture.frames.iter().map(size).collect();
    let count = |of: &[u32; 2]| sizes.iter().filter(|one| *one == of).count();
    let Some(most) = sizes.iter().rev().copied().max_by_key(|one| count(one)) else { return };
    let all = std::mem::take(&mut capture.frames).into_iter().zip(std::mem::take(&mut capture.names));
    for (frame, name) in all {
        let [width, height] = size(&frame);
        if [width, height] == most {
            capture.frames.push(frame);
            capture.names.push(name);
        } else {
            let expected = format!("expected {} x {} pixels as most images have", most[0], most[1]);
            capture.lost.push(format!("{name}.depth.png: {expected}, found {width} x {height}"));
        }
    }
    capture.labels = vec![None; capture.frames.len()];
}

/// The lens of a folder that states none: that of 7-Scenes' depth camera, as `qv reconstruct` takes it.
fn usual_lens() -> Vec<f64> {
    let [cx, cy] = SIZE.map(|side| 0.5 * f64::from(side));
    vec![DEPTH_FOCAL, 0.0, cx, 0.0, DEPTH_FOCAL, cy, 0.0, 0.0, 1.0]
}

/// The lens of a folder: fx 0 cx, 0 fy cy, 0 0 1, with its centre well inside the image.
fn check_lens(k: &[f64], [width, height]: [u32; 2]) -> Result<(), String> {
    if [k[1], k[3], k[6], k[7]] != [0.0; 4] || k[8] != 1.0 {
        return Err(format!("expected fx 0 cx, 0 fy cy, 0 0 1 in camera-intrinsics.txt, found {k:?}"));
    }
    let inside = |centre: f64, side: u32| (0.2..0.8).contains(&(centre / f64::from(side)));
    if inside(k[2], width) && inside(k[5], height) {
        return Ok(());
    }
    Err(format!(
        "expected an image around the centre of camera-intrinsics.txt, {} {}, found {width} x {height} pixels",
        k[2], k[5]
    ))
}

fn open_transforms(folder: &Path, bar: &ProgressBar) -> Result<DepthCapture, Failure> {
    let path = folder.join("transforms.json");
    let capture = open_cameras(&path)?;
    let document = transforms(folder).unwrap_or_default();
    let mut out = DepthCapture::default();
    bar.set_length(capture.cameras.len() as u64);
    for (index, one) in capture.cameras.iter().enumerate() {
        bar.inc(1);
        let file = |key: &str| document["frames"][index].get(key).and_then(Value::as_str).map(|name| folder.join(name));
        let read = || -> Result<(DepthFrame, Option<Vec<u8>>), Failure> {
            let depth_path = DEPTH_KEYS
                .into_iter()
                .find_map(file)
                .ok_or_else(|| about(&path, format!("frame {index}: expected depth_file_path, found none")))?;
            let scale = one.attachments.depth.as_ref().map_or(0.001, |depth| depth.metres_per_unit);
            let (depth, size) = depth_image(&depth_path, scale)?;
            if size != [one.camera.width, one.camera.height] {
                let expected = format!("expected {} x {} pixels", one.camera.width, one.camera.height);
                return Err(about(
                    &depth_path,
                    format!("{expected} as the camera has, found {} x {}", size[0], size[1]),
                ));
            }
            if !one.distortion.is_none() {
                return Err(about(
                    &path,
                    format!("frame {index}: expected depth without distortion, found a lens with it"),
                ));
            }
            let labels = file("label_file_path").map(|path| label_image(&path, size)).transpose()?;
            Ok((DepthFrame { camera: one.camera, depth, weight: vec![] }, labels))
        };
        match read() {
            Ok((frame, labels)) => out.push(one.name.clone(), frame, labels),
            Err(error) => out.lost.push(error.to_string()),
        }
    }
    Ok(out)
}

impl DepthCapture {
    /// What was drawn of each frame, before any depth is left out.
    pub fn drawn(&mut self) -> Vec<RenderedFrame> {
        let all = self.frames.iter().zip(std::mem::take(&mut self.colours));
        all.map(|(frame, colour)| RenderedFrame { colour, depth: frame.depth.clone() }).collect()
    }

    fn push(&mut self, name: String, frame: DepthFrame, labels: Option<Vec<u8>>) {
        self.names.push(name);
        self.frames.push(frame);
        self.labels.push(labels);
    }
}

/// Depths \[m\] of a 16-bit image, 0 where it has 0 or 65535; and its size.
fn depth_image(path: &Path, scale: f64) -> Result<(Vec<f32>, [u32; 2]), Failure> {
    let image = image_of(path).map_err(|found| about(path, format!("expected a depth image, found {found}")))?;
    let DynamicImage::ImageLuma16(image) = image else {
        return Err(about(path, format!("expected 16 bits of grey, found {:?}", image.color())));
    };
    let size = [image.width(), image.height()];
    let metres = |d: u16| if d == u16::MAX { 0.0 } else { (f64::from(d) * scale) as f32 };
    Ok((image.into_raw().into_iter().map(metres).collect(), size))
}

/// The image of a file.
pub fn image_of(path: &Path) -> Result<DynamicImage, String> {
    pictures::read(&fs::read(path).map_err(|e| e.to_string())?)
}

fn label_image(path: &Path, [width, height]: [u32; 2]) -> Result<Vec<u8>, Failure> {
    let image = image_of(path).map_err(|found| about(path, format!("expected a label image, found {found}")))?;
    match image {
        DynamicImage::ImageLuma8(image) if [image.width(), image.height()] == [width, height] => Ok(image.into_raw()),
        other => {
            let found = format!("{:?}, {} x {}", other.color(), other.width(), other.height());
            Err(about(path, format!("expected 8 bits of grey, {width} x {height}, found {found}")))
        }
    }
}

/// So many numbers of a text file.
fn numbers(path: &Path, count: usize) -> Result<Vec<f64>, Failure> {
    let text = fs::read_to_string(path).map_err(|e| about(path, format!("expected {count} numbers, found {e}")))?;
    let found: Result<Vec<f64>, _> = text.split_whitespace().map(str::parse).collect();
    let found = found.map_err(|e| about(path, format!("expected {count} numbers, found {e}")))?;
    if let Some(odd) = found.iter().find(|x| !x.is_finite()) {
        return Err(about(path, format!("expected {count} finite numbers, found {odd}")));
    }
    if found.len() != count {
        return Err(about(path, format!("expected {count} numbers, found {}", found.len())));
    }
    Ok(found)
}

/// `camera_from_world` of a 4 x 4 matrix `world_from_camera`, row by row.
fn pose_of(m: &[f64]) -> Result<Pose, String> {
    let column = |k: usize| glam::DVec3::new(m[k], m[4 + k], m[8 + k]);
    let rotation = glam::DMat3::from_cols(column(0), column(1), column(2));
    let off = (rotation * rotation.transpose() - glam::DMat3::IDENTITY).to_cols_array();
    if off.iter().any(|x| x.abs() > 1e-2) || rotation.determinant() < 0.0 {
        return Err(format!("expected a rotation, found determinant {:.4}", rotation.determinant()));
    }
    Ok(Pose { position: column(3), rotation: glam::DQuat::from_mat3(&rotation).normalize() }.inverse())
}
