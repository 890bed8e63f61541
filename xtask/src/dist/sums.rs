//! SHA256SUMS, as `sha256sum --check` reads it.

use anyhow::{Context, Result};
use sha2::{Digest, Sha256};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

/// Its name.
const FILE: &str = "SHA256SUMS";

/// Writes the hashes of all files of a folder, by name.
///
/// # Errors
/// A file cannot be read, or the list cannot be written.
pub fn write(folder: &Path) -> Result<()> {
    let entries = fs::read_dir(folder).with_context(|| format!("reading {}", folder.display()))?;
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    files.retain(|path| path.is_file() && path.file_name() != Some(FILE.as_ref()));
    files.sort();
    let mut text = String::new();
    for path in files {
        let bytes = fs::read(&path).with_context(|| format!("reading {}", path.display()))?;
        for byte in Sha256::digest(&bytes) {
            write!(text, "{byte:02x}")?;
        }
        writeln!(text, "  {}", path.file_name().unwrap_or_default().to_string_lossy())?;
    }
    let (list, beside) = (folder.join(FILE), folder.join(format!(".{FILE}.part")));
    fs::write(&beside, text).with_context(|| format!("writing {}", beside.display()))?;
    fs::rename(&beside, &list).with_context(|| format!("writing {}", list.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_the_standard_and_leave_their_own_file_out() {
        let folder = std::env::temp_dir().join(format!("qv-sums-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join("b"), "").unwrap();
        fs::write(folder.join("a"), "abc").unwrap();
        write(&folder).unwrap();
        // A second time, with the list in the folder.
        write(&folder).unwrap();
        // FIPS 180-2, appendix B.1; the hash of nothing.
        let right = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad  a\n\
                     e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855  b\n";
        assert_eq!(fs::read_to_string(folder.join(FILE)).unwrap(), right);
        fs::remove_dir_all(folder).unwrap();
    }
}
