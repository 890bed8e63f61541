//! `cargo xtask test`: every test of the workspace, and a summary.

use crate::{process, python, workspace::Workspace};
use anyhow::Result;

/// Python environments under `fixtures`, and the variables through which tests find them.
const ENVIRONMENTS: [(&str, &str); 4] =
    [("mcap", "QV_PYTHON"), ("mesh", "QV_PYTHON_MESH"), ("onnx", "QV_PYTHON_ONNX"), ("splat", "QV_PYTHON_SPLAT")];

/// Counts over all test programs.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
struct Counts {
    passed: u64,
    failed: u64,
    ignored: u64,
}

impl Counts {
    /// Adds what a `test result:` line says; other lines change nothing.
    fn add_line(&mut self, line: &str) {
        let Some(result) = line.trim_start().strip_prefix("test result:") else { return };
        for part in result.split([';', '.']) {
            let mut words = part.split_whitespace();
            let (Some(number), Some(what)) = (words.next().and_then(|w| w.parse::<u64>().ok()), words.next()) else {
                continue;
            };
            match what {
                "passed" => self.passed += number,
                "failed" => self.failed += number,
                "ignored" => self.ignored += number,
                _ => {}
            }
        }
    }
}

/// Runs all tests of all features, unit, integration and documentation; true when all passed. The last line is `N passed, N failed`.
///
/// # Errors
/// Cargo cannot be started.
pub fn run(workspace: &Workspace, release: bool) -> Result<bool> {
    let mut cargo = process::cargo();
    cargo.current_dir(&workspace.workspace_root).args(["test", "--workspace", "--all-features", "--no-fail-fast"]);
    if release {
        cargo.arg("--release");
    }
    for (name, variable) in ENVIRONMENTS {
        if !workspace.workspace_root.join("fixtures").join(name).join("requirements.txt").is_file() {
            continue;
        }
        match python::environment(workspace, name) {
            Ok(python) => {
                cargo.env(variable, python);
            }
            // The tests that want it say that they skip.
            Err(error) => eprintln!("note: tests that read our files from Python ({name}) will skip: {error:#}"),
        }
    }
    let mut counts = Counts::default();
    let succeeded = process::watch(&mut cargo, |line| counts.add_line(line))?;
    if !succeeded && counts.failed == 0 {
        // Did not compile, or a test program died without a result: that is a failure, too.
        counts.failed = 1;
        println!("cargo test failed before a result was printed");
    }
    if counts.ignored > 0 {
        println!("{} ignored", counts.ignored);
    }
    println!("{} passed, {} failed", counts.passed, counts.failed);
    Ok(succeeded)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn result_lines_are_added_up() {
        let mut counts = Counts::default();
        counts
            .add_line("test result: ok. 11 passed; 0 failed; 2 ignored; 0 measured; 0 filtered out; finished in 0.7s");
        counts.add_line("test result: FAILED. 3 passed; 4 failed; 0 ignored; 0 measured; 9 filtered out");
        counts.add_line("test gait::passed ... ok");
        assert_eq!(counts, Counts { passed: 14, failed: 4, ignored: 2 });
    }
}
