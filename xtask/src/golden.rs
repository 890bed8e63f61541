//! `cargo xtask golden`: reference results under `fixtures/`, listed in `fixtures/manifest.toml`.

use crate::workspace::{Build, Workspace};
use crate::{blind, pipeline, process, python};
use anyhow::{Context, Result, bail};
use clap::Subcommand;
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::Command;

/// What to do with goldens.
#[derive(Subcommand)]
pub enum Golden {
    /// Run the tests that the manifest names
    Check {
        /// Instead of tests: `stages` runs the pipeline, and names the first stage whose figures moved; `navigate` the same with
        /// its optional stage; `blind` has a few sealed recordings diagnosed, and names those of which something else is said
        #[arg(value_parser = ["stages", "navigate", "blind"])]
        what: Option<String>,
        /// Also run the generators and compare their output with the files, byte by byte
        #[arg(long)]
        regenerate: bool,
        /// With a word: run the programs that `cargo xtask test` built, which are slower, and build none with optimisation
        #[arg(long, requires = "what")]
        test_build: bool,
        /// With `stages` or `navigate`: the sizes of the guides instead of those of continuous integration, several times the work
        #[arg(long, requires = "what")]
        full: bool,
    },
    /// Write goldens anew with their pinned generators
    Bless {
        /// Names in the manifest; all when none is given
        names: Vec<String>,
        /// Run the programs that `cargo xtask test` built, which are slower, and build none with optimisation
        #[arg(long)]
        test_build: bool,
    },
}

/// The golden of sealed recordings, and who writes it.
const BLIND: &str = "blind";
/// The golden of a short training, and who writes it.
const WALK: &str = "walk";

/// `fixtures/manifest.toml`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Programs that write goldens, by name.
    pub generators: BTreeMap<String, Generator>,
    /// The goldens.
    #[serde(default)]
    pub golden: Vec<Entry>,
}

/// Who writes goldens.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Generator {
    /// A Python program relative to `fixtures/`, which takes `--out FOLDER` and names; or, without an environment,
    /// `pipeline` for `cargo xtask pipeline`, `blind` for `cargo xtask blind`, `walk` for a short training.
    pub command: String,
    /// Folder under `fixtures/` whose requirements.txt pins what a Python program needs.
    pub environment: Option<String>,
    /// Modules of integration tests (of any crate) that compare with its goldens.
    pub tests: Vec<String>,
}

/// One golden.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// File relative to `fixtures/`.
    pub file: String,
    /// Key in `generators`.
    pub generator: String,
    /// What the generator and the tests call it.
    pub name: String,
}

impl Manifest {
    /// Reads the manifest of a workspace.
    ///
    /// # Errors
    /// The file is missing or malformed, or an entry names a generator that is not there.
    pub fn read(root: &Path) -> Result<Self> {
        let path = root.join("fixtures/manifest.toml");
        let text = fs::read_to_string(&path).with_context(|| format!("reading {}", path.display()))?;
        let manifest: Self = toml::from_str(&text).with_context(|| format!("in {}", path.display()))?;
        for entry in &manifest.golden {
            if !manifest.generators.contains_key(&entry.generator) {
                bail!(
                    "{}: {}: expected a generator of the manifest, found {:?}",
                    path.display(),
                    entry.name,
                    entry.generator
                );
            }
        }
        Ok(manifest)
    }
}

/// Checks or blesses; true when all agrees.
///
/// # Errors
/// The manifest cannot be read, or a program cannot be run.
pub fn run(workspace: &Workspace, what: Golden) -> Result<bool> {
    let manifest = Manifest::read(&workspace.workspace_root)?;
    match what {
        Golden::Bless { names, test_build } => bless(&built(workspace, test_build), &manifest, &names).map(|()| true),
        Golden::Check { what: Some(what), test_build, full, .. } => {
            let workspace = built(workspace, test_build);
            if what == BLIND {
                return blind::golden::check(&workspace);
            }
            let name = if full { format!("{what}_full") } else { what };
            let (of, size) =
                pipeline::Of::named(&name).with_context(|| format!("no golden {name:?} of the pipeline"))?;
            pipeline::check_golden(&workspace, of, size)
        }
        Golden::Check { what: None, regenerate, .. } => {
            let tests = check_tests(workspace, &manifest)?;
            Ok(if regenerate { compare_regenerated(workspace, &manifest)? && tests } else { tests })
        }
    }
}

/// The workspace with the programs of the tests, or optimised ones.
fn built(workspace: &Workspace, test_build: bool) -> Workspace {
    let build = if test_build { Build::Tests } else { Build::Release };
    Workspace { build, ..workspace.clone() }
}

