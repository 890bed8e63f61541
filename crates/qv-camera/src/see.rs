//! Photographs aligned with the scene, one by one.

use crate::CameraError;
use crate::align::{self, Alignment, Offsets, Target};
use crate::footage::{Footage, Intrinsics, Photograph, Rig};
use crate::model::{self, Sighting, Together};
use crate::path::Path;
use qv_core::statistics::median;
use qv_gap::decision::Policy;
use rayon::prelude::*;

/// Fewest photographs that anything is said of.
pub const FEWEST: usize = 6;

/// Share of the pixels that must show the scene, in all photographs and in one that counts.
pub(crate) const IN_VIEW: f64 = 0.15;

const ENOUGH: f64 = 0.3;

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
    /// Reported of photographs done and all.
    pub progress: Option<&'a (dyn Fn(usize, usize) + Sync)>,
}

impl Default for LookOptions<'_> {
    fn default() -> Self {
        Self { width: 160, most: 40, without: Vec::new(), policy: Policy::default(), seed: 1, progress: None }
    }
}

pub(crate) fn out_of_view(share: f64) -> CameraError {
    let expected = "a scene that the camera sees from the measured poses (same frame, metres, camera axes x right, y down, z forward)";
    CameraError::new("scene", expected, format!("{:.0} % of the pixels in view", 100.0 * share))
}

/// A photograph with what came of its alignment.
pub(crate) struct LinearisedWindow {
    pub target: Target,
    /// As stated.
    pub before: align::Disagreement,
    /// At its own best.
    pub aligned: Alignment,
    pub sighting: Sighting,
}

/// Photographs within the path, evenly spread.
pub(crate) fn chosen<'a>(footage: &Footage<'a>, path: &Path, most: usize) -> Result<Vec<&'a Photograph>, CameraError> {
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
pub(crate) fn see(
    footage: &Footage,
    path: &Path,
    chosen: &[&Photograph],
    options: &LookOptions,
) -> Result<Vec<LinearisedWindow>, CameraError> {
    let rig = &footage.rig;
    let stated = stated(rig, options.width);
    let count = std::sync::atomic::AtomicUsize::new(0);
    let remarks = || {
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
        remarks();
        Ok((photograph.time, target, before, aligned))
    });
    let mut coarse: Vec<(f64, Target, align::Disagreement, Alignment)> = coarse.collect::<Result<_, CameraError>>()?;
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
            starts.push(plus(&together.predicted(&fit.shared, time), &stated));
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
        remarks();
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
fn sighting(time: f64, aligned: &Alignment, stated: &Offsets) -> Option<Sighting> {
    let offsets = Offsets {
        gain: aligned.offsets.gain - stated.gain,
        blur: aligned.offsets.blur - stated.blur,
        ..aligned.offsets
    };
    Sighting::new(time, offsets, &aligned.information)
}

/// What is stated of the camera as offsets of a photograph.
pub(crate) fn stated(rig: &Rig, width: usize) -> Offsets {
    let scale = width.min(rig.intrinsics.width as usize) as f64 / f64::from(rig.intrinsics.width);
    Offsets { gain: rig.gain.ln(), blur: (rig.blur * scale).powi(2), ..Offsets::NONE }
}

/// Offsets with those that are stated.
pub(crate) fn plus(offsets: &Offsets, stated: &Offsets) -> Offsets {
    Offsets { gain: offsets.gain + stated.gain, blur: offsets.blur + stated.blur, ..*offsets }
}
