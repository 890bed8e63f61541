//! Rules about the text of files.

use super::layers;
use super::rust_text::{Strings, code, without_tests};
use super::source::Source;
use crate::workspace::{Package, Workspace};
use std::path::Path;

const VAGUE_NAMES: [&str; 6] = ["utils", "util", "common", "helpers", "helper", "misc"];
/// Clock, environment and global random state: not in the libraries of layers 0 to 2.
const AMBIENT: [&str; 14] = [
    "std::time",
    "Instant::now",
    "SystemTime",
    "std::env",
    "env::var",
    "env::args",
    "rand::rng",
    "rand::random",
    "thread_rng",
    "from_entropy",
    "from_os_rng",
    "OsRng",
    "getrandom",
    "fastrand",
];
/// Only binaries print.
const PRINTING: [&str; 6] = ["println!", "print!", "eprintln!", "eprint!", "dbg!", "stdout()"];
/// Crates that know the Go2: its own, the one that simulates it with something wrong, and the one that gives its model to whoever names it.
const KNOW_THE_ROBOT: [&str; 3] = ["qv-go2", "qv-sealed", "qv-open"];
/// What only they may speak of.
const ROBOT: [&str; 8] = ["go2", "unitree", "lowcmd", "lowstate", "\"fl_", "\"fr_", "\"rl_", "\"rr_"];

/// All findings about files.
pub fn check(workspace: &Workspace, sources: &[Source]) -> Vec<String> {
    let mut found = Vec::new();
    for source in sources {
        found.extend(names(&source.path));
        found.extend(places(source));
        found.extend(unfinished(source));
        found.extend(shader_owner(&source.path));
    }
    for package in workspace.members().filter(|package| package.has_target("lib")) {
        let Ok(folder) = package.folder().strip_prefix(&workspace.workspace_root) else { continue };
        for source in sources.iter().filter(|source| in_library(&source.path, folder)) {
            found.extend(library_rules(package, source));
        }
    }
    found
}

/// Whether a path is library code of the crate in `folder`: not its binaries, tests, benches or examples.
fn in_library(path: &Path, folder: &Path) -> bool {
    let Ok(inside) = path.strip_prefix(folder.join("src")) else { return false };
    path.extension().is_some_and(|e| e == "rs") && inside != Path::new("main.rs") && !inside.starts_with("bin")
}

fn names(path: &Path) -> Vec<String> {
    let vague = path.iter().any(|part| {
        let stem = Path::new(part).file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
        VAGUE_NAMES.contains(&stem)
    });
    if vague { vec![format!("{}: expected a name that says what is inside", path.display())] } else { Vec::new() }
}

/// The repository must not know on which machine it was written, nor fetch from anywhere but crates.io.
fn places(source: &Source) -> Vec<String> {
    // Written in two halves, so that this file passes its own rule.
    let folders = [concat!("/wo", "rk/"), concat!("/ho", "me/"), concat!("/ro", "ot/"), concat!("/t", "mp/")];
    let mut found = Vec::new();
    for (number, line) in source.text.lines().enumerate() {
        let at = || format!("{}:{}", source.path.display(), number + 1);
        if let Some(folder) = folders.iter().find(|folder| names_folder(line, folder)) {
            found.push(format!("{}: expected no path of a particular machine, found {folder}", at()));
        }
        let locked = source.path == Path::new("Cargo.lock") && line.starts_with("source = ");
        if locked && line != "source = \"registry+https://github.com/rust-lang/crates.io-index\"" {
            found.push(format!("{}: expected the crates.io registry, found {line}", at()));
        }
    }
    found
}

/// Whether the folder occurs as the start of an absolute path, not within a longer one.
fn names_folder(line: &str, folder: &str) -> bool {
    line.match_indices(folder).any(|(at, _)| {
        let before = line[..at].chars().next_back();
        before.is_none_or(|c| !(c.is_alphanumeric() || "._-/~}".contains(c)))
    })
}

fn unfinished(source: &Source) -> Vec<String> {
    let text_marks = [concat!("TO", "DO"), concat!("FIX", "ME"), concat!("XX", "X")];
    let macros = [concat!("todo", "!("), concat!("unimplemented", "!(")];
    if source.path == Path::new("Cargo.lock") {
        return Vec::new();
    }
    let mut found = Vec::new();
    for (number, line) in source.text.lines().enumerate() {
        if let Some(mark) = text_marks.iter().chain(&macros).find(|mark| contains_word(line, mark)) {
            found.push(format!("{}:{}: expected finished work, found {mark}", source.path.display(), number + 1));
        }
    }
    found
}

/// Whether `word` occurs and does not continue a longer word on either side.
fn contains_word(line: &str, word: &str) -> bool {
    let continues = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
    let ends_open = word.ends_with(|c: char| c.is_alphanumeric());
    line.match_indices(word).any(|(at, _)| {
        let before = continues(line[..at].chars().next_back());
        let after = ends_open && continues(line[at + word.len()..].chars().next());
        !before && !after
    })
}

