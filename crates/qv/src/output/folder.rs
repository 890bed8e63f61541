//! The folder of `--out DIR`: written into by one process at a time, changed as a whole.
//!
//! The folder belongs to the process, as standard output does: whatever is written below it is staged, and takes its place with all else at a
//! commit. The moves of a commit are stated in the manifest before they are made, so that the next owner of the folder ends them if this one
//! is killed between two.

use super::inputs::refuse_read;
use super::manifest::{Manifest, exists, files_below, hash, sync};
use super::paths::temporary;
use crate::Failure;
use crate::lock::{Lock, LockAttempt};
use crate::outcome::about;
use crate::progress::remark;
use crate::terminal::print_message;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::{fs, io};

/// Name of the lock in a folder that a command writes into.
const LOCK: &str = "qv.lock";

/// The folder that this process writes into.
static CURRENT: Mutex<Option<Current>> = Mutex::new(None);

struct Current {
    /// The folder, without links.
    root: PathBuf,
    manifest: Manifest,
    /// Files that are written and wait, with the places that they take.
    staged: Vec<(PathBuf, PathBuf)>,
    /// Our files that a commit removes.
    unwanted: Vec<PathBuf>,
    /// Files that this process put there.
    written: BTreeSet<PathBuf>,
    /// Folders that were made for what is staged, outermost first.
    made: Vec<PathBuf>,
    /// Folders that were claimed.
    claimed: Vec<PathBuf>,
    /// Folders that were made so that the folder is there, outermost first.
    made_for_it: Vec<PathBuf>,
}

impl Current {
    /// A path below the folder, without links in its own folder; none for others.
    fn inside(&self, path: &Path) -> Option<PathBuf> {
        let name = path.file_name()?;
        let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let path = fs::canonicalize(parent).ok()?.join(name);
        path.starts_with(&self.root).then_some(path)
    }

    fn commit(&mut self) -> io::Result<()> {
        for (_, to) in &self.staged {
            if exists(to) && !self.written.contains(to) && !self.manifest.owns(to) {
                keep_aside(to)?;
            }
        }
        for (from, to) in &self.staged {
            self.manifest.own(to, &hash(from)?)?;
            // What other programs work on can be made again.
            if !self.claimed.iter().any(|folder| to.starts_with(folder)) {
                sync(from)?;
            }
        }
        let staged = std::mem::take(&mut self.staged);
        self.manifest.make_moves(&staged)?;
        for path in std::mem::take(&mut self.unwanted) {
            if !staged.iter().any(|(_, to)| *to == path) {
                self.manifest.remove(&path)?;
            }
        }
        self.written.extend(staged.into_iter().map(|(_, to)| to));
        self.made.clear();
        Ok(())
    }

    /// Lists what is in the folders that were claimed: nothing that comes into them from now on is ours.
    fn release(&mut self) -> io::Result<()> {
        let claimed = std::mem::take(&mut self.claimed);
        claimed.iter().try_for_each(|folder| self.manifest.release(folder))
    }

    /// Removes what is staged.
    fn discard(&mut self) {
        for (from, _) in self.staged.drain(..) {
            _ = fs::remove_file(&from);
            self.manifest.end(&from);
        }
        self.unwanted.clear();
        self.made.drain(..).rev().for_each(|folder| _ = fs::remove_dir(folder));
    }
}

/// Renames a file that is not ours, and says so: another takes its place.
fn keep_aside(path: &Path) -> io::Result<()> {
    let name = path.file_name().unwrap_or_default();
    let kept = (1..).map(|k| {
        let mut kept = name.to_os_string();
        kept.push(format!(".kept-{k}"));
        path.with_file_name(kept)
    });
    let Some(kept) = kept.into_iter().find(|kept| !exists(kept)) else { return Ok(()) };
    fs::rename(path, &kept)?;
    print_message!("'{}' was not written by qv, or was changed: it is kept as '{}'", path.display(), kept.display());
    Ok(())
}

fn with_current<T>(of: impl FnOnce(&mut Current) -> io::Result<T>) -> io::Result<Option<T>> {
    let mut current = CURRENT.lock().unwrap_or_else(|e| e.into_inner());
    current.as_mut().map(of).transpose()
}

