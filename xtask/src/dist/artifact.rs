//! The files that are given away, one for each processor and kind.

use crate::workspace::Workspace;
use anyhow::{Context, Result};
use std::fs;
use std::path::{Path, PathBuf};

/// One of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Artifact {
    /// Wheel for x86-64, glibc 2.17
    #[value(name = "x86_64-wheel")]
    X86Wheel,
    /// Static program for x86-64, in an archive
    #[value(name = "x86_64-static")]
    X86Static,
    /// Wheel for aarch64, glibc 2.17
    #[value(name = "aarch64-wheel")]
    ArmWheel,
    /// Static program for aarch64, in an archive
    #[value(name = "aarch64-static")]
    ArmStatic,
}

impl Artifact {
    /// In the order in which they are built.
    pub const ALL: [Self; 4] = [Self::X86Wheel, Self::X86Static, Self::ArmWheel, Self::ArmStatic];

    /// As `--target` has it.
    pub fn name(self) -> &'static str {
        match self {
            Self::X86Wheel => "x86_64-wheel",
            Self::X86Static => "x86_64-static",
            Self::ArmWheel => "aarch64-wheel",
            Self::ArmStatic => "aarch64-static",
        }
    }

    /// Whether it is a wheel.
    pub fn is_wheel(self) -> bool {
        matches!(self, Self::X86Wheel | Self::ArmWheel)
    }

    /// `x86_64` or `aarch64`.
    pub fn processor(self) -> &'static str {
        match self {
            Self::X86Wheel | Self::X86Static => "x86_64",
            Self::ArmWheel | Self::ArmStatic => "aarch64",
        }
    }

    /// The triple that rustc builds for.
    pub fn triple(self) -> String {
        let library = if self.is_wheel() { "gnu" } else { "musl" };
        format!("{}-unknown-linux-{library}", self.processor())
    }

    /// Folder within the archive of a static program, and the archive's name without its ending.
    ///
    /// # Errors
    /// The workspace states no version.
    pub fn stem(self, workspace: &Workspace) -> Result<String> {
        Ok(format!("qv-{}-linux-{}", workspace.version()?, self.processor()))
    }

    /// Where the archive of a static program lies.
    ///
    /// # Errors
    /// The workspace states no version.
    pub fn archive(self, workspace: &Workspace, folder: &Path) -> Result<PathBuf> {
        Ok(folder.join(format!("{}.tar.gz", self.stem(workspace)?)))
    }

    /// The file that was built before, if it was.
    ///
    /// # Errors
    /// The folder cannot be read.
    pub fn file(self, workspace: &Workspace, folder: &Path) -> Result<Option<PathBuf>> {
        if !self.is_wheel() {
            return Ok(Some(self.archive(workspace, folder)?).filter(|path| path.is_file()));
        }
        let start = format!("quadverse-{}-", workspace.version()?);
        let end = format!("_{}.whl", self.processor());
        let Ok(entries) = fs::read_dir(folder) else { return Ok(None) };
        for entry in entries {
            let path = entry.with_context(|| format!("reading {}", folder.display()))?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            if name.starts_with(&start) && name.ends_with(&end) {
                return Ok(Some(path));
            }
        }
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::ValueEnum as _;

    #[test]
    fn names_are_those_of_the_option() {
        for artifact in Artifact::ALL {
            assert_eq!(Artifact::from_str(artifact.name(), false), Ok(artifact));
        }
        assert_eq!(Artifact::ArmWheel.triple(), "aarch64-unknown-linux-gnu");
        assert_eq!(Artifact::X86Static.triple(), "x86_64-unknown-linux-musl");
    }
}
