//! Lists the files of `robots/`, so that a robot is added by adding its file.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::{env, fs};

fn main() {
    let folder = Path::new(&env::var("CARGO_MANIFEST_DIR").expect("set by cargo")).join("robots");
    println!("cargo::rerun-if-changed={}", folder.display());
    let mut code = String::new();
    list(&mut code, "FILES", &folder, "toml", |path| path.file_stem());
    list(&mut code, "DEFINITIONS", &folder.join("messages"), "msg", |path| path.file_name());
    let out = PathBuf::from(env::var("OUT_DIR").expect("set by cargo")).join("robots.rs");
    fs::write(&out, code).unwrap_or_else(|e| panic!("{}: {e}", out.display()));
}

/// A constant with name and text of every file of a folder with that ending, by name.
fn list(code: &mut String, constant: &str, folder: &Path, ending: &str, name: fn(&Path) -> Option<&std::ffi::OsStr>) {
    let entries = fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    let mut files: Vec<PathBuf> = entries.flatten().map(|e| e.path()).collect();
    files.retain(|path| path.extension().is_some_and(|e| e == ending));
    files.sort();
    writeln!(code, "const {constant}: [(&str, &str); {}] = [", files.len()).expect("a string takes all");
    for path in files {
        let name = name(&path).map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        writeln!(code, "    ({name:?}, include_str!({:?})),", path.display().to_string()).expect("a string takes all");
    }
    code.push_str("];\n");
}