/// Where a file of the output folder is written first; none for files elsewhere.
pub fn begin(path: &Path) -> io::Result<Option<PathBuf>> {
    let begun = with_current(|current| {
        let Some(path) = current.inside(path) else { return Ok(None) };
        refuse_read(&path)?;
        let new = temporary(&path);
        current.manifest.begin(&new)?;
        Ok(Some(new))
    })?;
    Ok(begun.flatten())
}

/// States that a file that was begun is gone again.
pub fn failed(new: &Path) {
    _ = with_current(|current| {
        current.manifest.end(new);
        Ok(())
    });
}

/// Adds a file that is written to those that take their places together.
pub fn stage(new: PathBuf, path: &Path) -> io::Result<()> {
    let staged = with_current(|current| {
        let path = current.inside(path).ok_or_else(|| io::Error::other("its folder is gone"))?;
        current.staged.retain(|(_, to)| *to != path);
        current.staged.push((new, path));
        Ok(())
    })?;
    staged.ok_or_else(|| io::Error::other("no folder is written into"))
}

/// The file to read to see what was written as `path`.
pub fn staged(path: &Path) -> PathBuf {
    let found = with_current(|current| {
        let inside = current.inside(path);
        Ok(current.staged.iter().find(|(_, to)| Some(to) == inside.as_ref()).map(|(from, _)| from.clone()))
    });
    found.ok().flatten().flatten().unwrap_or_else(|| path.into())
}

/// Puts all that was written so far in its place.
///
/// # Errors
/// The folder cannot be written into: then what was not moved yet is not.
pub fn commit() -> io::Result<()> {
    with_current(Current::commit).map(|_| ())
}

/// Removes a file of the output folder at the next commit, if it is ours.
pub fn remove(path: &Path) {
    _ = with_current(|current| {
        current.unwanted.extend(current.inside(path));
        Ok(())
    });
}

/// Makes a folder. One in the output folder is removed again if nothing is written into it.
pub fn make_folder(path: &Path) -> io::Result<()> {
    let mut missing: Vec<PathBuf> = path.ancestors().take_while(|one| !one.exists()).map(Path::to_path_buf).collect();
    missing.retain(|one| !one.as_os_str().is_empty());
    fs::create_dir_all(path)?;
    with_current(|current| {
        let made = missing.iter().rev().filter_map(|one| fs::canonicalize(one).ok());
        current.made.extend(made.filter(|one| one.starts_with(&current.root)));
        Ok(())
    })?;
    Ok(())
}

/// Takes a folder in the output folder for what this command, and programs that it calls, write there at once. Our files in it are removed if
/// `empty` says so.
///
/// # Errors
/// Something in it is not ours, or it is a link.
pub fn claim(folder: &Path, empty: bool) -> Result<(), Failure> {
    let cannot = |reason: String| -> Failure {
        let hint = "move it away, or name another folder with --out";
        format!("cannot write into '{}': {reason}; {hint}", folder.display()).into()
    };
    if folder.is_symlink() || exists(folder) && !folder.is_dir() {
        return Err(cannot("it is a link or a file".into()));
    }
    make_folder(folder).map_err(|e| cannot(e.to_string()))?;
    let claimed = with_current(|current| {
        let folder = fs::canonicalize(folder)?;
        let is_foreign = |path: &PathBuf| !current.manifest.owns(path);
        if let Some(foreign) = files_below(&folder).into_iter().find(is_foreign) {
            return Err(io::Error::other(format!("'{}' was not written by qv, or was changed", foreign.display())));
        }
        if empty {
            current.manifest.clear(&folder)?;
            fs::create_dir_all(&folder)?;
        }
        current.manifest.claim(&folder)?;
        current.claimed.push(folder);
        Ok(())
    });
    claimed.map(|_| ()).map_err(|e| cannot(e.to_string()))
}

/// Lists what is in the folders that were claimed: their work is done.
pub fn keep_what_is_claimed() -> io::Result<()> {
    with_current(Current::release).map(|_| ())
}

