//! The camera of a robot on disk, and the images that it took.

use crate::RunArguments;
use crate::open::{bag_files, file_error};
use qv_camera::{Intrinsics, Photograph, Rig};
use qv_core::{Mismatch, Pose};
use qv_recording::images::{CameraInfo, Images, read_images};
use qv_recording::run::Clock;
use qv_recording::{RecordingError, Run};
use qv_splat::captures::distortion::Distortion;
use qv_splat::captures::pictures;
use qv_splat::train::{Pixels, undistorted};
use serde::Deserialize;
use std::fs;
use std::path::Path;

/// `camera.toml`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    width: Option<u32>,
    height: Option<u32>,
    fx: Option<f64>,
    fy: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    #[serde(default)]
    distortion: Vec<f64>,
    #[serde(default)]
    delay: f64,
    #[serde(default = "one")]
    gain: f64,
    #[serde(default)]
    blur: f64,
    base_from_camera: Mounting,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Mounting {
    position: [f64; 3],
    quaternion: [f64; 4],
}

fn one() -> f64 {
    1.0
}

/// A camera with its lens.
#[derive(Clone, Copy)]
pub struct RobotCamera {
    pub rig: Rig,
    pub distortion: Distortion,
}

/// What is said of the camera: the file, with the bag's own camera info for the inner numbers that the file leaves out.
pub fn open_camera(path: &Path, info: Option<&CameraInfo>) -> Result<RobotCamera, RecordingError> {
    let text = fs::read_to_string(path).map_err(|e| file_error(path, "a description of the camera", &e.to_string()))?;
    parse_camera(&text, info).map_err(|(expected, found)| file_error(path, &expected, &found))
}

fn parse_camera(text: &str, info: Option<&CameraInfo>) -> Result<RobotCamera, (String, String)> {
    let file: CameraFile = toml::from_str(text).map_err(|e| {
        ("width, height, fx, fy, cx, cy, and [base_from_camera] position and quaternion".into(), e.to_string())
    })?;
    let of_info = |index: usize| info.map(|i| i.matrix[index]);
    let need = |name: &str, value: Option<f64>| {
        value.ok_or_else(|| (format!("`{name}` here, or sensor_msgs/msg/CameraInfo in the bag"), "neither".to_string()))
    };
    let intrinsics = Intrinsics {
        fx: need("fx", file.fx.or(of_info(0)))?,
        fy: need("fy", file.fy.or(file.fx).or(of_info(4)))?,
        cx: need("cx", file.cx.or(of_info(2)))?,
        cy: need("cy", file.cy.or(of_info(5)))?,
        width: need("width", file.width.or(info.map(|i| i.width)).map(f64::from))? as u32,
        height: need("height", file.height.or(info.map(|i| i.height)).map(f64::from))? as u32,
    };
    // Coefficients go with the intrinsics that they were measured with.
    let from_info = file.fx.is_none() && file.distortion.is_empty();
    let coefficients = match info.filter(|_| from_info) {
        Some(info) if info.distortion.iter().all(|d| *d == 0.0) => Vec::new(),
        Some(info) if info.distortion_model == "plumb_bob" => info.distortion.clone(),
        Some(info) => return Err(("distortion model `plumb_bob`".into(), format!("`{}`", info.distortion_model))),
        None => file.distortion,
    };
    let distortion = match coefficients[..] {
        [] => Distortion::default(),
        [k1, k2, p1, p2] => Distortion { k1, k2, p1, p2, k3: 0.0 },
        [k1, k2, p1, p2, k3] => Distortion { k1, k2, p1, p2, k3 },
        _ => return Err(("distortion k1, k2, p1, p2, k3".into(), format!("{} numbers", coefficients.len()))),
    };
    let Mounting { position, quaternion } = file.base_from_camera;
    let base_from_camera = Pose::from_position_wxyz(position, quaternion)
        .ok_or_else(|| ("base_from_camera with a quaternion w, x, y, z".to_string(), format!("{quaternion:?}")))?;
    let rig = Rig { intrinsics, base_from_camera, delay: file.delay, gain: file.gain, blur: file.blur };
    Ok(RobotCamera { rig, distortion })
}

