//! Has a robot changed since it was calibrated? The linear model of a diagnosis, of two recordings at once.
//!
//! Both recordings are linearised about the calibrated robot, as a diagnosis does it ([`moments`]). What a robot differs by from its model is
//! nearly the same in both, so that it cancels ([`contrast`]): what is left is the change, each parameter with its interval. Nothing is
//! searched and nothing is fitted by simulation. [`decide`] corrects for the number of parameters that are tested and names the changes.

mod contrast;
mod decide;
mod moments;
mod normal;

pub use decide::{Answer, Difference, Drift};

use crate::diagnose::study;
use crate::{GapError, Options};
use contrast::Contrast;
use moments::Moments;
use qv_recording::Run;
use qv_rollout::WindowOptions;
use qv_sim::{Model, Terrain};

/// Windows of a recording, at most: a check of every day may cost less than a diagnosis.
const WINDOWS: usize = 40;

/// Numbers that decide.
#[derive(Debug, Clone, PartialEq)]
pub struct DriftPolicy {
    /// Probability of any false alarm, over all parameters (Holm, Scandinavian Journal of Statistics 6, 1979).
    pub alarm: f64,
    /// How far a robot's parameters may move from one day to the next without a change, as a share of what robots of its kind differ by.
    pub session: f64,
    /// Changes that are named, at most.
    pub most: usize,
    /// Least part of the evidence of the first change that another one beside it has.
    pub beside: f64,
    /// So many times as large as the calibration could show: from there on a recording shows an effect no longer.
    pub blunter: f64,
}

impl Default for DriftPolicy {
    fn default() -> Self {
        Self { alarm: 0.01, session: 0.1, most: 6, beside: 0.1, blunter: 3.0 }
    }
}

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
