//! Scores as they are told.

use qv_splat::train::Score;
use serde_json::{Value, json};

/// Scores in words; where a half is masked in all photographs, or nothing is left of the other to fit to, it has none.
pub fn in_words(s: &Score) -> String {
    let halves = [
        ("right halves", s.psnr_right),
        ("with the exposure of the left", s.psnr_right_fitted),
        ("with its gains", s.psnr_right_gains),
    ];
    let told =
        halves.iter().filter(|(_, score)| score.is_finite()).map(|(what, score)| format!("{what} {score:.2} dB"));
    let told = told.collect::<Vec<_>>().join(", ");
    let told = if told.is_empty() { "right halves are masked".into() } else { told };
    format!("PSNR {:.2} dB, SSIM {:.4}; {told}", s.psnr, s.ssim)
}

/// Scores for metrics.json; those that are no numbers become null.
pub fn named(name: &str, s: &Score) -> Value {
    json!({"name": name, "psnr": s.psnr, "ssim": s.ssim, "psnr_right": s.psnr_right, "ssim_right": s.ssim_right,
        "psnr_right_fitted": s.psnr_right_fitted, "ssim_right_fitted": s.ssim_right_fitted,
        "psnr_right_gains": s.psnr_right_gains})
}
