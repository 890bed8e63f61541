//! `cargo xtask fuzz`: each target of `fuzz/` for a given time.

use crate::{process, workspace::Workspace};
use anyhow::{Context, Result, bail};
use std::fs;
use std::process::Command;

/// Runs every target; true when none found anything.
///
/// # Errors
/// There are no targets, or cargo-fuzz or the nightly toolchain is missing.
pub fn run(workspace: &Workspace, seconds: u64) -> Result<bool> {
    let folder = workspace.workspace_root.join("fuzz");
    if !folder.join("Cargo.toml").is_file() {
        bail!("expected fuzz targets in {}, found none", folder.display());
    }
    // `cargo` alone, not the pinned one that started this program: only rustup's front end understands `+nightly`.
    let nightly = || {
        let mut command = Command::new("cargo");
        command.arg("+nightly").current_dir(&workspace.workspace_root).env_remove("RUSTUP_TOOLCHAIN");
        command
    };
    if !process::works(nightly().arg("--version")) {
        bail!("expected a nightly toolchain, found none (rustup toolchain install nightly)");
    }
    if !process::works(nightly().args(["fuzz", "--version"])) {
        bail!("expected cargo-fuzz, found none (cargo install cargo-fuzz)");
    }
    let targets = process::output(nightly().args(["fuzz", "list"]))?;
    let mut failed = Vec::new();
    for target in targets.split_whitespace() {
        println!("{target}: {seconds} s");
        let limit = format!("-max_total_time={seconds}");
        // The first folder takes what the fuzzer finds; the seeds of the repository stay few.
        let found = workspace.target_directory.join("fuzz-corpus").join(target);
        fs::create_dir_all(&found).with_context(|| format!("making {}", found.display()))?;
        let seeds = folder.join("corpus").join(target);
        let mut fuzz = nightly();
        fuzz.args(["fuzz", "run", target]).arg(&found);
        if seeds.is_dir() {
            fuzz.arg(&seeds);
        }
        if process::run(fuzz.args(["--", &limit])).is_err() {
            failed.push(target);
        }
    }
    match failed.is_empty() {
        true => println!("{} fuzz targets ran for {seconds} s each, none failed", targets.split_whitespace().count()),
        false => println!("failed: {}", failed.join(", ")),
    }
    Ok(failed.is_empty())
}
