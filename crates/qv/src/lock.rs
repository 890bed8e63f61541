//! One process at a time: a lock of the system on a file, which ends with the processes that hold it.

use crate::Failure;
use crate::progress::remark;
use crate::scene::about;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{ErrorKind, Read, Seek, SeekFrom, Write};
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

    /// Whether the file that is locked is the one that has the name.
    #[cfg(unix)]
    fn is_at_its_place(&self) -> bool {
        use std::os::unix::fs::MetadataExt;
        let (named, locked) = (fs::metadata(&self.path), self.file.metadata());
        matches!((named, locked), (Ok(a), Ok(b)) if (a.dev(), a.ino()) == (b.dev(), b.ino()))
    }

    /// A file that is open cannot be removed there.
    #[cfg(not(unix))]
    fn is_at_its_place(&self) -> bool {
        self.path.exists()
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

/// Name of the lock in a folder that a command writes into.
const IN_OUTPUT: &str = "qv.lock";

/// A folder that is written into, by one process at a time. At the end nothing of the lock is left.
pub struct OutputFolder {
    /// None on a file system without locks.
    lock: Option<Lock>,
    /// Folders that were made for it, outermost first.
    made: Vec<PathBuf>,
}

impl OutputFolder {
    /// Takes the lock on a folder, which is made if need be.
    ///
    /// # Errors
    /// Somebody has it, or the folder cannot be made or written into.
    pub fn take(folder: &Path) -> Result<Self, Failure> {
        let mut made: Vec<PathBuf> =
            folder.ancestors().take_while(|one| !one.exists()).map(Path::to_path_buf).collect();
        made.retain(|one| !one.as_os_str().is_empty());
        made.reverse();
        fs::create_dir_all(folder).map_err(|e| about(folder, format!("expected a folder, found {e}")))?;
        let file = folder.join(IN_OUTPUT);
        loop {
            let lock = match Lock::try_take(&file) {
                Ok(Tried::Taken(lock)) => lock,
                Ok(Tried::HeldBy(who)) => {
                    let expected = "expected nobody else to write into this folder";
                    return Err(about(folder, format!("{expected}, found {who}; wait for it, or name another folder")));
                }
                Err(error) if has_no_locks(&file) => {
                    remark(&format!("{error}; take care that nothing else writes into this folder"));
                    fs::remove_file(&file).ok();
                    return Ok(Self { lock: None, made });
                }
                Err(error) => return Err(error),
            };
            // Who had it may have removed the file between its opening and its locking here.
            if lock.is_at_its_place() {
                return Ok(Self { lock: Some(lock), made });
            }
        }
    }
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        if let Some(lock) = &self.lock {
            fs::remove_file(&lock.path).ok();
        }
        // What was made for a command that wrote nothing: a folder with something in it stays.
        self.made.iter().rev().for_each(|folder| drop(fs::remove_dir(folder)));
    }
}

/// Whether locks are not to be had where a file lies.
fn has_no_locks(path: &Path) -> bool {
    let tried = OpenOptions::new().write(true).open(path).map(|file| file.try_lock());
    matches!(tried, Ok(Err(TryLockError::Error(e))) if e.kind() == ErrorKind::Unsupported)
}

fn holder(file: &mut File) -> String {
    let mut text = String::new();
    file.seek(SeekFrom::Start(0)).and_then(|_| file.read_to_string(&mut text)).ok();
    text
}

/// The name of this machine.
fn host() -> String {
    let told = fs::read_to_string("/proc/sys/kernel/hostname").ok().or_else(|| std::env::var("HOSTNAME").ok());
    told.map_or("this machine".into(), |name| name.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_output_folder_has_one_writer_and_keeps_nothing_of_the_lock() {
        let root = std::env::temp_dir().join(format!("qv-output-{}", std::process::id()));
        let folder = root.join("a/b");
        let first = OutputFolder::take(&folder).unwrap();
        let second = OutputFolder::take(&folder).err().unwrap().to_string();
        assert!(second.contains(&format!("found process {} on ", std::process::id())), "{second}");
        drop(first);
        assert!(!root.exists(), "nothing was written into it");
        let again = OutputFolder::take(&folder).unwrap();
        fs::write(folder.join("result"), "").unwrap();
        drop(again);
        let left: Vec<_> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(left, ["result"]);
        fs::write(folder.join(IN_OUTPUT), "process 1 on another").unwrap();
        drop(OutputFolder::take(&folder).unwrap());
        assert!(!folder.join(IN_OUTPUT).exists(), "who died with it is followed");
        fs::write(root.join("file"), "").unwrap();
        let error = OutputFolder::take(&root.join("file")).err().unwrap().to_string();
        assert!(error.contains("expected a folder"), "{error}");
        fs::remove_dir_all(&root).unwrap();
    }

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
        assert_eq!(fs::read_to_string(&path).unwrap(), "", "who ends well leaves no name");
        fs::remove_file(&path).unwrap();
    }
}
