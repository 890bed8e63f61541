//! The error of this crate.

use qv_core::Mismatch;
use qv_rollout::RolloutError;
use qv_sim::SimError;

/// Why friction could not be calibrated.
#[derive(Debug, thiserror::Error)]
pub enum ContactError {
    /// A table of materials, or an answer of a language model, cannot be used.
    #[error("{file}: expected {expected}, found {found}")]
    Prior {
        /// Name of the file, or `answer` of a language model.
        file: String,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
    /// The runs or the terrain cannot be used.
    #[error(transparent)]
    Run(#[from] Mismatch),
    /// The recording and its robot.
    #[error(transparent)]
    Rollout(#[from] RolloutError),
    /// The simulator.
    #[error("simulator: {0}")]
    Sim(#[from] SimError),
}

impl ContactError {
    pub(crate) fn run(what: impl Into<String>, expected: impl Into<String>, found: impl ToString) -> Self {
        Self::Run(Mismatch::new(what, expected, found))
    }

    pub(crate) fn prior(file: &str, expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self::Prior { file: file.into(), expected: expected.into(), found: found.into() }
    }
}
