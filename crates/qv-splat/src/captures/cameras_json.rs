//! Cameras in a JSON of our own, for views that nothing else describes:
//!
//! ```json
//! {"format": "qv-cameras/1", "cameras": [
//!   {"name": "front", "width": 640, "height": 480, "fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0,
//!    "position": [0.0, -2.0, 1.0], "rotation": [1.0, 0.0, 0.0, 0.0], "distortion": {"k1": 0.05}}]}
//! ```
//!
//! `position` is the camera's place in the world \[m\], `rotation` takes its axes (x right, y down, z forward) to the world's, w,
//! x, y, z. `fy` may be missing and is `fx` then, `cx` and `cy` and are the middle, `distortion` (k1, k2, k3, p1, p2) and is none;
//! `image` may name an image.

use super::distortion::Distortion;
use super::{Attachments, Capture, CaptureCamera, finish};
use crate::SplatError;
use crate::error::off;
use qv_core::{Camera, Pose};
use serde_json::{Value, json};

/// What the file calls itself.
pub const FORMAT: &str = "qv-cameras/1";

/// Reads the text of a file.
///
/// # Errors
/// Names the camera and the value that is off.
pub fn read(text: &str) -> Result<Capture, SplatError> {
    let document: Value = serde_json::from_str(text).map_err(|error| off("cameras", "JSON", error))?;
    read_value(&document)
}

const KEYS: [&str; 11] =
    ["name", "image", "width", "height", "fx", "fy", "cx", "cy", "distortion", "position", "rotation"];
const COEFFICIENTS: [&str; 5] = ["k1", "k2", "k3", "p1", "p2"];

/// Reads a document. See [`read`].
///
/// # Errors
/// As [`read`].
pub fn read_value(document: &Value) -> Result<Capture, SplatError> {
    let format = document.get("format").and_then(Value::as_str).unwrap_or("none");
    if format != FORMAT {
        return Err(off("cameras, format", FORMAT, format));
    }
    let list = document.get("cameras").and_then(Value::as_array);
    let list = list.ok_or_else(|| off("cameras", "a list `cameras`", "none"))?;
    finish(list.iter().enumerate().map(camera).collect::<Result<_, _>>()?, "cameras")
}

fn camera((index, value): (usize, &Value)) -> Result<CaptureCamera, SplatError> {
    let place = |key: &str| format!("cameras, {index}, {key}");
    let optional = |from: &Value, key: &str| match from.get(key) {
        None => Ok(None),
        Some(found) => found.as_f64().map(Some).ok_or_else(|| off(place(key), "a number", found)),
    };
    let side = |key: &str| {
        let found = value.get(key).and_then(Value::as_u64).and_then(|side| u32::try_from(side).ok());
        found.ok_or_else(|| off(place(key), "a whole number of pixels", value.get(key).unwrap_or(&Value::Null)))
    };
    let text = |key: &str| match value.get(key) {
        None => Ok(None),
        Some(found) => found.as_str().map(|s| Some(s.to_string())).ok_or_else(|| off(place(key), "a text", found)),
    };
    let (name, image) = (text("name")?.unwrap_or_default(), text("image")?);
    known(value, &place("keys"), &KEYS)?;
    let (width, height) = (side("width")?, side("height")?);
    let fx = optional(value, "fx")?.ok_or_else(|| off(place("fx"), "a number", "none"))?;
    let nothing = json!({});
    let lens = value.get("distortion").unwrap_or(&nothing);
    known(lens, &place("distortion"), &COEFFICIENTS)?;
    let coefficient = |key: &str| optional(lens, key).map(|found| found.unwrap_or(0.0));
    let position = numbers::<3>(value, "position").ok_or_else(|| off(place("position"), "3 numbers", "no such"))?;
    let rotation = numbers::<4>(value, "rotation").ok_or_else(|| off(place("rotation"), "4 numbers", "no such"))?;
    let world_from_camera = Pose::from_position_wxyz(position, rotation);
    let world_from_camera = world_from_camera
        .ok_or_else(|| off(place("rotation"), "a quaternion that is not zero", format!("{rotation:?}")))?;
    let camera = Camera {
        fx,
        fy: optional(value, "fy")?.unwrap_or(fx),
        cx: optional(value, "cx")?.unwrap_or(0.5 * f64::from(width)),
        cy: optional(value, "cy")?.unwrap_or(0.5 * f64::from(height)),
        width,
        height,
        camera_from_world: world_from_camera.inverse(),
    };
    let distortion = Distortion {
        k1: coefficient("k1")?,
        k2: coefficient("k2")?,
        k3: coefficient("k3")?,
        p1: coefficient("p1")?,
        p2: coefficient("p2")?,
    };
    Ok(CaptureCamera { name, camera, distortion, image, attachments: Attachments::default() })
}