fn check_tests(workspace: &Workspace, manifest: &Manifest) -> Result<bool> {
    let mut cargo = process::cargo();
    cargo.current_dir(&workspace.workspace_root).args(["test", "--workspace", "--all-features", "--tests", "--"]);
    // Tests of a module go by its name.
    cargo.args(manifest.generators.values().flat_map(|generator| &generator.tests).map(|test| format!("{test}::")));
    let mut missing: BTreeSet<&String> = manifest.generators.values().flat_map(|generator| &generator.tests).collect();
    let passed = process::watch(&mut cargo, |line| {
        missing.retain(|test| !line.strip_prefix("test ").is_some_and(|name| name.contains(&format!("{test}::"))));
    })?;
    missing.iter().for_each(|test| println!("fixtures/manifest.toml: no test of {test} was run"));
    Ok(passed && missing.is_empty())
}

fn bless(workspace: &Workspace, manifest: &Manifest, names: &[String]) -> Result<()> {
    if let Some(unknown) = names.iter().find(|name| manifest.golden.iter().all(|entry| entry.name != **name)) {
        let known: Vec<&str> = manifest.golden.iter().map(|entry| entry.name.as_str()).collect();
        bail!("expected a name among {}, found {unknown:?}", known.join(", "));
    }
    for (key, generator) in &manifest.generators {
        let chosen: Vec<&Entry> = manifest
            .golden
            .iter()
            .filter(|entry| entry.generator == *key && (names.is_empty() || names.contains(&entry.name)))
            .collect();
        if let Some(first) = chosen.first() {
            let fixtures = workspace.workspace_root.join("fixtures");
            let file = fixtures.join(&first.file);
            let out = file.parent().with_context(|| format!("{} has no folder", file.display()))?;
            generate(workspace, generator, out, &chosen)?;
        }
    }
    Ok(())
}

fn generate(workspace: &Workspace, generator: &Generator, out: &Path, entries: &[&Entry]) -> Result<()> {
    let Some(environment) = &generator.environment else {
        if generator.command == BLIND {
            return blind::golden::write(workspace, out);
        }
        if generator.command == WALK {
            return entries.iter().try_for_each(|entry| walk(workspace, &entry.name, out));
        }
        if generator.command != "pipeline" {
            bail!(
                "a generator without an environment: expected `pipeline`, `blind` or `walk`, found {:?}",
                generator.command
            );
        }
        return entries.iter().try_for_each(|entry| pipeline::write_golden(workspace, &entry.name, out));
    };
    let python = python::environment(workspace, environment)?;
    let program = workspace.workspace_root.join("fixtures").join(&generator.command);
    let mut command = Command::new(python);
    // No byte code beside the sources.
    command.env("PYTHONDONTWRITEBYTECODE", "1").arg(program).arg("--out").arg(out);
    process::run(command.args(entries.iter().map(|entry| &entry.name)))
}

/// A short training, written by the example of the crate that trains.
fn walk(workspace: &Workspace, name: &str, out: &Path) -> Result<()> {
    fs::create_dir_all(out).with_context(|| format!("making {}", out.display()))?;
    let mut cargo = process::cargo();
    cargo.current_dir(&workspace.workspace_root).args(["run", "--release", "--package", "quadverse-policy"]);
    process::run(cargo.args(["--example", "short_training", "--"]).arg(out.join(format!("{name}.json"))))
}

/// Whether the generators write today what is stored. MuJoCo promises the same bits on the same machine only, so this
/// is asked for, not part of every check.
fn compare_regenerated(workspace: &Workspace, manifest: &Manifest) -> Result<bool> {
    let mut same = true;
    for (key, generator) in &manifest.generators {
        let out = workspace.target_directory.join("regenerated").join(key);
        let entries: Vec<&Entry> = manifest.golden.iter().filter(|entry| entry.generator == *key).collect();
        generate(workspace, generator, &out, &entries)?;
        for entry in entries {
            let stored = workspace.workspace_root.join("fixtures").join(&entry.file);
            let fresh = out.join(stored.file_name().with_context(|| format!("{} has no file name", entry.file))?);
            let read = |path: &Path| fs::read(path).with_context(|| format!("reading {}", path.display()));
            if read(&stored)? != read(&fresh)? {
                println!("{} differs from {}", fresh.display(), stored.display());
                same = false;
            }
        }
    }
    println!("generators {}", if same { "write what is stored" } else { "do not write what is stored" });
    Ok(same)
}
