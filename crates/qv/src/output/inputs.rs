//! What is read is never written over.

use super::manifest::exists;
use super::paths::is_same;
use crate::Failure;
use clap::{ArgMatches, Command};
use std::ffi::OsStr;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Arguments that name what is written.
const OUTPUTS: [&str; 3] = ["out", "scene_out", "junit"];
/// Positional arguments that name a folder to write into.
const FOLDERS: [(&str, &str); 1] = [("man", "folder")];

/// What commands write into the folder of `--out DIR`. An input of one of these names, or in a folder of one, is refused at once; what is written
/// under names that depend on the input is looked at when it is written.
const WRITTEN: [(&str, &[&str]); 13] = [
    ("demo", &["run.mcap", "truth.json", "why", "view.html"]),
    ("fixture", &["run.mcap", "terrain.glb", "truth.json"]),
    ("replay", &["replay.json", "replay.html", "replay.mcap", "replay.layout.json"]),
    (
        "diagnose",
        &[
            "report.json",
            "report.html",
            "calibrated.toml",
            "calibrated_camera.toml",
            "mjcf_fragment.xml",
            "mjcf_by_hand.txt",
            "robot_calibrated.urdf",
            "isaac_lab_actuators.py",
            "evidence.json",
            "policy.json",
            "validation.json",
            "without",
        ],
    ),
    ("drift", &["drift.json", "drift.html"]),
    ("next", &["next.json", "commands.csv", "commands.mcap"]),
    ("contact", &["contact.json", "contact.html", "calibrated.toml", "terrain.glb"]),
    (
        "reconstruct",
        &[
            "scene.ply",
            "checkpoint.qvt",
            "metrics.json",
            "cameras.json",
            "aside.json",
            "capture",
            "previews",
            "held_out",
            "masks",
        ],
    ),
    (
        "train",
        &[
            "policy.onnx",
            "policy.toml",
            "settings.toml",
            "checkpoint.bin",
            "metrics.json",
            "weights.bin",
            "walk.html",
            "replay.mcap",
            "robot.urdf",
        ],
    ),
    ("play", &["play.json", "walk.html", "replay.mcap", "robot.urdf"]),
    ("record", &["hidden.toml"]),
    ("roll", &["roll.json"]),
    (
        "tune",
        &[
            "policy.onnx",
            "policy.toml",
            "checkpoint.bin",
            "compensator.json",
            "compensator.onnx",
            "calibrated.toml",
            "settings.toml",
            "tune.json",
            "tune.html",
            "stages",
        ],
    ),
];

/// What this process reads.
static READ: OnceLock<Vec<PathBuf>> = OnceLock::new();

/// The innermost command that was typed, with what was typed for it.
pub fn innermost<'c, 'm>(root: &'c Command, matches: &'m ArgMatches) -> Option<(&'c Command, &'m ArgMatches)> {
    let (mut command, mut matches) = (root, matches);
    while let Some((name, inner)) = matches.subcommand() {
        (command, matches) = (command.find_subcommand(name)?, inner);
    }
    Some((command, matches))
}

/// Where the command that was typed writes.
#[derive(Debug, Default)]
pub struct Targets {
    /// The folder of `--out DIR`.
    pub folder: Option<PathBuf>,
    /// Files that options name.
    pub files: Vec<PathBuf>,
}

/// Where the command that was typed writes.
pub fn targets(root: &Command, matches: &ArgMatches) -> Targets {
    innermost(root, matches).map_or_else(Targets::default, |(command, matches)| targets_of(command, matches))
}

fn targets_of(command: &Command, matches: &ArgMatches) -> Targets {
    let mut targets = Targets::default();
    for arg in command.get_arguments() {
        let id = arg.get_id().as_str();
        if !is_output(command.get_name(), id) {
            continue;
        }
        let is_folder = arg.get_value_names().is_some_and(|names| names.iter().any(|name| name == "DIR"));
        let mut paths = matches.try_get_many::<PathBuf>(id).ok().flatten().into_iter().flatten().cloned();
        if is_folder { targets.folder = paths.next() } else { targets.files.extend(paths) }
    }
    targets
}

fn is_output(command: &str, id: &str) -> bool {
    OUTPUTS.contains(&id) || FOLDERS.contains(&(command, id))
}

/// Refuses a command of which an input is, or lies in, what it would write; remembers its inputs for [`refuse_read`]. Nothing was read or written
/// before.
///
/// # Errors
/// Names the input and the output.
pub fn refuse(root: &Command, matches: &ArgMatches) -> Result<(), Failure> {
    let Some((command, matches)) = innermost(root, matches) else { return Ok(()) };
    let read: Vec<PathBuf> = (command.get_arguments())
        .filter(|arg| !is_output(command.get_name(), arg.get_id().as_str()))
        .filter_map(|arg| matches.try_get_raw(arg.get_id().as_str()).ok().flatten())
        .flatten()
        .flat_map(paths_of)
        .filter(|path| path.exists())
        .collect();
    let targets = targets_of(command, matches);
    for file in targets.files.iter().filter(|file| !file.is_dir()) {
        refuse_inputs(file, &read)?;
    }
    if let Some(folder) = &targets.folder {
        let names = WRITTEN.iter().find(|(name, _)| *name == command.get_name()).map_or(&[][..], |(_, names)| names);
        names.iter().try_for_each(|name| refuse_inside(&folder.join(name), &read))?;
    }
    READ.set(read).ok();
    Ok(())
}

