//! Names of files that are being written, and whether two paths are one file.

use std::ffi::OsString;
use std::fs::{self};
use std::path::{Path, PathBuf};

/// Ending of files that are being written.
pub(super) const ENDING: &str = ".qv-new";

/// Longest name to which the rest of a temporary name is added \[bytes\].
const LONGEST: usize = 200;

/// Whether two paths are of one file or folder, which is there.
pub fn is_same(a: &Path, b: &Path) -> bool {
    fs::canonicalize(a).is_ok_and(|a| fs::canonicalize(b).is_ok_and(|b| a == b)) || is_same_file(a, b)
}

/// Where a file is written before it takes its place. Two processes that write one file have two.
pub fn temporary(path: &Path) -> PathBuf {
    let mut name = OsString::from(".");
    name.push(shortened(path));
    name.push(format!(".{}{ENDING}", std::process::id()));
    path.with_file_name(name)
}

/// Whether a name is one of [`temporary`].
pub fn is_temporary(path: &Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str());
    name.is_some_and(|name| name.starts_with('.') && name.ends_with(ENDING) && process_of(name).is_some())
}

/// Whether two names are of one file.
#[cfg(unix)]
fn is_same_file(a: &Path, b: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let id = |path: &Path| fs::metadata(path).ok().filter(fs::Metadata::is_file).map(|file| (file.dev(), file.ino()));
    id(a).is_some_and(|own| id(b) == Some(own))
}

#[cfg(not(unix))]
fn is_same_file(_: &Path, _: &Path) -> bool {
    false
}

/// The name of a file, cut so that more can be added.
pub(super) fn shortened(path: &Path) -> OsString {
    let name = path.file_name().unwrap_or_default();
    if name.len() <= LONGEST {
        return name.to_owned();
    }
    let text = name.to_string_lossy();
    let end = (0..=LONGEST.min(text.len())).rev().find(|end| text.is_char_boundary(*end)).unwrap_or(0);
    text[..end].into()
}

/// The process that a temporary file is of.
fn process_of(name: &str) -> Option<i32> {
    name.strip_suffix(ENDING)?.rsplit_once('.')?.1.parse().ok()
}
