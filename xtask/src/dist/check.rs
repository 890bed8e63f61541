//! Whether what was built runs in an old system: its version, something that computes, and the import from Python.

use super::artifact::Artifact;
use super::system::{PYTHON, SUITE, System};
use crate::{process, python, workspace::Workspace};
use anyhow::{Context, Result, bail};
use std::fs;
use std::path::Path;
use std::process::Command;

/// How a check ended.
enum Verdict {
    Pass,
    Failure(String),
    Skip(String),
}

/// Folder of an artifact in a system.
const PLACE: &str = "opt/quadverse";
/// What a check writes, in a system.
const OUTPUT: &str = "tmp/quadverse";

/// Steps four robots for 0.1 s; they fall from where they were put.
const IMPORT: &str = "import numpy, quadverse\n\
    batch = quadverse.Batch('go2', 4)\n\
    qpos = numpy.zeros((4, batch.nq))\n\
    qpos[:, 2], qpos[:, 3] = 2.0, 1.0\n\
    batch.set_state(qpos)\n\
    batch.step(round(0.1 / batch.timestep))\n\
    fall = 2.0 - float(batch.bind('qpos')[0, 2])\n\
    assert 0.04 < fall < 0.06, fall\n\
    print(quadverse.__version__)\n";

/// Checks artifacts that were built; true when none fails.
///
/// # Errors
/// One was not built, or a system cannot be made.
pub fn run(workspace: &Workspace, folder: &Path, chosen: &[Artifact]) -> Result<bool> {
    let (mut passed, mut failed, mut skipped) = (0, 0, 0);
    for &artifact in chosen {
        let name = artifact.name();
        match check(workspace, folder, artifact)? {
            Verdict::Pass => {
                passed += 1;
                println!("{name}: passed on Debian {SUITE}");
            }
            Verdict::Failure(reason) => {
                failed += 1;
                println!("{name}: failed: {reason}");
            }
            Verdict::Skip(reason) => {
                skipped += 1;
                println!("{name}: skipped: {reason}");
            }
        }
    }
    println!("{passed} passed, {failed} failed, {skipped} skipped");
    Ok(failed == 0)
}

fn check(workspace: &Workspace, folder: &Path, artifact: Artifact) -> Result<Verdict> {
    let name = artifact.name();
    let Some(file) = artifact.file(workspace, folder)? else {
        bail!("cannot check '{name}': it is not in {}\nhint: cargo xtask dist --target {name}", folder.display());
    };
    let system = match System::make(workspace, artifact.processor())? {
        Ok(system) => system,
        Err(reason) => return Ok(Verdict::Skip(reason)),
    };
    for used in [PLACE, OUTPUT] {
        empty(&system.root.join(used))?;
    }
    let place = system.root.join(PLACE);
    let program = if artifact.is_wheel() {
        install(workspace, &file, &place, artifact)?;
        format!("{PLACE}/bin/qv")
    } else {
        let mut tar = Command::new("tar");
        tar.args(["--extract", "--strip-components=1", "--file"]).arg(&file);
        process::run(tar.arg("--directory").arg(&place))?;
        format!("{PLACE}/qv")
    };
    if let Some(reason) = run_program(&system, &program)? {
        return Ok(Verdict::Failure(reason));
    }
    Ok(match artifact.is_wheel().then(|| import(&system)).transpose()?.flatten() {
        Some(reason) => Verdict::Failure(reason),
        None => Verdict::Pass,
    })
}

/// An empty folder.
fn empty(folder: &Path) -> Result<()> {
    if folder.exists() {
        fs::remove_dir_all(folder).with_context(|| format!("removing {}", folder.display()))?;
    }
    fs::create_dir_all(folder).with_context(|| format!("making {}", folder.display()))
}

/// Installs a wheel and numpy from outside, for the Python of the system.
fn install(workspace: &Workspace, wheel: &Path, place: &Path, artifact: Artifact) -> Result<()> {
    let python = python::environment(workspace, "dist")?;
    let mut pip = Command::new(python);
    pip.args(["-m", "pip", "install", "--quiet", "--only-binary", ":all:", "--python-version", PYTHON]);
    pip.args(["--platform", &format!("manylinux2014_{}", artifact.processor())]);
    process::run(pip.arg("--target").arg(place).arg(wheel))
}

/// Runs `qv`: its version, then a robot is simulated, and its recording replayed. Why it failed, if it did.
fn run_program(system: &System, program: &str) -> Result<Option<String>> {
    let (fixture, replay) = (system.path(&format!("{OUTPUT}/fixture")), system.path(&format!("{OUTPUT}/replay")));
    let mut version = system.command(program);
    let mut record = system.command(program);
    record.args(["fixture", "--quiet", "--out"]).arg(&fixture);
    let mut simulate = system.command(program);
    simulate.args(["replay", "--quiet"]).arg(fixture.join("run.mcap"));
    simulate.arg("--terrain").arg(fixture.join("terrain.glb")).arg("--out").arg(&replay);
    for command in [version.arg("--version"), &mut record, &mut simulate] {
        if let Some(reason) = failure(command)? {
            return Ok(Some(reason));
        }
    }
    let report = system.root.join(OUTPUT).join("replay/replay.json");
    let text = fs::read_to_string(&report).with_context(|| format!("reading {}", report.display()))?;
    let fields: serde_json::Value = serde_json::from_str(&text).context("replay.json is no JSON")?;
    let has_windows = fields["windows"].as_array().map_or(fields["windows"].is_object(), |all| !all.is_empty());
    Ok((!has_windows).then(|| "replay.json has no windows".into()))
}

/// Imports the package and steps robots. Why that failed, if it did.
fn import(system: &System) -> Result<Option<String>> {
    let mut python = system.command("usr/bin/python3");
    failure(python.env("PYTHONPATH", system.path(PLACE)).args(["-c", IMPORT]))
}

/// Runs a command; what it said, if it failed.
fn failure(command: &mut Command) -> Result<Option<String>> {
    let output = command.output().with_context(|| format!("cannot start {command:?}"))?;
    let messages = String::from_utf8_lossy(&output.stderr);
    Ok((!output.status.success()).then(|| format!("{command:?}: {}: {}", output.status, messages.trim())))
}
