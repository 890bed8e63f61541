//! What can go wrong.

use thiserror::Error;

/// Why a recording cannot be diagnosed by its torque balance.
#[derive(Debug, Error)]
pub enum HeldError {
    /// The recording lacks something.
    #[error("cannot weigh the torques of '{what}': {reason}")]
    Recording {
        /// Recording or joint.
        what: String,
        /// Why.
        reason: String,
    },
    /// Positions are compared for too short a time: what there is, and what is needed \[s\].
    #[error("cannot compare positions: {0} s can be, and {1} are needed")]
    Short(f64, f64),
    /// Robots of the fleet ran away: how many, of how many.
    #[error("cannot simulate references: {0} of {1} robots ran away, for the controller does not hold the model")]
    Fleet(usize, usize),
    /// Recording and model do not belong together.
    #[error(transparent)]
    Rollout(#[from] qv_rollout::RolloutError),
    /// The simulator refused.
    #[error(transparent)]
    Sim(#[from] qv_sim::SimError),
}

impl HeldError {
    pub(crate) fn recording(what: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Recording { what: what.into(), reason: reason.into() }
    }
}
