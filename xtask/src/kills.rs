//! `cargo xtask kills`: the tests that kill commands at random moments, with many kills of each command.

use crate::{process, workspace::Workspace};
use anyhow::Result;

/// Runs the tests; true when no result was lost or half new.
///
/// # Errors
/// The tests cannot be built.
pub fn run(workspace: &Workspace, each: u32) -> Result<bool> {
    let mut tests = process::cargo();
    tests.current_dir(&workspace.workspace_root).env("QV_KILLS", each.to_string());
    tests.args(["test", "-p", "quadverse", "--all-features", "--test", "it", "--", "safety::kills"]);
    let mut count = 0;
    let passed = process::watch(&mut tests, |line| count += usize::from(line.starts_with("test safety::kills")))?;
    println!("{count} commands were killed {each} times each");
    Ok(passed && count > 0)
}