fn shader_owner(path: &Path) -> Vec<String> {
    let shader = path.extension().is_some_and(|e| e == "wgsl");
    if shader && !path.starts_with("crates/qv-raster") {
        return vec![format!("{}: expected WGSL in qv-raster only", path.display())];
    }
    Vec::new()
}

/// Rules of library code: what it may reach for, print and know.
fn library_rules(package: &Package, source: &Source) -> Vec<String> {
    let bare = without_tests(&code(&source.text, Strings::Blank));
    let mut found = Vec::new();
    let mut complain = |number: usize, expected: &str, what: &str| {
        found.push(format!("{}:{}: expected {expected}, found {what}", source.path.display(), number + 1));
    };
    let low = layers::layer(&package.short()).is_some_and(|layer| layer <= 2);
    for (number, line) in bare.lines().enumerate() {
        if let Some(what) = AMBIENT.iter().find(|what| low && line.contains(*what)) {
            complain(number, "no clock, environment or global random state in layers 0 to 2", what);
        }
        if let Some(what) = PRINTING.iter().find(|what| contains_word(line, what)) {
            complain(number, "only binaries to print", what);
        }
    }
    if !KNOW_THE_ROBOT.contains(&package.short().as_str()) {
        // Lines that the tests occupy are blank in `bare`; names may sit in strings, so those are looked at, too.
        let spoken = code(&source.text, Strings::Keep);
        for (number, (line, bare_line)) in spoken.lines().zip(bare.lines()).enumerate() {
            let lower = line.to_lowercase();
            if let Some(what) = ROBOT.iter().find(|what| !bare_line.trim().is_empty() && lower.contains(*what)) {
                complain(number, "only qv-go2, qv-sealed and qv-open to know the Go2", what);
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(path: &str, text: &str) -> Source {
        Source { path: path.into(), text: text.into() }
    }

    fn package(name: &str) -> Package {
        Package {
            name: name.into(),
            version: String::new(),
            id: String::new(),
            license: None,
            manifest_path: String::new().into(),
            dependencies: Vec::new(),
            targets: Vec::new(),
            features: Default::default(),
            publish: Some(Vec::new()),
            description: None,
            keywords: Vec::new(),
            categories: Vec::new(),
        }
    }

    #[test]
    fn vague_names_are_found() {
        assert_eq!(names(Path::new("crates/qv-sim/src/utils.rs")).len(), 1);
        assert_eq!(names(Path::new("crates/qv-sim/src/common/pose.rs")).len(), 1);
        assert!(names(Path::new("crates/qv-sim/src/contact.rs")).is_empty());
    }

    #[test]
    fn machine_paths_are_found_and_relative_ones_are_not() {
        let path = concat!("x = \"/wo", "rk/here\"");
        assert_eq!(places(&source("a.md", path)).len(), 1);
        assert!(places(&source("a.md", concat!("frame/wo", "rk/energy ../ho", "me/x"))).is_empty());
        assert_eq!(places(&source("Cargo.lock", "source = \"registry+https://elsewhere\"")).len(), 1);
    }

    #[test]
    fn unfinished_work_is_found() {
        assert_eq!(unfinished(&source("a.rs", concat!("// TO", "DO later"))).len(), 1);
        assert_eq!(unfinished(&source("a.rs", concat!("fn f() { todo", "!() }"))).len(), 1);
        assert!(unfinished(&source("a.rs", concat!("METHO", "TODO_LIST"))).is_empty());
    }

    #[test]
    fn libraries_reach_for_nothing_but_their_arguments() {
        let clock = source("crates/qv-sim/src/a.rs", "fn f() { let t = std::time::Instant::now(); }");
        assert_eq!(library_rules(&package("qv-sim"), &clock).len(), 1);
        assert!(library_rules(&package("qv-gap"), &clock).is_empty(), "layer 3 may");
        let printing = source("crates/qv-gap/src/a.rs", "fn f() { println!(\"x\"); }");
        assert_eq!(library_rules(&package("qv-gap"), &printing).len(), 1);
        let fine = "// std::time\n#[cfg(test)]\nmod tests { fn f() { println!(\"std::env\") } }\nlet s = \"std::env\";";
        assert!(library_rules(&package("qv-sim"), &source("a.rs", fine)).is_empty());
    }

    #[test]
    fn only_its_own_crate_knows_the_go2() {
        let name = source("a.rs", "let foot = \"FL_foot\";");
        assert_eq!(library_rules(&package("qv-sim"), &name).len(), 1);
        assert!(library_rules(&package("qv-go2"), &name).is_empty());
        assert!(library_rules(&package("qv-sealed"), &name).is_empty());
        let test = source("a.rs", "#[cfg(test)]\nmod tests {\n    const ROBOT: &str = \"go2\";\n}\n");
        assert!(library_rules(&package("qv-sim"), &test).is_empty());
    }
}
