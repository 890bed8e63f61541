//! nerfstudio's `transforms.json` (docs.nerf.studio, *Data conventions*, nerfstudio 1.x), which instant-ngp began.
//!
//! `transform_matrix` is `world_from_camera` with OpenGL's axes: x right, y up, z back. Intrinsics stand once, or with each
//! frame. The poses are taken as they are: `applied_transform` shows where they came from and is passed over. `mask_path`,
//! `depth_file_path` (16 bits, `depth_unit_scale_factor` metres per unit) are nerfstudio's; `label_file_path` is ours.

use super::distortion::Distortion;
use super::{Attachments, Capture, CaptureCamera, DepthFile, Sizes, finish, json};
use crate::SplatError;
use crate::error::off;
use glam::{DMat3, DQuat, DVec3};
use qv_core::{Camera, Pose};
use serde_json::Value;
use std::collections::BTreeSet;

const PLACE: &str = "transforms.json";
/// Keys of a frame's depth image: nerfstudio's, and instant-ngp's.
pub const DEPTH_KEYS: [&str; 2] = ["depth_file_path", "depth_path"];
/// Largest entry of R Rᵀ - 1 that passes as rounding of the file.
const ORTHOGONAL: f64 = 1e-3;

/// Reads a file whose images are not there: it must say how large they are.
///
/// # Errors
/// As [`read_with`].
pub fn read(text: &str) -> Result<Capture, SplatError> {
    read_value(&json::parse(text.as_bytes(), PLACE)?)
}

/// Reads a document whose images are not there. See [`read`].
///
/// # Errors
/// As [`read_with`].
pub fn read_value(document: &Value) -> Result<Capture, SplatError> {
    read_with(document, &mut |_| Err("none".into()))
}

/// Reads a document; where it has no `w` and `h`, as instant-ngp's and Blender's have none, `sizes` gives those of the images. What is
/// null counts as not there. Frames whose pose is no rigid transform, or whose size is not known, are left out and named in `lost`.
///
/// # Errors
/// Names the frame and the value that is off, and camera models other than the pinhole with OpenCV's distortion k1, k2, k3, p1, p2; no frame
/// is left.
pub fn read_with(document: &Value, sizes: Sizes) -> Result<Capture, SplatError> {
    let frames = document.get("frames").and_then(Value::as_array);
    let frames = frames.ok_or_else(|| off(PLACE, "a list `frames`", "none"))?;
    let (mut cameras, mut lost) = (vec![], vec![]);
    for (index, frame) in frames.iter().enumerate() {
        let place = format!("{PLACE}, frame {index}");
        let values = Values { document, frame, place: &place };
        match values.pose().and_then(|pose| Ok((pose, values.size(sizes)?))) {
            Ok((pose, size)) => cameras.push(camera(&values, pose, size)?),
            Err(Fault::Frame(error)) => lost.push(error),
            Err(Fault::File(error)) => return Err(error),
        }
    }
    if let (true, Some(error)) = (cameras.is_empty(), lost.first()) {
        return Err(error.clone());
    }
    let lost = lost.iter().map(ToString::to_string).collect();
    let mut capture = Capture { lost, ..finish(cameras, PLACE)? };
    split(document, &mut capture);
    Ok(capture)
}

/// nerfstudio's own split: what `val_filenames` and `test_filenames` name is held out; what none of the lists names is left out.
fn split(document: &Value, capture: &mut Capture) {
    let list = |key: &str| {
        let all = document.get(key).and_then(Value::as_array);
        all.map(|all| all.iter().filter_map(Value::as_str).map(plain_path).collect::<BTreeSet<&str>>())
    };
    let Some(training) = list("train_filenames") else { return };
    let held: BTreeSet<&str> = ["val_filenames", "test_filenames"].into_iter().filter_map(list).flatten().collect();
    let is_in =
        |set: &BTreeSet<&str>, one: &CaptureCamera| one.image.as_deref().is_some_and(|i| set.contains(plain_path(i)));
    let before = capture.cameras.len();
    capture.cameras.retain(|one| is_in(&training, one) || is_in(&held, one));
    if capture.cameras.len() < before {
        let left = before - capture.cameras.len();
        capture.lost.push(format!("{left} frames that neither train_filenames nor val_filenames, test_filenames name"));
    }
    let both = |one: &&CaptureCamera| is_in(&held, one) && !is_in(&training, one);
    let names: BTreeSet<String> = capture.cameras.iter().filter(both).map(|one| one.name.clone()).collect();
    let count = names.len();
    capture
        .remarks
        .push(format!("held out: the {count} images that the capture's val_filenames and test_filenames name"));
    capture.held_out = Some(names);
}

