//! `cargo xtask book`: the pages of `docs` as a book, with links checked before.

use crate::{process, tidy, workspace::Workspace};
use anyhow::{Context, Result};
use std::fs;
use std::path::{Path, PathBuf};
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
    let book = workspace.target_directory.join("book");
    let dead = dead_links(&book)?;
    dead.iter().for_each(|line| println!("{line}"));
    println!("written to {}, {} dead links", book.join("index.html").display(), dead.len());
    Ok(dead.is_empty())
}

/// Links of the book's pages to files that it does not have: what is outside `docs` is no part of it, and its first page is a copy.
fn dead_links(book: &Path) -> Result<Vec<String>> {
    let mut dead = Vec::new();
    for page in pages(book)? {
        let text = fs::read_to_string(&page).with_context(|| format!("reading {}", page.display()))?;
        let folder = page.parent().unwrap_or(book);
        let own = text.split_once("<main>").map_or("", |(_, rest)| rest.split("</main>").next().unwrap_or_default());
        let shown = page.strip_prefix(book).unwrap_or(&page).display();
        let lost = links(own).into_iter().filter(|link| !folder.join(link).exists());
        dead.extend(lost.map(|link| format!("{shown}: expected {link} in the book, found none")));
    }
    dead.sort();
    Ok(dead)
}

/// Files that a page links to, without places in them, and without addresses.
fn links(html: &str) -> Vec<&str> {
    let all = ["href=\"", "src=\""].into_iter().flat_map(|key| html.split(key).skip(1));
    let targets = all.filter_map(|rest| rest.split(['"', '#']).next());
    targets.filter(|target| !target.is_empty() && !target.contains(':')).collect()
}

/// The book's pages, but for those that mdbook makes of all others.
fn pages(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).with_context(|| format!("reading {}", folder.display()))? {
        let path = entry?.path();
        let is_of_mdbook = ["print.html", "toc.html", "404.html"].iter().any(|name| path.ends_with(name));
        if path.is_dir() {
            found.extend(pages(&path)?);
        } else if path.extension().is_some_and(|e| e == "html") && !is_of_mdbook {
            found.push(path);
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_to_nothing_are_found() {
        let folder = std::env::temp_dir().join(format!("qv-book-{}", std::process::id()));
        fs::create_dir_all(folder.join("guide")).unwrap();
        let page = "<main><a href=\"b.html#x\">b</a><a href=\"https://x.y\">y</a><a href=\"#z\">z</a><img src=\"../gone.png\"></main><a href=\"c.html\">";
        fs::write(folder.join("guide/a.html"), page).unwrap();
        fs::write(folder.join("guide/b.html"), "<main></main>").unwrap();
        let dead = dead_links(&folder).unwrap();
        fs::remove_dir_all(&folder).unwrap();
        assert_eq!(dead, ["guide/a.html: expected ../gone.png in the book, found none"]);
    }
}
