//! The error of this crate.

/// What can be wrong with a request to render.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RasterError {
    /// A cloud or a camera that is off.
    #[error("{place}: {source}")]
    Input {
        /// Which cloud or view.
        place: String,
        /// What is off.
        source: qv_core::CoreError,
    },
    /// Two lengths that must agree do not.
    #[error("{what}: expected length {expected}, found {found}")]
    Length {
        /// The array that is off.
        what: String,
        /// Length that was expected.
        expected: usize,
        /// Length that was found.
        found: usize,
    },
    /// An index beyond what there is.
    #[error("{what}: expected an index below {count}, found {found}")]
    Index {
        /// What the index names, and where it was found.
        what: String,
        /// How many there are.
        count: usize,
        /// The index that was found.
        found: usize,
    },
    /// A request beyond a limit, which is found before memory is taken.
    #[error("{what}: expected at most {limit}, found {found}")]
    TooLarge {
        /// What there is too much of, with its unit.
        what: String,
        /// The limit.
        limit: u64,
        /// What was asked for.
        found: u64,
    },
    /// The card has no memory left for a buffer: less at once may do.
    #[cfg(feature = "gpu")]
    #[error("memory of the graphics device: expected {bytes} bytes for `{what}`, found less left: {reason}")]
    DeviceMemory {
        /// The buffer.
        what: String,
        /// Its size.
        bytes: u64,
        /// What the device says.
        reason: String,
    },
    /// No graphics adapter that can do the work.
    #[cfg(feature = "gpu")]
    #[error("graphics adapter: expected {expected}, found {found}")]
    Adapter {
        /// What is needed.
        expected: String,
        /// What there is.
        found: String,
    },
    /// The graphics device failed.
    #[cfg(feature = "gpu")]
    #[error("graphics device: {0}")]
    Device(String),
}
