//! Folders of RGB-D frames as 7-Scenes has them (Shotton et al., 2013): `frame-000000.color.jpg` or `.png`, `.depth.png` in millimetres,
//! 65535 or 0 where there is none, `.pose.txt` with a 4x4 matrix `world_from_camera`, OpenCV's axes.
//!
//! The intrinsics that the data set gives, f = 585, are those of the depth camera. The colour camera is a Kinect's with f = 525; both have
//! their principal point in the middle of 640x480. The two are taken to stand in one place. `camera-intrinsics.txt` (3x3) beside the
//! frames is the depth camera's lens, `color-intrinsics.txt` the colour camera's, where they are there.

use super::distortion::Distortion;
use super::{Attachments, Capture, CaptureCamera, DepthFile, finish};
use crate::SplatError;
use crate::error::off;
use glam::{DMat3, DQuat, DVec3};
use qv_core::{Camera, Pose};
use std::collections::BTreeSet;

/// Focal length of the colour camera \[px\].
pub const COLOUR_FOCAL: f64 = 525.0;
/// Focal length of the depth camera \[px\].
pub const DEPTH_FOCAL: f64 = 585.0;
/// Files with the lens of the depth camera and of the colour camera.
const DEPTH_LENS: &str = "camera-intrinsics.txt";
const COLOUR_LENS: &str = "color-intrinsics.txt";
/// Columns and rows of both images.
pub const SIZE: [u32; 2] = [640, 480];
/// Largest entry of R Rᵀ - 1 that passes as drift of the tracker.
const ORTHOGONAL: f64 = 1e-2;

/// A capture of a folder's files, whose names may come in any order; `text` gives the contents of one of them.
///
/// # Errors
/// No colour image is there, or none has a pose that is a rigid transform. Single frames without one are left out, and named in `lost`.
pub fn read(names: &[String], text: &mut dyn FnMut(&str) -> Result<String, SplatError>) -> Result<Capture, SplatError> {
    let stem = |name: &String| Some(name.split_once(".color.")?.0.to_string());
    let mut colours: Vec<(&String, String)> = names.iter().filter_map(|name| Some((name, stem(name)?))).collect();
    colours.sort();
    if colours.is_empty() {
        return Err(off("RGB-D folder", "images named FRAME.color.jpg or .png", "none"));
    }
    let mut lens = |file: &str, usual: f64| {
        let there = names.iter().any(|name| name == file);
        if there { intrinsics(file, &text(file)?) } else { Ok(pinhole(usual)) }
    };
    let (of_colour, of_depth) = (lens(COLOUR_LENS, COLOUR_FOCAL)?, lens(DEPTH_LENS, DEPTH_FOCAL)?);
    let mut camera = |(name, stem): (&String, String)| {
        let pose_file = format!("{stem}.pose.txt");
        if !names.contains(&pose_file) {
            return Err(off(format!("RGB-D folder, {name}"), format!("a pose in {pose_file}"), "no such file"));
        }
        let camera_from_world = pose(&pose_file, &text(&pose_file)?)?;
        let camera = Camera { camera_from_world, ..of_colour };
        let depth_name = format!("{stem}.depth.png");
        let depth = names.contains(&depth_name).then_some(DepthFile {
            path: depth_name,
            metres_per_unit: 1e-3,
            camera: Some(Camera { camera_from_world, ..of_depth }),
        });
        let attachments = Attachments { depth, ..Default::default() };
        let image = Some(name.clone());
        Ok(CaptureCamera { name: stem, camera, distortion: Distortion::default(), image, attachments })
    };
    let (mut cameras, mut lost) = (vec![], vec![]);
    for one in colours {
        match camera(one) {
            Ok(camera) => cameras.push(camera),
            Err(error) => lost.push(error),
        }
    }
    if cameras.is_empty() {
        return Err(lost.remove(0));
    }
    // Frames whose photograph is gone.
    let photographed: BTreeSet<String> = names.iter().filter_map(stem).collect();
    let poses = names.iter().filter_map(|name| name.strip_suffix(".pose.txt"));
    let gone = poses.filter(|frame| !photographed.contains(*frame));
    let gone = gone.map(|frame| {
        off(format!("RGB-D folder, {frame}"), format!("an image {frame}.color.jpg or .png"), "no such file")
    });
    lost.extend(gone);
    let lost = lost.iter().map(ToString::to_string).collect();
    Ok(Capture { lost, ..finish(cameras, "RGB-D folder")? })
}

fn pinhole(focal: f64) -> Camera {
    let [width, height] = SIZE;
    let (cx, cy) = (0.5 * f64::from(width), 0.5 * f64::from(height));
    Camera { fx: focal, fy: focal, cx, cy, width, height, camera_from_world: Pose::IDENTITY }
}