fn plain_path(path: &str) -> &str {
    path.trim_start_matches("./")
}

/// What a fault costs.
enum Fault {
    /// This frame.
    Frame(SplatError),
    /// The file: the same is wrong with other frames, or means another lens.
    File(SplatError),
}

fn camera(values: &Values, pose: Pose, [width, height]: [u32; 2]) -> Result<CaptureCamera, SplatError> {
    let place = values.place;
    let model = values.get("camera_model").and_then(Value::as_str).unwrap_or("OPENCV");
    if !["OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL"].contains(&model) {
        let expected = "OPENCV, PINHOLE, SIMPLE_PINHOLE, SIMPLE_RADIAL or RADIAL";
        return Err(off(format!("{place}, camera_model"), expected, model));
    }
    if values.get("is_fisheye").and_then(Value::as_bool) == Some(true) {
        return Err(off(format!("{place}, is_fisheye"), "false", true));
    }
    for name in ["k4", "k5", "k6"] {
        let found = values.number(name)?.unwrap_or(0.0);
        if found != 0.0 {
            return Err(off(format!("{place}, {name}"), "0", found));
        }
    }
    let zero = |name: &str| values.number(name).map(|found| found.unwrap_or(0.0));
    let distortion = Distortion { k1: zero("k1")?, k2: zero("k2")?, k3: zero("k3")?, p1: zero("p1")?, p2: zero("p2")? };
    let fx = values.focal("x", width)?;
    let fy = values.focal("y", height)?;
    let fx = fx.or(fy).ok_or_else(|| off(place, "a focal length or an angle of view along x", "neither"))?;
    let camera = Camera {
        fx,
        fy: fy.unwrap_or(fx),
        cx: values.number("cx")?.unwrap_or(0.5 * f64::from(width)),
        cy: values.number("cy")?.unwrap_or(0.5 * f64::from(height)),
        width,
        height,
        camera_from_world: pose,
    };
    let image = values.path().ok_or_else(|| off(place, "file_path", "none"))?.to_string();
    let attachments = attachments(values)?;
    Ok(CaptureCamera { name: String::new(), camera, distortion, image: Some(image), attachments })
}

/// Files beside the image: nerfstudio's masks and depths, labels by the same pattern.
fn attachments(values: &Values) -> Result<Attachments, SplatError> {
    let path = |name: &str| values.frame.get(name).and_then(Value::as_str).map(String::from);
    // instant-ngp's key for the same.
    let of_ngp = values.number("integer_depth_scale")?;
    let metres_per_unit = values.number("depth_unit_scale_factor")?.or(of_ngp).unwrap_or(1e-3);
    if !(metres_per_unit.is_finite() && metres_per_unit > 0.0) {
        return Err(off("depth_unit_scale_factor", "metres per unit, above 0", metres_per_unit));
    }
    let depth = DEPTH_KEYS.into_iter().find_map(path).map(|path| DepthFile { path, metres_per_unit, camera: None });
    Ok(Attachments { mask: path("mask_path"), depth, labels: path("label_file_path") })
}

/// Values of a frame, or of the whole file.
struct Values<'a> {
    document: &'a Value,
    frame: &'a Value,
    place: &'a str,
}

