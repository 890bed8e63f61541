//! One process at a time: a lock of the system on a file, which ends with the processes that hold it.

use crate::Failure;
use crate::outcome::about;
use crate::output::open_plain;
use crate::progress::remark;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// How often a lock that somebody holds is tried again.
const AGAIN: Duration = Duration::from_millis(100);

/// A lock that is held. A child that gets a copy of its file holds it, too, as long as it lives.
pub struct Lock {
    file: File,
    path: PathBuf,
}

/// What came of trying.
pub enum LockAttempt {
    Taken(Lock),
    /// Who has it, in words.
    HeldBy(String),
}

impl Lock {
    /// Takes the lock on `path` if nobody has it. What a process left that died with it is reported.
    ///
    /// # Errors
    /// The file cannot be made, or its file system has no locks.
    pub fn try_take(path: &Path) -> Result<LockAttempt, Failure> {
        let failed = |e: io::Error| about(path, format!("expected to lock it, found {e}"));
        // Neither a link is followed nor a file changed that is none of a lock.
        let mut options = OpenOptions::new();
        let mut file = open_plain(path, options.read(true).write(true).create(true).truncate(false)).map_err(failed)?;
        let before = holder(&mut file).map_err(failed)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let who = if before.is_empty() { "a process that is ending".into() } else { before };
                return Ok(LockAttempt::HeldBy(who));
            }
            Err(TryLockError::Error(e)) => return Err(failed(e)),
        }
        // It may have been written between its opening and its locking.
        let before = holder(&mut file).map_err(failed)?;
        if !before.is_empty() {
            remark(&format!("{}: took over the lock of {before}, which is gone", path.display()));
        }
        let own = format!("process {} on {}", std::process::id(), host());
        let mut lock = Self { file, path: path.into() };
        lock.write(&own).map_err(failed)?;
        Ok(LockAttempt::Taken(lock))
    }

    /// Waits until nobody has it; none where `stop` became true meanwhile.
    ///
    /// # Errors
    /// As [`Lock::try_take`].
    pub fn wait(path: &Path, stop: &AtomicBool) -> Result<Option<Self>, Failure> {
        let mut is_told = false;
        while !stop.load(Ordering::Relaxed) {
            match Self::try_take(path)? {
                LockAttempt::Taken(lock) => return Ok(Some(lock)),
                LockAttempt::HeldBy(_) if is_told => {}
                LockAttempt::HeldBy(who) => {
                    remark(&format!("{}: waits for {who}", path.display()));
                    is_told = true;
                }
            }
            std::thread::sleep(AGAIN);
        }
        Ok(None)
    }

    /// For a child to hold.
    pub fn copy(&self) -> Result<File, Failure> {
        self.file.try_clone().map_err(|e| about(&self.path, format!("expected to share the lock, found {e}")))
    }

    /// Removes the file of a lock that is held.
    pub fn remove(&self) {
        fs::remove_file(&self.path).ok();
    }

    /// Removes the file of a lock that this process holds and ends with.
    pub fn remove_own(path: &Path) {
        let own = format!("{BEGIN}{} ", std::process::id());
        let held = open_plain(path, OpenOptions::new().read(true)).and_then(|mut file| holder(&mut file));
        if held.is_ok_and(|text| text.starts_with(&own)) {
            fs::remove_file(path).ok();
        }
    }

    /// Removes the file of a lock whose holder is gone.
    pub fn remove_left(path: &Path) {
        let left = open_plain(path, OpenOptions::new().read(true).write(true));
        let is_left =
            |mut file: File| holder(&mut file).is_ok() && !matches!(file.try_lock(), Err(TryLockError::WouldBlock));
        if left.is_ok_and(is_left) {
            fs::remove_file(path).ok();
        }
    }

    /// Whether locks are not to be had where a file lies.
    pub fn are_missing(path: &Path) -> bool {
        let tried = open_plain(path, OpenOptions::new().write(true)).map(|file| file.try_lock());
        matches!(tried, Ok(Err(TryLockError::Error(e))) if e.kind() == ErrorKind::Unsupported)
    }

    /// Whether the file that is locked is the one that has the name.
    #[cfg(unix)]
    pub fn is_at_its_place(&self) -> bool {
        use std::os::unix::fs::MetadataExt;
        let (named, locked) = (fs::metadata(&self.path), self.file.metadata());
        matches!((named, locked), (Ok(a), Ok(b)) if (a.dev(), a.ino()) == (b.dev(), b.ino()))
    }

    /// A file that is open cannot be removed there.
    #[cfg(not(unix))]
    pub fn is_at_its_place(&self) -> bool {
        self.path.exists()
    }

    fn write(&mut self, text: &str) -> io::Result<()> {
        self.file.set_len(0)?;
        self.file.seek(SeekFrom::Start(0))?;
        self.file.write_all(text.as_bytes())
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Nobody is to take it over: this ended well.
        self.write("").ok();
    }
}

