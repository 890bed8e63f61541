//! The camera in the diagnosis: what it sees against what a splat of the place shows at the measured pose.
//!
//! Stage one aligns each photograph with the scene and gets what it is off by (`align`); stage two asks which effect of the
//! camera all photographs share (`model`, `judge`), and tells how far photographs and scene agree in
//! photographs that the fit has not seen. What is accused is decided from that by `qv_gap::decision`. See `docs/visual.md`.

/// Types of these stand in the interface of this crate.
pub use {glam, qv_core};

pub mod align;
mod calibrated;
mod error;
#[cfg(test)]
#[path = "../../../fixtures/facts.rs"]
mod facts;
pub mod html;
mod judge;
pub mod model;
pub mod path;
pub mod picture;
mod sight;

pub use calibrated::to_toml;
pub use error::CameraError;
pub use judge::{CameraEffect, EFFECTS};
pub use sight::{Look, Looks};

use align::{Aligned, Offsets, Target};
use model::{Sighting, Together};
use path::Path;
use qv_core::statistics::median;
use qv_core::{Camera, GaussianCloud, JointSeries, Pose};
use qv_gap::decision::Policy;
use qv_raster::RasterError;
use rayon::prelude::*;

/// Fewest photographs that anything is said of.
pub const FEWEST: usize = 6;
/// Share of the pixels that must show the scene, in all photographs and in one that counts.
const IN_VIEW: f64 = 0.15;
const ENOUGH: f64 = 0.3;

/// A pinhole camera's inner numbers, OpenCV's axes, pixel centres at one half.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// Focal length along x \[px\].
    pub fx: f64,
    /// Focal length along y \[px\].
    pub fy: f64,
    /// Principal point, x \[px\].
    pub cx: f64,
    /// Principal point, y \[px\].
    pub cy: f64,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// A camera on a robot as it is said to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rig {
    /// The camera.
    pub intrinsics: Intrinsics,
    /// Where it is mounted; camera axes x right, y down, z forward.
    pub base_from_camera: Pose,
    /// A photograph with the stamp t was taken at t - delay on the clock of the poses \[s\]; neutral is 0.
    pub delay: f64,
    /// Displayed values are those of the scene times this; neutral is 1.
    pub gain: f64,
    /// Deviation of a blur \[px of the photograph\]; neutral is 0.
    pub blur: f64,
}

impl Rig {
    /// The camera at a pose.
    pub fn camera(&self, camera_from_world: Pose) -> Camera {
        let Intrinsics { fx, fy, cx, cy, width, height } = self.intrinsics;
        Camera { fx, fy, cx, cy, width, height, camera_from_world }
    }

    fn check(&self) -> Result<(), CameraError> {
        let off =
            |e: qv_core::CoreError| CameraError::new("camera", "intrinsics and mounting of a camera", e.to_string());
        self.camera(self.base_from_camera).check().map_err(off)?;
        let numbers =
            [("delay", self.delay, -1.0..=1.0), ("gain", self.gain, 0.05..=20.0), ("blur", self.blur, 0.0..=50.0)];
        match numbers.iter().find(|(_, value, range)| !range.contains(value)) {
            Some((name, value, range)) => Err(CameraError::new(
                format!("camera {name}"),
                format!("{} to {}", range.start(), range.end()),
                value.to_string(),
            )),
            None => Ok(()),
        }
    }
}

/// A photograph without distortion.
#[derive(Debug, Clone, PartialEq)]
pub struct Photograph {
    /// Stamp \[s, on the clock of the poses\].
    pub time: f64,
    /// Red, green, blue as displayed and 255, or 0 where there is no photograph; row by row from the top.
    pub rgba: Vec<[u8; 4]>,
}

/// What is compared.
#[derive(Clone, Copy)]
pub struct Footage<'a> {
    /// The place, in the frame of the poses.
    pub cloud: &'a GaussianCloud,
    /// Colour that it was made to be drawn over, 0 to 1.
    pub background: [f32; 3],
    /// The camera.
    pub rig: Rig,
    /// Measured `world_from_base` as x, y, z \[m\], w, x, y, z.
    pub poses: Option<&'a JointSeries>,
    /// Photographs in the order of their stamps.
    pub photographs: &'a [Photograph],
}

