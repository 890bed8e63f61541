//! Python environments under the target folder, one for each `fixtures/<name>/requirements.txt`.

use crate::{process, workspace::Workspace};
use anyhow::{Context, Result, bail};
use std::fs;
use std::path::PathBuf;
use std::process::Command;

/// The Python of the environment that holds what `fixtures/<name>/requirements.txt` pins; makes it when it is missing
/// or the file has changed.
///
/// # Errors
/// No such file, no Python with `venv`, or the packages cannot be installed.
pub fn environment(workspace: &Workspace, name: &str) -> Result<PathBuf> {
    let requirements = workspace.workspace_root.join("fixtures").join(name).join("requirements.txt");
    let wanted = fs::read_to_string(&requirements).with_context(|| format!("reading {}", requirements.display()))?;
    let folder = workspace.target_directory.join("venv").join(name);
    let (python, installed) = (folder.join("bin").join("python"), folder.join("requirements.installed"));
    if fs::read_to_string(&installed).is_ok_and(|found| found == wanted) && python.is_file() {
        return Ok(python);
    }
    eprintln!("making the Python environment {}", folder.display());
    if folder.exists() {
        fs::remove_dir_all(&folder).with_context(|| format!("removing {}", folder.display()))?;
    }
    if !process::works(Command::new("python3").args(["-c", "import venv, ensurepip"])) {
        bail!("expected a python3 with the modules venv and ensurepip (Debian: apt-get install python3-venv)");
    }
    process::run(Command::new("python3").args(["-m", "venv"]).arg(&folder))?;
    process::run(Command::new(&python).args(["-m", "pip", "install", "--quiet", "-r"]).arg(&requirements))?;
    fs::write(&installed, wanted).with_context(|| format!("writing {}", installed.display()))?;
    Ok(python)
}