/// A misspelt key must not pass for one that is not there.
fn known(value: &Value, place: &str, keys: &[&str]) -> Result<(), SplatError> {
    let object = value.as_object().ok_or_else(|| off(place, format!("an object with {}", keys.join(", ")), value))?;
    match object.keys().find(|key| !keys.contains(&key.as_str())) {
        Some(other) => Err(off(place, keys.join(", "), other)),
        None => Ok(()),
    }
}

fn numbers<const N: usize>(value: &Value, key: &str) -> Option<[f64; N]> {
    let list: Vec<f64> = value.get(key)?.as_array()?.iter().map(Value::as_f64).collect::<Option<_>>()?;
    list.try_into().ok()
}

/// The text of a file with these cameras.
pub fn write(capture: &Capture) -> String {
    let one = |one: &CaptureCamera| {
        let (c, d) = (&one.camera, &one.distortion);
        let world_from_camera = c.camera_from_world.inverse();
        let mut out = json!({"name": one.name, "width": c.width, "height": c.height, "fx": c.fx, "fy": c.fy, "cx": c.cx,
            "cy": c.cy, "position": world_from_camera.position.to_array(), "rotation": world_from_camera.wxyz()});
        if !d.is_none() {
            out["distortion"] = json!({"k1": d.k1, "k2": d.k2, "k3": d.k3, "p1": d.p1, "p2": d.p2});
        }
        if let Some(image) = &one.image {
            out["image"] = json!(image);
        }
        out
    };
    json!({"format": FORMAT, "cameras": capture.cameras.iter().map(one).collect::<Vec<_>>()}).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    fn good() -> Value {
        json!({"format": FORMAT, "cameras": [{"name": "front", "width": 640, "height": 480, "fx": 500.0,
            "position": [0.0, -2.0, 1.0], "rotation": [0.5, -0.5, 0.5, 0.5], "distortion": {"k1": 0.05}}]})
    }

    #[test]
    fn what_is_written_is_read() {
        let capture = read_value(&good()).unwrap();
        let camera = &capture.cameras[0].camera;
        assert_eq!((camera.fy, camera.cx, camera.cy, capture.cameras[0].distortion.k1), (500.0, 320.0, 240.0, 0.05));
        let place = camera.camera_from_world.inverse().position.to_array();
        assert!(place.iter().zip([0.0, -2.0, 1.0]).all(|(a, b)| (a - b).abs() < 1e-12), "{place:?}");
        let again = read(&write(&capture)).unwrap();
        assert_eq!(again.cameras[0].name, "front");
        let moved = again.cameras[0].camera.camera_from_world.position - camera.camera_from_world.position;
        assert!(moved.length() < 1e-12);
    }

    #[test]
    fn each_fault_is_named() {
        let fault = |key: &str, value: Value| {
            let mut file = good();
            file["cameras"][0][key] = value;
            read_value(&file).unwrap_err().to_string()
        };
        assert!(fault("width", json!(-1)).states("cameras 0"));
        assert!(fault("fx", json!(-5.0)).states("pixels 0.001 10 000 000 -5"));
        assert!(fault("rotation", json!([0, 0, 0, 0])).states("quaternion"));
        assert!(fault("position", json!([0, 0])).states("numbers 3"));
        assert!(fault("distortion", json!({"k1": "x"})).states("k1"));
        assert!(read("{\"format\": \"x\"}").unwrap_err().to_string().states("qv-cameras/1"));
    }
}
