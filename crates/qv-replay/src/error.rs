//! The error of this crate.

use qv_recording::RecordingError;
use qv_rollout::RolloutError;
use qv_sim::SimError;

/// Why a run could not be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The run, its robot or the options cannot be used.
    #[error("{what}: expected {expected}, found {found}")]
    Run {
        /// What is missing or off.
        what: String,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
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
    pub(crate) fn run(what: impl Into<String>, expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self::Run { what: what.into(), expected: expected.into(), found: found.into() }
    }
}

impl From<ReplayError> for RecordingError {
    fn from(error: ReplayError) -> Self {
        match error {
            ReplayError::Run { what, expected, found } => Self::Run { what, expected, found },
            ReplayError::Rollout(error) => error.into(),
            ReplayError::Recording(error) => error,
            ReplayError::Sim(error) => RolloutError::Sim(error).into(),
            ReplayError::Write { what, reason } => Self::Write { what, reason },
        }
    }
}
