//! Depth of the photographs themselves, where none was measured.

use super::arguments::Reconstruct;
use super::watch::TRAINING;
use crate::progress::{Stages, remark};
use qv_splat::files::Points;
use qv_splat::stereo::{StereoDepth, StereoOptions, measure};
use qv_splat::train::Dataset;
use serde_json::{Value, json};

/// Weight of that depth unless another one is asked for.
pub(super) const WEIGHT: f32 = 0.1;
/// Share of the Gaussians that a step leaves out at the end of the run where that depth is there: without it dropout does not help.
pub(super) const DROP: f32 = 0.3;

/// Where depth comes from.
pub(super) struct Depths {
    /// Photographs to learn from whose depth the capture has.
    pub given: usize,
    /// What stereo measured of the others.
    pub measured: Option<StereoDepth>,
}

impl Reconstruct {
    /// Share of the work that lies behind when training begins.
    pub(super) fn training_from(&self) -> f64 {
        if self.no_stereo {
            return TRAINING[0];
        }
        // On the card training takes less time than depths do, on the processor far more.
        #[cfg(feature = "gpu")]
        if self.gpu {
            return 0.6;
        }
        0.2
    }

    /// Measures depth of the photographs that have none. Where that cannot be done training goes on without, and why is reported.
    pub(super) fn add_depths(&self, dataset: &mut Dataset, points: Option<&Points>, bar: &Stages) -> Depths {
        let count = dataset.training.len();
        let given = dataset.training.iter().filter(|one| one.depth.iter().any(|z| *z > 0.0)).count();
        if self.no_stereo {
            return Depths { given, measured: None };
        }
        let from = TRAINING[0];
        bar.begin(2, 4, "depth from images", Some(from));
        if given == count {
            let use_of = if self.depth_prior.is_some() { "" } else { "; --depth-prior WEIGHT learns from it" };
            remark(&format!("the capture has the depth of all {count} images: none is measured from them{use_of}"));
            return Depths { given, measured: None };
        }
        let done = |count: usize, of: usize| {
            let share = count as f64 / of as f64;
            bar.at(from + share * (self.training_from() - from), &format!("image {count} of {of}"));
        };
        let measured = measure(dataset, points, &StereoOptions::default(), &done);
        if let Err(error) = &measured {
            remark(&format!("no depth is measured from the images: {error}"));
        }
        Depths { given, measured: measured.ok().filter(|measured| measured.share > 0.0) }
    }
}

/// For metrics.json.
pub(super) fn named(depths: &Depths) -> Value {
    let given = depths.given;
    depths.measured.as_ref().map_or(json!({"given": given}), |m| {
        json!({"given": given, "photographs": m.photographs, "share": m.share, "planes": m.planes, "step_of_depth": m.step})
    })
}

/// In words; nothing where none was measured.
pub(super) fn in_words(stereo: &Value) -> Option<String> {
    let (count, share) = (stereo["photographs"].as_u64()?, stereo["share"].as_f64()?);
    let given = stereo["given"].as_u64().filter(|given| *given > 0);
    let given = given.map_or(String::new(), |given| format!("; {given} have the capture's"));
    Some(format!("depth from images: {:.0} % of the pixels of {count}{given}", 100.0 * share))
}
