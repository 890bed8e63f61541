//! The error of this crate.

use qv_core::Mismatch;
use qv_fit::FitError;
use qv_policy::PolicyError;
use qv_rollout::RolloutError;
use qv_sim::SimError;

/// What can be wrong with recordings, compensators and their training.
#[derive(Debug, thiserror::Error)]
pub enum ResidualError {
    /// The simulator refused something.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// A policy or its training.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// A recording and its robot.
    #[error(transparent)]
    Rollout(#[from] RolloutError),
    /// Input that does not serve.
    #[error(transparent)]
    Input(#[from] Mismatch),
}

impl From<FitError> for ResidualError {
    fn from(error: FitError) -> Self {
        let FitError { what, expected, found } = error;
        Self::Input(Mismatch { what, expected, found })
    }
}

impl ResidualError {
    /// Input that does not serve.
    pub fn input(what: impl Into<String>, expected: impl Into<String>, found: impl ToString) -> Self {
        Self::Input(Mismatch::new(what, expected, found))
    }
}
