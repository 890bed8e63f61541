//! `cargo xtask ros2`: the node for ROS 2 in `ros2/`, which is a workspace of its own: its licences, clippy, and its tests over loopback.

use crate::{process, tidy, workspace::Workspace};
use anyhow::{Context, Result, bail};
use std::process::Command;

/// `cargo WHAT` in the node's folder, which builds into a folder of its own.
fn cargo(workspace: &Workspace, what: &[&str]) -> Command {
    let mut command = process::cargo();
    command.current_dir(workspace.workspace_root.join("ros2"));
    command.env("CARGO_TARGET_DIR", workspace.target_directory.join("ros2")).args(what);
    command
}

/// Checks, builds and tests it; true when nothing fails.
///
/// # Errors
/// It is not there, cargo cannot be started, or a licence is not allowed.
pub fn run(workspace: &Workspace) -> Result<bool> {
    let json = process::output(&mut cargo(workspace, &["metadata", "--format-version", "1", "--locked"]))?;
    let node: Workspace = serde_json::from_str(&json).context("cargo metadata of ros2: unexpected shape")?;
    let wrong = tidy::licences(workspace, &node.packages)?;
    if !wrong.is_empty() {
        bail!("licences of ros2:\n{}", wrong.join("\n"));
    }
    println!("licences: {} packages, all allowed", node.packages.len());
    process::run(&mut cargo(workspace, &["fmt", "--check"]))?;
    let clippy = ["clippy", "--locked", "--all-targets", "--quiet", "--", "-D", "warnings"];
    process::run(&mut cargo(workspace, &clippy))?;
    Ok(process::run(&mut cargo(workspace, &["test", "--locked"])).is_ok())
}
