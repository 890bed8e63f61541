//! Errors about files.

use qv_recording::RecordingError;
use std::path::Path;

/// An error about a file that cannot be written.
pub fn write_error(what: &Path, error: &std::io::Error) -> RecordingError {
    RecordingError::Write { what: what.display().to_string(), reason: error.to_string() }
}

/// An error about a file.
pub fn file_error(path: &Path, expected: &str, found: &str) -> RecordingError {
    RecordingError::File { file: path.display().to_string(), expected: expected.into(), found: found.into() }
}