/// How to look.
#[derive(Clone)]
pub struct LookOptions<'a> {
    /// Columns of the finest picture that is compared.
    pub width: usize,
    /// Most photographs, evenly spread.
    pub most: usize,
    /// Effects that may not be accused.
    pub without: Vec<String>,
    /// The numbers that decide.
    pub policy: Policy,
    /// Seed of the bootstrap.
    pub seed: u64,
    /// Told of photographs done and all.
    pub progress: Option<&'a (dyn Fn(usize, usize) + Sync)>,
}

impl Default for LookOptions<'_> {
    fn default() -> Self {
        Self { width: 160, most: 40, without: Vec::new(), policy: Policy::default(), seed: 1, progress: None }
    }
}

/// Compares photographs with the scene, and measures what may be wrong with the camera.
///
/// # Errors
/// Too few photographs or poses, an image whose size is not that of the intrinsics, a scene that is nowhere in view.
pub fn look(footage: &Footage, options: &LookOptions) -> Result<Look, CameraError> {
    footage.rig.check()?;
    let path = Path::new(footage.poses)?;
    let chosen = chosen(footage, &path, options.most)?;
    let seen = see(footage, &path, &chosen, options)?;
    judge::judge(footage, &path, &seen, options)
}

/// Whether there is something to compare, before time is spent on it.
///
/// # Errors
/// As [`look`], but a scene out of view is found in three photographs only.
pub fn check(footage: &Footage, options: &LookOptions) -> Result<(), CameraError> {
    footage.rig.check()?;
    let path = Path::new(footage.poses)?;
    let chosen = chosen(footage, &path, options.most)?;
    let rig = &footage.rig;
    let mut most = 0.0f64;
    for k in [1, 3, 5] {
        let photograph = chosen[k * chosen.len() / 6];
        let camera = rig.camera((path.at(photograph.time - rig.delay) * rig.base_from_camera).inverse());
        let target = Target::new(&photograph.rgba, &rig.intrinsics, camera, options.width).over(footage.background);
        most = most.max(align::disagreement(footage.cloud, &target, &stated(rig, options.width), 0)?.seen);
    }
    if most < IN_VIEW { Err(out_of_view(most)) } else { Ok(()) }
}

fn out_of_view(share: f64) -> CameraError {
    let expected = "a scene that the camera sees from the measured poses (same frame, metres, camera axes x right, y down, z forward)";
    CameraError::new("scene", expected, format!("{:.0} % of the pixels in view", 100.0 * share))
}

/// A photograph with what came of its alignment.
struct LinearisedWindow {
    target: Target,
    /// As stated.
    before: align::Disagreement,
    /// At its own best.
    aligned: Aligned,
    sighting: Sighting,
}

/// Photographs within the path, evenly spread.
fn chosen<'a>(footage: &Footage<'a>, path: &Path, most: usize) -> Result<Vec<&'a Photograph>, CameraError> {
    let Intrinsics { width, height, .. } = footage.rig.intrinsics;
    let [first, last] = path.span();
    let pixels = width as usize * height as usize;
    if let Some(odd) = footage.photographs.iter().find(|p| p.rgba.len() != pixels) {
        let found = format!("{} pixels at {:.3} s", odd.rgba.len(), odd.time);
        return Err(CameraError::new("image size", format!("{width} x {height} pixels as the camera says"), found));
    }
    let within: Vec<&Photograph> =
        footage.photographs.iter().filter(|p| p.time >= first && p.time <= last && p.time.is_finite()).collect();
    if within.len() < FEWEST {
        let found = format!("{} of {} images", within.len(), footage.photographs.len());
        let expected = format!("at least {FEWEST} images between {first:.3} and {last:.3} s, while there are poses");
        return Err(CameraError::new("images", expected, found));
    }
    let count = within.len().min(most.max(FEWEST));
    Ok((0..count).map(|k| within[(2 * k + 1) * within.len() / (2 * count)]).collect())
}

