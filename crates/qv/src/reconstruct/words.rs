//! Scores as they are reported.

use crate::colmap::PoseChoice;
use qv_splat::train::transients::Mask;
use qv_splat::train::{Ground, GroundScore, Score};
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

/// The mean of scores for metrics.json; null without any.
pub fn named_mean(scores: &[Score]) -> Option<Value> {
    Score::mean(scores).map(|mean| named("mean", &mean))
}

/// What was left out of photographs because it moves, for metrics.json; null where it was not looked for.
pub fn of_masks(masks: &[Mask]) -> Value {
    let shares: Vec<f64> = masks.iter().map(Mask::share).collect();
    let count = shares.iter().filter(|share| **share > 0.0).count();
    let mean = shares.iter().sum::<f64>() / shares.len().max(1) as f64;
    if masks.is_empty() { Value::Null } else { json!({"photographs": count, "share": mean}) }
}

/// The same in words; nothing where it is null.
pub fn masks_in_words(transients: &Value) -> Option<String> {
    let (count, share) = (transients["photographs"].as_u64()?, transients["share"].as_f64()?);
    Some(format!("what moves: {:.1} % of all pixels were left out, in {count} images (masks)", 100.0 * share))
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
