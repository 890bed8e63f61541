//! What benchmarks share: contestants, what they print, and where results go.

use crate::process;
use crate::workspace::Workspace;
use anyhow::{Context, Result};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs;
use std::path::PathBuf;
use std::process::Command;

/// Builds an example, whichever crate has it, and gives its program.
pub fn build(workspace: &Workspace, example: &str, features: &[&str]) -> Result<PathBuf> {
    let owner = workspace.members().find(|package| package.has_example(example));
    let owner = owner.with_context(|| format!("expected a crate with the example {example}, found none"))?;
    let mut cargo = process::cargo();
    cargo.current_dir(&workspace.workspace_root).args(["build", "--release", "--package", &owner.name]);
    process::run(cargo.args(["--example", example, "--features", &features.join(",")]))?;
    Ok(workspace.target_directory.join("release/examples").join(example))
}

/// Runs a contestant, whose last line of output is JSON.
pub fn last_line<T: DeserializeOwned>(command: &mut Command) -> Result<T> {
    let text = process::output(command)?;
    parse(&text).with_context(|| format!("{command:?}"))
}

/// The JSON of the last line.
pub fn parse<T: DeserializeOwned>(text: &str) -> Result<T> {
    let line = text.lines().next_back().unwrap_or_default();
    serde_json::from_str(line).with_context(|| format!("expected a last line of JSON, found {line:?}"))
}

/// Middle value; of an even number the mean of the two in the middle. `values` is not empty.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    if values.len().is_multiple_of(2) { 0.5 * (values[middle - 1] + values[middle]) } else { values[middle] }
}

/// Writes results into `bench/` under the target folder.
pub fn write(workspace: &Workspace, name: &str, results: &impl Serialize) -> Result<()> {
    let file = folder(workspace)?.join(name);
    fs::write(&file, serde_json::to_string_pretty(results)? + "\n")
        .with_context(|| format!("writing {}", file.display()))?;
    println!("written to {}", file.display());
    Ok(())
}

/// `bench/` under the target folder, which is made when it is not there.
pub fn folder(workspace: &Workspace) -> Result<PathBuf> {
    let folder = workspace.target_directory.join("bench");
    fs::create_dir_all(&folder).with_context(|| format!("making {}", folder.display()))?;
    Ok(folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians() {
        assert_eq!(median(vec![3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(vec![4.0, 1.0, 2.0, 3.0]), 2.5);
    }
}