/// Aligns all photographs: coarsely from where they should be, then finely from what they say together.
fn see(
    footage: &Footage,
    path: &Path,
    chosen: &[&Photograph],
    options: &LookOptions,
) -> Result<Vec<LinearisedWindow>, CameraError> {
    let rig = &footage.rig;
    let stated = stated(rig, options.width);
    let count = std::sync::atomic::AtomicUsize::new(0);
    let told = || {
        let done = count.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
        if let Some(progress) = options.progress {
            progress(done, 2 * chosen.len());
        }
    };
    let nominal = |time: f64| (path.at(time - rig.delay) * rig.base_from_camera).inverse();
    let coarse = chosen.par_iter().map(|photograph| {
        let camera = rig.camera(nominal(photograph.time));
        let target = Target::new(&photograph.rgba, &rig.intrinsics, camera, options.width).over(footage.background);
        let before = align::disagreement(footage.cloud, &target, &stated, target.levels() - 1)?;
        let middle = target.levels() - 1;
        let aligned = align::align(footage.cloud, &target, stated, 0..middle)?;
        told();
        Ok((photograph.time, target, before, aligned))
    });
    let mut coarse: Vec<(f64, Target, align::Disagreement, Aligned)> = coarse.collect::<Result<_, CameraError>>()?;
    let mut shares: Vec<f64> = coarse.iter().map(|c| c.2.seen).collect();
    let typical = median(&mut shares);
    if typical < IN_VIEW {
        return Err(out_of_view(typical));
    }
    coarse.retain(|c| c.2.seen >= ENOUGH);
    let sightings: Vec<Sighting> = coarse.iter().filter_map(|c| sighting(c.0, &c.3, &stated)).collect();
    let together = Together::new(path, rig.base_from_camera, rig.delay, &sightings);
    let everything: Vec<usize> = (0..model::SHARED).collect();
    let common = together.as_ref().and_then(|t| Some((t, t.fit(&everything, &[[0.0; model::SHARED]], |_| true)?)));
    let seen = coarse.into_par_iter().map(|(time, target, before, aligned)| {
        let middle = target.levels() - 2;
        let mut starts = vec![aligned.offsets, stated];
        if let Some((together, fit)) = &common {
            starts.push(plus(&together.foretold(&fit.shared, time), &stated));
        }
        let mut best: Option<(f64, Offsets)> = None;
        for start in starts {
            let loss = align::disagreement(footage.cloud, &target, &start, middle)?.loss;
            if best.is_none_or(|b| loss < b.0) {
                best = Some((loss, start));
            }
        }
        let start = best.map_or(stated, |b| b.1);
        let aligned = align::align(footage.cloud, &target, start, middle..target.levels())?;
        told();
        Ok(sighting(time, &aligned, &stated).map(|sighting| LinearisedWindow { target, before, aligned, sighting }))
    });
    let seen: Vec<Option<LinearisedWindow>> = seen.collect::<Result<_, CameraError>>()?;
    let seen: Vec<LinearisedWindow> = seen.into_iter().flatten().collect();
    if seen.len() < FEWEST {
        let expected =
            format!("at least {FEWEST} images in which the scene fills {:.0} % of the pixels", 100.0 * ENOUGH);
        return Err(CameraError::new("images", expected, seen.len().to_string()));
    }
    Ok(seen)
}

/// What a photograph is off by beyond what is stated of the camera.
fn sighting(time: f64, aligned: &Aligned, stated: &Offsets) -> Option<Sighting> {
    let offsets = Offsets {
        gain: aligned.offsets.gain - stated.gain,
        blur: aligned.offsets.blur - stated.blur,
        ..aligned.offsets
    };
    Sighting::new(time, offsets, &aligned.information)
}

/// What is stated of the camera as offsets of a photograph.
fn stated(rig: &Rig, width: usize) -> Offsets {
    let scale = width.min(rig.intrinsics.width as usize) as f64 / f64::from(rig.intrinsics.width);
    Offsets { gain: rig.gain.ln(), blur: (rig.blur * scale).powi(2), ..Offsets::NONE }
}

/// Offsets with those that are stated.
fn plus(offsets: &Offsets, stated: &Offsets) -> Offsets {
    Offsets { gain: offsets.gain + stated.gain, blur: offsets.blur + stated.blur, ..*offsets }
}

fn raster_error(error: RasterError) -> CameraError {
    CameraError::new("scene", "Gaussians that can be drawn", error.to_string())
}
