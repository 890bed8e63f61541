//! Files that are there whole or not at all.

use super::folder;
use super::manifest::{open_plain, sync};
use super::paths::{ENDING, shortened, temporary};
use crate::Failure;
use crate::outcome::about;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Links that are followed to a file that is not there yet.
const MOST_LINKS: usize = 40;

/// Writes a file beside its place and renames it, so that a full disk or a kill leaves the old one. In the folder of `--out DIR` it takes its place
/// when the command ends, or at the next [`super::commit`].
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    put(path, bytes).map_err(|e| about(path, format!("expected to write it, found {e}")))
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
    let is_staged = folder::begin(path).map_err(&failed)?;
    if let Some(new) = is_staged {
        write_new(&new, &failed, write).inspect_err(|_| folder::failed(&new))?;
        // It is brought to the disk when it takes its place.
        return folder::stage(new, path).map_err(failed);
    }
    if is_special(path) {
        let file = OpenOptions::new().write(true).open(path).map_err(&failed)?;
        let mut file = BufWriter::new(file);
        write(&mut file)?;
        return file.flush().map_err(failed);
    }
    let path = followed(path).map_err(&failed)?;
    remove_leftovers(&path);
    let new = temporary(&path);
    write_new(&new, &failed, |file| {
        write(file)?;
        file.flush().and_then(|()| file.get_ref().sync_all()).map_err(&failed)
    })?;
    take_place(&new, &path).map_err(failed)
}

/// Writes a file that is not there yet; an error leaves none.
fn write_new<E>(
    new: &Path,
    failed: impl Fn(io::Error) -> E,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<(), E>,
) -> Result<(), E> {
    let all = || {
        let mut options = OpenOptions::new();
        let file = open_plain(new, options.write(true).create(true).truncate(true)).map_err(&failed)?;
        // Who finds it unlocked knows that its writer is gone. Some file systems have no locks.
        _ = file.try_lock();
        let mut file = BufWriter::new(file);
        write(&mut file)?;
        file.flush().map_err(&failed)
    };
    let written = all();
    if written.is_err() {
        fs::remove_file(new).ok();
    }
    written
}

fn take_place(new: &Path, path: &Path) -> io::Result<()> {
    if let Ok(old) = fs::metadata(path) {
        // Who may read it may read the new one.
        fs::set_permissions(new, old.permissions()).ok();
    }
    let moved = fs::rename(new, path);
    match moved {
        Ok(()) => path.parent().map_or(Ok(()), |folder| sync(folder).or(Ok(()))),
        Err(_) => fs::remove_file(new).and(moved),
    }
}

/// Removes what processes left beside a file that were writing it and are gone.
fn remove_leftovers(path: &Path) {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let begin = format!(".{}.", shortened(path).to_string_lossy());
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let Some(rest) = name.to_str().and_then(|name| name.strip_prefix(&begin)) else { continue };
        let process = rest.strip_suffix(ENDING).and_then(|process| process.parse().ok());
        if process.is_some_and(|process| !is_alive(process)) && is_unlocked(&entry.path()) {
            fs::remove_file(entry.path()).ok();
        }
    }
}

fn is_unlocked(path: &Path) -> bool {
    open_plain(path, OpenOptions::new().read(true)).is_ok_and(|file| file.try_lock().is_ok())
}

/// Whether a process of this machine runs.
#[cfg(unix)]
fn is_alive(process: i32) -> bool {
    use rustix::process::{Pid, test_kill_process};
    let tested = Pid::from_raw(process).map(test_kill_process);
    matches!(tested, Some(Ok(()) | Err(rustix::io::Errno::PERM)))
}

#[cfg(not(unix))]
fn is_alive(_: i32) -> bool {
    false
}

/// Whether a path is of something that is written into: a device, a pipe, a socket, or an open file by the name of its descriptor.
fn is_special(path: &Path) -> bool {
    let Ok(found) = fs::metadata(path) else { return false };
    if found.is_dir() {
        return false;
    }
    !found.is_file() || std::path::absolute(path).is_ok_and(|path| is_descriptor(&path))
}

/// Whether a name is one of an open file, such as /dev/stdout or /proc/self/fd/1.
fn is_descriptor(path: &Path) -> bool {
    let is_of_process = path.starts_with("/proc") && path.parent().is_some_and(|folder| folder.ends_with("fd"));
    let is_stream = ["/dev/stdin", "/dev/stdout", "/dev/stderr"].iter().any(|stream| path == Path::new(stream));
    is_of_process || is_stream || path.starts_with("/dev/fd")
}

/// The file that a link leads to, whether it is there or not; another path is given as it is.
fn followed(path: &Path) -> io::Result<PathBuf> {
    let mut path = path.to_path_buf();
    for _ in 0..MOST_LINKS {
        match fs::read_link(&path) {
            Ok(to) => path = path.parent().unwrap_or(Path::new("")).join(to),
            Err(_) => return Ok(path),
        }
    }
    Err(io::Error::other("too many links"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use crate::output::paths::is_temporary;

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("qv-whole-{name}-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        folder
    }

    #[test]
    fn a_file_is_replaced_and_nothing_else_is_left() {
        let folder = folder("replaced");
        let path = folder.join("a.txt");
        write_whole(&path, b"one").unwrap();
        write_whole(&path, b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
        let failed = stream(&path, |e| e, |file| file.write_all(b"half").and(Err(io::Error::other("no space"))));
        assert_eq!((failed.unwrap_err().to_string(), fs::read(&path).unwrap()), ("no space".into(), b"two".to_vec()));
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 1, "nothing of what failed");
        let error = write_whole(&folder.join("no/such.txt"), b"x").unwrap_err().to_string();
        assert!(error.contains("such.txt") && error.states("write"), "{error}");
        let long = folder.join("é".repeat(120));
        write_whole(&long, b"long").unwrap();
        assert_eq!(fs::read(&long).unwrap(), b"long");
        fs::remove_dir_all(&folder).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn links_and_devices_stay() {
        let folder = folder("links");
        let (target, link, dangling) = (folder.join("target"), folder.join("link"), folder.join("dangling"));
        fs::write(&target, "old").unwrap();
        std::os::unix::fs::symlink("target", &link).unwrap();
        std::os::unix::fs::symlink("later", &dangling).unwrap();
        write_whole(&link, b"new").unwrap();
        write_whole(&dangling, b"new").unwrap();
        assert!(link.is_symlink() && dangling.is_symlink());
        assert_eq!([&target, &folder.join("later")].map(|path| fs::read(path).unwrap()), [b"new", b"new"]);
        write_whole(Path::new("/dev/null"), b"nothing").unwrap();
        assert!(is_special(Path::new("/dev/null")));
        assert!(is_descriptor(Path::new("/proc/self/fd/1")) && is_descriptor(Path::new("/dev/stdout")));
        assert!(!is_descriptor(Path::new("/dev/shm/scene.ply")), "a regular file there is replaced as a whole");
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn leftovers_of_the_dead_are_removed() {
        let folder = folder("leftovers");
        let path = folder.join("a.txt");
        let (dead, alive) = (folder.join(".a.txt.2147483646.qv-new"), temporary(&folder.join("b.txt")));
        for left in [&dead, &alive, &folder.join(".a.txt.qv-new"), &folder.join("a.txt.7.new")] {
            fs::write(left, "half").unwrap();
        }
        assert!(is_temporary(&dead) && is_temporary(&alive) && !is_temporary(&path));
        write_whole(&path, b"one").unwrap();
        assert!(!dead.exists() && alive.exists());
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 4, "what is not ours stays");
        fs::remove_dir_all(&folder).unwrap();
    }
}