/// A camera as the text that [`open_camera`] reads.
pub fn to_toml(camera: &RobotCamera, sentence: &str) -> String {
    let d = &camera.distortion;
    qv_camera::to_toml(&camera.rig, [d.k1, d.k2, d.p1, d.p2, d.k3], sentence)
}

/// Images of a run before they are decoded: stamps on the run's clock, and files.
pub struct RunImages {
    pub images: Vec<(f64, Vec<u8>)>,
    pub info: Option<CameraInfo>,
    /// What was lost or is not as it should be, a line each.
    pub notes: Vec<String>,
}

/// Reads the images of a run: of a bag those of `topic`, or of the topic with most; of a table those that `images.csv` beside it names
/// (columns `time` and `file`). At most `most` within the span of the poses, evenly spread.
pub fn open_images(
    arguments: &RunArguments,
    run: &Run,
    topic: Option<&str>,
    most: usize,
) -> Result<RunImages, RecordingError> {
    let path = &arguments.run;
    let directory = if path.is_dir() { path.as_path() } else { path.parent().unwrap_or(Path::new(".")) };
    let is_table = path.extension().is_some_and(|e| e == "csv") || path.join("run.csv").exists();
    let span = run.measured.base_pose.as_ref().filter(|p| !p.is_empty()).map(|p| [p.time[0], p.time[p.len() - 1]]);
    if is_table {
        let listed = table_images(&directory.join("images.csv"))?;
        let images = spread(listed, span, most).into_iter().map(|(time, name)| {
            let file = directory.join(&name);
            fs::read(&file).map(|bytes| (time, bytes)).map_err(|e| file_error(&file, "an image", &e.to_string()))
        });
        return Ok(RunImages { images: images.collect::<Result<_, _>>()?, info: None, notes: Vec::new() });
    }
    let found: Images = read_images(bag_files(path)?, topic);
    if found.images.is_empty() {
        let expected = match topic {
            Some(topic) => format!("sensor_msgs/msg/CompressedImage on {topic}"),
            None => "a topic with sensor_msgs/msg/CompressedImage".into(),
        };
        let there = match (found.topics.is_empty(), &found.damaged) {
            (_, Some((count, why))) => format!("{count} damaged messages: {why}"),
            (true, None) => "none".into(),
            (false, None) => format!("images on {}", found.topics.join(", ")),
        };
        return Err(Mismatch::new("images", expected, there).into());
    }
    let mut notes = Vec::new();
    if let Some((count, why)) = &found.damaged {
        notes.push(format!("{count} messages of {} could not be read: {why}", found.topic));
    }
    if found.clock == Some(Clock::Log) {
        notes.push(format!(
            "stamps of {} are those of the log: a delay of the camera includes that of the recorder",
            found.topic
        ));
    }
    let epoch = run.epoch as i128;
    let timed = found.images.into_iter().map(|i| ((i128::from(i.stamp) - epoch) as f64 * 1e-9, i.data)).collect();
    Ok(RunImages { images: spread(timed, span, most), info: found.info, notes })
}

fn spread<T>(all: Vec<(f64, T)>, span: Option<[f64; 2]>, most: usize) -> Vec<(f64, T)> {
    let within: Vec<(f64, T)> = all.into_iter().filter(|(t, _)| span.is_none_or(|[a, b]| *t >= a && *t <= b)).collect();
    let (n, count) = (within.len(), within.len().min(most));
    let chosen: std::collections::BTreeSet<usize> = (0..count).map(|k| (2 * k + 1) * n / (2 * count.max(1))).collect();
    within.into_iter().enumerate().filter(|(i, _)| chosen.contains(i)).map(|(_, x)| x).collect()
}

