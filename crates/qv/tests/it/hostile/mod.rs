//! Files that mean harm, or are broken so that they might: small ones must be done or refused within 5 s of processor time and 1 GB, whatever
//! they claim.

mod bags;
mod meshes;
mod names;
mod pages;
mod pictures;
mod policies;
mod tables;

use std::path::Path;
use std::process::{Command, Output};

/// Address space \[KiB\] and processor time \[s\] of a command.
const MEMORY: u64 = 1 << 20;
const SECONDS: u64 = 5;

/// `qv` within the limits. It may fail, but not by a panic or a signal.
fn bounded(arguments: &[&str]) -> (i32, String, String) {
    bounded_in(Path::new("."), arguments)
}

fn bounded_in(folder: &Path, arguments: &[&str]) -> (i32, String, String) {
    let mut command = Command::new("sh");
    command.arg("-c").arg(format!("ulimit -v {MEMORY}; ulimit -t {SECONDS}; exec \"$0\" \"$@\""));
    let output: Output = command.arg(env!("CARGO_BIN_EXE_qv")).args(arguments).current_dir(folder).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (out, err) = (text(&output.stdout), text(&output.stderr));
    let code = output.status.code().unwrap_or_else(|| panic!("{arguments:?}: {}\n{err}", output.status));
    assert!([0, 1, 3].contains(&code) && !err.contains("panicked"), "{arguments:?}: {code}\n{err}");
    assert!(err.lines().all(|line| line.chars().count() < 700), "{err}");
    (code, out, err)
}
