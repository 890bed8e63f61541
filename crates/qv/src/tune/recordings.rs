//! Recordings and folders of recordings become one log.

use crate::open::{file_error, open_run};
use crate::terminal::print_message;
use crate::{Failure, Reading, RunArguments};
use qv_policy::velocity::{TaskRobot, TaskSettings};
use qv_residual::log::Log;
use std::fs;
use std::path::{Path, PathBuf};

/// Reads them; how many could not be used, which are reported on standard error.
pub fn read(
    paths: &[PathBuf],
    pose_topic: Option<&str>,
    robot: &TaskRobot,
    task: &TaskSettings,
) -> Result<(Log, usize), Failure> {
    let mut all = Vec::new();
    for path in paths {
        all.extend(recordings_in(path)?);
    }
    let mut log = Log::new(robot, task);
    let mut refused = Vec::new();
    for path in &all {
        let arguments = RunArguments {
            run: path.clone(),
            reading: Reading { pose_topic: pose_topic.map(str::to_owned), ..Default::default() },
        };
        let name = path.display().to_string();
        let read = open_run(&arguments).map_err(|e| e.to_string());
        let added = read.and_then(|run| log.add(&name, &run, robot).map_err(|e| e.to_string()));
        if let Err(why) = added {
            let is_named = why.contains(&name);
            refused.push(if is_named { why } else { format!("{name}: {why}") });
        }
    }
    if log.stretches.is_empty() {
        return Err(refused.join("\n").into());
    }
    for why in refused.iter().chain(&log.remarks) {
        print_message!("{why}");
    }
    log.remarks.extend(refused.iter().cloned());
    Ok((log, refused.len()))
}

/// A recording, or those in a folder in the order of their names.
fn recordings_in(path: &Path) -> Result<Vec<PathBuf>, Failure> {
    let metadata =
        fs::metadata(path).map_err(|e| file_error(path, "a recording or a folder of some", &e.to_string()))?;
    let holds = |end: &str| {
        fs::read_dir(path).is_ok_and(|d| d.flatten().any(|e| e.file_name().to_string_lossy().ends_with(end)))
    };
    let is_one = !metadata.is_dir() || path.join("run.csv").exists() || path.join("metadata.yaml").exists();
    if is_one {
        return Ok(vec![path.to_path_buf()]);
    }
    let mut inside: Vec<PathBuf> = fs::read_dir(path)?.flatten().map(|e| e.path()).collect();
    inside.retain(|p| p.join("run.csv").exists() || p.join("metadata.yaml").exists() || is_file_of_a_bag(p));
    inside.sort();
    match inside.is_empty() && !holds(".mcap") {
        true => {
            Err(file_error(path, "recordings (folders with run.csv or metadata.yaml, or .mcap files)", "none").into())
        }
        false => Ok(inside),
    }
}

fn is_file_of_a_bag(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    [".mcap", ".db3", ".mcap.zstd", ".db3.zstd"].iter().any(|end| name.ends_with(end))
}
