//! The error of this crate.

/// Why nothing could be fitted.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FitError {
    /// The problem or the residuals have a shape or a number that means nothing.
    #[error("cannot fit '{what}': expected {expected}, found {found}")]
    Input {
        /// What is off.
        what: String,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
    /// The start ran away: there is nothing to compare with.
    #[error("cannot fit 'start': its residuals are not finite, or its simulation ran away")]
    RanAway,
}

impl FitError {
    pub(crate) fn input(what: impl Into<String>, expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self::Input { what: what.into(), expected: expected.into(), found: found.into() }
    }
}
