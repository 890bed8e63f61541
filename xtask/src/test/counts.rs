//! `cargo xtask test`: every test of the workspace, and a summary.

use crate::{process, python, workspace::Workspace};
use anyhow::Result;
use std::collections::BTreeSet;

/// Python environments under `fixtures`, and the variables through which tests find them.
const ENVIRONMENTS: [(&str, &str); 5] = [
    ("mcap", "QV_PYTHON"),
    ("mesh", "QV_PYTHON_MESH"),
    ("mujoco", "QV_PYTHON_MUJOCO"),
    ("onnx", "QV_PYTHON_ONNX"),
    ("splat", "QV_PYTHON_SPLAT"),
];

/// What a test says that skips (`fixtures/skipped.rs`): the name of its thread and the reason follow.
const SKIPPED: &str = "skipped test: ";

/// Counts over all test programs.
#[derive(Debug, Default, PartialEq, Eq)]
struct Counts {
    passed: u64,
    failed: u64,
    /// Tests that said that they skip, and those that are ignored.
    skipped: u64,
    /// Name and reason of each of these.
    reasons: Vec<String>,
    /// Names of the tests of the program that runs now that said so.
    of_program: BTreeSet<String>,
    /// The test whose line has begun, where one runs after another.
    begun: String,
}

impl Counts {
    /// Adds what a line says: a `test result:`, a test that skips, one that is ignored; other lines change nothing.
    fn add_line(&mut self, line: &str) {
        if let Some(said) = line.strip_prefix(SKIPPED) {
            self.add_skipped(said);
        } else if let Some(result) = line.trim_start().strip_prefix("test result:") {
            self.add_result(result);
        } else if let Some(test) = line.strip_prefix("test ") {
            let (name, end) = test.split_once(" ... ").unwrap_or((test, ""));
            name.clone_into(&mut self.begun);
            if let Some(why) = end.strip_prefix("ignored") {
                let why = why.trim_start_matches(", ").trim();
                let why = if why.is_empty() { "ignored" } else { why };
                self.reasons.push(format!("{name}: {why}"));
            }
        }
    }

    fn add_skipped(&mut self, said: &str) {
        let (thread, why) = said.split_once(": ").unwrap_or((said, ""));
        // Where tests run one after another they have no threads, and the name stands on the line before.
        let name = if thread == "main" { self.begun.clone() } else { thread.to_owned() };
        // A test may say so more than once.
        if self.of_program.insert(name.clone()) {
            self.reasons.push(format!("{name}: {why}"));
        }
    }

    fn add_result(&mut self, result: &str) {
        // Test programs take a test that returns for one that passed.
        let said = std::mem::take(&mut self.of_program).len() as u64;
        self.skipped += said;
        for part in result.split([';', '.']) {
            let mut words = part.split_whitespace();
            let (Some(number), Some(what)) = (words.next().and_then(|w| w.parse::<u64>().ok()), words.next()) else {
                continue;
            };
            match what {
                "passed" => self.passed += number.saturating_sub(said),
                "failed" => self.failed += number,
                "ignored" => self.skipped += number,
                _ => {}
            }
        }
    }
}

/// Runs all tests of all features, unit, integration and documentation; true when all passed. Before the last line, `N passed, N failed,
/// N skipped`, stand the tests that were skipped, with reasons.
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
    counts.reasons.iter().for_each(|reason| println!("skipped: {reason}"));
    println!("{} passed, {} failed, {} skipped", counts.passed, counts.failed, counts.skipped);
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
        assert_eq!((counts.passed, counts.failed, counts.skipped), (14, 4, 2));
    }

    #[test]
    fn a_test_that_skips_is_counted_once_and_not_as_passed() {
        let mut counts = Counts::default();
        for line in [
            "running 4 tests",
            "",
            "skipped test: reads: no Python with numpy",
            "test writes ... ok",
            "skipped test: reads: no Python with scipy",
            "test reads ... ok",
            "test big ... ignored, writes 2 GB",
            "test old ... ignored",
            "test result: ok. 2 passed; 0 failed; 2 ignored; 0 measured; 0 filtered out; finished in 0.7s",
            // Another program, whose tests run one after another.
            "test first ... ",
            "skipped test: main: no card",
            "ok",
            "test second ... ",
            "skipped test: main: no card",
            "ok",
            "test result: ok. 3 passed; 0 failed; 0 ignored; 0 measured; 0 filtered out; finished in 0.7s",
        ] {
            counts.add_line(line);
        }
        assert_eq!((counts.passed, counts.failed, counts.skipped), (2, 0, 5));
        let reasons =
            ["reads: no Python with numpy", "big: writes 2 GB", "old: ignored", "first: no card", "second: no card"];
        assert_eq!(counts.reasons, reasons);
    }

    #[test]
    fn the_line_that_tests_write_is_the_one_that_is_counted() {
        let helper = include_str!("../../fixtures/skipped.rs");
        assert!(helper.contains(&format!("\\n{SKIPPED}{{}}: {{why}}\\n")), "{SKIPPED}");
    }
}
