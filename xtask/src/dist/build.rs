//! Building with zig as the linker and C compiler, so that an old glibc or musl suffices.

use super::artifact::Artifact;
use crate::{process, programs, python, wheel, workspace::Workspace};
use anyhow::{Context, Result, bail};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// The oldest glibc that Rust's standard library links with; that of manylinux2014.
const GLIBC: (u32, u32) = (2, 17);
/// The profile in Cargo.toml.
const PROFILE: &str = "dist";
/// Features beside the default ones.
pub const FEATURES: &str = "live";

/// Builds an artifact into `folder` and returns its file.
///
/// # Errors
/// The standard library of its target is missing, it does not build, or it needs a newer glibc.
pub fn build(workspace: &Workspace, folder: &Path, artifact: Artifact) -> Result<PathBuf> {
    check_library(artifact)?;
    let python = python::environment(workspace, "dist")?;
    let program = program(workspace, &python, artifact)?;
    if artifact.is_wheel() {
        check_glibc(&program)?;
        wheel::lay_program(workspace, &program)?;
        return wheel(workspace, &python, folder, artifact);
    }
    archive(workspace, &program, folder, artifact)
}

/// Whether rustc has the standard library of a target.
fn check_library(artifact: Artifact) -> Result<()> {
    let triple = artifact.triple();
    let mut rustc = Command::new("rustc");
    let folder = process::output(rustc.args(["--print", "target-libdir", "--target", &triple]))?;
    if !Path::new(folder.trim()).is_dir() {
        bail!(
            "cannot build '{}': rustc has no library for {triple}\nhint: rustup target add {triple}",
            artifact.name()
        );
    }
    Ok(())
}

/// Builds `qv`.
fn program(workspace: &Workspace, python: &Path, artifact: Artifact) -> Result<PathBuf> {
    let triple = artifact.triple();
    let target = if artifact.is_wheel() { format!("{triple}.{}.{}", GLIBC.0, GLIBC.1) } else { triple.clone() };
    let mut cargo = process::cargo();
    cargo.args(["zigbuild", "--locked", "--profile", PROFILE, "--package", "quadverse", "--bin", "qv"]);
    cargo.args(["--features", FEATURES, "--target", &target]);
    process::run(with_tools(&mut cargo, workspace, python)?)?;
    Ok(workspace.target_directory.join(triple).join(PROFILE).join(programs::file("qv")))
}

/// Builds the native part and packs the wheel.
fn wheel(workspace: &Workspace, python: &Path, folder: &Path, artifact: Artifact) -> Result<PathBuf> {
    let packed = folder.join(artifact.name());
    if packed.exists() {
        fs::remove_dir_all(&packed).with_context(|| format!("removing {}", packed.display()))?;
    }
    let mut maturin = Command::new(python);
    maturin.args(["-m", "maturin", "build", "--locked", "--zig", "--profile", PROFILE, "--target", &artifact.triple()]);
    maturin.args(["--compatibility", "manylinux2014", "--out"]).arg(&packed);
    maturin.current_dir(workspace.workspace_root.join("python"));
    process::run(with_tools(&mut maturin, workspace, python)?)?;
    let made = wheel::only_wheel(&packed)?;
    let file = folder.join(made.file_name().context("a wheel has a name")?);
    fs::rename(&made, &file).with_context(|| format!("writing {}", file.display()))?;
    fs::remove_dir(&packed).with_context(|| format!("removing {}", packed.display()))?;
    Ok(file)
}

/// Packs a static program with its licences, without times and owners, so that the same program gives the same bytes.
fn archive(workspace: &Workspace, program: &Path, folder: &Path, artifact: Artifact) -> Result<PathBuf> {
    let (staged, stem) = (folder.join(artifact.name()), artifact.stem(workspace)?);
    if staged.exists() {
        fs::remove_dir_all(&staged).with_context(|| format!("removing {}", staged.display()))?;
    }
    let inside = staged.join(&stem);
    fs::create_dir_all(&inside).with_context(|| format!("making {}", inside.display()))?;
    let licence = |name: &str| (workspace.workspace_root.join(name), inside.join(name));
    for (from, to) in [(program.to_path_buf(), inside.join("qv")), licence("LICENSE-MIT"), licence("LICENSE-APACHE")] {
        fs::copy(&from, &to).with_context(|| format!("copying {}", from.display()))?;
    }
    let file = artifact.archive(workspace, folder)?;
    let beside = file.with_extension("part");
    let mut tar = Command::new("tar");
    tar.args(["--create", "--sort=name", "--owner=0", "--group=0", "--numeric-owner", "--mtime=@0"]);
    tar.args(["--use-compress-program", "gzip -n -9", "--file"]).arg(&beside);
    process::run(tar.arg("--directory").arg(&staged).arg(&stem))?;
    fs::rename(&beside, &file).with_context(|| format!("writing {}", file.display()))?;
    fs::remove_dir_all(&staged).with_context(|| format!("removing {}", staged.display()))?;
    Ok(file)
}

/// Lets a build find zig and cargo-zigbuild of an environment.
fn with_tools<'c>(command: &'c mut Command, workspace: &Workspace, python: &Path) -> Result<&'c mut Command> {
    let tools = python.parent().context("a Python lies in a folder")?.to_path_buf();
    let others = env::var_os("PATH").unwrap_or_default();
    let path = env::join_paths([tools].into_iter().chain(env::split_paths(&others))).context("joining PATH")?;
    Ok(command.env("PATH", path).env("CARGO_TARGET_DIR", &workspace.target_directory))
}

/// Refuses a program that needs a newer glibc than the wheel states.
fn check_glibc(program: &Path) -> Result<()> {
    let bytes = fs::read(program).with_context(|| format!("reading {}", program.display()))?;
    match newest_glibc(&bytes) {
        Some(needed) if needed > GLIBC => bail!(
            "cannot put '{}' into the wheel: it needs glibc {}.{}, newer than {}.{}",
            program.display(),
            needed.0,
            needed.1,
            GLIBC.0,
            GLIBC.1
        ),
        _ => Ok(()),
    }
}

/// The newest glibc that a program names among the versions of its symbols.
fn newest_glibc(bytes: &[u8]) -> Option<(u32, u32)> {
    const START: &[u8] = b"\0GLIBC_";
    let starts = bytes.windows(START.len()).enumerate().filter(|(_, window)| *window == START);
    let version = |(at, _): (usize, &[u8])| {
        let rest = &bytes[at + START.len()..];
        let end = rest.iter().take(16).position(|byte| *byte == 0)?;
        let (major, minor) = std::str::from_utf8(&rest[..end]).ok()?.split_once('.')?;
        Some((major.parse().ok()?, minor.split('.').next()?.parse().ok()?))
    };
    starts.filter_map(version).max()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_glibc_is_found_by_number_not_by_letter() {
        let text = b"x\0GLIBC_2.9\0GLIBC_2.17\0GLIBC_2.2.5\0libm.so.6\0GLIBC_PRIVATE\0 GLIBC_2.99";
        assert_eq!(newest_glibc(text), Some((2, 17)));
        assert_eq!(newest_glibc(b"static"), None);
    }
}
