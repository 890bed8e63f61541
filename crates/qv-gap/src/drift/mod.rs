//! Has a robot changed since it was calibrated? The linear model of a diagnosis, of two recordings at once.
//!
//! Both recordings are linearised about the calibrated robot, as a diagnosis does it (`moments`). What a robot differs by from its model is
//! nearly the same in both, so that it cancels (`contrast`): what is left is the change, each parameter with its interval. Nothing is
//! searched and nothing is fitted by simulation. `decide` corrects for the number of parameters that are tested and names the changes.

mod contrast;
mod decide;
mod moments;
mod normal;
mod policy;

pub use decide::{Answer, Difference, Drift};
pub use policy::DriftPolicy;

use crate::diagnose::study;
use crate::{GapError, Options};
use contrast::Contrast;
use moments::Moments;
use qv_recording::Run;
use qv_rollout::WindowOptions;
use qv_sim::{Model, Terrain};

/// Windows of a recording, at most: a check of every day may cost less than a diagnosis.
const WINDOWS: usize = 40;

/// What the recordings of a calibration say of every parameter, to compare others with.
pub struct Baseline {
    then: Moments,
    /// The calibration compared with itself: what it can show.
    itself: Contrast,
    policy: DriftPolicy,
}

impl Baseline {
    /// Of recordings of the calibration. `options.given` are the parameters that were calibrated.
    ///
    /// # Errors
    /// When there are no recordings, they are not of this model, or they have too little.
    pub fn new(
        then: &[Run],
        model: &Model,
        terrain: &Terrain,
        options: &Options,
        policy: &DriftPolicy,
    ) -> Result<Self, GapError> {
        let then = study(then, model, terrain, &sloped(options), Moments::of)?;
        let itself = Contrast::new(&then, &then, policy.session)?;
        Ok(Self { then, itself, policy: policy.clone() })
    }

    /// Compares recordings of today, with the same `options`.
    ///
    /// # Errors
    /// As [`Baseline::new`].
    pub fn compare(&self, now: &[Run], model: &Model, terrain: &Terrain, options: &Options) -> Result<Drift, GapError> {
        let now = study(now, model, terrain, &sloped(options), Moments::of)?;
        let both = Contrast::new(&self.then, &now, self.policy.session)?;
        Ok(decide::decide(&self.itself, &both, &self.policy))
    }
}

/// The same with one level of each effect, without limits, and with fewer windows: a slope needs no more.
fn sloped<'a>(options: &Options<'a>) -> Options<'a> {
    let mut library: Vec<_> = options.library.iter().filter(|effect| effect.levels_of.is_none()).cloned().collect();
    library.iter_mut().for_each(|effect| effect.levels.truncate(1));
    Options {
        library,
        given: options.given.clone(),
        reference: Vec::new(),
        cut: WindowOptions { most: options.cut.most.min(WINDOWS), ..options.cut },
        effort: options.effort,
        policy: options.policy.clone(),
        without: Vec::new(),
        clock: options.clock,
        progress: options.progress,
    }
}