/// The lens of a matrix fx 0 cx, 0 fy cy, 0 0 1.
fn intrinsics(file: &str, text: &str) -> Result<Camera, SplatError> {
    let k: Vec<f64> = text.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    let [fx, a, cx, b, fy, cy, c, d, one] = k[..] else {
        return Err(off(file, "3 rows of 3 numbers", k.len()));
    };
    let [width, height] = SIZE;
    let inside = (0.0..f64::from(width)).contains(&cx) && (0.0..f64::from(height)).contains(&cy);
    let is_lens = fx > 0.0 && fy > 0.0 && fx.is_finite() && fy.is_finite() && [a, b, c, d] == [0.0; 4] && one == 1.0;
    if !(is_lens && inside) {
        let found = format!("fx {fx}, fy {fy}, cx {cx}, cy {cy}");
        return Err(off(file, format!("fx 0 cx, 0 fy cy, 0 0 1 with the centre inside {width}x{height}"), found));
    }
    Ok(Camera { fx, fy, cx, cy, ..pinhole(fx) })
}

fn pose(file: &str, text: &str) -> Result<Pose, SplatError> {
    let numbers: Option<Vec<f64>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
    let m = numbers.filter(|m| m.len() == 16).ok_or_else(|| off(file, "4 rows of 4 numbers", text.len()))?;
    let column = |k: usize| DVec3::new(m[k], m[4 + k], m[8 + k]);
    let rotation = DMat3::from_cols(column(0), column(1), column(2));
    let far = (rotation * rotation.transpose() - DMat3::IDENTITY).to_cols_array();
    let worst = far.iter().fold(0.0f64, |most, x| if x.is_nan() { f64::INFINITY } else { most.max(x.abs()) });
    if worst > ORTHOGONAL || rotation.determinant() < 0.0 || !column(3).is_finite() {
        let found = format!("determinant {:.4}, R Rᵀ off by {worst:.4}", rotation.determinant());
        return Err(off(file, "a rotation and a position", found));
    }
    Ok(Pose { position: column(3), rotation: DQuat::from_mat3(&rotation).normalize() }.inverse())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn frames_are_read_and_faults_named() {
        let names: Vec<String> =
            ["b.color.png", "b.pose.txt", "a.color.jpg", "a.depth.png", "a.pose.txt"].map(String::from).to_vec();
        let mut text = |name: &str| {
            Ok(match name {
                "a.pose.txt" => "1 0 0 2\n0 1 0 3\n0 0 1 4\n0 0 0 1\n".to_string(),
                _ => "0 -1 0 0\n1 0 0 0\n0 0 1 0\n0 0 0 1\n".to_string(),
            })
        };
        let capture = read(&names, &mut text).unwrap();
        let [a, b] = &capture.cameras[..] else { panic!("{capture:?}") };
        assert_eq!((a.name.as_str(), a.image.as_deref(), a.camera.fx), ("a.color", Some("a.color.jpg"), 525.0));
        assert_eq!(a.attachments.depth.as_ref().map(|depth| depth.path.as_str()), Some("a.depth.png"));
        assert!(b.attachments.depth.is_none());
        let seen = a.camera.camera_from_world.transform_point(DVec3::new(2.0, 3.0, 5.0));
        assert!((seen - DVec3::Z).length() < 1e-12);
        let with = |file: &str| [&names[..], &[file.to_string()]].concat();
        let mut lenses = |name: &str| match name.strip_suffix("-intrinsics.txt") {
            Some(_) => Ok("600 0 310 0 590 250 0 0 1".to_string()),
            None => text(name),
        };
        let of_depth = read(&with(DEPTH_LENS), &mut lenses).unwrap().cameras[0].clone();
        let depth = of_depth.attachments.depth.unwrap().camera.unwrap();
        assert_eq!(
            (of_depth.camera.fx, [depth.fx, depth.fy, depth.cx, depth.cy]),
            (525.0, [600.0, 590.0, 310.0, 250.0])
        );
        assert_eq!(read(&with(COLOUR_LENS), &mut lenses).unwrap().cameras[0].camera.cy, 250.0);
        let bad = |name: &str| if name == DEPTH_LENS { Ok("600 0 910 0 590 250 0 0 1".into()) } else { text(name) };
        let error = read(&with(DEPTH_LENS), &mut { bad }).unwrap_err().to_string();
        assert!(error.states("camera-intrinsics.txt 0"), "{error}");
        let error = read(&names, &mut |_| Ok("1 0 0 0 0 2 0 0 0 0 1 0 0 0 0 1".into())).unwrap_err().to_string();
        assert!(error.states("a.pose.txt"), "{error}");
        let error = read(&names[..1], &mut text).unwrap_err().to_string();
        assert!(error.states("b.pose.txt"), "{error}");
        assert!(read(&[], &mut text).is_err());
        let lost = read(&with("c.pose.txt"), &mut text).unwrap().lost;
        assert_eq!(lost, ["RGB-D folder, c: expected an image c.color.jpg or .png, found no such file"]);
    }
}
