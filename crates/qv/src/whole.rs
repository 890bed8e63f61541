//! Files that are there whole or not at all.

use crate::Failure;
use crate::scene::about;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Writes a file beside its place and renames it, so that a full disk or a kill leaves the old one.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    put(path, bytes).map_err(|e| about(path, format!("expected to write it, found {e}")))
}

/// Whether two paths are of one file or folder, which is there.
pub fn is_same(a: &Path, b: &Path) -> bool {
    fs::canonicalize(a).is_ok_and(|a| fs::canonicalize(b).is_ok_and(|b| a == b))
}

/// Refuses to write over what is read.
pub fn refuse_inputs<'a>(out: &Path, inputs: impl IntoIterator<Item = &'a PathBuf>) -> Result<(), Failure> {
    match inputs.into_iter().find(|input| is_same(input, out)) {
        Some(input) => {
            let found = format!("found {}, which is read", input.display());
            Err(about(out, format!("expected a file of its own to write, {found}")))
        }
        None => Ok(()),
    }
}

/// The same as [`write_whole`], with the error as it is.
pub fn put(path: &Path, bytes: impl AsRef<[u8]>) -> io::Result<()> {
    stream(path, |e| e, |file| file.write_all(bytes.as_ref()))
}

/// The same for what is written piece by piece; an error of `write` leaves nothing. `failed` makes the caller's error of one of the file.
pub fn stream<E>(
    path: &Path,
    failed: impl Fn(io::Error) -> E,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<(), E>,
) -> Result<(), E> {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    // Two processes that write one file do not write into each other's.
    name.push(format!(".{}.new", std::process::id()));
    let new = path.with_file_name(name);
    let all = || {
        let mut file = BufWriter::new(File::create(&new).map_err(&failed)?);
        write(&mut file)?;
        file.flush().map_err(&failed)?;
        drop(file);
        fs::rename(&new, path).map_err(&failed)
    };
    let written = all();
    if written.is_err() {
        fs::remove_file(&new).ok();
    }
    written
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
        let failed = stream(&path, |e| e, |file| file.write_all(b"half").and(Err(io::Error::other("no space"))));
        assert_eq!((failed.unwrap_err().to_string(), fs::read(&path).unwrap()), ("no space".into(), b"two".to_vec()));
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 1, "nothing of what failed");
        let error = write_whole(&folder.join("no/such.txt"), b"x").unwrap_err().to_string();
        assert!(error.contains("such.txt") && error.contains("expected to write it"), "{error}");
        fs::remove_dir_all(&folder).unwrap();
    }
}