impl<'a> Values<'a> {
    fn get(&self, name: &str) -> Option<&'a Value> {
        let of = |value: &'a Value| value.get(name).filter(|found| !found.is_null());
        of(self.frame).or_else(|| of(self.document))
    }

    /// The image as the file names it.
    fn path(&self) -> Option<&str> {
        self.frame.get("file_path").and_then(Value::as_str)
    }

    /// Width and height of the file, else of the image.
    fn size(&self, sizes: Sizes) -> Result<[u32; 2], Fault> {
        if let (Some(width), Some(height)) =
            (self.side("w").map_err(Fault::File)?, self.side("h").map_err(Fault::File)?)
        {
            return Ok([width, height]);
        }
        let path = self.path().ok_or_else(|| Fault::File(off(self.place, "file_path", "none")))?;
        let expected = "w and h, or an image to look at";
        sizes(path).map_err(|found| Fault::Frame(off(self.place, expected, format!("neither: {found}"))))
    }

    fn pose(&self) -> Result<Pose, Fault> {
        pose(self.frame, self.place).map_err(Fault::Frame)
    }

    fn number(&self, name: &str) -> Result<Option<f64>, SplatError> {
        match self.get(name) {
            None => Ok(None),
            Some(found) => match found.as_f64() {
                Some(number) => Ok(Some(number)),
                None => Err(off(format!("{}, {name}", self.place), "a number", found)),
            },
        }
    }

    /// Width or height, which some files have as floats.
    fn side(&self, name: &str) -> Result<Option<u32>, SplatError> {
        let Some(found) = self.number(name)? else { return Ok(None) };
        if found < 1.0 || found > f64::from(u32::MAX) || found.fract() != 0.0 {
            return Err(off(format!("{}, {name}", self.place), "a whole number of pixels", found));
        }
        Ok(Some(found as u32))
    }

    /// A focal length along an axis in pixels, `fl_x` or `fl_y`, else from the angle of view in radians.
    fn focal(&self, axis: &str, side: u32) -> Result<Option<f64>, SplatError> {
        let of_angle = |angle: f64| 0.5 * f64::from(side) / (0.5 * angle).tan();
        let angle = self.number(&format!("camera_angle_{axis}"))?;
        Ok(self.number(&["fl", axis].join("_"))?.or(angle.map(of_angle)))
    }
}

fn pose(frame: &Value, place: &str) -> Result<Pose, SplatError> {
    let place = || format!("{place}, transform_matrix");
    let found = frame.get("transform_matrix").ok_or_else(|| off(place(), "a 4x4 matrix", "none"))?;
    let rows: Option<Vec<Vec<f64>>> = found.as_array().and_then(|rows| {
        rows.iter().map(|row| row.as_array().and_then(|row| row.iter().map(Value::as_f64).collect())).collect()
    });
    let rows = rows.filter(|rows| [3, 4].contains(&rows.len()) && rows.iter().all(|row| row.len() == 4));
    let rows = rows.ok_or_else(|| off(place(), "3 or 4 rows of 4 numbers", shortened(found)))?;
    // OpenGL's camera looks along -z with y up, ours along z with y down.
    let column = |k: usize, sign: f64| sign * DVec3::new(rows[0][k], rows[1][k], rows[2][k]);
    world_from_camera(DMat3::from_cols(column(0, 1.0), column(1, -1.0), column(2, -1.0)), column(3, 1.0))
        .map_err(|found| off(place(), "a rotation and a position", found))
}

/// `camera_from_world` of a rotation matrix and a position, `world_from_camera`.
///
/// # Errors
/// The matrix is no rotation, in words.
fn world_from_camera(rotation: DMat3, position: DVec3) -> Result<Pose, String> {
    let off_by = (rotation * rotation.transpose() - DMat3::IDENTITY).to_cols_array();
    let largest = off_by.iter().fold(0.0f64, |most, x| if x.is_nan() { f64::NAN } else { most.max(x.abs()) });
    if largest.is_nan() || largest > ORTHOGONAL || rotation.determinant() < 0.0 || !position.is_finite() {
        return Err(format!("determinant {:.6}, R Rᵀ off by {largest:.6}", rotation.determinant()));
    }
    Ok(Pose { position, rotation: DQuat::from_mat3(&rotation).normalize() }.inverse())
}

