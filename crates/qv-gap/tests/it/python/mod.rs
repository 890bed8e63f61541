//! Programs in Python that read our files, and what they print.

use std::path::PathBuf;
use std::process::Command;

/// A Python that imports `module`: the one that QV_PYTHON_MUJOCO names (`cargo xtask test` makes it), else `python3`. Says so when the
/// test goes without.
pub fn python_with(module: &str) -> Option<PathBuf> {
    let named = std::env::var_os("QV_PYTHON_MUJOCO").map_or_else(|| PathBuf::from("python3"), PathBuf::from);
    let found = Command::new(&named).args(["-c", &format!("import {module}")]).output();
    if found.is_ok_and(|o| o.status.success()) {
        return Some(named);
    }
    crate::skipped::skipped(format!("no Python that imports {module} (cargo xtask test makes one)"));
    None
}

/// What a program prints that is given a folder with these files.
pub fn python(python: &PathBuf, name: &str, program: &str, files: &[(&str, &str)]) -> String {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::create_dir_all(&folder).unwrap();
    for (file, text) in files {
        std::fs::write(folder.join(file), text).unwrap();
    }
    let output = Command::new(python).arg("-c").arg(program).current_dir(&folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}
