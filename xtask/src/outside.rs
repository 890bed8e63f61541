//! `cargo xtask outside`: a program outside of the workspace, built from the packaged form of our crates and run.

use crate::{process, workspace::Workspace};
use anyhow::{Context, Result};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Crates that the program names.
const USED: [&str; 2] = ["quadverse-contact", "quadverse-sim"];
/// Folder of the program, in the target folder.
const FOLDER: &str = "outside";

/// Packages, unpacks, builds and runs; true when the program succeeds.
///
/// # Errors
/// A crate cannot be packaged or unpacked, or the program cannot be written.
pub fn run(workspace: &Workspace) -> Result<bool> {
    let folder = workspace.target_directory.join(FOLDER);
    let crates = folder.join("crates");
    if crates.exists() {
        fs::remove_dir_all(&crates).with_context(|| format!("removing {}", crates.display()))?;
    }
    for made in [&crates, &folder.join("src")] {
        fs::create_dir_all(made).with_context(|| format!("making {}", made.display()))?;
    }
    let names = published(workspace);
    package(workspace, &names)?;
    let version = workspace.version()?;
    for name in &names {
        unpack(&workspace.target_directory.join(format!("package/{name}-{version}.crate")), &crates)?;
    }
    let needed = needed(workspace);
    let source = workspace.workspace_root.join("fixtures/outside/main.rs");
    copy(&source, &folder.join("src/main.rs"))?;
    // The versions that are tested here; cargo leaves out of the list what the program does not use.
    copy(&workspace.workspace_root.join("Cargo.lock"), &folder.join("Cargo.lock"))?;
    let manifest = folder.join("Cargo.toml");
    fs::write(&manifest, manifest_text(&needed, version)).with_context(|| format!("writing {}", manifest.display()))?;
    let mut program = process::cargo();
    program.current_dir(&folder).args(["run", "--quiet", "--release"]).env("CARGO_TARGET_DIR", folder.join("target"));
    process::succeeds(&mut program)
}

/// Packages that may go to a registry. All are packaged at once: what tests of one use is looked for, too.
fn published(workspace: &Workspace) -> Vec<String> {
    let published = workspace.members().filter(|package| package.is_published());
    published.map(|package| package.name.clone()).collect()
}

/// Those of ours that the program links.
fn needed(workspace: &Workspace) -> Vec<String> {
    let mut needed = USED.map(String::from).to_vec();
    let mut next = 0;
    while next < needed.len() {
        let package = workspace.members().find(|package| package.name == needed[next]);
        let linked = package.into_iter().flat_map(|p| &p.dependencies).filter(|d| d.kind.as_deref() != Some("dev"));
        for name in linked.map(|dependency| &dependency.name) {
            if !needed.contains(name) && workspace.members().any(|package| package.name == *name) {
                needed.push(name.clone());
            }
        }
        next += 1;
    }
    needed
}

/// Archives as a registry would get them, under `package` in the target folder.
fn package(workspace: &Workspace, names: &[String]) -> Result<()> {
    let mut cargo = process::cargo();
    cargo.current_dir(&workspace.workspace_root).env("CARGO_TARGET_DIR", &workspace.target_directory);
    // Each is built below, by the program.
    cargo.args(["package", "--quiet", "--locked", "--no-verify", "--allow-dirty"]);
    process::run(cargo.args(names.iter().flat_map(|name| ["--package", name])))
}

fn unpack(archive: &Path, folder: &Path) -> Result<()> {
    process::run(Command::new("tar").arg("-xzf").arg(archive).arg("-C").arg(folder))
}

fn copy(from: &PathBuf, to: &PathBuf) -> Result<()> {
    fs::copy(from, to).map(drop).with_context(|| format!("copying {}", from.display()))
}

/// The program's manifest: a workspace of its own, with paths in place of the registry.
fn manifest_text(names: &[String], version: &str) -> String {
    // Packages in a folder of a workspace are its members, whose tests' dependencies are looked for.
    let mut text = String::from(
        "[package]\nname = \"outside\"\nedition = \"2024\"\npublish = false\n\n\
         [workspace]\nexclude = [\"crates\"]\n\n[dependencies]\n",
    );
    let path = |name: &str| format!("path = \"crates/{name}-{version}\"");
    for name in USED {
        text += &format!("{} = {{ package = \"{name}\", {} }}\n", crate::workspace::short(name), path(name));
    }
    text += "\n[patch.crates-io]\n";
    for name in names {
        text += &format!("{name} = {{ {} }}\n", path(name));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_manifest_takes_all_of_ours_from_paths() {
        let names = ["quadverse-contact", "quadverse-core", "quadverse-sim"].map(String::from);
        let fields: toml::Value = toml::from_str(&manifest_text(&names, "1.2.3")).unwrap();
        assert_eq!(fields["dependencies"]["qv-sim"]["path"].as_str(), Some("crates/quadverse-sim-1.2.3"));
        assert_eq!(fields["dependencies"]["qv-sim"]["package"].as_str(), Some("quadverse-sim"));
        assert_eq!(
            fields["patch"]["crates-io"]["quadverse-core"]["path"].as_str(),
            Some("crates/quadverse-core-1.2.3")
        );
        assert!(fields.get("workspace").is_some(), "it belongs to no other workspace");
    }
}
