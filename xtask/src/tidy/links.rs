//! Links of pages: every file and every heading that a page of Markdown points at is there, and the book has every page of `docs`.

use super::source::Source;
use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};

/// The table of contents of the book.
const SUMMARY: &str = "docs/SUMMARY.md";

/// What is linked to and not there, one line each.
pub fn check(texts: &[Source], files: &[PathBuf]) -> Vec<String> {
    let pages: Vec<&Source> = texts.iter().filter(|s| s.path.extension().is_some_and(|end| end == "md")).collect();
    let mut found: Vec<String> = pages.iter().flat_map(|page| broken(page, &pages, files)).collect();
    found.extend(unlisted(&pages));
    found
}

/// Links of a page that lead nowhere.
fn broken(page: &Source, pages: &[&Source], files: &[PathBuf]) -> Vec<String> {
    let here = page.path.display();
    let mut found = vec![];
    for target in links(&page.text) {
        let (file, heading) = target.split_once('#').map_or((target, None), |(file, heading)| (file, Some(heading)));
        let folder = page.path.parent().unwrap_or(Path::new(""));
        let path = if file.is_empty() { page.path.clone() } else { plain(&folder.join(file)) };
        // A folder is there when something in it is.
        if !files.iter().any(|known| known.starts_with(&path)) {
            found.push(format!("{here}: link to {target}: expected a file of the repository, found none"));
        } else if let (Some(heading), Some(other)) = (heading, pages.iter().find(|p| p.path == path))
            && !anchors(&other.text).contains(heading)
        {
            found.push(format!("{here}: link to {target}: expected a heading of {}, found none", path.display()));
        }
    }
    found
}

/// Pages of `docs` that the book lacks.
fn unlisted(pages: &[&Source]) -> Vec<String> {
    let Some(summary) = pages.iter().find(|page| page.path == Path::new(SUMMARY)) else { return vec![] };
    let listed: BTreeSet<PathBuf> = links(&summary.text).into_iter().map(|link| Path::new("docs").join(link)).collect();
    let is_page = |page: &&&Source| page.path.starts_with("docs") && page.path != Path::new(SUMMARY);
    let missing = pages.iter().filter(is_page).filter(|page| !listed.contains(&page.path));
    missing.map(|page| format!("{SUMMARY}: expected {}, found no link to it", page.path.display())).collect()
}

/// A path without `.` and `..`.
fn plain(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => _ = out.pop(),
            Component::CurDir => {}
            other => out.push(other),
        }
    }
    out
}

/// Targets of links within the repository, outside of code.
fn links(text: &str) -> Vec<&str> {
    let mut found = vec![];
    for line in prose(text) {
        // What stands between backticks is code.
        for part in line.split('`').step_by(2) {
            let targets = part.split("](").skip(1).filter_map(|rest| rest.split([')', ' ']).next());
            found.extend(targets.filter(|t| !t.is_empty() && !t.contains("://") && !t.starts_with("mailto:")));
        }
        // A link whose words are code: its target stands behind the backtick.
        let behind = line.split("`](").skip(1).filter_map(|rest| rest.split([')', ' ']).next());
        found.extend(behind.filter(|t| !t.is_empty() && !t.contains("://")));
    }
    found
}

/// Lines outside of fences.
fn prose(text: &str) -> impl Iterator<Item = &str> {
    prose_lines(text).map(|(_, line)| line)
}

/// Lines outside of fences with their numbers from 1.
pub fn prose_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut is_code = false;
    let numbered = text.lines().enumerate().map(|(k, line)| (k + 1, line));
    numbered.filter(move |(_, line)| {
        let is_fence = line.trim_start().starts_with("```");
        is_code ^= is_fence;
        !is_code && !is_fence
    })
}

/// Headings as links name them: small letters, digits, hyphens for blanks.
fn anchors(text: &str) -> BTreeSet<String> {
    let headings = prose(text).filter(|line| line.starts_with('#'));
    let anchor = |line: &str| {
        let words = line.trim_start_matches('#').trim().to_lowercase();
        let kept = words.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
        kept.map(|c| if c == ' ' { '-' } else { c }).collect()
    };
    headings.map(anchor).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(path: &str, text: &str) -> Source {
        Source { path: path.into(), text: text.into() }
    }

    #[test]
    fn links_to_nowhere_and_pages_that_the_book_lacks_are_named() {
        let texts = [
            source(
                "docs/a.md",
                "[b](b.md#two-words), [`x`](../src/x.rs), [web](https://a.b/c.md)\n```\n[no](no.md)\n```\n`[no](no.md)`\n",
            ),
            source(
                "docs/b.md",
                "# B\n## Two `words`!\n[up](../README.md) [gone](c.md) [here](#three) [folder](../src)\n",
            ),
            source("docs/SUMMARY.md", "- [A](a.md)\n"),
            source("README.md", ""),
        ];
        let files: Vec<PathBuf> = texts.iter().map(|s| s.path.clone()).chain(["src/x.rs".into()]).collect();
        let found = check(&texts, &files);
        assert_eq!(found.len(), 3, "{found:?}");
        assert!(found[0].starts_with("docs/b.md: link to c.md: expected a file"), "{found:?}");
        assert!(found[1].starts_with("docs/b.md: link to #three: expected a heading of docs/b.md"), "{found:?}");
        assert!(found[2].starts_with("docs/SUMMARY.md: expected docs/b.md"), "{found:?}");
    }
}
