//! The error of this crate.

use qv_recording::RecordingError;
use qv_sim::SimError;

/// Why a run could not be simulated.
#[derive(Debug, thiserror::Error)]
pub enum RolloutError {
    /// The run, the robot and the parameters do not fit together.
    #[error("{what}: expected {expected}, found {found}")]
    Run {
        /// What is missing or off.
        what: String,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
    /// The recording.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The simulator.
    #[error("simulator: {0}")]
    Sim(#[from] SimError),
}

impl RolloutError {
    pub(crate) fn run(what: impl Into<String>, expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self::Run { what: what.into(), expected: expected.into(), found: found.into() }
    }
}

impl From<RolloutError> for RecordingError {
    fn from(error: RolloutError) -> Self {
        match error {
            RolloutError::Run { what, expected, found } => Self::Run { what, expected, found },
            RolloutError::Recording(error) => error,
            RolloutError::Sim(error) => {
                Self::Run { what: "simulator".into(), expected: "a simulation".into(), found: error.to_string() }
            }
        }
    }
}