/// What a value may name: itself, or what stands behind `=` in it.
fn paths_of(value: &OsStr) -> Vec<PathBuf> {
    let behind = value.to_str().and_then(|text| text.split_once('=')).map(|(_, path)| PathBuf::from(path));
    behind.into_iter().chain([PathBuf::from(value)]).collect()
}

fn refused(out: &Path, input: &Path) -> Failure {
    let hint = "name another place with --out";
    format!("cannot write '{}': the input '{}' is read from there\nhint: {hint}", out.display(), input.display()).into()
}

/// Refuses to write over what is read. A device or a pipe is not written over.
///
/// # Errors
/// Names both.
pub fn refuse_inputs<'a>(out: &Path, inputs: impl IntoIterator<Item = &'a PathBuf>) -> Result<(), Failure> {
    let is_over = |input: &&PathBuf| is_same(input, out) && (out.is_file() || out.is_dir());
    inputs.into_iter().find(is_over).map_or(Ok(()), |input| Err(refused(out, input)))
}

/// The same for inputs that lie in a folder that is written, too.
fn refuse_inside(out: &Path, inputs: &[PathBuf]) -> Result<(), Failure> {
    refuse_inputs(out, inputs)?;
    let Ok(folder) = std::fs::canonicalize(out) else { return Ok(()) };
    let inside = inputs.iter().find(|input| std::fs::canonicalize(input).is_ok_and(|input| input.starts_with(&folder)));
    inside.map_or(Ok(()), |input| Err(refused(out, input)))
}

/// Refuses to write a file that an option names as one that is read: what commands write under names that depend on their input is seen here.
///
/// # Errors
/// Names both.
pub fn refuse_read(path: &Path) -> io::Result<()> {
    if !exists(path) {
        return Ok(());
    }
    let read = READ.get().map_or(&[][..], Vec::as_slice);
    let files = read.iter().filter(|input| input.is_file());
    refuse_inputs(path, files).map_err(|e| io::Error::other(e.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory as _;
    use std::fs;

    fn refused_of(words: &[&str]) -> Option<String> {
        let mut root = crate::Cli::command();
        root.build();
        let matches = root.clone().try_get_matches_from([&["qv"], words].concat()).unwrap();
        let command = innermost(&root, &matches).unwrap();
        assert!(!targets_of(command.0, command.1).files.is_empty() || targets(&root, &matches).folder.is_some());
        refuse(&root, &matches).err().map(|e| e.to_string())
    }

    #[test]
    fn an_input_that_would_be_written_is_refused() {
        let folder = std::env::temp_dir().join(format!("qv-refused-{}", std::process::id()));
        fs::create_dir_all(folder.join("capture/images")).unwrap();
        fs::write(folder.join("calibrated.toml"), "").unwrap();
        fs::write(folder.join("run.csv"), "").unwrap();
        fs::write(folder.join("mesh.glb"), "").unwrap();
        fs::hard_link(folder.join("mesh.glb"), folder.join("same.glb")).unwrap();
        let at = |name: &str| folder.join(name).display().to_string();
        let (root, run, calibrated) = (at("."), at("run.csv"), at("calibrated.toml"));
        assert!(
            refused_of(&["diagnose", &run, "--params", &calibrated, "--out", &root]).unwrap().contains("calibrated")
        );
        assert_eq!(refused_of(&["diagnose", &run, "--out", &root]), None);
        let capture = at("capture");
        assert!(refused_of(&["reconstruct", &capture, "--out", &root]).is_some());
        assert!(refused_of(&["reconstruct", &at("capture/images"), "--out", &root]).is_some());
        assert_eq!(refused_of(&["reconstruct", &capture, "--out", &at("scene")]), None);
        assert!(refused_of(&["mesh", &at("mesh.glb"), "--out", &at("same.glb")]).is_some());
        assert_eq!(refused_of(&["mesh", &at("mesh.glb"), "--out", &at("other.glb")]), None);
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn every_command_with_an_output_folder_is_listed() {
        fn each(command: &Command, missing: &mut Vec<String>) {
            let writes = command.get_arguments().any(|arg| {
                arg.get_id() == "out"
                    && arg.get_value_names().is_some_and(|names| names.iter().any(|name| name == "DIR"))
            });
            // Names of images depend on the cameras; the rehearsal is no command of users.
            let is_known =
                |name: &str| ["render", "rehearse"].contains(&name) || WRITTEN.iter().any(|(known, _)| *known == name);
            if writes && !is_known(command.get_name()) {
                missing.push(command.get_name().into());
            }
            command.get_subcommands().for_each(|inner| each(inner, missing));
        }
        let (mut root, mut missing) = (crate::Cli::command(), vec![]);
        root.build();
        each(&root, &mut missing);
        assert!(missing.is_empty(), "{missing:?}");
    }
}