/// Removes our files in a folder: one below the output folder, or the output folder of another process that ended. Other files stay.
///
/// # Errors
/// A file of ours cannot be removed, or there is a file with the name of the manifest that is none.
pub fn clear(folder: &Path) -> io::Result<()> {
    if !folder.is_dir() || folder.is_symlink() {
        return Ok(());
    }
    let root = fs::canonicalize(folder)?;
    let own = with_current(|current| match root.starts_with(&current.root) {
        true => current.manifest.clear(&root).map(|()| true),
        false => Ok(false),
    })?;
    if own == Some(true) {
        return Ok(());
    }
    let mut manifest = Manifest::read(&root)?;
    manifest.recover()?;
    manifest.clear(&root)?;
    manifest.rewrite()?;
    Lock::remove_left(&root.join(LOCK));
    // It stays where there is something else in it.
    _ = fs::remove_dir(folder);
    Ok(())
}

/// Gives the folder back as it was, since the process ends now. Nothing is written into it any more: whoever begins to waits until the end.
pub fn abandon() {
    let mut locked = CURRENT.lock().unwrap_or_else(|e| e.into_inner());
    if let Some(current) = locked.as_mut() {
        current.discard();
        // What another thread is writing is left to the next owner.
        _ = current.release().and_then(|()| current.manifest.rewrite());
        Lock::remove_own(&current.root.join(LOCK));
        current.made_for_it.iter().rev().for_each(|folder| _ = fs::remove_dir(folder));
    }
    std::mem::forget(locked);
}

/// A folder that is written into, by one process at a time. At the end nothing of the lock is left.
pub struct OutputFolder {
    /// None on a file system without locks.
    lock: Option<Lock>,
    /// Folders that were made for it, outermost first.
    made: Vec<PathBuf>,
}

impl OutputFolder {
    /// Takes the lock on a folder, which is made if need be, and ends what a process left there that was killed.
    ///
    /// # Errors
    /// Somebody has it, or the folder cannot be made or written into.
    pub fn take(folder: &Path) -> Result<Self, Failure> {
        let taken = Self::locked(folder)?;
        let cannot = |e: io::Error| format!("cannot write into '{}': {e}", folder.display());
        let root = fs::canonicalize(folder).map_err(cannot)?;
        let mut manifest = Manifest::read(&root).map_err(cannot)?;
        manifest.recover().map_err(cannot)?;
        let current = Current {
            root,
            manifest,
            staged: vec![],
            unwanted: vec![],
            written: BTreeSet::new(),
            made: vec![],
            claimed: vec![],
            made_for_it: taken.made.clone(),
        };
        *CURRENT.lock().unwrap_or_else(|e| e.into_inner()) = Some(current);
        Ok(taken)
    }

