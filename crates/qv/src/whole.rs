//! Files that are there as a whole or not at all.

use crate::open::write_error;
use qv_replay::ReplayError;
use std::fs;
use std::path::Path;

/// Writes a file beside its place and renames it, so that a reader never meets half of it.
///
/// # Errors
/// When the directory cannot be written to.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), ReplayError> {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".part");
    let part = path.with_file_name(name);
    let written = fs::write(&part, bytes).and_then(|()| fs::rename(&part, path));
    written.map_err(|e| {
        // Nothing is left of it; that it cannot be removed either changes nothing.
        _ = fs::remove_file(&part);
        write_error(path, &e)
    })
}
