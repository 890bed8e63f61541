//! `cargo xtask fuzz`: each target of `fuzz/` for a given time.

use crate::{process, workspace::Workspace};
use anyhow::{Context, Result, bail};
use std::fs;
use std::process::Command;

/// `cargo fuzz WHAT` with the pinned compiler and no sanitizer.
///
/// The coverage counters that libFuzzer needs are unstable, not missing: `RUSTC_BOOTSTRAP` opens them on stable. The address sanitizer
/// needs a nightly's run time; our readers have no `unsafe` of their own, so that it would look at other people's code alone.
fn fuzz(workspace: &Workspace, what: &[&str]) -> Command {
    let mut command = process::cargo();
    command.current_dir(&workspace.workspace_root);
    command.env("CARGO_TARGET_DIR", workspace.target_directory.join("fuzz")).env("RUSTC_BOOTSTRAP", "1");
    command.arg("fuzz").args(what);
    command
}

/// Runs the targets, or those that are named; true when none found anything.
///
/// # Errors
/// There are no targets, one is named that does not exist, a build fails, or cargo-fuzz is missing.
pub fn run(workspace: &Workspace, seconds: u64, only: &[String]) -> Result<bool> {
    let folder = workspace.workspace_root.join("fuzz");
    if !folder.join("Cargo.toml").is_file() {
        bail!("expected fuzz targets in {}, found none", folder.display());
    }
    if !process::works(&mut fuzz(workspace, &["--version"])) {
        bail!("expected cargo-fuzz, found none (cargo install cargo-fuzz)");
    }
    let listed = process::output(&mut fuzz(workspace, &["list"]))?;
    let targets = chosen(&listed, only)?;
    process::run(&mut fuzz(workspace, &["build", "-s", "none"]))?;
    let mut failed = Vec::new();
    for target in &targets {
        println!("{target}: {seconds} s");
        // The first folder takes what the fuzzer finds; the seeds of the repository stay few.
        let found = workspace.target_directory.join("fuzz-corpus").join(target);
        fs::create_dir_all(&found).with_context(|| format!("making {}", found.display()))?;
        let seeds = folder.join("corpus").join(target);
        let mut run = fuzz(workspace, &["run", "-s", "none", target]);
        run.arg(&found);
        if seeds.is_dir() {
            run.arg(&seeds);
        }
        // A reader that takes 10 s for a small file is a fault.
        if process::run(run.arg("--").arg(format!("-max_total_time={seconds}")).arg("-timeout=10")).is_err() {
            failed.push(*target);
        }
    }
    match failed.is_empty() {
        true => println!("{} fuzz targets ran for {seconds} s each, none failed", targets.len()),
        false => println!("failed: {}", failed.join(", ")),
    }
    Ok(failed.is_empty())
}

/// The targets that are listed, or those of them that are named.
fn chosen<'a>(listed: &'a str, only: &[String]) -> Result<Vec<&'a str>> {
    let all: Vec<&str> = listed.split_whitespace().collect();
    if let Some(unknown) = only.iter().find(|name| !all.contains(&name.as_str())) {
        bail!("expected a fuzz target ({}), found {unknown}", all.join(", "));
    }
    Ok(all.into_iter().filter(|name| only.is_empty() || only.iter().any(|o| o == name)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn named_targets_must_exist() {
        assert_eq!(chosen("a\nb\n", &[]).unwrap(), ["a", "b"]);
        assert_eq!(chosen("a\nb\n", &["b".into()]).unwrap(), ["b"]);
        assert!(chosen("a\nb\n", &["c".into()]).unwrap_err().to_string().contains("a, b"));
    }
}
