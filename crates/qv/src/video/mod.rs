//! A video becomes a COLMAP project: ffmpeg takes frames, the sharp ones stay, COLMAP finds from where they were taken.

mod frames;

use crate::outcome::about;
use crate::output::{self, write_whole};
use crate::{Failure, colmap};
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::{Path, PathBuf};

/// Endings of what is taken for a video.
const ENDINGS: [&str; 6] = ["mp4", "mov", "mkv", "avi", "webm", "m4v"];
/// Fewest frames with a pose that a scene is learned from.
const FEWEST: usize = 8;
/// File that says what a project was made of.
const STAMP: &str = "video.json";

/// Whether a path is a video by its ending.
pub fn is_video(path: &Path) -> bool {
    let ending = path.extension().and_then(|e| e.to_str()).map(str::to_lowercase);
    ending.is_some_and(|ending| ENDINGS.contains(&ending.as_str()))
}

/// An error about a file that is no capture: it may be a video of an ending that is not known.
pub fn or_video(path: &Path, error: Failure) -> Failure {
    if !path.is_file() || path.extension().is_some_and(|ending| ending == "json") {
        return error;
    }
    format!("{error}; videos end in .{}", ENDINGS.join(", .")).into()
}

/// What a project was made of, so that it is not made twice.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Stamp {
    video: PathBuf,
    bytes: u64,
    modified: u64,
    frames: usize,
}

/// A project that is good enough, and what of the video was lost.
#[derive(Serialize, Deserialize)]
struct VideoProject {
    of: Stamp,
    lost: Vec<String>,
}

impl Stamp {
    fn of(video: &Path, frames: usize) -> Result<Self, Failure> {
        let expected = |found: String| about(video, format!("expected a video, found {found}"));
        let file = fs::metadata(video).map_err(|e| expected(e.to_string()))?;
        if !file.is_file() {
            return Err(expected("a folder".into()));
        }
        let since = |time: std::time::SystemTime| time.duration_since(std::time::UNIX_EPOCH).map_or(0, |d| d.as_secs());
        let path = std::path::absolute(video).map_err(|e| expected(e.to_string()))?;
        Ok(Self { video: path, bytes: file.len(), modified: file.modified().map_or(0, since), frames })
    }
}

/// A project of a video with at most so many frames in `folder`, and what of it was lost; the one that is there already if it was made of the same.
///
/// # Errors
/// ffmpeg or Python are not there, the video cannot be read or is too short, or too few frames find a place.
pub fn project(video: &Path, folder: &Path, frames: usize) -> Result<Vec<String>, Failure> {
    let stamp = Stamp::of(video, frames)?;
    let stamp_file = folder.join(STAMP);
    let found = fs::read_to_string(&stamp_file).ok().and_then(|text| serde_json::from_str::<VideoProject>(&text).ok());
    if let Some(made) = found.filter(|made| made.of == stamp && folder.join("sparse/0/images.bin").is_file()) {
        return Ok(made.lost);
    }
    // Frames of another video would be matched with these, and its project would pass for this one's if this one fails.
    output::claim(folder, true)?;
    let images = folder.join("images");
    frames::take(video, &images, frames)?;
    let placed = colmap::find(&images, folder, None)?;
    if placed.placed < FEWEST.min(placed.frames) {
        let expected = format!("expected at least {FEWEST} frames that overlap their neighbours");
        let found = format!("{} of {} with a place; move slower, or sideways as well", placed.placed, placed.frames);
        return Err(about(video, format!("{expected}, found {found}")));
    }
    let (left, mut lost) = (placed.frames - placed.placed, vec![]);
    if left > 0 {
        lost.push(format!("{}: {left} of {} frames have no place", video.display(), placed.frames));
    }
    lost.extend(placed.doubt(video));
    let text = serde_json::to_string(&VideoProject { of: stamp, lost: lost.clone() })?;
    write_whole(&stamp_file, text.as_bytes())?;
    output::commit().and_then(|()| output::keep_what_is_claimed()).map_err(|e| about(folder, e))?;
    Ok(lost)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn videos_are_known_by_their_ending() {
        assert!(is_video(Path::new("a/walk.MP4")) && is_video(Path::new("x.webm")));
        assert!(!is_video(Path::new("transforms.json")) && !is_video(Path::new("mp4")));
    }

    #[test]
    fn what_is_no_video_is_named() {
        let folder = std::env::temp_dir().join(format!("qv-video-{}", std::process::id()));
        let missing = project(&folder.join("none.mp4"), &folder.join("out"), 10).unwrap_err().to_string();
        assert!(missing.contains("none.mp4") && missing.states("video"), "{missing}");
        fs::create_dir_all(folder.join("dir.mp4")).unwrap();
        assert!(project(&folder.join("dir.mp4"), &folder.join("out"), 10).unwrap_err().to_string().states("folder"));
        fs::write(folder.join("text.mp4"), "no video at all").unwrap();
        let text = project(&folder.join("text.mp4"), &folder.join("out"), 10).unwrap_err().to_string();
        // Without ffmpeg that is what is said.
        assert!(text.contains("text.mp4") || text.contains("ffprobe"), "{text}");
        fs::write(folder.join("walk.xyz"), "no video at all").unwrap();
        let remarks = |name: &str| or_video(&folder.join(name), "no JSON".to_string().into()).to_string();
        assert!(remarks("walk.xyz").states("JSON .mp4 .mov"));
        assert_eq!(remarks("transforms.json"), "no JSON");
        fs::remove_dir_all(&folder).unwrap();
    }
}
