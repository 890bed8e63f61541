//! The error of this crate.

/// Why a plan or a unit of it cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FleetError {
    /// A file is not as it should be.
    #[error("{file}: expected {expected}, found {found}")]
    File {
        /// Its name.
        file: String,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
    /// A unit is asked for that the plan does not have.
    #[error("unit {asked}: expected {expected}, found none of that name")]
    Unit {
        /// What was asked for.
        asked: String,
        /// What the plan has.
        expected: String,
    },
}
