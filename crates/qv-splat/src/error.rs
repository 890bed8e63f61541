//! The error of this crate.

/// What can be wrong with a file of splats or cameras, or with what is to be written.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SplatError {
    /// Something in a file is not what its format says.
    #[error("{place}: expected {expected}, found {found}")]
    Format {
        /// Which format, and where in it.
        place: String,
        /// What the format says.
        expected: String,
        /// What is there.
        found: String,
    },
    /// A file ends early, or claims more than it holds.
    #[error("{place}: expected {expected} bytes from byte {byte} on, found {found}")]
    CutOff {
        /// Which format, and which part of it.
        place: String,
        /// Where the part begins.
        byte: u64,
        /// Its length in bytes, as the file claims.
        expected: u64,
        /// Bytes that are there.
        found: u64,
    },
    /// More than what is read, which is found before memory is taken.
    #[error("{place}: expected at most {limit}, found {found}")]
    TooLarge {
        /// What there is too much of, with its unit.
        place: String,
        /// The limit.
        limit: u64,
        /// What the file claims.
        found: u64,
    },
    /// A format that other tools convert.
    #[error("cannot read {format}: splat-transform (PlayCanvas) converts it, as in `splat-transform IN scene.ply`")]
    Unread {
        /// The format, with its article.
        format: &'static str,
    },
    /// A cloud that is to be written is off.
    #[error("cloud to write: {0}")]
    Cloud(#[from] qv_core::CoreError),
    /// Drawing failed.
    #[error(transparent)]
    Raster(#[from] qv_raster::RasterError),
}

/// Shorthand for [`SplatError::Format`].
pub(crate) fn off(place: impl Into<String>, expected: impl Into<String>, found: impl ToString) -> SplatError {
    SplatError::Format { place: place.into(), expected: expected.into(), found: found.to_string() }
}

/// An error about a file or a folder, for those who open them.
pub fn error_at(place: &str, expected: &str, found: &str) -> SplatError {
    off(place, expected, found)
}
