//! The error of this crate.

use qv_core::Mismatch;
use qv_recording::RecordingError;
use qv_sim::SimError;

/// Why a run could not be simulated.
#[derive(Debug, thiserror::Error)]
pub enum RolloutError {
    /// The run, the robot and the parameters do not fit together.
    #[error(transparent)]
    Run(#[from] Mismatch),
    /// The recording.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The simulator.
    #[error("simulator: {0}")]
    Sim(#[from] SimError),
}

impl RolloutError {
    pub(crate) fn run(what: impl Into<String>, expected: impl Into<String>, found: impl ToString) -> Self {
        Self::Run(Mismatch::new(what, expected, found))
    }
}

impl From<RolloutError> for RecordingError {
    fn from(error: RolloutError) -> Self {
        match error {
            RolloutError::Run(error) => Self::Run(error),
            RolloutError::Recording(error) => error,
            RolloutError::Sim(error) => Self::Run(Mismatch::new("simulator", "a simulation", error)),
        }
    }
}