/// How the text of a lock begins. One that ended well is empty.
const BEGIN: &str = "process ";
/// Longest text that is reported for a lock \[characters\].
const MOST: usize = 120;

/// Who holds a lock, or held it, as the file says; empty where nobody does.
///
/// # Errors
/// The text is none of a lock.
fn holder(file: &mut File) -> io::Result<String> {
    let mut bytes = vec![];
    file.seek(SeekFrom::Start(0))?;
    file.take(4096).read_to_end(&mut bytes)?;
    let text = String::from_utf8_lossy(&bytes);
    if !text.is_empty() && !text.starts_with(BEGIN) {
        return Err(io::Error::other(format!("a file that does not begin with '{}'", BEGIN.trim())));
    }
    Ok(text.chars().take(MOST).flat_map(char::escape_debug).collect())
}

/// The name of this machine.
fn host() -> String {
    let remarks = fs::read_to_string("/proc/sys/kernel/hostname").ok().or_else(|| std::env::var("HOSTNAME").ok());
    remarks.map_or("this machine".into(), |name| name.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn what_is_no_lock_is_neither_changed_nor_told() {
        let folder = std::env::temp_dir().join(format!("qv-no-lock-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let (secret, link, hard) = (folder.join("secret"), folder.join("link"), folder.join("hard"));
        fs::write(&secret, "password").unwrap();
        std::os::unix::fs::symlink(&secret, &link).unwrap();
        fs::hard_link(&secret, &hard).unwrap();
        for path in [&link, &hard, &secret] {
            let error = Lock::try_take(path).err().unwrap().to_string();
            assert!(!error.contains("password"), "{error}");
            Lock::remove_left(path);
        }
        assert_eq!(fs::read_to_string(&link).unwrap(), "password");
        assert!(hard.exists());
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_lock_is_held_once_and_taken_over() {
        let path = std::env::temp_dir().join(format!("qv-lock-{}", std::process::id()));
        let LockAttempt::Taken(lock) = Lock::try_take(&path).unwrap() else { panic!("nobody has it") };
        let LockAttempt::HeldBy(who) = Lock::try_take(&path).unwrap() else { panic!("it is held") };
        assert!(who.starts_with(&format!("process {} on ", std::process::id())), "{who}");
        let copy = lock.copy().unwrap();
        drop(lock);
        assert!(matches!(Lock::try_take(&path).unwrap(), LockAttempt::HeldBy(_)), "a copy holds it");
        drop(copy);
        let stopped = AtomicBool::new(true);
        assert!(Lock::wait(&path, &stopped).unwrap().is_none());
        assert!(Lock::wait(&path, &AtomicBool::new(false)).unwrap().is_some());
        assert_eq!(fs::read_to_string(&path).unwrap(), "", "who ends well leaves no name");
        fs::remove_file(&path).unwrap();
    }
}
