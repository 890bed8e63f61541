//! Scores as they are reported.

use crate::colmap::PoseChoice;
use qv_splat::SplatError;
use qv_splat::train::{Dataset, Ground, GroundScore, Model, Score, shutter};
use serde_json::{Value, json};

/// Whose poses were taken, and why, for metrics.json.
pub fn of_poses(chosen: &PoseChoice) -> Value {
    let taken = if chosen.is_given() { "capture" } else { "colmap" };
    json!({"taken": taken, "why": chosen.why, "given_explain": chosen.explain[0], "colmap_explain": chosen.explain[1]})
}

/// The same in words: a line.
pub fn poses_in_words(poses: &Value) -> String {
    let whose = if poses["taken"] == "colmap" { "by COLMAP" } else { "of the capture" };
    poses["why"].as_str().map_or(String::new(), |why| format!("poses {whose}: {why}\n"))
}

/// Scores in words; where a half is masked in all photographs, or nothing is left of the other to fit to, it has none.
pub fn in_words(s: &Score) -> String {
    let halves = [
        ("right halves", s.psnr_right),
        ("with the exposure of the left", s.psnr_right_fitted),
        ("with its gains", s.psnr_right_gains),
    ];
    let remarks =
        halves.iter().filter(|(_, score)| score.is_finite()).map(|(what, score)| format!("{what} {score:.2} dB"));
    let remarks = remarks.collect::<Vec<_>>().join(", ");
    let remarks = if remarks.is_empty() { "right halves are masked".into() } else { remarks };
    format!("PSNR {:.2} dB, SSIM {:.4}; {remarks}", s.psnr, s.ssim)
}

/// Scores for metrics.json; those that are no numbers become null.
pub fn named(name: &str, s: &Score) -> Value {
    json!({"name": name, "psnr": s.psnr, "ssim": s.ssim, "psnr_right": s.psnr_right, "ssim_right": s.ssim_right,
        "psnr_right_fitted": s.psnr_right_fitted, "ssim_right_fitted": s.ssim_right_fitted,
        "psnr_right_gains": s.psnr_right_gains})
}

/// How often photographs were learned from, for metrics.json: the weight of ground, and the smallest and largest of what each photograph has by
/// it; null where all are alike.
pub fn of_views(ground: f64, weights: &[f32]) -> Value {
    let most = weights.iter().fold(0.0f32, |most, weight| most.max(*weight));
    let least = weights.iter().fold(f32::INFINITY, |least, weight| least.min(*weight));
    if ground > 0.0 { json!({"weight": ground, "least": least, "most": most}) } else { Value::Null }
}

/// How photographs were exposed and cameras moved, for metrics.json: null where cameras are taken to be at rest. Lengths are of the way from the
/// beginning of a photograph to its end: of what it shows in it, of the camera, and of its turn.
pub fn of_shutter(model: &Model, dataset: &Dataset) -> Result<Value, SplatError> {
    let Some(how) = &dataset.shutter else { return Ok(Value::Null) };
    let mut pixels = vec![];
    for (k, motion) in model.motions.iter().enumerate() {
        pixels.extend(shutter::length(&model.cloud, &model.camera(dataset, k), motion, dataset)?);
    }
    let mean = |all: &mut dyn Iterator<Item = f64>| all.sum::<f64>() / model.motions.len().max(1) as f64;
    let norm = |m: &[f32]| m.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt();
    let metres = mean(&mut model.motions.iter().map(|m| norm(&m[..3])));
    let radians = mean(&mut model.motions.iter().map(|m| norm(&m[3..])));
    let of_pixels = (!pixels.is_empty()).then(|| pixels.iter().sum::<f64>() / pixels.len() as f64);
    Ok(json!({"samples": how.samples, "readout": how.readout, "gamma": how.gamma, "motion_px": of_pixels,
        "motion_m": metres, "motion_deg": radians.to_degrees()}))
}

/// The ground and its scores for metrics.json: null where none was found or no held-out photograph shows it.
pub fn of_ground(ground: Option<&Ground>, scores: &[GroundScore]) -> Value {
    let (Some(ground), Some(mean)) = (ground, GroundScore::mean(scores)) else { return Value::Null };
    json!({"normal": ground.normal.to_array(), "height": ground.height, "within": ground.within,
        "photographs": scores.len(), "share": mean.share, "psnr": mean.psnr, "ssim": mean.ssim})
}

/// The same in words; nothing where it is null.
pub fn ground_in_words(ground: &Value) -> Option<String> {
    let [share, psnr, ssim] = ["share", "psnr", "ssim"].map(|key| ground[key].as_f64());
    Some(format!("ground alone, {:.0} % of pixels: PSNR {:.2} dB, SSIM {:.4}", 100.0 * share?, psnr?, ssim?))
}
