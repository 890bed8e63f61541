//! Whether a stage is fresh: by the contents of what it read and wrote.

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::{Path, PathBuf};

/// What a stage leaves beside its outputs: contents that it was run on, and what it wrote.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub struct Stamp {
    /// Hash of arguments, programs and what was read.
    pub inputs: u64,
    /// Hash of what was written.
    pub outputs: u64,
}

impl Stamp {
    /// The stamp in a file; `None` where there is none that can be read.
    pub fn read(file: &Path) -> Option<Self> {
        fs::read_to_string(file).ok().and_then(|text| serde_json::from_str(&text).ok())
    }

    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, file: &Path) -> Result<()> {
        fs::write(file, serde_json::to_string(self)?).with_context(|| format!("writing {}", file.display()))
    }
}

/// A hash of words and of the contents of files and folders, in the manner of FNV-1a but by eight bytes: against stale results, not against
/// forgers, and programs of a hundred megabytes are read for each stage.
///
/// # Errors
/// A file cannot be read.
pub fn hash(words: &[String], paths: &[PathBuf]) -> Result<u64> {
    let mut state = 0xcbf2_9ce4_8422_2325_u64;
    let mut add = |bytes: &[u8]| {
        // High bits come down, or the last byte of a word would never reach the low ones.
        let mut mix = |word: u64| {
            state = (state ^ word).wrapping_mul(0x0100_0000_01b3);
            state ^= state >> 32;
        };
        // The length keeps "ab", "c" apart from "a", "bc".
        mix(bytes.len() as u64);
        for chunk in bytes.chunks(8) {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            mix(u64::from_le_bytes(word));
        }
    };
    words.iter().for_each(|word| add(word.as_bytes()));
    for path in paths {
        for file in files(path)? {
            if path.is_dir() {
                add(file.strip_prefix(path).unwrap_or(&file).to_string_lossy().as_bytes());
            }
            add(&fs::read(&file).with_context(|| format!("reading {}", file.display()))?);
        }
    }
    Ok(state)
}

/// A file itself, or all files of a folder and of folders in it, sorted; none of what is not there.
fn files(path: &Path) -> Result<Vec<PathBuf>> {
    if path.is_file() {
        return Ok(vec![path.to_path_buf()]);
    }
    if !path.is_dir() {
        return Ok(vec![]);
    }
    let mut entries: Vec<PathBuf> = fs::read_dir(path)
        .and_then(|list| list.map(|entry| entry.map(|e| e.path())).collect())
        .with_context(|| format!("reading {}", path.display()))?;
    entries.sort();
    let mut out = vec![];
    for entry in entries {
        out.extend(files(&entry)?);
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contents_and_their_borders_change_the_hash() {
        let words = |w: &[&str]| hash(&w.iter().map(|w| (*w).to_string()).collect::<Vec<_>>(), &[]).unwrap();
        assert_eq!(words(&["ab", "c"]), words(&["ab", "c"]));
        assert_ne!(words(&["ab", "c"]), words(&["a", "bc"]));
        assert_ne!(words(&["ab"]), words(&["ac"]));
    }

    #[test]
    fn a_folder_is_its_files_and_their_names() {
        let folder = std::env::temp_dir().join(format!("qv-stamp-{}", std::process::id()));
        fs::create_dir_all(folder.join("in")).unwrap();
        fs::write(folder.join("in/a"), "1").unwrap();
        let now = |folder: &PathBuf| hash(&[], std::slice::from_ref(folder)).unwrap();
        let first = now(&folder);
        fs::rename(folder.join("in/a"), folder.join("in/b")).unwrap();
        let renamed = now(&folder);
        fs::write(folder.join("in/b"), "2").unwrap();
        let changed = now(&folder);
        fs::remove_dir_all(&folder).unwrap();
        assert!(first != renamed && renamed != changed && now(&folder) != changed);
    }
}
