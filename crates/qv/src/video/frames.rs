//! Frames of a video: more than are wanted are taken, and of each few that follow each other the sharpest stays.

use crate::Failure;
use crate::outcome::about;
use crate::progress::spinner;
use crate::rgbd::image_of;
use image::imageops::FilterType;
use rayon::prelude::*;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Frames that are taken for one that stays.
const OF: usize = 4;
/// Longest side of a frame \[px\].
const LONGEST: u32 = 1600;
/// Side to which a frame is brought before its sharpness is reported \[px\]: noise of the sensor is no detail.
const JUDGED_AT: u32 = 480;
/// Shortest video \[s\].
const SHORTEST: f64 = 1.0;

/// Takes at most `count` sharp frames, evenly spread, into `images`, beside which nothing lies that is not ours.
///
/// # Errors
/// ffmpeg is not there or cannot read the video, or the video is too short.
pub fn take(video: &Path, images: &Path, count: usize) -> Result<(), Failure> {
    let (duration, rate) = asked(video)?;
    if duration < SHORTEST {
        return Err(about(video, format!("expected a video of at least {SHORTEST} s, found {duration:.2} s")));
    }
    let candidates = images.with_file_name("candidates");
    for folder in [images, &candidates] {
        fs::create_dir_all(folder).map_err(|e| about(folder, format!("expected a folder, found {e}")))?;
    }
    let sign = spinner("taking frames");
    let each = ((OF * count) as f64 / duration).min(rate);
    let filter =
        format!("fps={each:.6},scale='if(gt(iw,ih),min({LONGEST},iw),-2)':'if(gt(iw,ih),-2,min({LONGEST},ih))'");
    let mut ffmpeg = Command::new("ffmpeg");
    let whole = std::path::absolute(video).map_err(|e| about(video, format!("expected a video, found {e}")))?;
    ffmpeg.args(["-v", "error", "-nostdin", "-y", "-i"]).arg(as_file(&whole)).args(["-vf", &filter, "-q:v", "2"]);
    // In its folder, whose own name may have a `%` or a colon.
    let output = ffmpeg.current_dir(&candidates).arg("%06d.jpg").output().map_err(|e| missing("ffmpeg", &e))?;
    let taken = files_of(&candidates)?;
    if taken.len() < 2 {
        let said = String::from_utf8_lossy(&output.stderr);
        let said = said.lines().last().unwrap_or("no frames");
        return Err(about(video, format!("expected a video that ffmpeg reads, found {said}")));
    }
    sign.set_message("keeping sharp frames");
    let groups: Vec<&[PathBuf]> = grouped(&taken, count);
    let sharpest = groups.par_iter().map(|group| {
        let judged: Vec<(f64, &PathBuf)> =
            group.iter().map(|path| Ok((sharpness(path)?, path))).collect::<Result<_, String>>()?;
        // The first of equals.
        let best = judged.iter().rev().max_by(|a, b| a.0.total_cmp(&b.0));
        best.map(|(_, path)| (*path).clone()).ok_or_else(|| "no frame".to_string())
    });
    let kept: Vec<PathBuf> = sharpest.collect::<Result<_, String>>()?;
    for path in kept {
        let target = images.join(path.file_name().unwrap_or_default());
        fs::rename(&path, &target).map_err(|e| about(&target, format!("expected to write it, found {e}")))?;
    }
    for path in taken.iter().filter(|path| path.exists()) {
        fs::remove_file(path).map_err(|e| about(path, format!("expected to remove it, found {e}")))?;
    }
    fs::remove_dir(&candidates).map_err(|e| about(&candidates, format!("expected to remove it, found {e}")))?;
    sign.finish_and_clear();
    Ok(())
}

/// A path that ffmpeg takes for one: what stands before a colon, as in `2024-05-01T12:30.mp4`, would be a protocol.
fn as_file(path: &Path) -> OsString {
    let mut text = OsString::from("file:");
    text.push(path);
    text
}

