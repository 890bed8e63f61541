//! The list of files in an output folder that this program wrote.
//!
//! The file `.qv-files` has a line that says what it is, then a record of JSON a line. Records are added while a command works, and the file is
//! written anew, sorted, when it ends. A file is ours if the manifest has its path and the hash of its contents.

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::path::{Component, Path, PathBuf};

/// Name of the file.
pub const FILE: &str = ".qv-files";
/// Its first line.
const HEAD: &str = "qv-files/1";
/// Largest manifest that is read \[bytes\].
const MOST: u64 = 1 << 28;

/// A line of the manifest. Paths are relative to the folder, with `/` between names.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum Record {
    /// A file with these contents is ours.
    File { path: String, sha256: String },
    /// A file that is being written, and is to be renamed.
    Temporary { path: String },
    /// All below this folder is ours: programs that this one calls write there.
    Claimed { path: String },
    /// What was claimed is listed file by file from here on.
    Released { path: String },
    /// Files that are written, and take their places now.
    Moves { from_to: Vec<[String; 2]> },
    /// The moves were made.
    Moved,
}

/// The files of a folder that are ours.
#[derive(Debug, Default)]
pub struct Manifest {
    root: PathBuf,
    /// Hashes by path: several where a file was to be replaced and may not have been.
    files: BTreeMap<String, BTreeSet<String>>,
    temporary: BTreeSet<String>,
    claimed: BTreeSet<String>,
    moves: Vec<[String; 2]>,
}

