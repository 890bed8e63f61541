//! A file that rules read.

use std::path::PathBuf;

/// A text file of the repository.
pub struct Source {
    /// Relative to the root.
    pub path: PathBuf,
    /// All of it.
    pub text: String,
}
