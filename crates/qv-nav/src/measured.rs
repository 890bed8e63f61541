//! Cameras as a diagnosis found them: the middle and the spread of what all photographs of a recording share, and their scatter.

use crate::NavError;
use crate::lens::LensSpread;
use crate::net::WIDTH;
use crate::sight::Rig;
use glam::{DQuat, DVec3};
use qv_core::Pose;
use serde_json::Value;
use std::f64::consts::SQRT_2;

/// An interval of 95 % is so many standard deviations to each side.
const HALF: f64 = 1.96;

/// What `visual` in report.json of `qv diagnose --scene` says of the camera: how cameras differ, and how the one of `rig` really sits. Variances are
/// doubled, since a diagnosis knows no recording but its own; the scatter from photograph to photograph is added. What a diagnosis does not measure
/// (noise, balance of colours, gamma, exposure time) is as in [`LensSpread::wide`].
///
/// # Errors
/// The report has no camera, lacks a number, or a number means nothing.
pub fn camera(report: &Value, rig: &Rig) -> Result<(LensSpread, Rig), NavError> {
    let visual = &report["visual"];
    if !visual["shared"].is_array() {
        return Err(NavError::value("report", "`visual`, which `qv diagnose --scene` writes", "none"));
    }
    let noise = |key: &str| number(&visual["noise"][key], &format!("visual.noise.{key}"));
    let [gain, delay, focal, blur] = ["gain", "delay", "focal_scale", "blur"].map(|name| shared(visual, name));
    let (gain, delay, focal, blur) = (gain?, delay?, focal?, blur?);
    let [turn, place] = ["rotation", "translation"].map(|kind| axes(visual, kind));
    let ((turn, turn_spread), (place, place_spread)) = (turn?, place?);
    if gain.middle <= 0.0 || focal.middle <= 0.0 {
        return Err(NavError::value("gain and focal_scale", "above 0", format!("{}, {}", gain.middle, focal.middle)));
    }
    let columns = number(&visual["size"][0], "visual.size")?;
    if columns < 1.0 {
        return Err(NavError::value("visual.size", "at least 1 px", columns));
    }
    // Of the photographs' pixels to those of the network's picture.
    let pixel = WIDTH as f64 / columns;
    let between = |x: &SharedEstimate, most: f64, scale: f64| {
        [x.middle - 2.0 * x.spread, x.middle + 2.0 * x.spread].map(|x| (scale * x).clamp(0.0, most))
    };
    let wide = LensSpread::wide();
    let spread = LensSpread {
        gain: [gain.middle.ln(), (gain.spread / gain.middle).hypot(noise("gain")?)],
        delay: between(&delay, 0.3, 1.0),
        blur: between(&blur, 10.0, pixel),
        focal: (focal.spread / focal.middle).hypot(noise("focal")?),
        turn: turn_spread.hypot(noise("rotation")?),
        place: place_spread.hypot(noise("translation")?),
        ..wide
    };
    spread.check()?;
    Ok((spread, moved(rig, turn, place, focal.middle)))
}

/// A number that all photographs share, and twice its variance's root.
struct SharedEstimate {
    middle: f64,
    spread: f64,
}

fn shared(visual: &Value, name: &str) -> Result<SharedEstimate, NavError> {
    let all = visual["shared"].as_array().map_or(&[][..], Vec::as_slice);
    let found = all.iter().find(|p| p["name"] == name);
    let found = found.ok_or_else(|| NavError::value("visual.shared", &format!("`{name}`"), "none"))?;
    let of = |value: &Value| number(value, &format!("visual.shared, {name}"));
    let (low, high) = (of(&found["ci95"][0])?, of(&found["ci95"][1])?);
    if low > high {
        return Err(NavError::value(&format!("visual.shared, {name}"), "an interval", format!("{low} to {high}")));
    }
    Ok(SharedEstimate { middle: of(&found["value"])?, spread: SQRT_2 * 0.5 * (high - low) / HALF })
}

