//! An old Debian in a folder, in which what is given away is run: as root in a chroot, or under qemu-user for another processor.

use crate::{process, workspace::Workspace};
use anyhow::{Context, Result};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// Debian 11: glibc 2.31, Python 3.9.
pub const SUITE: &str = "bullseye";
/// CPython of it, as pip names it.
pub const PYTHON: &str = "3.9";

/// The folder, and how its programs are started.
pub struct System {
    /// The folder, seen from here.
    pub root: PathBuf,
    /// The folder, seen from its programs.
    inside: PathBuf,
    /// Words in front of a program.
    starter: Vec<OsString>,
}

impl System {
    /// Makes the system of a processor where it is missing; the reason, where that cannot be done here.
    ///
    /// # Errors
    /// The packages of the system cannot be fetched or unpacked.
    pub fn make(workspace: &Workspace, processor: &str) -> Result<Result<Self, String>> {
        let root = workspace.target_directory.join("chroot").join(format!("{SUITE}-{processor}"));
        let is_own = processor == env::consts::ARCH;
        let qemu = format!("qemu-{processor}-static");
        if let Some(reason) = obstacle(is_own, &qemu) {
            return Ok(Err(reason));
        }
        if !root.join(READY).is_file() {
            debootstrap(&root, processor, is_own)?;
        }
        let (inside, starter) = match is_own {
            true => (PathBuf::from("/"), vec!["chroot".into(), root.clone().into()]),
            false => (root.clone(), vec![qemu.into(), "-L".into(), root.clone().into()]),
        };
        Ok(Ok(Self { root, inside, starter }))
    }

    /// A path of the system as its programs see it.
    pub fn path(&self, relative: &str) -> PathBuf {
        self.inside.join(relative)
    }

    /// A program of the system, without the variables of this one.
    pub fn command(&self, program: &str) -> Command {
        let mut command = Command::new(&self.starter[0]);
        command.args(&self.starter[1..]).arg(self.path(program));
        command.env_clear().env("PATH", "/usr/sbin:/usr/bin:/sbin:/bin").env("HOME", self.path("tmp"));
        command
    }
}

/// Written when a system is whole.
const READY: &str = ".ready";

/// Why there can be no system here.
fn obstacle(is_own: bool, qemu: &str) -> Option<String> {
    let is_root = process::output(Command::new("id").arg("-u")).is_ok_and(|id| id.trim() == "0");
    if !is_root {
        return Some("debootstrap needs root".into());
    }
    if !process::works(Command::new("debootstrap").arg("--version")) {
        return Some("debootstrap is not installed (apt-get install debootstrap)".into());
    }
    let has_qemu = is_own || process::works(Command::new(qemu).arg("--version"));
    (!has_qemu).then(|| format!("{qemu} is not installed (apt-get install qemu-user-static)"))
}

/// Fetches Debian with Python. Programs of another processor cannot set themselves up, so that packages are only unpacked.
fn debootstrap(root: &Path, processor: &str, is_own: bool) -> Result<()> {
    if root.exists() {
        fs::remove_dir_all(root).with_context(|| format!("removing {}", root.display()))?;
    }
    fs::create_dir_all(root).with_context(|| format!("making {}", root.display()))?;
    let mut command = Command::new("debootstrap");
    let architecture = if processor == "aarch64" { "arm64" } else { "amd64" };
    command.args(["--variant=minbase", "--include=python3", "--arch", architecture]);
    if !is_own {
        command.arg("--foreign");
    }
    process::run(command.arg(SUITE).arg(root).stdout(std::process::Stdio::null()))?;
    if !is_own {
        unpack(root)?;
    }
    fs::write(root.join(READY), "").with_context(|| format!("writing to {}", root.display()))
}

/// Unpacks all packages that were fetched.
fn unpack(root: &Path) -> Result<()> {
    let archives = root.join("var/cache/apt/archives");
    let entries = fs::read_dir(&archives).with_context(|| format!("reading {}", archives.display()))?;
    let mut packages: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    packages.retain(|path| path.extension().is_some_and(|end| end == "deb"));
    packages.sort();
    for package in packages {
        // Links such as /lib to /usr/lib stay.
        let script = "dpkg-deb --fsys-tarfile \"$1\" | tar --extract --keep-directory-symlink --directory \"$2\"";
        process::run(Command::new("sh").args(["-c", script, "sh"]).arg(package).arg(root))?;
    }
    Ok(())
}
