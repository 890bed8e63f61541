//! Results of other commands, as JSON.

use crate::Failure;
use crate::outcome::about;
use serde_json::Value;
use std::fs;
use std::path::Path;

/// A report, which has at least the given key.
pub fn read_json(path: &Path, key: &str) -> Result<Value, Failure> {
    let text = fs::read_to_string(path).map_err(|e| about(path, format!("expected a report, found {e}")))?;
    let value: Value = serde_json::from_str(&text).map_err(|e| about(path, format!("expected JSON, found {e}")))?;
    match value.get(key) {
        Some(_) => Ok(value),
        None => Err(about(path, format!("expected a report with `{key}`, found none"))),
    }
}
