//! `cargo xtask quick`: format, clippy and tests of the crates that changed, for the loop of a developer.

use crate::{process, test, workspace::Workspace};
use anyhow::{Context, Result, bail};
use std::path::Path;
use std::process::Command;
use std::time::Instant;

/// What counts as a change.
#[derive(clap::Args)]
pub struct Quick {
    /// Revision that the working tree is compared with
    #[arg(long, default_value = "HEAD", value_name = "REV")]
    since: String,
}

/// Checks the crates that changed; true when all is well.
///
/// # Errors
/// git or cargo cannot be run.
pub fn run(workspace: &Workspace, quick: &Quick) -> Result<bool> {
    let clock = Instant::now();
    let packages = changed(workspace, &changed_files(workspace, &quick.since)?);
    if !process::succeeds(process::cargo().current_dir(&workspace.workspace_root).args(["fmt", "--all", "--check"]))? {
        return Ok(false);
    }
    if packages.is_empty() {
        println!("no crate differs from {}", quick.since);
        return Ok(true);
    }
    println!("changed: {}", packages.join(", "));
    let which: Vec<String> = packages.iter().flat_map(|name| ["--package".into(), name.clone()]).collect();
    let which = [which, vec!["--all-features".into()]].concat();
    let mut clippy = process::cargo();
    clippy.current_dir(&workspace.workspace_root).args(["clippy", "--all-targets", "--locked"]).args(&which);
    let is_clean = process::succeeds(clippy.args(["--", "-D", "warnings"]))?;
    let passed = is_clean && test::run_packages(workspace, &which, false)?;
    println!("{:.0} s", clock.elapsed().as_secs_f64());
    Ok(passed)
}

/// Files that differ from a revision, and those that git does not know yet, relative to the root.
fn changed_files(workspace: &Workspace, since: &str) -> Result<Vec<String>> {
    if since.starts_with('-') {
        bail!("--since: expected a revision, found {since:?}");
    }
    let git = |words: &[&str]| {
        let mut command = Command::new("git");
        process::output(command.current_dir(&workspace.workspace_root).args(words)).context("listing what changed")
    };
    let listed = git(&["diff", "--name-only", "-z", since, "--"])?
        + &git(&["ls-files", "-z", "--others", "--exclude-standard"])?;
    Ok(listed.split('\0').filter(|name| !name.is_empty()).map(String::from).collect())
}

/// Names of the packages that own one of the files; all where one belongs to none and is no page: a lock file, or what tests share.
fn changed(workspace: &Workspace, files: &[String]) -> Vec<String> {
    let root = &workspace.workspace_root;
    let owns = |folder: &Path| files.iter().any(|file| root.join(file).starts_with(folder));
    let has_owner = |file: &&String| workspace.members().any(|package| root.join(file).starts_with(package.folder()));
    let is_page = |file: &&String| [".md", ".png"].iter().any(|end| file.ends_with(end));
    let is_all = files.iter().any(|file| !has_owner(&file) && !is_page(&file));
    let members = workspace.members().filter(|package| is_all || owns(package.folder()));
    members.map(|package| package.name.clone()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_belongs_to_the_package_in_whose_folder_it_lies() {
        let workspace = Workspace::load().unwrap();
        let of = |files: &[&str]| changed(&workspace, &files.iter().map(|f| (*f).to_string()).collect::<Vec<_>>());
        assert_eq!(of(&["crates/qv-sim/src/lib.rs", "README.md"]), ["quadverse-sim"]);
        assert_eq!(of(&["crates/qv/Cargo.toml"]), ["quadverse"], "not the crates whose names begin alike");
        assert_eq!(of(&["fixtures/yard/src/lib.rs"]), ["yard"]);
        assert!(of(&["docs/guide/tuning.md"]).is_empty());
        assert_eq!(of(&["fixtures/facts.rs"]).len(), workspace.members().count(), "what tests share");
    }
}