/// Times and names of `images.csv`.
fn table_images(path: &Path) -> Result<Vec<(f64, String)>, RecordingError> {
    let text = fs::read_to_string(path)
        .map_err(|e| file_error(path, "images of the run (columns time, file)", &e.to_string()))?;
    let mut lines = text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty());
    let head: Vec<&str> = lines.next().map(|(_, l)| l.split(',').map(str::trim).collect()).unwrap_or_default();
    let column = |name: &str| {
        head.iter()
            .position(|h| *h == name)
            .ok_or_else(|| file_error(path, &format!("a column `{name}`"), &head.join(", ")))
    };
    let (time, file) = (column("time")?, column("file")?);
    let row = |(number, line): (usize, &str)| {
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let stamp = cells.get(time).and_then(|c| c.parse::<f64>().ok()).filter(|t| t.is_finite());
        match (stamp, cells.get(file)) {
            (Some(stamp), Some(name)) if !name.is_empty() => Ok((stamp, name.to_string())),
            _ => Err(file_error(path, &format!("a time and a file in line {}", number + 1), line)),
        }
    };
    let mut rows: Vec<(f64, String)> = lines.map(row).collect::<Result<_, _>>()?;
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(rows)
}

/// Decodes images and takes the lens's distortion away.
pub fn photographs(images: &[(f64, Vec<u8>)], camera: &RobotCamera) -> Result<Vec<Photograph>, RecordingError> {
    let Intrinsics { width, height, .. } = camera.rig.intrinsics;
    let one = |(time, bytes): &(f64, Vec<u8>)| {
        let about = |expected: String, found: String| -> RecordingError {
            Mismatch::new(format!("image at {time:.3} s"), expected, found).into()
        };
        let decoded = pictures::read(bytes).map_err(|found| about("a JPEG or PNG image".into(), found))?;
        if (decoded.width(), decoded.height()) != (width, height) {
            let found = format!("{} x {}", decoded.width(), decoded.height());
            return Err(about(format!("{width} x {height} pixels as the camera's intrinsics say"), found));
        }
        let rgba = decoded.into_rgb8().pixels().map(|p| [p[0], p[1], p[2], 255]).collect();
        let pixels = Pixels { width: width as usize, height: height as usize, rgba };
        let pinhole = camera.rig.camera(Pose::IDENTITY);
        Ok(Photograph { time: *time, rgba: undistorted(pixels, &pinhole, &camera.distortion).rgba })
    };
    images.iter().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "width = 64\nheight = 48\nfx = 50.0\nfy = 51.0\ncx = 32.0\ncy = 24.0\ndistortion = [0.1, 0.0, 0.01, 0.0]\n\
        [base_from_camera]\nposition = [0.3, 0.0, 0.1]\nquaternion = [0.5, -0.5, 0.5, -0.5]\n";

    #[test]
    fn a_camera_is_read_and_written_back() {
        let mut camera = parse_camera(TEXT, None).unwrap_or_else(|e| panic!("{e:?}"));
        assert_eq!((camera.rig.intrinsics.fy, camera.distortion.p1, camera.rig.gain), (51.0, 0.01, 1.0));
        camera.rig.delay = 0.0125;
        let back = parse_camera(&to_toml(&camera, "a\nb"), None).unwrap_or_else(|e| panic!("{e:?}"));
        assert_eq!((back.rig, back.distortion), (camera.rig, camera.distortion));
    }

    #[test]
    fn inner_numbers_may_come_from_the_bag() {
        let info = CameraInfo {
            width: 640,
            height: 480,
            distortion_model: "plumb_bob".into(),
            distortion: vec![0.2, 0.0, 0.0, 0.0, 0.0],
            matrix: [500.0, 0.0, 320.0, 0.0, 501.0, 240.0, 0.0, 0.0, 1.0],
        };
        let mounting = &TEXT[TEXT.find('[').unwrap()..];
        let mounting = &mounting[mounting.find("[base").unwrap()..];
        let camera = parse_camera(mounting, Some(&info)).unwrap_or_else(|e| panic!("{e:?}"));
        assert_eq!((camera.rig.intrinsics.fy, camera.distortion.k1), (501.0, 0.2));
        let (expected, found) = parse_camera(mounting, None).err().unwrap();
        assert!(expected.contains("CameraInfo") && found == "neither", "{expected} {found}");
        let (expected, _) = parse_camera(&TEXT.replace("0.5, -0.5, 0.5, -0.5", "0, 0, 0, 0"), None).err().unwrap();
        assert!(expected.contains("quaternion"), "{expected}");
    }
}