impl Manifest {
    /// Reads the manifest of a folder. A folder without one owns nothing; a last line that was cut off is ignored.
    ///
    /// # Errors
    /// A file of that name is not a manifest, or cannot be read.
    pub fn read(root: &Path) -> io::Result<Self> {
        let mut manifest = Self { root: root.into(), ..Self::default() };
        let path = root.join(FILE);
        let file = match open_plain(&path, OpenOptions::new().read(true)) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(manifest),
            file => file?,
        };
        let mut text = String::new();
        file.take(MOST).read_to_string(&mut text)?;
        let mut lines = text.lines();
        if lines.next() != Some(HEAD) {
            return Err(io::Error::other(format!("'{FILE}' does not begin with {HEAD}")));
        }
        lines.filter_map(|line| serde_json::from_str(line).ok()).for_each(|record| manifest.take(record));
        Ok(manifest)
    }

    fn take(&mut self, record: Record) {
        match record {
            Record::File { path, sha256 } if is_inside(&path) => _ = self.files.entry(path).or_default().insert(sha256),
            Record::Temporary { path } if is_inside(&path) => _ = self.temporary.insert(path),
            Record::Claimed { path } if is_inside(&path) => _ = self.claimed.insert(path),
            Record::Released { path } => _ = self.claimed.remove(&path),
            Record::Moves { from_to } if from_to.iter().flatten().all(|path| is_inside(path)) => self.moves = from_to,
            Record::Moved => self.moves.clear(),
            _ => {}
        }
    }

    fn add(&mut self, record: Record) -> io::Result<()> {
        let path = self.root.join(FILE);
        let mut file = open_plain(&path, OpenOptions::new().append(true).create(true))?;
        let mut text = if file.metadata()?.len() == 0 { format!("{HEAD}\n") } else { String::new() };
        text += &serde_json::to_string(&record).map_err(io::Error::other)?;
        text.push('\n');
        file.write_all(text.as_bytes())?;
        self.take(record);
        Ok(())
    }

    /// A path as the manifest has it; none where it is not below the folder, or no text.
    pub fn relative(&self, path: &Path) -> Option<String> {
        let parts: Option<Vec<&str>> =
            path.strip_prefix(&self.root).ok()?.components().map(|part| part.as_os_str().to_str()).collect();
        Some(parts?.join("/")).filter(|text| !text.is_empty())
    }

    /// States that a file is being written.
    pub fn begin(&mut self, temporary: &Path) -> io::Result<()> {
        self.relative(temporary).map_or(Ok(()), |path| self.add(Record::Temporary { path }))
    }

    /// Forgets a file that was being written, and has its place or is gone.
    pub fn end(&mut self, temporary: &Path) {
        let name = self.relative(temporary);
        name.iter().for_each(|name| _ = self.temporary.remove(name));
    }

    /// States that a file with these contents is ours.
    pub fn own(&mut self, path: &Path, sha256: &str) -> io::Result<()> {
        let known = |path: &String| self.files.get(path).is_some_and(|all| all.contains(sha256));
        let Some(path) = self.relative(path).filter(|path| !known(path)) else { return Ok(()) };
        self.add(Record::File { path, sha256: sha256.into() })
    }

    /// States that all below a folder is ours until [`Manifest::release`].
    pub fn claim(&mut self, folder: &Path) -> io::Result<()> {
        self.relative(folder).map_or(Ok(()), |path| self.add(Record::Claimed { path }))
    }

    /// Lists all files below a folder that was claimed.
    pub fn release(&mut self, folder: &Path) -> io::Result<()> {
        let Some(path) = self.relative(folder).filter(|path| self.claimed.contains(path)) else { return Ok(()) };
        for file in files_below(folder) {
            let sha256 = hash(&file)?;
            self.own(&file, &sha256)?;
        }
        self.add(Record::Released { path })
    }

    /// Whether a file is one that we wrote, with the contents that we gave it. A link is not.
    pub fn owns(&self, path: &Path) -> bool {
        if !fs::symlink_metadata(path).is_ok_and(|file| file.is_file()) || !self.is_below(path) {
            return false;
        }
        let Some(name) = self.relative(path) else { return false };
        if self
            .claimed
            .iter()
            .any(|folder| name.strip_prefix(folder.as_str()).is_some_and(|rest| rest.starts_with('/')))
        {
            return true;
        }
        let known = self.files.get(&name).filter(|all| !all.is_empty());
        known.is_some_and(|all| hash(path).is_ok_and(|found| all.contains(&found)))
    }

    /// Whether the folder of a path lies below ours also where links are followed.
    fn is_below(&self, path: &Path) -> bool {
        let (root, parent) = (fs::canonicalize(&self.root), path.parent().map(fs::canonicalize));
        matches!((root, parent), (Ok(root), Some(Ok(parent))) if parent.starts_with(&root))
    }

    /// Our files, those of which the contents changed among them.
    fn paths(&self) -> impl Iterator<Item = PathBuf> + '_ {
        self.files.keys().map(|name| self.root.join(name))
    }

    /// States that files take their places, makes the moves and states that they were made.
    pub fn make_moves(&mut self, moves: &[(PathBuf, PathBuf)]) -> io::Result<()> {
        let text = |path: &Path| self.relative(path).ok_or_else(|| io::Error::other("a name that is no text"));
        let from_to: io::Result<Vec<[String; 2]>> =
            moves.iter().map(|(from, to)| Ok([text(from)?, text(to)?])).collect();
        // Names that are no text cannot be listed; such files are renamed all the same.
        if let Ok(from_to) = from_to {
            self.add(Record::Moves { from_to })?;
            sync(&self.root.join(FILE))?;
        }
        for (from, to) in moves {
            fs::rename(from, to)?;
            self.end(from);
        }
        let folders: BTreeSet<&Path> = moves.iter().filter_map(|(_, to)| to.parent()).collect();
        folders.into_iter().for_each(|folder| _ = sync(folder));
        self.add(Record::Moved)
    }

    /// Ends what a command left that was killed: moves that it had begun are made, files that it was writing are removed.
    pub fn recover(&mut self) -> io::Result<()> {
        for [from, to] in std::mem::take(&mut self.moves) {
            let (from, to) = (self.root.join(from), self.root.join(to));
            if is_plain(&from) && self.is_below(&from) && self.is_below(&to) && (!exists(&to) || self.owns(&to)) {
                fs::rename(from, to)?;
            }
        }
        for name in std::mem::take(&mut self.temporary) {
            let path = self.root.join(&name);
            if super::paths::is_temporary(&path) && is_plain(&path) && self.is_below(&path) {
                fs::remove_file(path)?;
            }
        }
        self.rewrite()
    }

    /// Removes our files below `folder`, and folders that are empty then. Other files stay.
    pub fn clear(&mut self, folder: &Path) -> io::Result<()> {
        let mut below: Vec<PathBuf> = self.paths().filter(|path| path.starts_with(folder)).collect();
        let claimed: Vec<PathBuf> = self.claimed.iter().map(|name| self.root.join(name)).collect();
        let claimed = claimed.into_iter().filter(|path| path.starts_with(folder) && self.is_below(path));
        below.extend(claimed.flat_map(|path| files_below(&path)));
        for path in below {
            self.remove(&path)?;
        }
        Ok(())
    }

    /// Removes a file if it is ours, and the folders that are empty then.
    pub fn remove(&mut self, path: &Path) -> io::Result<()> {
        if self.owns(path) {
            fs::remove_file(path)?;
            let inside = |folder: &&Path| *folder != self.root && folder.starts_with(&self.root);
            // A folder with something in it is not removed.
            _ = path.ancestors().skip(1).take_while(inside).try_for_each(fs::remove_dir);
        }
        Ok(())
    }

    /// Writes the manifest anew: what is there and ours. Without any there is none.
    pub fn rewrite(&mut self) -> io::Result<()> {
        let root = self.root.clone();
        // One hash for each file stays, that of its contents. What somebody changed is not ours any more.
        let needs_look = |all: &BTreeSet<String>| all.len() > 1;
        for (name, all) in &mut self.files {
            let path = root.join(name);
            match is_plain(&path) {
                false => all.clear(),
                true if needs_look(all) => {
                    let found = hash(&path)?;
                    all.retain(|known| *known == found);
                }
                true => {}
            }
        }
        self.files.retain(|_, all| !all.is_empty());
        let path = root.join(FILE);
        if self.files.is_empty() && self.claimed.is_empty() && self.temporary.is_empty() {
            return fs::remove_file(&path).or_else(missing_is_fine);
        }
        let files = self.files.iter().flat_map(|(path, all)| all.iter().map(|sha256| (path.clone(), sha256.clone())));
        let records = files.map(|(path, sha256)| Record::File { path, sha256 });
        let claimed = self.claimed.iter().map(|path| Record::Claimed { path: path.clone() });
        let mut text = format!("{HEAD}\n");
        // What a thread is writing while the process ends.
        let temporary = self.temporary.iter().map(|path| Record::Temporary { path: path.clone() });
        for record in records.chain(claimed).chain(temporary) {
            text += &serde_json::to_string(&record).map_err(io::Error::other)?;
            text.push('\n');
        }
        let new = root.join(format!("{FILE}.new"));
        fs::remove_file(&new).or_else(missing_is_fine)?;
        let mut file = open_plain(&new, OpenOptions::new().write(true).create_new(true))?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        fs::rename(new, path)
    }
}

