//! `cargo xtask dist`: what is given away: wheels and static programs for Linux, their hashes, and a list of what is inside.

mod artifact;
mod build;
mod check;
mod sbom;
mod sums;
mod system;

use crate::workspace::Workspace;
use anyhow::{Context, Result};
use artifact::Artifact;
use std::fs;
use std::path::{Path, PathBuf};

/// What to make.
#[derive(clap::Args)]
pub struct Dist {
    /// Make only this artifact [default: all]
    #[arg(long, value_enum, value_name = "ARTIFACT")]
    target: Vec<Artifact>,
    /// Run what was made before in old systems: x86-64 in a chroot (root, debootstrap), aarch64 under qemu-user
    #[arg(long)]
    check: bool,
}

/// Largest size of a file \[bytes\].
const LARGEST: u64 = 25_000_000;

/// Builds the artifacts, or checks those that were built; false when one is too large or fails.
///
/// # Errors
/// A tool or the standard library of a target is missing, or something does not build.
pub fn run(workspace: &Workspace, how: &Dist) -> Result<bool> {
    let chosen = if how.target.is_empty() { Artifact::ALL.to_vec() } else { how.target.clone() };
    let folder = folder(workspace);
    if how.check {
        return check::run(workspace, &folder, &chosen);
    }
    fs::create_dir_all(&folder).with_context(|| format!("making {}", folder.display()))?;
    let mut fits = true;
    for artifact in chosen {
        let file = build::build(workspace, &folder, artifact)?;
        fits &= report_size(&file)?;
    }
    sbom::write(workspace, &folder)?;
    sums::write(&folder)?;
    println!("written to {}", folder.display());
    Ok(fits)
}

/// Folder that everything goes to.
fn folder(workspace: &Workspace) -> PathBuf {
    workspace.target_directory.join("distribution")
}

fn report_size(file: &Path) -> Result<bool> {
    let bytes = fs::metadata(file).with_context(|| format!("reading {}", file.display()))?.len();
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let fits = bytes <= LARGEST;
    let remark = if fits { "" } else { ", more than allowed" };
    println!("{name}: {:.1} of {} MB{remark}", bytes as f64 / 1e6, LARGEST / 1_000_000);
    Ok(fits)
}
