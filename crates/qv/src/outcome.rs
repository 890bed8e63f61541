//! How a command ended.

use std::path::Path;

/// Why a command failed, in words for whoever typed it.
pub type Failure = Box<dyn std::error::Error>;

/// How a command ended when it did not fail.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    Done,
    Partial,
    /// A robot is not what it was.
    Changed,
    /// Somebody stopped it; it can go on.
    Stopped,
}

/// An error with the file that it is about.
pub fn about(path: &Path, error: impl std::fmt::Display) -> Failure {
    format!("{}: {error}", path.display()).into()
}
