//! Where the description of a recording lies, and which files of another program a path stands for.

use std::path::{Path, PathBuf};

/// The description of the table at `path`, its CSV file or its directory.
pub fn description_of(path: &Path) -> PathBuf {
    if let Some(root) = root(path) {
        return root.join("run.toml");
    }
    if path.is_dir() {
        return path.join("run.toml");
    }
    let own = path.with_extension("toml");
    if own.exists() { own } else { path.parent().unwrap_or(Path::new("")).join("run.toml") }
}

/// What a path is.
pub(crate) enum Kind {
    /// The folder of a dataset, and the one file of it that is meant.
    LeRobot(PathBuf, Option<PathBuf>),
    Sage(PathBuf),
}

/// `None` for what is no recording of another program, or one in a single file.
pub(crate) fn kind(path: &Path) -> Option<Kind> {
    let is_dataset = |folder: &Path| folder.join("meta/info.json").is_file();
    if path.is_dir() {
        if is_dataset(path) {
            return Some(Kind::LeRobot(path.into(), None));
        }
        return path.join("state_motor.csv").is_file().then(|| Kind::Sage(path.into()));
    }
    let root = path.extension().is_some_and(|e| e == "parquet").then(|| path.ancestors().find(|up| is_dataset(up)));
    root.flatten().map(|root| Kind::LeRobot(root.into(), Some(path.into())))
}

/// The folder that a recording of another program is in, where `run.toml` is.
pub fn root(path: &Path) -> Option<PathBuf> {
    match kind(path)? {
        Kind::LeRobot(root, _) | Kind::Sage(root) => Some(root),
    }
}