/// Values along x, y, z, and the greatest spread of the three.
fn axes(visual: &Value, kind: &str) -> Result<(DVec3, f64), NavError> {
    let [x, y, z] = ["x", "y", "z"].map(|axis| shared(visual, &format!("{kind}_{axis}")));
    let all = [x?, y?, z?];
    let most = all.iter().map(|s| s.spread).fold(0.0, f64::max);
    Ok((DVec3::from(all.map(|s| s.middle)), most))
}

fn number(value: &Value, what: &str) -> Result<f64, NavError> {
    let found = value.as_f64().filter(|x| x.is_finite());
    found.ok_or_else(|| NavError::value(what, "a finite number", value))
}

/// The rig whose camera sits where the diagnosis found it. `turn` and `place` are those of the stated camera in the true one's axes.
fn moved(rig: &Rig, turn: DVec3, place: DVec3, focal: f64) -> Rig {
    let true_from_stated = Pose { position: place, rotation: DQuat::from_scaled_axis(turn) };
    let found = rig.base_from_camera() * true_from_stated.inverse();
    rig.mounted(&found, rig.focal * focal)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use serde_json::json;

    fn report() -> Value {
        let one = |name: &str, value: f64, half: f64| json!({"name": name, "value": value, "ci95": [value - half, value + half], "unit": ""});
        let mut shared = vec![one("gain", 1.2, 0.0588), one("stops", 0.5, 0.1), one("delay", 0.08, 0.0098)];
        shared.extend(
            ["x", "y", "z"].map(|k| one(&format!("translation_{k}"), if k == "z" { 0.03 } else { 0.0 }, 0.0098)),
        );
        shared.extend(["x", "y", "z"].map(|k| one(&format!("rotation_{k}"), if k == "y" { 0.05 } else { 0.0 }, 0.0)));
        shared.extend([one("focal_scale", 1.03, 0.0), one("blur", 2.0, 0.0)]);
        let noise = json!({"rotation": 0.002, "translation": 0.0, "gain": 0.04, "focal": 0.001});
        json!({"visual": {"shared": shared, "noise": noise, "size": [320, 240]}})
    }

    #[test]
    fn a_report_gives_the_camera_and_how_well_it_is_known() {
        let rig = Rig { turn: [0.0; 3], ..Rig::default() };
        let (spread, found) = camera(&report(), &rig).unwrap();
        let is = |x: f64, y: f64| assert!((x - y).abs() < 1e-9, "{x} {y}");
        is(spread.gain[0], 1.2f64.ln());
        is(spread.gain[1], (SQRT_2 * 0.03 / 1.2f64).hypot(0.04));
        is(spread.delay[1] - 0.08, 2.0 * SQRT_2 * 0.005);
        is(spread.blur[0], 0.5);
        is(spread.turn, 0.002);
        is(spread.place, SQRT_2 * 0.005);
        is(found.focal, 615.0 * 1.03);
        // The stated camera lies 3 cm before the true one, so the true one sits further back.
        assert!(found.place[0] < rig.place[0] - 0.029 && found.place[2] == rig.place[2], "{:?}", found.place);
        // Seen from the true one, the stated one is turned about "down" to the right: the true one looks to the left.
        assert!((found.turn[2] - 0.05).abs() < 1e-9 && found.turn[1].abs() < 1e-9, "{:?}", found.turn);
        assert_eq!(moved(&Rig::default(), DVec3::ZERO, DVec3::ZERO, 1.0).place, Rig::default().place);
    }

    #[test]
    fn a_report_that_lacks_a_number_is_named() {
        let rig = Rig::default();
        let said = |report: &Value| camera(report, &rig).unwrap_err().to_string();
        assert!(said(&json!({})).states("--scene"));
        let mut lacking = report();
        lacking["visual"]["shared"].as_array_mut().unwrap().retain(|p| p["name"] != "delay");
        assert!(said(&lacking).contains("delay"));
        let mut odd = report();
        odd["visual"]["noise"]["gain"] = json!("much");
        assert!(said(&odd).contains("visual.noise.gain"));
        let mut wild = report();
        wild["visual"]["shared"][0]["value"] = json!(-1.0);
        assert!(said(&wild).states("above 0"));
        wild["visual"]["size"][0] = json!(0);
        wild["visual"]["shared"][0]["value"] = json!(1.0);
        assert!(said(&wild).contains("size"));
    }
}
