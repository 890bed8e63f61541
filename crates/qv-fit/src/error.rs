//! The error of this crate.

/// The problem or its residuals have a shape or a number that means nothing.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("cannot fit '{what}': expected {expected}, found {found}")]
pub struct FitError {
    /// What is off.
    pub what: String,
    /// What was expected.
    pub expected: String,
    /// What was found.
    pub found: String,
}

impl FitError {
    pub(crate) fn input(what: impl Into<String>, expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self { what: what.into(), expected: expected.into(), found: found.into() }
    }

    /// Without residuals at the start there is nothing to compare with.
    pub(crate) fn ran_away() -> Self {
        Self::input("start", "finite residuals", "none: what is simulated ran away")
    }
}