/// Whether text of a manifest is a path below its folder.
fn is_inside(text: &str) -> bool {
    !text.is_empty() && Path::new(text).components().all(|part| matches!(part, Component::Normal(_)))
}

/// Whether something has this name, a link that leads nowhere among it.
pub fn exists(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok()
}

fn is_plain(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|file| file.is_file())
}

/// Opens a regular file; a link is not followed.
///
/// # Errors
/// As of opening; or it is a link, a device or a pipe.
pub fn open_plain(path: &Path, options: &mut OpenOptions) -> io::Result<File> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::OpenOptionsExt;
        let flags = rustix::fs::OFlags::NOFOLLOW | rustix::fs::OFlags::NONBLOCK;
        options.custom_flags(flags.bits() as i32);
    }
    let is_odd = fs::symlink_metadata(path).is_ok_and(|found| !found.is_file());
    let odd = || io::Error::other(format!("'{}' is not a regular file", path.display()));
    if is_odd {
        return Err(odd());
    }
    let file = options.open(path)?;
    if file.metadata()?.is_file() { Ok(file) } else { Err(odd()) }
}

/// All files below a folder; links are not followed, and are files here.
pub fn files_below(folder: &Path) -> Vec<PathBuf> {
    let (mut files, mut folders) = (vec![], vec![folder.to_path_buf()]);
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).into_iter().flatten().flatten() {
            let is_folder = entry.file_type().is_ok_and(|kind| kind.is_dir());
            if is_folder { &mut folders } else { &mut files }.push(entry.path());
        }
    }
    files.sort();
    files
}

