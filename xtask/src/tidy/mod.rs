//! `cargo xtask tidy`: the invariants of docs/dev/ARCHITECTURE.md, read from `cargo metadata` and the files. Also a test.

mod circles;
mod goldens;
mod layers;
mod licences;
mod links;
mod module_paths;
mod names;
mod rust_text;
mod source;
mod sources;
mod words;

use crate::workspace::{Package, Workspace};
use anyhow::{Context, Result};
use source::Source;
use std::fs;

/// Everything that breaks an invariant, one line each.
///
/// # Errors
/// Something that must be read cannot be read.
fn findings(workspace: &Workspace) -> Result<Vec<String>> {
    let root = &workspace.workspace_root;
    let (texts, files) = (sources(workspace)?, workspace.files()?);
    let mut found = layers::check(workspace, &texts);
    found.extend(licences::check(workspace, &workspace.packages)?);
    found.extend(sources::check(workspace, &texts));
    found.extend(circles::check(workspace, &texts));
    found.extend(names::check(&texts));
    found.extend(links::check(&texts, &files));
    found.extend(words::check(&texts));
    found.extend(goldens::check(root, &texts)?);
    found.sort();
    Ok(found)
}

/// All files of the repository that are text.
fn sources(workspace: &Workspace) -> Result<Vec<Source>> {
    let mut texts = Vec::new();
    for path in workspace.files()? {
        let file = workspace.workspace_root.join(&path);
        let bytes = fs::read(file).with_context(|| format!("reading {}", path.display()))?;
        // What is not UTF-8 is not text, and no rule here speaks of it.
        if let Ok(text) = String::from_utf8(bytes) {
            texts.push(Source { path, text });
        }
    }
    Ok(texts)
}

/// Links of pages that lead nowhere, and pages that the book lacks.
///
/// # Errors
/// A file cannot be read.
pub fn broken_links(workspace: &Workspace) -> Result<Vec<String>> {
    Ok(links::check(&sources(workspace)?, &workspace.files()?))
}

/// Those of some packages, of whatever workspace, whose licence deny.toml does not allow.
///
/// # Errors
/// deny.toml cannot be read.
pub fn licences(workspace: &Workspace, packages: &[Package]) -> Result<Vec<String>> {
    licences::check(workspace, packages)
}

/// Prints what breaks an invariant; true when nothing does.
///
/// # Errors
/// Something that must be read cannot be read.
pub fn run(workspace: &Workspace) -> Result<bool> {
    let found = findings(workspace)?;
    for line in &found {
        println!("{line}");
    }
    println!("tidy: {} found", found.len());
    Ok(found.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_workspace_is_tidy() {
        let found = findings(&Workspace::load().unwrap()).unwrap();
        assert!(found.is_empty(), "{}", found.join("\n"));
    }
}
