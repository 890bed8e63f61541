//! Files with their hashes.

use crate::Failure;
use crate::outcome::about;
use qv_fleet::InputFile;
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Bytes that are read at once.
const PIECE: usize = 1 << 17;

/// A file with size and hash.
///
/// # Errors
/// It cannot be read.
pub fn input(path: &Path) -> Result<InputFile, Failure> {
    let failed = |e: std::io::Error| about(path, format!("expected a readable file, found {e}"));
    let (mut file, mut hash, mut bytes) = (File::open(path).map_err(failed)?, Sha256::new(), 0);
    let mut piece = vec![0; PIECE];
    loop {
        let count = file.read(&mut piece).map_err(failed)?;
        if count == 0 {
            break;
        }
        hash.update(&piece[..count]);
        bytes += count as u64;
    }
    let sha256 = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    Ok(InputFile { path: path.display().to_string(), bytes, sha256 })
}