/// SHA-256 of a file's contents, in hexadecimal.
pub fn hash(path: &Path) -> io::Result<String> {
    let (mut file, mut hash) = (open_plain(path, OpenOptions::new().read(true))?, Sha256::new());
    let mut piece = vec![0; 1 << 17];
    loop {
        match file.read(&mut piece)? {
            0 => break,
            count => hash.update(&piece[..count]),
        }
    }
    Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Waits until a file, or the list of a folder's files, is on the disk.
pub fn sync(path: &Path) -> io::Result<()> {
    File::open(path)?.sync_all()
}

pub fn missing_is_fine(error: io::Error) -> io::Result<()> {
    if error.kind() == io::ErrorKind::NotFound { Ok(()) } else { Err(error) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(name: &str) -> PathBuf {
        let path = std::env::temp_dir().join(format!("qv-manifest-{name}-{}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        fs::canonicalize(path).unwrap()
    }

    fn wrote(manifest: &mut Manifest, name: &str, text: &str) -> PathBuf {
        let path = manifest.root.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, text).unwrap();
        manifest.own(&path, &hash(&path).unwrap()).unwrap();
        path
    }

    #[test]
    fn only_files_with_their_contents_are_ours() {
        let root = folder("own");
        let mut manifest = Manifest::read(&root).unwrap();
        let (a, b) = (wrote(&mut manifest, "a/b/one.txt", "one"), wrote(&mut manifest, "a/two.txt", "two"));
        fs::write(root.join("a/three.txt"), "three").unwrap();
        fs::write(&b, "changed").unwrap();
        let mut manifest = Manifest::read(&root).unwrap();
        assert_eq!([&a, &b, &root.join("a/three.txt")].map(|path| manifest.owns(path)), [true, false, false]);
        manifest.clear(&root).unwrap();
        assert!(!root.join("a/b").exists(), "an empty folder goes");
        assert_eq!(files_below(&root), [FILE, "a/three.txt", "a/two.txt"].map(|name| root.join(name)));
        manifest.files.retain(|name, _| name.contains("one"));
        manifest.rewrite().unwrap();
        assert!(!root.join(FILE).exists(), "nothing is ours any more");
        fs::remove_dir_all(root).unwrap();
    }

    #[test]
    fn a_manifest_reaches_nothing_outside() {
        let root = folder("outside");
        fs::create_dir_all(root.join("in")).unwrap();
        fs::create_dir_all(root.join("elsewhere")).unwrap();
        let other = root.join("elsewhere/keep.txt");
        fs::write(&other, "keep").unwrap();
        let sha256 = hash(&other).unwrap();
        #[cfg(unix)]
        std::os::unix::fs::symlink(root.join("elsewhere"), root.join("in/link")).unwrap();
        let lines = [
            HEAD.to_string(),
            format!("{{\"file\":{{\"path\":\"../elsewhere/keep.txt\",\"sha256\":\"{sha256}\"}}}}"),
            format!("{{\"file\":{{\"path\":\"link/keep.txt\",\"sha256\":\"{sha256}\"}}}}"),
            "{\"claimed\":{\"path\":\"link\"}}".into(),
            "{\"temporary\":{\"path\":\"link/keep.txt\"}}".into(),
            "{\"claimed\":{\"path\":\"..\"}}".into(),
        ];
        fs::write(root.join("in").join(FILE), lines.join("\n")).unwrap();
        let mut manifest = Manifest::read(&root.join("in")).unwrap();
        manifest.recover().unwrap();
        manifest.clear(&root.join("in")).unwrap();
        assert!(other.exists());
        fs::write(root.join("in").join(FILE), "something else").unwrap();
        assert!(Manifest::read(&root.join("in")).is_err());
        fs::remove_dir_all(root).unwrap();
    }

    #[test]
    fn moves_that_were_begun_are_ended() {
        let root = folder("moves");
        let mut manifest = Manifest::read(&root).unwrap();
        let old = wrote(&mut manifest, "result", "old");
        let new = crate::output::paths::temporary(&old);
        let other = crate::output::paths::temporary(&root.join("other"));
        for path in [&new, &other] {
            fs::write(path, "new").unwrap();
            manifest.begin(path).unwrap();
        }
        let names = [&new, &old].map(|path| manifest.relative(path).unwrap());
        manifest.add(Record::Moves { from_to: vec![names] }).unwrap();
        let mut manifest = Manifest::read(&root).unwrap();
        manifest.recover().unwrap();
        assert_eq!(fs::read_to_string(&old).unwrap(), "new");
        assert!(!other.exists(), "what was being written is gone");
        fs::remove_dir_all(root).unwrap();
    }
}
