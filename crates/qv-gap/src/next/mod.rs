//! The next motion: which of several would show the leading hypotheses apart.
//!
//! Each motion is recorded in the simulator, of the robot as it is said to be, and its sensitivities and null are found as those of a real
//! recording. `power` says how likely a recording of it decides. Nothing here decides what is accused.

mod motions;
mod power;
mod record;

pub use motions::{Limits, Motion, motions};
pub use power::{Decides, Hypothesis, Worth};

use crate::decision::evidence::Evidence;
use crate::diagnose::study;
use crate::{GapError, Options};
use qv_recording::Run;
use qv_sim::{Model, Terrain};

/// A motion, and what a recording of it would show.
#[derive(Debug, Clone)]
pub struct Proposal {
    /// Commands, and what they mean in words.
    pub motion: Motion,
    /// The recording that the simulator makes of it.
    pub recording: Run,
    /// What it shows.
    pub worth: Worth,
}

/// The hypotheses that a diagnosis leaves open: of each effect the best candidate of the first round, at most `most`, best evidence first.
pub fn hypotheses(evidence: &Evidence, most: usize) -> Vec<Hypothesis> {
    let Some(round) = evidence.rounds.first() else { return Vec::new() };
    let mut all: Vec<Hypothesis> = Vec::new();
    let steady = round.candidates.iter().filter(|c| c.extent.is_none() && !c.values.is_empty());
    let mut steady: Vec<_> = steady.filter(|c| c.values.iter().all(|v| v.is_finite())).collect();
    steady.sort_by(|a, b| b.whole_evidence().total_cmp(&a.whole_evidence()));
    for candidate in steady {
        if all.len() < most && !all.iter().any(|h| h.effect == candidate.effect) {
            all.push(Hypothesis {
                effect: candidate.effect.clone(),
                scope: candidate.scope.clone(),
                values: candidate.values.clone(),
                evidence: candidate.whole_evidence(),
            });
        }
    }
    all
}

/// Each motion that stays within `limits` in the simulator, with what a recording of it would report `hypotheses`; best first. `watch` is
/// reported how many of how many are done.
///
/// # Errors
/// When the recording has too little, a hypothesis is none of the library's, or no motion stays within the limits.
pub fn next(
    run: &Run,
    model: &Model,
    terrain: &Terrain,
    options: &Options,
    hypotheses: &[Hypothesis],
    watch: &dyn Fn(usize, usize),
) -> Result<Vec<Proposal>, GapError> {
    if hypotheses.len() < 2 {
        return Err(GapError::run("hypotheses", "at least two", hypotheses.len().to_string()));
    }
    let limits = Limits::of(run, model)?;
    let all = motions(run, &limits);
    let count = all.len();
    let mut proposals = Vec::new();
    for (index, motion) in all.into_iter().enumerate() {
        watch(index, count);
        let Some((motion, recording)) = record::within_limits(run, model, terrain, options, &limits, motion)? else {
            continue;
        };
        let worth = study(std::slice::from_ref(&recording), model, terrain, options, |study| {
            power::worth(study, &options.policy, hypotheses)
        })?;
        proposals.push(Proposal { motion, recording, worth });
    }
    watch(count, count);
    if proposals.is_empty() {
        let found = "none of them: each falls, runs into a limit or is not followed";
        return Err(GapError::run("next motion", "a motion that the simulated robot follows within its limits", found));
    }
    proposals.sort_by(|a, b| b.worth.decides.total_cmp(&a.worth.decides));
    Ok(proposals)
}
