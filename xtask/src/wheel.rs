//! `cargo xtask python`: the wheel of the Python package, built, installed in an environment of its own, and tested.

use crate::{
    process, programs, python,
    workspace::{Build, Workspace},
};
use anyhow::{Context, Result, bail};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// How to build and test.
#[derive(clap::Args)]
pub struct Python {
    /// Build with all optimisation, as a wheel that is given away; else as `cargo test` does
    #[arg(long)]
    release: bool,
    /// Installs rsl_rl and torch (a few gigabytes), too, and so tests that rsl_rl learns
    #[arg(long)]
    rsl_rl: bool,
    /// Installs Ray (a few hundred megabytes), too, and so tests fleets on it
    #[arg(long)]
    ray: bool,
    /// Installs Rerun (a hundred megabytes), too, and so tests that it reads what a replay writes
    #[arg(long)]
    rerun: bool,
    /// Installs MuJoCo, too, and so tests that it moves as the robot with what a diagnosis exports
    #[arg(long)]
    mujoco: bool,
    /// Runs the tests that take minutes, too
    #[arg(long)]
    slow: bool,
    /// Only build the wheel and install it
    #[arg(long)]
    no_tests: bool,
    /// Tests the package without making a wheel, with the program and the library that `cargo xtask test` built
    #[arg(long, conflicts_with_all = ["release", "no_tests"])]
    test_build: bool,
    /// Arguments for pytest
    #[arg(last = true)]
    pytest: Vec<String>,
}

/// Builds, installs, tests; false when a test fails.
///
/// # Errors
/// No Python with `venv`, or the wheel cannot be built or installed.
pub fn run(workspace: &Workspace, how: &Python) -> Result<bool> {
    let python = if how.test_build {
        laid_out(workspace)?
    } else {
        program(workspace, how.release)?;
        installed(workspace, how.release)?
    };
    let extras =
        [(how.rsl_rl, "rsl_rl.txt"), (how.ray, "ray.txt"), (how.rerun, "rerun.txt"), (how.mujoco, "mujoco.txt")];
    for (wanted, file) in extras {
        if wanted {
            let pinned = workspace.workspace_root.join("fixtures/python").join(file);
            process::run(Command::new(&python).args(["-m", "pip", "install", "--quiet", "-r"]).arg(&pinned))?;
        }
    }
    if how.no_tests {
        return Ok(true);
    }
    let tests = workspace.workspace_root.join("python/tests");
    let mut pytest = Command::new(python);
    // From a folder without the sources, so that what was installed is tested.
    pytest.current_dir(&workspace.target_directory).env("PYTHONDONTWRITEBYTECODE", "1");
    if how.test_build {
        pytest.env("PYTHONPATH", workspace.target_directory.join(LAID_OUT));
    }
    pytest.args(["-m", "pytest", "-q", "-rs", "-p", "no:cacheprovider"]).arg(tests);
    if !how.slow {
        pytest.args(["-m", "not slow"]);
    }
    pytest.args(&how.pytest);
    process::succeeds(&mut pytest)
}

/// Folder of the package that is tested without a wheel, in the target folder.
const LAID_OUT: &str = "python-package";

/// Lays the package out as a wheel would, with the library that the tests' build has, and `qv` beside the Python that is returned.
fn laid_out(workspace: &Workspace) -> Result<PathBuf> {
    let python = python::environment(workspace, "python")?;
    let built = programs::build(&Workspace { build: Build::Tests, ..workspace.clone() }, &[], &[])?;
    let package = workspace.target_directory.join(LAID_OUT).join("quadverse");
    if package.exists() {
        fs::remove_dir_all(&package).with_context(|| format!("removing {}", package.display()))?;
    }
    fs::create_dir_all(&package).with_context(|| format!("making {}", package.display()))?;
    let copy = |from: &Path, to: &Path| fs::copy(from, to).with_context(|| format!("copying {}", from.display()));
    let sources = workspace.workspace_root.join("python/quadverse");
    for entry in fs::read_dir(&sources).with_context(|| format!("reading {}", sources.display()))?.flatten() {
        if entry.path().is_file() {
            copy(&entry.path(), &package.join(entry.file_name()))?;
        }
    }
    let library = [env::consts::DLL_PREFIX, "_quadverse", env::consts::DLL_SUFFIX].concat();
    let native = if cfg!(windows) { "_quadverse.pyd" } else { "_quadverse.abi3.so" };
    copy(&built.join(library), &package.join(native))?;
    let scripts = python.parent().context("a Python lies in a folder")?;
    let qv = scripts.join(programs::file("qv"));
    // A program that runs cannot be written over, but replaced.
    let _ = fs::remove_file(&qv);
    copy(&built.join(programs::file("qv")), &qv)?;
    Ok(python)
}

