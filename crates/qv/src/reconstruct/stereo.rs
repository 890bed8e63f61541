//! Depth of the photographs themselves, where none was measured.

use super::arguments::Reconstruct;
use super::watch::TRAINING;
use crate::Failure;
use crate::outcome::about;
use crate::progress::Stages;
use qv_splat::files::Points;
use qv_splat::stereo::{StereoDepth, StereoOptions, measure};
use qv_splat::train::Dataset;
use serde_json::{Value, json};

/// Weight of that depth unless another one is asked for.
pub(super) const USUAL_WEIGHT: f32 = 0.1;

impl Reconstruct {
    /// Weight of measured depth, which with `--stereo` is not 0 unless that is asked for.
    pub(super) fn depth_weight(&self) -> f32 {
        self.depth_prior.unwrap_or(if self.stereo { USUAL_WEIGHT } else { 0.0 })
    }

    /// Share of the work that lies behind when training begins.
    pub(super) fn training_from(&self) -> f64 {
        if !self.stereo {
            return TRAINING[0];
        }
        // On the card training takes less time than depths do, on the processor far more.
        #[cfg(feature = "gpu")]
        if self.gpu {
            return 0.6;
        }
        0.2
    }

    /// Measures depth where it is asked for, and shows what came of it; none where it is not.
    pub(super) fn add_depths(
        &self,
        dataset: &mut Dataset,
        points: Option<&Points>,
        bar: &Stages,
    ) -> Result<Option<StereoDepth>, Failure> {
        if !self.stereo {
            return Ok(None);
        }
        let from = TRAINING[0];
        bar.begin(2, 4, "depth from photographs", Some(from));
        let mut options = StereoOptions::default();
        if let Some(side) = self.stereo_side {
            options.side = side;
        }
        let done = |count: usize, of: usize| {
            let share = count as f64 / of as f64;
            bar.at(from + share * (self.training_from() - from), &format!("photograph {count} of {of}"));
        };
        let measured = measure(dataset, points, &options, &done);
        Ok(Some(measured.map_err(|e| about(&self.capture, e))?))
    }
}

/// For metrics.json.
pub(super) fn named(measured: Option<&StereoDepth>) -> Value {
    measured.map_or(
        Value::Null,
        |m| json!({"photographs": m.photographs, "share": m.share, "planes": m.planes, "step_of_depth": m.step}),
    )
}

/// In words; nothing where it was not asked for.
pub(super) fn in_words(stereo: &Value) -> Option<String> {
    let (count, share) = (stereo["photographs"].as_u64()?, stereo["share"].as_f64()?);
    Some(format!("depth from photographs: {:.0} % of the pixels of {count}", 100.0 * share))
}
