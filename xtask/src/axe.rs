//! `cargo xtask axe`: axe-core on the pages that tests kept. No build needs it: node and two of its packages are the user's.

use crate::{pipeline::look, process, workspace::Workspace};
use anyhow::{Context, Result};
use clap::Args;
use std::fs;
use std::path::PathBuf;
use std::process::Command;

const SCRIPT: &str = include_str!("axe.mjs");

/// Where pages and packages are.
#[derive(Args)]
pub struct Axe {
    /// Folder of pages; default target/pages, which `QV_PAGES=$PWD/target/pages cargo xtask test` fills
    #[arg(long, value_name = "DIR")]
    pages: Option<PathBuf>,
    /// Folder in which `npm install puppeteer-core axe-core` was run
    #[arg(long, value_name = "DIR")]
    modules: PathBuf,
}

/// True without serious findings.
///
/// # Errors
/// There is no node, browser, package or page.
pub fn run(workspace: &Workspace, axe: &Axe) -> Result<bool> {
    let browser = look::browser().context("cannot run axe: no Chromium on PATH")?;
    let browser = if browser.is_absolute() { browser } else { found(&browser)? };
    let pages = axe.pages.clone().unwrap_or_else(|| workspace.target_directory.join("pages"));
    let absolute = |path: &PathBuf| path.canonicalize().with_context(|| format!("no folder {}", path.display()));
    let script = workspace.target_directory.join("axe.mjs");
    fs::write(&script, SCRIPT).with_context(|| format!("writing {}", script.display()))?;
    let mut node = Command::new("node");
    process::succeeds(node.arg(&script).arg(absolute(&pages)?).arg(absolute(&axe.modules)?).arg(&browser))
}

/// The path of a program on PATH.
fn found(name: &std::path::Path) -> Result<PathBuf> {
    let paths = std::env::var_os("PATH").context("no PATH")?;
    let mut all = std::env::split_paths(&paths).map(|folder| folder.join(name));
    all.find(|path| path.is_file()).with_context(|| format!("no {} on PATH", name.display()))
}
