//! `cargo xtask advisories`: known faults of what is linked, where their database can be had.

use crate::{process, workspace::Workspace};
use anyhow::Result;

/// Checks the locked packages against the database of RustSec; true also where there is no program or no database, which is said.
///
/// # Errors
/// The program cannot be started.
pub fn run(workspace: &Workspace) -> Result<bool> {
    let deny = |words: &[&str]| {
        let mut command = process::cargo();
        command.current_dir(&workspace.workspace_root).arg("deny").args(words);
        command
    };
    if !process::works(&mut deny(&["--version"])) {
        println!("advisories were not checked: no cargo-deny (cargo install cargo-deny)");
        return Ok(true);
    }
    if !process::works(&mut deny(&["fetch", "db"])) {
        println!("advisories were not checked: their database cannot be had here");
        return Ok(true);
    }
    Ok(process::run(&mut deny(&["check", "advisories"])).is_ok())
}
