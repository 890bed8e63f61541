//! The error of this crate.

use crate::onnx::OnnxError;
use crate::roll::RollError;
use qv_core::Mismatch;
use qv_sim::SimError;

/// What can be wrong with a robot, a task, a policy or a training.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PolicyError {
    /// The simulator refused something.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// An ONNX file could not be written, read or run.
    #[error(transparent)]
    Onnx(#[from] OnnxError),
    /// A roll of somebody's policy went wrong.
    #[error(transparent)]
    Roll(#[from] RollError),
    /// A setting that means nothing.
    #[error(transparent)]
    Setting(#[from] Mismatch),
    /// A text that is not what it should be.
    #[error("{what}: {reason}")]
    Text {
        /// The file or part of it.
        what: String,
        /// What is wrong, with the line where the parser shows it.
        reason: String,
    },
    /// A training that ran away.
    #[error("training stopped at iteration {iteration}: expected a finite {term}, found {found}")]
    NotFinite {
        /// Iterations done before.
        iteration: u64,
        /// The term of the reward, the loss or the network that is not finite.
        term: String,
        /// Its value.
        found: f32,
    },
    /// A file of another robot, task or version.
    #[error(transparent)]
    Mismatch(Mismatch),
}

impl PolicyError {
    /// A setting that means nothing.
    pub(crate) fn setting(what: &str, expected: &str, found: impl std::fmt::Display) -> Self {
        Self::Setting(Mismatch::new(what, expected, found))
    }
}
