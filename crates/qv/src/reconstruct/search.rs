//! How many steps help, found before training on all photographs.

use super::watch::Run;
use super::{REPORT_EVERY, Reconstruct};
use crate::Failure;
use qv_core::GaussianCloud;
use qv_splat::train::aside::{Search, judged, put_aside};
use qv_splat::train::{Dataset, Model, TrainOptions, train};

/// What the search found.
pub(super) struct Searched {
    /// What was seen after which numbers of steps.
    pub search: Search,
    /// Photographs that were put aside.
    pub photographs: usize,
    /// The scene so far, when somebody stopped it.
    pub stopped_with: Option<GaussianCloud>,
}

impl Reconstruct {
    /// Finds how many steps help; none where that is not asked for: no more steps than usual, or a given end.
    pub(super) fn search(
        &self,
        dataset: &Dataset,
        options: &TrainOptions,
        cloud: &GaussianCloud,
        run: &mut Run,
    ) -> Result<Option<Searched>, Failure> {
        let usual = TrainOptions::default().iterations;
        if options.iterations <= usual || self.resume || self.max_seconds.is_some() {
            return Ok(None);
        }
        let Some(inner) = put_aside(dataset, self.aside) else { return Ok(None) };
        let mut engine = self.engine(&inner, options, Model::new(cloud.clone(), &inner))?;
        let (mut search, mut stopped) = (Search::new(usual), false);
        train(
            engine.as_mut(),
            inner.training.len(),
            options.iterations,
            options.seed,
            REPORT_EVERY,
            &mut |engine, at| {
                stopped = !run.searches(at);
                if stopped || !search.is_time(at.iteration) {
                    return Ok(!stopped);
                }
                let psnr = judged(&engine.model()?, &inner, options.exposure)?;
                Ok(search.see(at.iteration, psnr))
            },
        )?;
        let stopped_with = if stopped { Some(engine.model()?.cloud) } else { None };
        Ok(Some(Searched { search, photographs: inner.held_out.len(), stopped_with }))
    }
}
