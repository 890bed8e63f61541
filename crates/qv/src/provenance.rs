//! Where an output comes from: the program, the words of its command line, and the files that it read with their hashes.

use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// For JSON: `program`, `version`, `arguments`, `inputs` (`path`, `bytes`, `sha256`; of a folder its files, by name). What is no path, such as a
/// ground that is built in, stands in the arguments alone.
pub fn provenance<'p>(paths: impl IntoIterator<Item = &'p Path>) -> Value {
    let inputs: Vec<Value> = paths.into_iter().flat_map(files).filter_map(|path| input(&path)).collect();
    json!({
        "program": "qv",
        "version": env!("CARGO_PKG_VERSION"),
        "arguments": crate::config::arguments(),
        "inputs": inputs,
    })
}

/// The files that a path is.
fn files(path: &Path) -> Vec<PathBuf> {
    if !path.is_dir() {
        return vec![path.to_path_buf()];
    }
    let mut inside: Vec<PathBuf> = fs::read_dir(path).into_iter().flatten().flatten().map(|e| e.path()).collect();
    // The manifest of what we wrote there is none of the input.
    inside.retain(|path| path.is_file() && path.file_name() != Some(crate::output::MANIFEST.as_ref()));
    inside.sort();
    inside
}

/// A file; `None` where there is none that can be read once more.
fn input(path: &Path) -> Option<Value> {
    let mut hash = Hash(Sha256::new());
    let bytes = io::copy(&mut File::open(path).ok().filter(|_| path.is_file())?, &mut hash).ok()?;
    let sha256: String = hash.0.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    Some(json!({ "path": path.display().to_string(), "bytes": bytes, "sha256": sha256 }))
}

/// A hash that is written to.
struct Hash(Sha256);

impl Write for Hash {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_named_with_their_hashes() {
        let folder = std::env::temp_dir().join(format!("qv-provenance-{}", std::process::id()));
        fs::create_dir_all(folder.join("inside")).unwrap();
        fs::write(folder.join("b.txt"), "abc").unwrap();
        fs::write(folder.join("a.txt"), "").unwrap();
        let found = provenance([folder.as_path(), Path::new("plane")]);
        let inputs = found["inputs"].as_array().unwrap();
        assert_eq!(inputs.len(), 2, "a ground that is built in is no file: {found:#}");
        assert!(inputs[0]["path"].as_str().unwrap().ends_with("a.txt"));
        // FIPS 180-2, appendix B.1.
        let right = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!((inputs[1]["bytes"].as_u64(), inputs[1]["sha256"].as_str()), (Some(3), Some(right)));
        fs::remove_dir_all(folder).unwrap();
    }
}
