//! One process at a time: a lock of the system on a file, which ends with the processes that hold it.

use crate::Failure;
use crate::progress::remark;
use crate::scene::about;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Seek, SeekFrom, Write};
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
pub enum Tried {
    Taken(Lock),
    /// Who has it, in words.
    HeldBy(String),
}

impl Lock {
    /// Takes the lock on `path` if nobody has it. What a process left that died with it is told.
    ///
    /// # Errors
    /// The file cannot be made, or its file system has no locks.
    pub fn try_take(path: &Path) -> Result<Tried, Failure> {
        let failed = |e: std::io::Error| about(path, format!("expected to lock it, found {e}"));
        let mut file =
            OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path).map_err(failed)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let who = holder(&mut file);
                return Ok(Tried::HeldBy(if who.is_empty() { "a process that is ending".into() } else { who }));
            }
            Err(TryLockError::Error(e)) => return Err(failed(e)),
        }
        let before = holder(&mut file);
        if !before.is_empty() {
            remark(&format!("{}: took over the lock of {before}, which is gone", path.display()));
        }
        let own = format!("process {} on {}", std::process::id(), host());
        let mut lock = Self { file, path: path.into() };
        lock.write(&own).map_err(failed)?;
        Ok(Tried::Taken(lock))
    }

    /// Waits until nobody has it; none where `stop` became true meanwhile.
    ///
    /// # Errors
    /// As [`Lock::try_take`].
    pub fn wait(path: &Path, stop: &AtomicBool) -> Result<Option<Self>, Failure> {
        let mut is_told = false;
        while !stop.load(Ordering::Relaxed) {
            match Self::try_take(path)? {
                Tried::Taken(lock) => return Ok(Some(lock)),
                Tried::HeldBy(_) if is_told => {}
                Tried::HeldBy(who) => {
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

    fn write(&mut self, text: &str) -> std::io::Result<()> {
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

fn holder(file: &mut File) -> String {
    let mut text = String::new();
    file.seek(SeekFrom::Start(0)).and_then(|_| file.read_to_string(&mut text)).ok();
    text
}

/// The name of this machine.
fn host() -> String {
    let told = std::fs::read_to_string("/proc/sys/kernel/hostname").ok().or_else(|| std::env::var("HOSTNAME").ok());
    told.map_or("this machine".into(), |name| name.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lock_is_held_once_and_taken_over() {
        let path = std::env::temp_dir().join(format!("qv-lock-{}", std::process::id()));
        let Tried::Taken(lock) = Lock::try_take(&path).unwrap() else { panic!("nobody has it") };
        let Tried::HeldBy(who) = Lock::try_take(&path).unwrap() else { panic!("it is held") };
        assert!(who.starts_with(&format!("process {} on ", std::process::id())), "{who}");
        let copy = lock.copy().unwrap();
        drop(lock);
        assert!(matches!(Lock::try_take(&path).unwrap(), Tried::HeldBy(_)), "a copy holds it");
        drop(copy);
        let stopped = AtomicBool::new(true);
        assert!(Lock::wait(&path, &stopped).unwrap().is_none());
        assert!(Lock::wait(&path, &AtomicBool::new(false)).unwrap().is_some());
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "", "who ends well leaves no name");
        std::fs::remove_file(&path).unwrap();
    }
}
