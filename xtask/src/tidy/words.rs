//! Words of our own for what the field calls otherwise: neither pages nor messages use them.

use super::links::prose_lines;
use super::rust_text::{Strings, code, literals, without_tests};
use super::source::Source;
use std::path::Path;

#[path = "../../../fixtures/words.rs"]
mod list;

/// Stands for the first byte of a literal.
const MARK: u8 = b'@';

/// All findings in pages and in string literals of programs.
pub fn check(sources: &[Source]) -> Vec<String> {
    sources
        .iter()
        .flat_map(|source| if is_page(&source.path) { in_page(source) } else { in_messages(source) })
        .collect()
}

/// Pages for readers; the history of what changed keeps the words of its day.
fn is_page(path: &Path) -> bool {
    path.extension().is_some_and(|end| end == "md") && path != Path::new("CHANGELOG.md")
}

/// Programs whose strings people read: not tests, examples, or the list itself.
fn has_messages(path: &Path) -> bool {
    let apart = ["tests", "examples", "fixtures", "fuzz", "benches"];
    path.extension().is_some_and(|end| end == "rs") && !path.iter().any(|part| apart.iter().any(|name| part == *name))
}

fn in_page(page: &Source) -> Vec<String> {
    let mut found = Vec::new();
    for (number, line) in prose_lines(&page.text) {
        // What stands between backticks is code.
        let text: Vec<&str> = line.split('`').step_by(2).collect();
        found.extend(findings(&page.path, number, &text.join("`")));
    }
    found
}

fn in_messages(source: &Source) -> Vec<String> {
    if !has_messages(&source.path) {
        return Vec::new();
    }
    let all = literals(&source.text);
    // Marks where literals begin; those of tests go with the tests.
    let mut marked = code(&source.text, Strings::Blank).into_bytes();
    all.iter().for_each(|(at, _)| marked[*at] = MARK);
    let kept = without_tests(&String::from_utf8(marked).unwrap_or_default()).into_bytes();
    // A key or a name has no blanks.
    let read = all.iter().filter(|(at, literal)| kept.get(*at) == Some(&MARK) && literal.contains(' '));
    let line = |at: usize| 1 + source.text[..at].matches('\n').count();
    read.flat_map(|(at, literal)| findings(&source.path, line(*at), &message(literal))).collect()
}

/// What people read of a literal: neither names of values in braces nor code in backticks.
fn message(literal: &str) -> String {
    let prose: Vec<&str> = literal.split('`').step_by(2).collect();
    let mut text = String::new();
    let mut depth = 0usize;
    for c in prose.join("`").chars() {
        depth += usize::from(c == '{');
        if depth == 0 {
            text.push(c);
        }
        depth = depth.saturating_sub(usize::from(c == '}'));
    }
    text
}

fn findings(path: &Path, number: usize, text: &str) -> Vec<String> {
    let one = |(old, field): (&str, &str)| format!("{}:{number}: expected `{field}`, found `{old}`", path.display());
    list::old_words(text).into_iter().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(path: &str, text: &str) -> Vec<String> {
        check(&[Source { path: path.into(), text: text.into() }])
    }

    #[test]
    fn old_words_of_pages_and_messages_are_findings() {
        let page = "# A robot\nIt strays.\n```\nqv strays\n```\nThe `strays` option, astray.\n";
        assert_eq!(of("docs/a.md", page), ["docs/a.md:2: expected `path-tracking error`, found `strays`"]);
        let code =
            "fn f() { say(\"the robot strays by {stray} of `stray`\"); } // strays\nconst KEY: &str = \"strays\";\n";
        assert_eq!(of("crates/a/src/lib.rs", code).len(), 1);
        assert!(of("CHANGELOG.md", "It strays.").is_empty() && of("crates/a/tests/it.rs", code).is_empty());
    }

    #[test]
    fn messages_of_tests_are_free() {
        let code = "fn f() {}\n#[cfg(test)]\nmod tests {\n    fn g() { h(\"it strays far\",\n\"it strays\"); }\n}\n";
        assert!(of("crates/a/src/lib.rs", code).is_empty());
    }
}