fn shortened(value: &Value) -> String {
    value.to_string().chars().take(60).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use serde_json::json;

    fn good() -> Value {
        json!({"w": 640, "h": 480.0, "fl_x": 500.0, "cx": 310.0, "k1": 0.1, "frames": [
            {"file_path": "images/a.jpg", "transform_matrix": [[1, 0, 0, 1.0], [0, 0, -1, 2.0], [0, 1, 0, 3.0], [0, 0, 0, 1]]},
            {"file_path": "images/b.jpg", "fl_x": 400.0, "fl_y": 410.0,
             "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]}]})
    }

    #[test]
    fn axes_intrinsics_and_names() {
        let capture = read(&good().to_string()).unwrap();
        let [a, b] = &capture.cameras[..] else { panic!("{capture:?}") };
        assert_eq!((a.name.as_str(), a.image.as_deref()), ("a", Some("images/a.jpg")));
        let c = &a.camera;
        assert_eq!((c.fx, c.fy, c.cx, c.cy, c.width, c.height), (500.0, 500.0, 310.0, 240.0, 640, 480));
        assert_eq!((b.camera.fx, b.camera.fy, a.distortion.k1), (400.0, 410.0, 0.1));
        // The camera stands at (1, 2, 3) and looks along its own -z, which is the world's y.
        let ahead = c.camera_from_world.transform_point(DVec3::new(1.0, 4.0, 3.0));
        assert!((ahead - DVec3::new(0.0, 0.0, 2.0)).length() < 1e-12, "{ahead}");
        let above = c.camera_from_world.transform_point(DVec3::new(1.0, 2.0, 4.0));
        assert!((above - DVec3::new(0.0, -1.0, 0.0)).length() < 1e-12, "{above}");
    }

    #[test]
    fn an_angle_of_view_stands_for_a_focal_length() {
        let mut file = good();
        file.as_object_mut().unwrap().remove("fl_x");
        file["camera_angle_x"] = json!(2.0 * (640.0f64 / 1000.0).atan());
        assert!((read_value(&file).unwrap().cameras[0].camera.fx - 500.0).abs() < 1e-9);
    }

    #[test]
    fn each_fault_is_named() {
        let fault = |path: &str, value: Value| {
            let mut file = good();
            match path.split_once('.') {
                Some((_, name)) => file["frames"][1][name] = value,
                None => file[path] = value,
            }
            read_value(&file).unwrap_err().to_string()
        };
        assert!(fault("frames", json!(3)).states("`frames`"));
        assert!(fault("w", json!(640.5)).states("number 0 640.5"));
        assert!(fault("frame.w", json!(100_000)).states("1 images/b.jpg"));
        assert!(fault("frame.fl_x", json!("x")).states("1 fl_x"));
        assert!(fault("frame.k4", json!(0.1)).states("k4 0"));
        assert!(fault("camera_model", json!("OPENCV_FISHEYE")).states("OPENCV_FISHEYE"));
        assert!(fault("frame.file_path", json!(1)).states("file_path"));
        assert!(read("{").unwrap_err().to_string().states("JSON"));
    }

    #[test]
    fn a_frame_without_a_pose_is_left_out() {
        let lost = |value: Value| {
            let mut file = good();
            file["frames"][1]["transform_matrix"] = value;
            let capture = read_value(&file).unwrap();
            assert_eq!((capture.cameras.len(), capture.lost.len()), (1, 1));
            capture.lost[0].clone()
        };
        let mirrored = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0]]);
        assert!(lost(mirrored.clone()).states("1 transform_matrix"));
        assert!(lost(json!([[1, 0], [0, 1]])).states("numbers 3 4 4"));
        assert!(lost(Value::Null).states("numbers 3 4 4"));
        let mut none = good();
        none["frames"] = json!([{"file_path": "a.png", "transform_matrix": mirrored}]);
        assert!(read_value(&none).unwrap_err().to_string().states("frame 0"));
    }

    #[test]
    fn what_is_null_is_not_there_and_nan_is_no_number() {
        let mut file = good();
        file["k3"] = Value::Null;
        file["frames"][1]["fl_x"] = Value::Null;
        let capture = read_value(&file).unwrap();
        assert_eq!((capture.cameras[1].camera.fx, capture.cameras[0].distortion.k3), (500.0, 0.0));
        let text = file.to_string().replace("310.0", "NaN");
        assert!(read(&text).unwrap_err().to_string().states("\"NaN\""));
        let harmless = file.to_string().replace("\"k3\":null", "\"sharpness\":NaN");
        assert_eq!(read(&harmless).unwrap(), capture);
    }

    #[test]
    fn images_tell_their_size() {
        let mut file = good();
        let root = file.as_object_mut().unwrap();
        for key in ["w", "h", "fl_x", "cx", "k1"] {
            root.remove(key);
        }
        root.insert("camera_angle_x".into(), json!(2.0 * (48.0f64 / 90.0).atan()));
        let mut sizes =
            |path: &str| if path == "images/a.jpg" { Ok([96, 64]) } else { Err("no such file".to_string()) };
        let capture = read_with(&file, &mut sizes).unwrap();
        let c = &capture.cameras[0].camera;
        assert_eq!(([c.width, c.height], [c.cx, c.cy], capture.cameras.len()), ([96, 64], [48.0, 32.0], 1));
        assert!((c.fx - 90.0).abs() < 1e-9 && c.fx == c.fy);
        let expected = "frame 1: expected w and h, or an image to look at, found neither: no such file";
        assert!(capture.lost[0].contains(expected), "{:?}", capture.lost);
        assert!(read_value(&file).is_err());
    }
}
