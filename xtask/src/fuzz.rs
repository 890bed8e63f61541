//! `cargo xtask fuzz`: each target of `fuzz/` for a given time.

use crate::{process, workspace::Workspace};
use anyhow::{Context, Result, bail};
use std::fs;
use std::process::Command;

/// How the fuzzers are built: on nightly with the address sanitizer, else with the pinned compiler and none.
///
/// What libFuzzer needs of the compiler (coverage counters) is unstable, not missing, so `RUSTC_BOOTSTRAP` opens it on stable.
/// The sanitizer's run time comes with nightly alone; our readers have no `unsafe` of their own, so little is lost without it.
struct Fuzzer<'a> {
    workspace: &'a Workspace,
    nightly: bool,
}

impl Fuzzer<'_> {
    fn cargo(&self) -> Command {
        // `cargo` alone, not the pinned one that started this program: only rustup's front end understands `+nightly`.
        let mut command = Command::new("cargo");
        command.current_dir(&self.workspace.workspace_root);
        command.env("CARGO_TARGET_DIR", self.workspace.target_directory.join("fuzz"));
        if self.nightly {
            command.arg("+nightly").env_remove("RUSTUP_TOOLCHAIN");
        } else {
            command.env("RUSTC_BOOTSTRAP", "1");
        }
        command
    }

    /// `cargo fuzz WHAT`, with the sanitizer that there is.
    fn fuzz(&self, what: &str) -> Command {
        let mut command = self.cargo();
        command.args(["fuzz", what]);
        if !self.nightly {
            command.args(["-s", "none"]);
        }
        command
    }
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
    let mut fuzzer = Fuzzer { workspace, nightly: true };
    fuzzer.nightly = process::works(fuzzer.cargo().arg("--version"));
    if !process::works(fuzzer.cargo().args(["fuzz", "--version"])) {
        bail!("expected cargo-fuzz, found none (cargo install cargo-fuzz)");
    }
    if !fuzzer.nightly {
        println!("no nightly toolchain: the pinned compiler, without the address sanitizer");
    }
    let listed = process::output(fuzzer.cargo().args(["fuzz", "list"]))?;
    let targets = chosen(&listed, only)?;
    process::run(&mut fuzzer.fuzz("build"))?;
    let mut failed = Vec::new();
    for target in &targets {
        println!("{target}: {seconds} s");
        // The first folder takes what the fuzzer finds; the seeds of the repository stay few.
        let found = workspace.target_directory.join("fuzz-corpus").join(target);
        fs::create_dir_all(&found).with_context(|| format!("making {}", found.display()))?;
        let seeds = folder.join("corpus").join(target);
        let mut fuzz = fuzzer.fuzz("run");
        fuzz.arg(target).arg(&found);
        if seeds.is_dir() {
            fuzz.arg(&seeds);
        }
        // A reader that takes 10 s for a small file is a fault.
        if process::run(fuzz.arg("--").arg(format!("-max_total_time={seconds}")).arg("-timeout=10")).is_err() {
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