/// Builds `qv` and lays it where maturin takes scripts of the wheel from.
fn program(workspace: &Workspace, release: bool) -> Result<()> {
    let mut build = process::cargo();
    build.args(["build", "--quiet", "--package", "quadverse", "--locked"]);
    build.args(["--profile", if release { "release" } else { "dev" }]);
    process::run(&mut build)?;
    let folder = if release { "release" } else { "debug" };
    let built = workspace.target_directory.join(folder).join(programs::file("qv"));
    lay_program(workspace, &built)
}

/// Lays a program where maturin takes scripts of the wheel from.
///
/// # Errors
/// It cannot be copied.
pub fn lay_program(workspace: &Workspace, program: &Path) -> Result<()> {
    let scripts = workspace.workspace_root.join("python/quadverse._quadverse.data/scripts");
    fs::create_dir_all(&scripts).with_context(|| format!("making {}", scripts.display()))?;
    fs::copy(program, scripts.join(programs::file("qv"))).with_context(|| format!("copying {}", program.display()))?;
    Ok(())
}

/// The Python of an environment that has the wheel of these sources, with `qv` where [`run`] built it before.
///
/// # Errors
/// As [`run`].
pub fn installed(workspace: &Workspace, release: bool) -> Result<PathBuf> {
    let python = python::environment(workspace, "python")?;
    let wheels = workspace.target_directory.join("wheels");
    if wheels.exists() {
        fs::remove_dir_all(&wheels).with_context(|| format!("removing {}", wheels.display()))?;
    }
    let mut maturin = Command::new(&python);
    maturin.current_dir(workspace.workspace_root.join("python")).args(["-m", "maturin", "build", "--locked"]);
    maturin.args(["--profile", if release { "release" } else { "dev" }]).arg("--out").arg(&wheels);
    // So that what cargo built before is not built again.
    maturin.env("CARGO_TARGET_DIR", &workspace.target_directory);
    process::run(&mut maturin)?;
    let wheel = only_wheel(&wheels)?;
    let mut pip = Command::new(&python);
    pip.args(["-m", "pip", "install", "--quiet", "--no-deps", "--force-reinstall"]).arg(&wheel);
    process::run(&mut pip)?;
    println!("installed {}", wheel.display());
    Ok(python)
}

/// The wheel that lies alone in a folder.
///
/// # Errors
/// There is none, or there are several.
pub fn only_wheel(folder: &Path) -> Result<PathBuf> {
    let entries = fs::read_dir(folder).with_context(|| format!("reading {}", folder.display()))?;
    let is_wheel = |path: &PathBuf| path.extension().is_some_and(|e| e == "whl");
    let found: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(is_wheel).collect();
    match found.as_slice() {
        [wheel] => Ok(wheel.clone()),
        _ => bail!("{}: expected one wheel, found {}", folder.display(), found.len()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_wheel_is_found_and_two_are_not() {
        let folder = env::temp_dir().join(format!("qv-wheels-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        assert!(only_wheel(&folder).unwrap_err().to_string().contains("found 0"));
        fs::write(folder.join("a.whl"), "").unwrap();
        fs::write(folder.join("note.txt"), "").unwrap();
        assert_eq!(only_wheel(&folder).unwrap(), folder.join("a.whl"));
        fs::write(folder.join("b.whl"), "").unwrap();
        assert!(only_wheel(&folder).unwrap_err().to_string().contains("found 2"));
        fs::remove_dir_all(folder).unwrap();
    }
}
