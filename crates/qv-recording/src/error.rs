//! The error of this crate.

use qv_core::Mismatch;

/// Why a recording could not be turned into a run, or a run not be replayed.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// A message definition cannot be understood.
    #[error("schema of {type_name}, line {line}: expected {expected}, found {found}")]
    Schema {
        /// Type whose definition is off.
        type_name: String,
        /// Line in the definition text, from 1; 0 when it is about the whole text.
        line: usize,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
    /// Bytes of a message do not agree with its definition.
    #[error("{field} at byte {offset}: expected {expected}, found {found}")]
    Cdr {
        /// Field path within the message.
        field: String,
        /// Byte offset in the message, the encapsulation header included.
        offset: usize,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
    /// A message type lacks a field that a mapping reads, or has another shape there.
    #[error("{type_name}: expected {expected}, found {found}")]
    Field {
        /// Message type.
        type_name: String,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
    /// A file cannot be read, or is not what its name says.
    #[error("{file}: expected {expected}, found {found}")]
    File {
        /// Name of the file.
        file: String,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
    /// A row of a table is off.
    #[error("{file}, line {line}, column `{column}`: expected {expected}, found {found}")]
    Table {
        /// Name of the file.
        file: String,
        /// Line, from 1.
        line: u64,
        /// Column name; empty when the line as a whole is meant.
        column: String,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
    /// The recording was read but cannot make a run, such as a bag without states.
    #[error(transparent)]
    Run(#[from] Mismatch),
    /// Writing an output failed.
    #[error("writing {what}: {reason}")]
    Write {
        /// What was being written.
        what: String,
        /// Why it failed.
        reason: String,
    },
}

impl RecordingError {
    pub(crate) fn cdr(field: &str, offset: usize, expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self::Cdr { field: field.to_string(), offset, expected: expected.into(), found: found.into() }
    }

    pub(crate) fn file(file: &str, expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self::File { file: file.to_string(), expected: expected.into(), found: found.into() }
    }

    pub(crate) fn run(what: impl Into<String>, expected: impl Into<String>, found: impl ToString) -> Self {
        Self::Run(Mismatch::new(what, expected, found))
    }
}
