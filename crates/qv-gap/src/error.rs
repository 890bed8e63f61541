//! The error of this crate.

use qv_core::Mismatch;
use qv_fit::FitError;
use qv_recording::RecordingError;
use qv_rollout::RolloutError;
use qv_sim::SimError;

/// Why a run could not be diagnosed.
#[derive(Debug, thiserror::Error)]
pub enum GapError {
    /// A library of effects cannot be used.
    #[error("{file}: expected {expected}, found {found}")]
    Library {
        /// Name of the file.
        file: String,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
    /// The run cannot be diagnosed.
    #[error(transparent)]
    Run(#[from] Mismatch),
    /// The recording.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The simulator.
    #[error("simulator: {0}")]
    Sim(#[from] SimError),
}

impl GapError {
    /// The same, with what is known to be wrong with the recordings.
    pub(crate) fn beside(self, known: &[String]) -> Self {
        let with_known = |found: String| format!("{found} ({})", known.join("; "));
        match self {
            Self::Run(off) | Self::Recording(RecordingError::Run(off)) if !known.is_empty() => {
                Self::Run(Mismatch { found: with_known(off.found), ..off })
            }
            other => other,
        }
    }

    pub(crate) fn run(what: impl Into<String>, expected: impl Into<String>, found: impl ToString) -> Self {
        Self::Run(Mismatch::new(what, expected, found))
    }
}

impl From<qv_held::HeldError> for GapError {
    fn from(error: qv_held::HeldError) -> Self {
        match error {
            qv_held::HeldError::Recording { what, reason } => Self::run(what, "torques that can be weighed", reason),
            qv_held::HeldError::Fleet(faulty, all) => Self::run(
                "recording",
                "a controller that holds the model",
                format!("{faulty} of {all} robots that ran away"),
            ),
            qv_held::HeldError::Short(has, needs) => {
                Self::run("recording", format!("{needs} s of positions"), format!("{has} s"))
            }
            qv_held::HeldError::Rollout(error) => error.into(),
            qv_held::HeldError::Sim(error) => Self::Sim(error),
        }
    }
}

impl From<FitError> for GapError {
    fn from(error: FitError) -> Self {
        let FitError { what, expected, found } = error;
        Self::run(what, expected, found)
    }
}

impl From<RolloutError> for GapError {
    fn from(error: RolloutError) -> Self {
        match error {
            RolloutError::Run(error) => Self::Run(error),
            RolloutError::Recording(error) => Self::Recording(error),
            RolloutError::Sim(error) => Self::Sim(error),
        }
    }
}
