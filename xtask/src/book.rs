//! `cargo xtask book`: the pages of `docs` as a book, with links checked before.

use crate::{process, tidy, workspace::Workspace};
use anyhow::Result;
use std::process::Command;

/// How to get the program that builds the book.
const INSTALL: &str =
    "error: cannot build the book: no 'mdbook' on PATH\nhint: cargo install mdbook --version ^0.4 --locked";

/// Checks the links of all pages and builds `target/book`; false where a link is broken or mdbook is missing.
///
/// # Errors
/// A page cannot be read, or mdbook fails.
pub fn run(workspace: &Workspace) -> Result<bool> {
    let broken = tidy::broken_links(workspace)?;
    for line in &broken {
        println!("{line}");
    }
    if !broken.is_empty() {
        println!("{} broken links", broken.len());
        return Ok(false);
    }
    let mut version = Command::new("mdbook");
    if !process::works(version.arg("--version")) {
        eprintln!("{INSTALL}");
        return Ok(false);
    }
    process::run(Command::new("mdbook").arg("build").arg(workspace.workspace_root.join("docs")))?;
    println!("written to {}", workspace.target_directory.join("book/index.html").display());
    Ok(true)
}