/// Duration \[s\] and frames a second of a video.
fn asked(video: &Path) -> Result<(f64, f64), Failure> {
    let mut ffprobe = Command::new("ffprobe");
    ffprobe.args(["-v", "error", "-select_streams", "v:0", "-show_entries", "stream=avg_frame_rate:format=duration"]);
    let output = ffprobe
        .args(["-of", "json"])
        .arg(as_file(video))
        .stdin(Stdio::null())
        .output()
        .map_err(|e| missing("ffprobe", &e))?;
    let said: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
    let duration = said["format"]["duration"].as_str().and_then(|text| text.parse::<f64>().ok());
    let rate = said["streams"][0]["avg_frame_rate"].as_str().and_then(ratio);
    duration.zip(rate).ok_or_else(|| {
        let why = String::from_utf8_lossy(&output.stderr);
        about(video, format!("expected a video with a duration, found {}", why.lines().last().unwrap_or("none")))
    })
}

/// A number like `30000/1001`.
fn ratio(text: &str) -> Option<f64> {
    let (over, under) = text.split_once('/')?;
    let value = over.parse::<f64>().ok()? / under.parse::<f64>().ok()?;
    (value.is_finite() && value > 0.0).then_some(value)
}

fn missing(program: &str, error: &std::io::Error) -> Failure {
    format!(
        "{program}: expected it among the programs, found {error}; install ffmpeg, or give a folder with images and \
         a COLMAP model or transforms.json"
    )
    .into()
}

fn files_of(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let entries = fs::read_dir(folder).map_err(|e| about(folder, format!("expected a folder, found {e}")))?;
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    files.sort();
    Ok(files)
}

/// Frames in at most `count` groups of neighbours.
fn grouped<T>(taken: &[T], count: usize) -> Vec<&[T]> {
    let groups = count.clamp(1, taken.len());
    (0..groups).map(|k| &taken[k * taken.len() / groups..(k + 1) * taken.len() / groups]).collect()
}

/// Variance of the Laplacian of the brightness (Pech-Pacheco et al., *Diatom autofocusing in brightfield microscopy*, 2000): motion and lenses out
/// of focus take detail away.
fn sharpness(path: &Path) -> Result<f64, String> {
    let grey = image_of(path).map_err(|found| format!("{}: expected an image, found {found}", path.display()))?;
    let grey = grey.resize(JUDGED_AT, JUDGED_AT, FilterType::Triangle).into_luma8();
    Ok(detail(&grey))
}

fn detail(grey: &image::GrayImage) -> f64 {
    let (width, height) = grey.dimensions();
    let at = |x: u32, y: u32| f64::from(grey.get_pixel(x, y).0[0]);
    let inner = (1..height.saturating_sub(1)).flat_map(|y| (1..width.saturating_sub(1)).map(move |x| (x, y)));
    let values: Vec<f64> =
        inner.map(|(x, y)| at(x - 1, y) + at(x + 1, y) + at(x, y - 1) + at(x, y + 1) - 4.0 * at(x, y)).collect();
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_hold_every_frame_once() {
        let taken: Vec<usize> = (0..23).collect();
        let groups = grouped(&taken, 5);
        assert_eq!(groups.len(), 5);
        assert_eq!(groups.concat(), taken);
        assert_eq!(grouped(&taken[..3], 10).len(), 3);
    }

    #[test]
    fn a_blurred_frame_has_less_detail() {
        let sharp =
            image::GrayImage::from_fn(64, 48, |x, y| image::Luma([if (x / 4 + y / 4) % 2 == 0 { 40 } else { 200 }]));
        let blurred = image::imageops::blur(&sharp, 1.5);
        assert!(detail(&blurred) < 0.2 * detail(&sharp));
        assert_eq!(detail(&image::GrayImage::new(2, 2)), 0.0);
    }

    #[test]
    fn rates_are_ratios() {
        assert_eq!(ratio("30/1"), Some(30.0));
        assert_eq!((ratio("0/0"), ratio("x"), ratio("30")), (None, None, None));
    }
}
