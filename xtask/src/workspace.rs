//! What `cargo metadata` says of the workspace, and which files it has.

use crate::process;
use anyhow::{Context, Result};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The part of `cargo metadata` that is used here.
#[derive(Debug, Clone, Deserialize)]
pub struct Workspace {
    /// Every package of the dependency graph.
    pub packages: Vec<Package>,
    /// Ids of the packages of this workspace.
    pub workspace_members: Vec<String>,
    /// Folder of the workspace's Cargo.toml.
    pub workspace_root: PathBuf,
    /// Folder that cargo builds into.
    pub target_directory: PathBuf,
    /// How chores build the programs that they run; `cargo metadata` says nothing of it.
    #[serde(skip)]
    pub build: Build,
}

/// One package.
#[derive(Debug, Clone, Deserialize)]
pub struct Package {
    /// Name as in Cargo.toml.
    pub name: String,
    /// Version as in Cargo.toml.
    pub version: String,
    /// Unique id.
    pub id: String,
    /// SPDX expression.
    pub license: Option<String>,
    /// Cargo.toml of the package.
    pub manifest_path: PathBuf,
    /// What it depends on.
    pub dependencies: Vec<Dependency>,
    /// What it builds.
    pub targets: Vec<Target>,
    /// Features and what each turns on.
    pub features: BTreeMap<String, Vec<String>>,
    /// Registries that it may go to: `None` for all, empty for none.
    pub publish: Option<Vec<String>>,
    /// One sentence for a registry.
    pub description: Option<String>,
    /// Words that one searches a registry for.
    pub keywords: Vec<String>,
    /// Parts of a registry that it belongs to.
    pub categories: Vec<String>,
}

/// One line of a dependency table.
#[derive(Debug, Clone, Deserialize)]
pub struct Dependency {
    /// Package that is depended on.
    pub name: String,
    /// `None` for normal ones, else `dev` or `build`.
    pub kind: Option<String>,
    /// Whether a feature has to turn it on.
    pub optional: bool,
}

/// One thing that a package builds.
#[derive(Debug, Clone, Deserialize)]
pub struct Target {
    /// Name of the program or library.
    pub name: String,
    /// `lib`, `bin`, `example`, `test`, ...
    pub kind: Vec<String>,
}

impl Package {
    /// What the crate is called in this workspace: see [`short`].
    pub fn short(&self) -> String {
        short(&self.name)
    }

    /// Whether it may go to a registry.
    pub fn is_published(&self) -> bool {
        self.publish.as_ref().is_none_or(|registries| !registries.is_empty())
    }

    /// Folder of the package.
    pub fn folder(&self) -> &Path {
        self.manifest_path.parent().unwrap_or(&self.manifest_path)
    }

    /// Whether it builds a target of this kind.
    pub fn has_target(&self, kind: &str) -> bool {
        self.targets.iter().any(|target| target.kind.iter().any(|k| k == kind))
    }

    /// Whether it has an example of this name.
    pub fn has_example(&self, name: &str) -> bool {
        self.targets.iter().any(|target| target.name == name && target.kind.iter().any(|k| k == "example"))
    }
}

/// What the crate of a package is called in code, docs and folders: `qv-sim` for the package `quadverse-sim`, `qv` for
/// `quadverse`. Others keep their names. Registries have `qv` and `qv-core` of strangers.
pub fn short(package: &str) -> String {
    match package.strip_prefix("quadverse") {
        Some(rest) if rest.is_empty() || rest.starts_with('-') => format!("qv{rest}"),
        _ => package.into(),
    }
}

impl Workspace {
    /// Asks cargo about the workspace of the current folder.
    ///
    /// # Errors
    /// Cargo fails or answers with something else than expected.
    pub fn load() -> Result<Self> {
        let json = process::output(process::cargo().args(["metadata", "--format-version", "1", "--locked"]))?;
        serde_json::from_str(&json).context("cargo metadata: unexpected shape")
    }

    /// The version that all packages of the workspace have.
    ///
    /// # Errors
    /// There is no command line among them.
    pub fn version(&self) -> Result<&str> {
        let package = self.members().find(|package| package.name == "quadverse");
        package.map(|package| package.version.as_str()).context("the workspace has no package 'quadverse'")
    }

    /// Packages of the workspace itself.
    pub fn members(&self) -> impl Iterator<Item = &Package> {
        self.packages.iter().filter(|package| self.workspace_members.contains(&package.id))
    }

    /// Files that git tracks or would track, relative to the root and sorted.
    ///
    /// # Errors
    /// git is missing or the folder is no repository.
    pub fn files(&self) -> Result<Vec<PathBuf>> {
        let mut git = Command::new("git");
        git.current_dir(&self.workspace_root).args(["ls-files", "-z", "--cached", "--others", "--exclude-standard"]);
        let listed = process::output(&mut git).context("listing the files of the repository")?;
        let mut files: Vec<PathBuf> = listed.split('\0').filter(|name| !name.is_empty()).map(PathBuf::from).collect();
        // A file deleted but not yet committed is still listed.
        files.retain(|file| self.workspace_root.join(file).is_file());
        files.sort();
        files.dedup();
        Ok(files)
    }
}

/// How programs are built.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Build {
    /// With optimisation.
    #[default]
    Release,
    /// As `cargo xtask test` leaves them: a half slower, and nothing is built twice. Results are the same.
    Tests,
}
