//! The errors of this crate.

/// What can be wrong with a shared type when it is built from outside data.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CoreError {
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle}: expected vertex indices below {vertices}, found {found}")]
    VertexIndex {
        /// Index of the offending triangle.
        triangle: usize,
        /// Number of vertices in the mesh.
        vertices: usize,
        /// The index that was found.
        found: u32,
    },
    /// A number that must be finite is not.
    #[error("{what} {index}: expected finite numbers, found {found}")]
    NotFinite {
        /// Kind of item, such as `vertex` or `sample`.
        what: &'static str,
        /// Index of the item.
        index: usize,
        /// The offending value as text.
        found: String,
    },
    /// Two lengths that must agree do not.
    #[error("{what}: expected length {expected}, found {found}")]
    Length {
        /// The array that is off.
        what: &'static str,
        /// Length that was expected.
        expected: usize,
        /// Length that was found.
        found: usize,
    },
    /// A value outside what is allowed.
    #[error("{what}: expected {expected}, found {found}")]
    Range {
        /// The value that is off.
        what: &'static str,
        /// What is allowed.
        expected: &'static str,
        /// The value that was found.
        found: String,
    },
    /// Time stamps must increase strictly.
    #[error("time stamps: expected strictly increasing seconds, found {found} after {previous} at sample {index}")]
    TimeOrder {
        /// Index of the offending sample.
        index: usize,
        /// Stamp before it, seconds.
        previous: f64,
        /// Offending stamp, seconds.
        found: f64,
    },
}

/// An input that is not what was expected; a variant of the errors of other crates.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{what}: expected {expected}, found {found}")]
pub struct Mismatch {
    /// The input, setting or part of a file.
    pub what: String,
    /// What was expected.
    pub expected: String,
    /// What was found.
    pub found: String,
}

impl Mismatch {
    /// What was expected of an input, and what was found.
    pub fn new(what: impl Into<String>, expected: impl Into<String>, found: impl ToString) -> Self {
        Self { what: what.into(), expected: expected.into(), found: found.to_string() }
    }
}
