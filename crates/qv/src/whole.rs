//! Files that are there whole or not at all.

use crate::Failure;
use crate::scene::about;
use std::fs;
use std::path::Path;

/// Writes a file beside its place and renames it, so that a power cut leaves the old one or the new one.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".new");
    let new = path.with_file_name(name);
    let written = fs::write(&new, bytes).and_then(|()| fs::rename(&new, path));
    written.map_err(|e| {
        fs::remove_file(&new).ok();
        about(path, format!("expected to write it, found {e}"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_and_nothing_else_is_left() {
        let folder = std::env::temp_dir().join(format!("qv-whole-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let path = folder.join("a.txt");
        write_whole(&path, b"one").unwrap();
        write_whole(&path, b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
        let error = write_whole(&folder.join("no/such.txt"), b"x").unwrap_err().to_string();
        assert!(error.contains("such.txt") && error.contains("expected to write it"), "{error}");
        fs::remove_dir_all(&folder).unwrap();
    }
}
