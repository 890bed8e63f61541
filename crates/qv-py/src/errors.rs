//! Errors of the libraries as exceptions of Python: what the caller gave is a `ValueError`, a file is an `OSError`.

use pyo3::PyErr;
use pyo3::exceptions::{PyOSError, PyValueError};
use qv_recording::RecordingError;

/// Bad input in the words of the library.
pub fn value(error: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Files that are not as expected are errors of the system's kind, all else is bad input.
pub fn opening(error: RecordingError) -> PyErr {
    match error {
        RecordingError::File { .. } | RecordingError::Write { .. } => PyOSError::new_err(error.to_string()),
        other => value(other),
    }
}
