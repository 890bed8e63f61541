//! The cameras of a capture: images with intrinsics, distortion and pose.

pub mod cameras_json;
pub mod colmap;
mod colmap_binary;
mod colmap_cameras;
pub mod colmap_points;
mod colmap_text;
pub mod distortion;
pub mod json;
pub mod nerfstudio;
pub mod pictures;
pub mod rgbd;
pub mod rgbd_folders;

use crate::SplatError;
use crate::error::off;
use distortion::Distortion;
use glam::DVec3;
use qv_core::Camera;
use qv_core::statistics::median;
use std::collections::BTreeSet;

/// A set of images, or of views that are to become images.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Capture {
    /// The cameras, in the order of the file, those of COLMAP by name. Their poses are in the frame of the file.
    pub cameras: Vec<CaptureCamera>,
    /// What could not be used, a line each.
    pub lost: Vec<String>,
    /// What was taken for granted or chosen, a line each; nothing is lost by it.
    pub remarks: Vec<String>,
    /// Which images the cameras are of, where EXIF shows to turn them.
    pub shown: pictures::ImageOrientation,
    /// Names of the cameras whose images the capture itself holds out; `None` where it says nothing of it.
    pub held_out: Option<BTreeSet<String>>,
}

/// Distance of cameras from the origin from which on 32 bits are too few for them \[m\].
const FAR: f64 = 1000.0;

impl Capture {
    /// Moves cameras that are far from the origin, as of a map's coordinates, to it: by their median, rounded to a metre. Returns what was
    /// taken off \[m\].
    pub fn move_near(&mut self) -> Option<DVec3> {
        let places: Vec<DVec3> =
            self.cameras.iter().map(|one| one.camera.camera_from_world.inverse().position).collect();
        let middle = |k: usize| median(&mut places.iter().map(|p| p[k]).collect::<Vec<f64>>());
        let origin = DVec3::new(middle(0), middle(1), middle(2)).round();
        if !(origin.is_finite() && origin.length() > FAR) {
            return None;
        }
        for one in &mut self.cameras {
            let mut pose = one.camera.camera_from_world.inverse();
            pose.position -= origin;
            one.camera.camera_from_world = pose.inverse();
            if let Some(camera) = one.attachments.depth.as_mut().and_then(|d| d.camera.as_mut()) {
                camera.camera_from_world = one.camera.camera_from_world;
            }
        }
        self.remarks.push(format!(
            "the cameras lie far from the origin: {} {} {} m are taken off, and kept as `origin` in metrics.json",
            origin.x, origin.y, origin.z
        ));
        Some(origin)
    }
}

/// Gives width and height of an image by its path, or says why not.
pub type Sizes<'a> = &'a mut dyn FnMut(&str) -> Result<[u32; 2], String>;

/// A camera with its image.
#[derive(Debug, Clone, PartialEq)]
pub struct CaptureCamera {
    /// What distinguishs it from the others: the image's file without folder and ending, or with the folders when two would be alike.
    pub name: String,
    /// Intrinsics and pose; OpenCV's axes, pixel centres at one half.
    pub camera: Camera,
    /// How the lens departs from the pinhole.
    pub distortion: Distortion,
    /// Path of the image as the file has it, relative to the capture; none for a view without an image.
    pub image: Option<String>,
    /// What else is known of each pixel.
    pub attachments: Attachments,
}

/// Files beside an image, each of the image's size and lens, with paths relative to the capture.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Attachments {
    /// A mask: pixels that are black take no part in training.
    pub mask: Option<String>,
    /// Depths.
    pub depth: Option<DepthFile>,
    /// Labels as grey values: 0 for none, then 1 + the label.
    pub labels: Option<String>,
}

/// An image of depths along z of the camera, 16 bits per pixel; 0 and 65535 where there is none.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthFile {
    /// Path relative to the capture.
    pub path: String,
    /// Metres per unit.
    pub metres_per_unit: f64,
    /// The camera that took it, in the same place as the colour camera; `None` when it is the colour camera itself.
    pub camera: Option<Camera>,
}

/// Checks every camera and gives each a name of its own, from its image where it has none.
fn finish(mut cameras: Vec<CaptureCamera>, place: &str) -> Result<Capture, SplatError> {
    for (index, one) in cameras.iter_mut().enumerate() {
        let label = one.image.clone().unwrap_or_else(|| one.name.clone());
        let at = || format!("{place}, camera {index} {label}");
        one.camera.check().map_err(|error| off(at(), "a camera", error))?;
        one.distortion.check().map_err(|found| off(at(), "finite coefficients of distortion", found))?;
    }
    name(&mut cameras);
    Ok(Capture { cameras, ..Capture::default() })
}

/// Endings of images, which are no part of a name.
const IMAGES: [&str; 9] = ["png", "jpg", "jpeg", "tif", "tiff", "bmp", "webp", "exr", "heic"];

/// Names from images: short ones when they differ, else with folders, else with numbers.
fn name(cameras: &mut [CaptureCamera]) {
    let whole = |path: &str| {
        let parts = path.split(['/', '\\']).filter(|part| !["", ".", ".."].contains(part));
        let joined = parts.collect::<Vec<_>>().join("_");
        match joined.rsplit_once('.') {
            Some((stem, kind)) if !stem.is_empty() && IMAGES.contains(&kind.to_ascii_lowercase().as_str()) => {
                stem.into()
            }
            _ => joined,
        }
    };
    let short = |path: &str| whole(path.rsplit(['/', '\\']).next().unwrap_or(path));
    let names = |of: &dyn Fn(&str) -> String| -> Vec<String> {
        cameras.iter().map(|one| of(one.image.as_deref().unwrap_or(&one.name))).collect()
    };
    let alike = |names: &[String]| {
        let mut sorted: Vec<&String> = names.iter().collect();
        sorted.sort();
        sorted.iter().any(|name| name.is_empty()) || sorted.windows(2).any(|pair| pair[0] == pair[1])
    };
    let mut chosen = names(&short);
    if alike(&chosen) {
        chosen = names(&whole);
    }
    if alike(&chosen) {
        chosen = chosen.iter().enumerate().map(|(index, name)| format!("{index:06}_{name}")).collect();
    }
    for (one, name) in cameras.iter_mut().zip(chosen) {
        one.name = name;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_core::Pose;

    fn names(images: &[&str]) -> Vec<String> {
        let camera =
            Camera { fx: 1.0, fy: 1.0, cx: 0.5, cy: 0.5, width: 1, height: 1, camera_from_world: Pose::IDENTITY };
        let of = |image: &&str| CaptureCamera {
            name: String::new(),
            camera,
            distortion: Distortion::default(),
            image: Some((*image).to_string()),
            attachments: Attachments::default(),
        };
        let capture = finish(images.iter().map(of).collect(), "test").unwrap();
        capture.cameras.into_iter().map(|one| one.name).collect()
    }

    #[test]
    fn names_differ_and_stay_within_a_folder() {
        assert_eq!(names(&["images/0001.jpg", "images/0002.v2.jpg"]), ["0001", "0002.v2"]);
        assert_eq!(names(&["left/1.png", "right/1.png"]), ["left_1", "right_1"]);
        assert_eq!(names(&["a.png", "a.jpg"]), ["000000_a", "000001_a"]);
        assert_eq!(
            names(&["../../etc/passwd", "C:\\x\\y.png", ".."]),
            ["000000_etc_passwd", "000001_C:_x_y", "000002_"]
        );
    }
}
