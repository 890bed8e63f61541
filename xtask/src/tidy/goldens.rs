//! Every golden is listed, complete and used.

use super::source::Source;
use crate::golden::Manifest;
use anyhow::Result;
use serde_json::Value;
use std::path::Path;

/// Keys that a golden must carry.
const HEADER: [&str; 5] = ["generator", "name", "seed", "options", "tolerance"];

/// Goldens that are not listed, not there, not complete, or read by no test.
///
/// # Errors
/// The manifest cannot be read.
pub fn check(root: &Path, sources: &[Source]) -> Result<Vec<String>> {
    Ok(against(&Manifest::read(root)?, sources))
}

fn against(manifest: &Manifest, sources: &[Source]) -> Vec<String> {
    let fixtures = Path::new("fixtures");
    let is_golden = |path: &Path| path.starts_with(fixtures) && path.iter().any(|part| part == "golden");
    let mut found = Vec::new();
    for source in sources.iter().filter(|source| is_golden(&source.path)) {
        let listed = manifest.golden.iter().any(|entry| fixtures.join(&entry.file) == source.path);
        if !listed {
            found.push(format!("{}: expected it in fixtures/manifest.toml, found nothing", source.path.display()));
        }
        found.extend(header(source));
    }
    for entry in &manifest.golden {
        let path = fixtures.join(&entry.file);
        if !sources.iter().any(|source| source.path == path) {
            found.push(format!("fixtures/manifest.toml: {}: expected the file {}", entry.name, path.display()));
        }
        let quoted = format!("\"{}\"", entry.name);
        let is_test =
            |path: &Path| path.extension().is_some_and(|e| e == "rs") && path.iter().any(|part| part == "tests");
        if !sources.iter().any(|source| is_test(&source.path) && source.text.contains(&quoted)) {
            found.push(format!("{}: expected a test that names {quoted}, found none: a dead golden", path.display()));
        }
    }
    found
}

fn header(source: &Source) -> Vec<String> {
    let path = source.path.display();
    let json: Value = match serde_json::from_str(&source.text) {
        Ok(json) => json,
        Err(error) => return vec![format!("{path}: expected JSON, found {error}")],
    };
    let missing = HEADER.iter().filter(|key| json.get(key).is_none());
    missing.map(|key| format!("{path}: expected the key {key:?} in a golden, found none")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = r#"{"generator": "g", "name": "a", "seed": 0, "options": {}, "tolerance": {}}"#;

    fn manifest() -> Manifest {
        toml::from_str(
            "[generators.g]\ncommand = \"g.py\"\nenvironment = \"g\"\ntests = [\"golden\"]\n\
             [[golden]]\nfile = \"g/golden/a.json\"\ngenerator = \"g\"\nname = \"a\"\n",
        )
        .unwrap()
    }

    fn source(path: &str, text: &str) -> Source {
        Source { path: path.into(), text: text.into() }
    }

    #[test]
    fn a_listed_complete_and_used_golden_passes() {
        let sources = [source("fixtures/g/golden/a.json", GOOD), source("crates/c/tests/golden.rs", "read(\"a\")")];
        assert_eq!(against(&manifest(), &sources), Vec::<String>::new());
    }

    #[test]
    fn each_fault_is_found() {
        let test = || source("crates/c/tests/golden.rs", "read(\"a\")");
        let a = || source("fixtures/g/golden/a.json", GOOD);
        assert_eq!(against(&manifest(), &[test()]).len(), 1, "file missing");
        assert_eq!(against(&manifest(), &[a()]).len(), 1, "dead");
        assert_eq!(against(&manifest(), &[a(), test(), source("fixtures/g/golden/b.json", GOOD)]).len(), 1, "unlisted");
        assert_eq!(against(&manifest(), &[test(), source("fixtures/g/golden/a.json", "{}")]).len(), 5, "no header");
        assert_eq!(against(&manifest(), &[test(), source("fixtures/g/golden/a.json", "nonsense")]).len(), 1);
    }
}
