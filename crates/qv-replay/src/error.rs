//! The error of this crate.

use qv_core::Mismatch;
use qv_recording::RecordingError;
use qv_rollout::RolloutError;
use qv_sim::SimError;

/// Why a run could not be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The run, its robot or the options cannot be used.
    #[error(transparent)]
    Run(#[from] Mismatch),
    /// Run and robot.
    #[error(transparent)]
    Rollout(#[from] RolloutError),
    /// The recording.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The simulator.
    #[error("simulator: {0}")]
    Sim(#[from] SimError),
    /// Writing an output failed.
    #[error("writing {what}: {reason}")]
    Write {
        /// What was being written.
        what: String,
        /// Why it failed.
        reason: String,
    },
}

impl ReplayError {
    pub(crate) fn run(what: impl Into<String>, expected: impl Into<String>, found: impl ToString) -> Self {
        Self::Run(Mismatch::new(what, expected, found))
    }
}

impl From<ReplayError> for RecordingError {
    fn from(error: ReplayError) -> Self {
        match error {
            ReplayError::Run(error) => Self::Run(error),
            ReplayError::Rollout(error) => error.into(),
            ReplayError::Recording(error) => error,
            ReplayError::Sim(error) => RolloutError::Sim(error).into(),
            ReplayError::Write { what, reason } => Self::Write { what, reason },
        }
    }
}
