//! The error of this crate.

use qv_core::CoreError;

/// What can be wrong with depth maps, meshes and mesh files.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// Something is not as it must be.
    #[error("{place}: expected {expected}, found {found}")]
    Value {
        /// Where it was found.
        place: String,
        /// What is allowed.
        expected: String,
        /// What was found.
        found: String,
    },
    /// The work would take more memory than it may.
    #[error("{place}: expected at most {limit} bytes of memory, found a need of {needed}; {advice}")]
    Memory {
        /// What needs it.
        place: String,
        /// What is allowed, bytes.
        limit: u64,
        /// What is needed as far as it was counted, bytes.
        needed: u64,
        /// What would need less.
        advice: String,
    },
    /// A mesh or a camera is not valid in itself.
    #[error(transparent)]
    Core(#[from] CoreError),
}

/// Shorthand for [`MeshError::Value`].
pub(crate) fn off(place: impl ToString, expected: impl ToString, found: impl ToString) -> MeshError {
    MeshError::Value { place: place.to_string(), expected: expected.to_string(), found: found.to_string() }
}
