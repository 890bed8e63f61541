//! The whole of it: from recordings and a policy to a policy that follows its commands better on the robot, or the word that nothing is
//! to be gained.
//!
//! Stretches of the recordings are dealt out: four of five are for fits, the fifth is held out. A candidate stays when its error on held-out
//! windows is less than that of the one before by two standard errors over stretches. Policies are trained on under what stayed; they are
//! compared in a simulator that is fitted to the held-out stretches alone, which no training has seen.

mod inputs;
mod keep;
mod report;
mod scored;
mod settings;
mod stages;

pub use inputs::Inputs;
pub use keep::{Event, Forget, Keep};
pub use report::{Candidate, HeldOut, Outcome, PathPair, Report};
pub use settings::LoopSettings;

use crate::ResidualError;
use crate::footing::Footing;
use crate::identify::tops;
use crate::windows::{Replayer, windows};
use inputs::picked;
use settings::is_held;

/// Closes the loop.
///
/// # Errors
/// When there is too little to fit or to hold out, or a number is not finite.
pub fn close(inputs: &Inputs, keep: &dyn Keep, notify: &mut dyn FnMut(Event)) -> Result<Outcome, ResidualError> {
    prepare(inputs, keep, notify)?.run()
}

/// The corrections that the loop would train on under, in the order in which they are tried, and whether they stay; no policy is trained.
///
/// # Errors
/// As [`close`].
pub fn fit_candidates(
    inputs: &Inputs,
    keep: &dyn Keep,
    notify: &mut dyn FnMut(Event),
) -> Result<Vec<Candidate>, ResidualError> {
    prepare(inputs, keep, notify)?.fit_candidates()
}

/// Deals the recordings out.
fn prepare<'a, 'b>(
    inputs: &'a Inputs<'a>,
    keep: &'a dyn Keep,
    notify: &'b mut dyn FnMut(Event),
) -> Result<stages::Loop<'a, 'b>, ResidualError> {
    let settings = inputs.settings;
    let replayer = Replayer::new(inputs.log, inputs.robot, &inputs.ground.terrain, &inputs.start.settings.task);
    let length = (settings.window * inputs.log.rate).round().max(1.0) as usize;
    let footing = (!inputs.ground.terrain.is_plane()).then(|| Footing::new(&replayer));
    let picked = |wanted: &dyn Fn(usize) -> bool| picked(inputs, footing.as_ref(), length, wanted);
    let held = picked(&|k| is_held(settings, k));
    let mut stretches: Vec<usize> = held.iter().map(|w| w.stretch).collect();
    stretches.dedup();
    let (all, kept) = (windows(inputs.log, length, |_| true).len(), picked(&|_| true).len());
    if stretches.len() < 3 || kept * 5 < all {
        let found = format!(
            "{:.0} s in {} stretches, and ground that agrees with the feet in {kept} of {all} windows",
            inputs.log.seconds(),
            inputs.log.stretches.len()
        );
        let expected = "at least 15 stretches of 2 to 10 s of walking on ground that is known to `footing`";
        return Err(ResidualError::input("recordings", expected, found));
    }
    let mut remarks = inputs.log.remarks.clone();
    if kept < all {
        remarks.push(format!(
            "{} of {all} windows of {} s are left out: feet and ground contradict each other by more than {} m in them",
            all - kept,
            settings.window,
            settings.footing
        ));
    }
    let tops = tops(&replayer);
    Ok(stages::Loop { inputs, replayer, footing, remarks, held, length, tops, keep, notify })
}
