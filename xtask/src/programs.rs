//! Programs of the workspace that chores run: how they are built, and where they lie.

use crate::process;
use crate::workspace::{Build, Workspace};
use anyhow::Result;
use std::path::PathBuf;

/// Builds programs of packages and returns the folder that they lie in; examples lie in its `examples`.
///
/// # Errors
/// They do not build.
pub fn build(workspace: &Workspace, packages: &[&str], options: &[&str]) -> Result<PathBuf> {
    let mut cargo = process::cargo();
    cargo.current_dir(&workspace.workspace_root).args(["build", "--locked"]);
    let folder = match workspace.build {
        Build::Release => {
            cargo.arg("--release").args(packages.iter().flat_map(|package| ["--package", package])).args(options);
            "release"
        }
        // The very targets and features of the tests: without what only tests depend on, features of dependencies differ, and these would be
        // built anew. Of examples only those that are asked for.
        Build::Tests => {
            cargo.args(["--workspace", "--all-features", "--lib", "--bins", "--tests"]);
            cargo.args(options.iter().skip_while(|option| **option != "--example").take(2));
            "debug"
        }
    };
    process::run(cargo.args(["--target-dir"]).arg(&workspace.target_directory))?;
    Ok(workspace.target_directory.join(folder))
}

/// Builds `qv` and returns the program.
///
/// # Errors
/// It does not build.
pub fn qv(workspace: &Workspace) -> Result<PathBuf> {
    Ok(build(workspace, &["quadverse"], &[])?.join(file("qv")))
}

/// What the file of a program is called here.
pub fn file(name: &str) -> String {
    format!("{name}{}", std::env::consts::EXE_SUFFIX)
}
