//! What the lines of a test program say: how many tests passed, failed and skipped, and how long each took.

use std::collections::BTreeSet;
use std::time::Duration;

/// What a test says that skips (`fixtures/skipped.rs`): the name of its thread and the reason follow.
const SKIPPED: &str = "skipped test: ";

/// Counts of one test program, or of several.
#[derive(Debug, Default, PartialEq)]
pub struct Counts {
    pub passed: u64,
    pub failed: u64,
    /// Tests that reported that they skip, and those that are ignored.
    pub skipped: u64,
    /// Name and reason of each of these.
    pub reasons: Vec<String>,
    /// Tests that ran, one after another, and the time that each took.
    pub durations: Vec<(String, Duration)>,
    /// Names of the tests of the program that runs now that reported a skip.
    of_program: BTreeSet<String>,
    /// The test whose line has begun.
    begun: String,
    /// When the last test ended, since the start of the program.
    last_end: Duration,
}

impl Counts {
    /// Adds a line that the program printed `at` this time since its start: a `test result:`, a test that ended, skips or is ignored.
    /// Other lines change nothing.
    pub fn add_line(&mut self, line: &str, at: Duration) {
        if let Some(said) = line.strip_prefix(SKIPPED) {
            self.add_skipped(said);
        } else if let Some(result) = line.trim_start().strip_prefix("test result:") {
            self.add_result(result);
        } else if let Some(test) = line.strip_prefix("test ") {
            let (name, end) = test.split_once(" ... ").unwrap_or((test, ""));
            name.clone_into(&mut self.begun);
            self.add_end(end, at);
            if let Some(why) = end.strip_prefix("ignored") {
                let why = why.trim_start_matches(", ").trim();
                let why = if why.is_empty() { "ignored" } else { why };
                self.reasons.push(format!("{name}: {why}"));
            }
        } else {
            self.add_end(line, at);
        }
    }

    /// Adds the time of the test that has begun, where its end stands here.
    fn add_end(&mut self, end: &str, at: Duration) {
        if matches!(end, "ok" | "FAILED") && !self.begun.is_empty() {
            self.durations.push((std::mem::take(&mut self.begun), at.saturating_sub(self.last_end)));
            self.last_end = at;
        }
    }

    /// Adds the counts of a program whose tests go by `name::`.
    pub fn add(&mut self, program: Counts, name: &str) {
        self.passed += program.passed;
        self.failed += program.failed;
        self.skipped += program.skipped;
        self.reasons.extend(program.reasons.into_iter().map(|reason| format!("{name}::{reason}")));
        self.durations.extend(program.durations.into_iter().map(|(test, took)| (format!("{name}::{test}"), took)));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn result_lines_are_added_up() {
        let mut counts = Counts::default();
        for line in [
            "test result: ok. 11 passed; 0 failed; 2 ignored; 0 measured; 0 filtered out; finished in 0.7s",
            "test result: FAILED. 3 passed; 4 failed; 0 ignored; 0 measured; 9 filtered out",
            "test gait::passed ... ok",
        ] {
            counts.add_line(line, Duration::ZERO);
        }
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
            counts.add_line(line, Duration::ZERO);
        }
        assert_eq!((counts.passed, counts.failed, counts.skipped), (2, 0, 5));
        let reasons =
            ["reads: no Python with numpy", "big: writes 2 GB", "old: ignored", "first: no card", "second: no card"];
        assert_eq!(counts.reasons, reasons);
    }

    #[test]
    fn the_line_that_tests_write_is_the_one_that_is_counted() {
        let helper = include_str!("../../../fixtures/skipped.rs");
        assert!(helper.contains(&format!("\\n{SKIPPED}{{}}: {{why}}\\n")), "{SKIPPED}");
    }

    #[test]
    fn a_test_takes_what_passes_from_the_end_of_the_one_before() {
        let mut program = Counts::default();
        let seconds = Duration::from_secs;
        for (line, at) in [
            ("test quick ... ok", 1),
            ("test slow ... ", 1),
            ("skipped test: main: no card", 1),
            ("ok", 6),
            ("test wrong ... FAILED", 8),
        ] {
            program.add_line(line, seconds(at));
        }
        let mut all = Counts::default();
        all.add(program, "qv-sim");
        let expected = [("quick", 1), ("slow", 5), ("wrong", 2)];
        assert_eq!(all.durations, expected.map(|(name, s)| (format!("qv-sim::{name}"), seconds(s))));
    }
}