    fn locked(folder: &Path) -> Result<Self, Failure> {
        let mut made: Vec<PathBuf> =
            folder.ancestors().take_while(|one| !one.exists()).map(Path::to_path_buf).collect();
        made.retain(|one| !one.as_os_str().is_empty());
        made.reverse();
        fs::create_dir_all(folder).map_err(|e| about(folder, format!("expected a folder, found {e}")))?;
        let file = folder.join(LOCK);
        loop {
            let lock = match Lock::try_take(&file) {
                Ok(LockAttempt::Taken(lock)) => lock,
                Ok(LockAttempt::HeldBy(who)) => {
                    let expected = "expected nobody else to write into this folder";
                    return Err(about(folder, format!("{expected}, found {who}; wait for it, or name another folder")));
                }
                Err(error) if Lock::are_missing(&file) => {
                    remark(&format!("{error}; take care that nothing else writes into this folder"));
                    Lock::remove_left(&file);
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

    /// Ends the work: with `keep` all that was written takes its place, else nothing more does.
    ///
    /// # Errors
    /// The folder cannot be written into.
    pub fn end(self, keep: bool) -> Result<(), Failure> {
        let Some(mut current) = CURRENT.lock().unwrap_or_else(|e| e.into_inner()).take() else { return Ok(()) };
        let committed = if keep { current.commit() } else { Ok(()) };
        current.discard();
        let listed = current.release().and_then(|()| current.manifest.rewrite());
        let cannot = |e| format!("cannot write into '{}': {e}", current.root.display()).into();
        committed.and(listed).map_err(cannot)
    }
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        self.lock.iter().for_each(Lock::remove);
        // What was made for a command that wrote nothing: a folder with something in it stays.
        self.made.iter().rev().for_each(|folder| drop(fs::remove_dir(folder)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    /// The folder belongs to the process: one test at a time has one.
    #[test]
    fn a_folder_is_changed_as_a_whole_and_keeps_what_is_not_ours() {
        let root = std::env::temp_dir().join(format!("qv-output-{}", std::process::id()));
        let folder = root.join("a/b");
        let first = OutputFolder::take(&folder).unwrap();
        let second = OutputFolder::take(&folder).err().unwrap().to_string();
        assert!(second.contains(&format!("found process {} on ", std::process::id())), "{second}");
        first.end(true).unwrap();
        assert!(!root.exists(), "nothing was written into it");
        let put = |name: &str, text: &str| super::super::put(&folder.join(name), text).unwrap();
        let names = || {
            let all = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
            let mut all: Vec<String> = all.collect();
            all.sort();
            all
        };
        let out = OutputFolder::take(&folder).unwrap();
        put("result", "one");
        assert!(!folder.join("result").exists());
        assert_eq!(fs::read_to_string(staged(&folder.join("result"))).unwrap(), "one");
        out.end(true).unwrap();
        assert_eq!(names(), [".qv-files", "result"]);
        // Ours is replaced; what somebody wrote or changed is kept.
        fs::write(folder.join("other"), "theirs").unwrap();
        let out = OutputFolder::take(&folder).unwrap();
        put("result", "two");
        put("other", "ours");
        out.end(true).unwrap();
        assert_eq!(names(), [".qv-files", "other", "other.kept-1", "result"]);
        assert_eq!(fs::read_to_string(folder.join("other.kept-1")).unwrap(), "theirs");
        // What fails leaves the old.
        let out = OutputFolder::take(&folder).unwrap();
        make_folder(&folder.join("more/inside")).unwrap();
        put("result", "three");
        put("more/inside/x", "x");
        out.end(false).unwrap();
        assert_eq!(fs::read_to_string(folder.join("result")).unwrap(), "two");
        assert_eq!(names(), [".qv-files", "other", "other.kept-1", "result"]);
        // A claimed folder must be ours.
        let out = OutputFolder::take(&folder).unwrap();
        fs::create_dir_all(folder.join("work")).unwrap();
        fs::write(folder.join("work/photograph"), "theirs").unwrap();
        assert!(claim(&folder.join("work"), true).unwrap_err().to_string().contains("photograph"));
        claim(&folder.join("own"), true).unwrap();
        fs::write(folder.join("own/database"), "by another program").unwrap();
        keep_what_is_claimed().unwrap();
        remove(&folder.join("work/photograph"));
        remove(&folder.join("result"));
        out.end(true).unwrap();
        assert!(folder.join("work/photograph").exists() && !folder.join("result").exists());
        // A command that fails leaves no claim: what comes into the folder later is not ours.
        let out = OutputFolder::take(&folder).unwrap();
        claim(&folder.join("own"), true).unwrap();
        out.end(false).unwrap();
        fs::create_dir_all(folder.join("own")).unwrap();
        fs::write(folder.join("own/frame.jpg"), "theirs").unwrap();
        let out = OutputFolder::take(&folder).unwrap();
        assert!(claim(&folder.join("own"), true).is_err());
        out.end(true).unwrap();
        clear(&folder).unwrap();
        assert_eq!(names(), ["other.kept-1", "own", "work"]);
        fs::write(folder.join(LOCK), "process 1 on another").unwrap();
        OutputFolder::take(&folder).unwrap().end(true).unwrap();
        assert!(!folder.join(LOCK).exists(), "who died with it is followed");
        let error = OutputFolder::take(&folder.join("other.kept-1")).err().unwrap().to_string();
        assert!(error.states("folder"), "{error}");
        fs::remove_dir_all(&root).unwrap();
    }
}
