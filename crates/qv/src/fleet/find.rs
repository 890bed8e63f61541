//! Recordings below a folder, and the files that each of them is.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Endings of bags.
const BAGS: [&str; 5] = [".mcap", ".db3", ".mcap.zstd", ".db3.zstd", ".bag"];
/// How deep the files of one recording lie at most.
const DEEP: usize = 4;

/// What a folder holds by which it is one recording: a table, a dataset of LeRobot, a folder of SAGE.
const SIGNS: [&str; 3] = ["run.csv", "meta/info.json", "state_motor.csv"];

/// Paths of recordings below `folder`, by name; nothing below `without`. A file is taken as it is.
pub fn recordings(folder: &Path, without: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let without = without.canonicalize().ok();
    look(folder, without.as_deref(), &mut BTreeSet::new(), &mut found);
    found.sort();
    found
}

fn look(path: &Path, without: Option<&Path>, seen: &mut BTreeSet<PathBuf>, found: &mut Vec<PathBuf>) {
    let Ok(real) = path.canonicalize() else { return found.push(path.to_path_buf()) };
    // A link may lead back to a folder above it.
    if without == Some(real.as_path()) || !seen.insert(real) {
        return;
    }
    if !path.is_dir() || is_recording(path) {
        return found.push(path.to_path_buf());
    }
    if fs::read_dir(path).is_err() {
        // What cannot be looked into is reported when it is opened.
        return found.push(path.to_path_buf());
    }
    let entries = entries(path);
    for entry in &entries {
        if entry.is_dir() || (is_bag(entry) && !is_copy(entry, &entries)) || is_table(entry) {
            look(entry, without, seen, found);
        }
    }
}

/// What a folder holds, by name; nothing hidden.
fn entries(folder: &Path) -> Vec<PathBuf> {
    let mut all: Vec<PathBuf> = fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
    all.retain(|path| !name(path).starts_with('.'));
    all.sort();
    all
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().to_lowercase()
}

fn is_recording(folder: &Path) -> bool {
    let is_split_bag = folder.join("metadata.yaml").is_file() && entries(folder).iter().any(|file| is_bag(file));
    is_split_bag || SIGNS.iter().any(|sign| folder.join(sign).is_file())
}

fn is_bag(path: &Path) -> bool {
    BAGS.iter().any(|ending| name(path).ends_with(ending)) && path.is_file()
}

/// Whether the same bag lies there without compression, too.
fn is_copy(path: &Path, beside: &[PathBuf]) -> bool {
    path.extension().is_some_and(|e| e == "zstd") && beside.contains(&path.with_extension(""))
}

/// A table that has a description: any other may be anything.
fn is_table(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == "csv") && path.is_file() && qv_open::description_of(path).is_file()
}

/// All files that the result of a recording depends on.
pub fn files(recording: &Path) -> Vec<PathBuf> {
    let mut all = Vec::new();
    collect(recording, DEEP, &mut all);
    let description =
        qv_open::description_of(&if recording.is_dir() { recording.join("run.csv") } else { recording.into() });
    if description.is_file() && (recording.is_dir() || is_table(recording)) {
        all.extend(models(&description));
        all.push(description);
    }
    // The manifest of what we wrote there is none of the recording.
    all.retain(|path| path.file_name() != Some(crate::output::MANIFEST.as_ref()));
    all.sort();
    all.dedup();
    all
}

/// A file that an option names, and those beside it that are read with it.
pub fn with_companions(file: &Path) -> Vec<PathBuf> {
    let mut all = vec![file.to_path_buf()];
    match file.extension().and_then(|e| e.to_str()) {
        Some("toml") => all.extend(models(file)),
        Some("onnx") => all.extend(["policy.toml", "checkpoint.bin"].map(|name| file.with_file_name(name))),
        _ => {}
    }
    all.retain(|path| path.is_file());
    all
}

fn collect(path: &Path, depth: usize, all: &mut Vec<PathBuf>) {
    if path.is_file() {
        all.push(path.to_path_buf());
    } else if depth > 0 {
        entries(path).iter().for_each(|entry| collect(entry, depth - 1, all));
    }
}

/// The models that a description of a run or of a robot names.
fn models(description: &Path) -> Vec<PathBuf> {
    let table = fs::read_to_string(description).ok().and_then(|text| text.parse::<toml::Table>().ok());
    let named = |key: &str| Some(description.with_file_name(table.as_ref()?.get(key)?.as_str()?));
    ["robot", "urdf"].iter().filter_map(|key| named(key)).filter(|path| path.is_file()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_is_found_once() {
        let root = std::env::temp_dir().join(format!("qv-find-{}", std::process::id()));
        let put = |name: &str, text: &str| {
            let path = root.join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        for name in ["a/run.csv", "a/arm.urdf", "b/x.mcap", "b/x.mcap.zstd", "b/y.db3.zstd", "b/note.txt"] {
            put(name, "");
        }
        put("a/run.toml", "robot = \"../robots/arm.urdf\"");
        put("robots/arm.urdf", "<robot/>");
        for name in ["split/metadata.yaml", "split/s_0.mcap", "split/s_1.mcap", ".git/z.mcap", "out/w.mcap"] {
            put(name, "");
        }
        for name in ["set/meta/info.json", "set/data/0.parquet", "deep/er/old.bag", "csv/no_description.csv"] {
            put(name, "");
        }
        #[cfg(unix)]
        std::os::unix::fs::symlink(&root, root.join("deep/back")).unwrap();
        let found = recordings(&root, &root.join("out"));
        let names: Vec<String> = found.iter().map(|p| p.strip_prefix(&root).unwrap().display().to_string()).collect();
        assert_eq!(names, ["a", "b/x.mcap", "b/y.db3.zstd", "deep/er/old.bag", "set", "split"]);
        let of = |name: &str| files(&root.join(name)).len();
        // Three in the folder, and the model that lies elsewhere.
        assert_eq!([of("a"), of("split"), of("set"), of("b/x.mcap")], [4, 3, 2, 1]);
        put("policy/policy.onnx", "");
        put("policy/policy.toml", "");
        assert_eq!(with_companions(&root.join("policy/policy.onnx")).len(), 2);
        assert_eq!(recordings(&root.join("none"), &root), [root.join("none")], "what is not there is told when opened");
        fs::remove_dir_all(root).unwrap();
    }
}
