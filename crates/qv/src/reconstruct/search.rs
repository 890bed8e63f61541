//! How many steps help, found before training on all photographs.

use super::REPORT_EVERY;
use super::arguments::Reconstruct;
use super::watch::Run;
use crate::Failure;
use crate::outcome::about;
use crate::output::{self, put};
use qv_core::GaussianCloud;
use qv_splat::train::aside::{Search, judged, put_aside};
use qv_splat::train::{Dataset, Model, TrainOptions, train};
use serde::{Deserialize, Serialize};
use std::fs;

/// Every so many photographs to learn from are put aside.
const ASIDE: usize = 8;

/// What the search found: the file `aside.json` in the output folder, by which `--resume` goes on with as many steps.
#[derive(Serialize, Deserialize)]
pub(super) struct SearchResult {
    /// Steps that were asked for.
    asked: u32,
    seed: u32,
    /// Photographs that were put aside.
    photographs: usize,
    /// Steps, and PSNR of those photographs after them \[dB\].
    psnr: Vec<(u32, f64)>,
    /// Steps that help most.
    pub steps: u32,
    /// The scene so far, when somebody stopped it.
    #[serde(skip)]
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
    ) -> Result<Option<SearchResult>, Failure> {
        let path = self.out.join("aside.json");
        if self.resume {
            // What cannot be read, or is of another search, says nothing of this run.
            let found = fs::read(&path).ok().and_then(|bytes| serde_json::from_slice::<SearchResult>(&bytes).ok());
            return Ok(found.filter(|found| (found.asked, found.seed) == (self.iterations, self.seed)));
        }
        // That of an earlier scene says nothing of this one.
        output::remove(&path);
        let usual = TrainOptions::default().iterations;
        if options.iterations <= usual || self.max_seconds.is_some() {
            return Ok(None);
        }
        let Some(inner) = put_aside(dataset, ASIDE) else { return Ok(None) };
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
                let psnr = judged(engine.model()?, &inner)?;
                Ok(search.see(at.iteration, psnr))
            },
        )?;
        let found = SearchResult {
            asked: self.iterations,
            seed: self.seed,
            photographs: inner.held_out.len(),
            steps: search.best(),
            psnr: search.seen,
            stopped_with: if stopped { Some(engine.model()?.cloud) } else { None },
        };
        if !stopped {
            let text = serde_json::to_string_pretty(&found).map_err(|e| about(&path, e))?;
            put(&path, text + "\n").map_err(|e| about(&path, format!("expected to write it, found {e}")))?;
        }
        Ok(Some(found))
    }
}
