//! Which parts of a view the given folders hold.

use crate::Failure;
use crate::outcome::about;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// Endings of bags.
const BAGS: [&str; 5] = [".mcap", ".db3", ".mcap.zstd", ".db3.zstd", ".bag"];
/// How many folders above those given a relative path of a report may start in.
const ABOVE: usize = 5;

/// What was found; `None` = nowhere.
#[derive(Default)]
pub struct Parts {
    pub scene: Option<PathBuf>,
    pub mesh: Option<PathBuf>,
    pub diagnosis: Option<Value>,
    /// Corrections that apply, if there are any.
    pub calibrated: Option<PathBuf>,
    pub contact: Option<Value>,
    /// The recording.
    pub run: Option<PathBuf>,
    pub remarks: Vec<String>,
}

impl Parts {
    /// Looks into the folders, in their order.
    ///
    /// # Errors
    /// A folder is none, or a report in it is no JSON.
    pub fn find(folders: &[PathBuf], run: Option<&Path>) -> Result<Self, Failure> {
        if let Some(folder) = folders.iter().find(|folder| !folder.is_dir()) {
            return Err(about(folder, "expected a folder that a command wrote, found none"));
        }
        let first = |name: &str| folders.iter().map(|folder| folder.join(name)).find(|path| path.is_file());
        let json = |name: &str| first(name).map(|path| read(&path)).transpose();
        let (diagnosis, contact, replay) = (json("report.json")?, json("contact.json")?, json("replay.json")?);
        let reports = [&diagnosis, &replay, &contact];
        let named = || reports.into_iter().flatten().flat_map(inputs).collect::<Vec<String>>();
        let mut remarks = Vec::new();
        let run = match run {
            Some(path) => Some(path.to_path_buf()),
            None => {
                let recordings: Vec<String> = named().into_iter().filter(|path| is_recording(path)).collect();
                let found = recordings.iter().find_map(|path| at(path, folders));
                if let (None, Some(path)) = (&found, recordings.first()) {
                    remarks.push(format!("{path}: the recording is not there any more; --run names another"));
                }
                found.map(|path| whole(&path))
            }
        };
        let mesh = first("terrain.glb")
            .or_else(|| named().iter().filter(|path| path.ends_with(".glb")).find_map(|path| at(path, folders)));
        let applies = diagnosis
            .as_ref()
            .is_some_and(|d| d["corrections_apply"] != false && d["causes"].as_array().is_some_and(|c| !c.is_empty()));
        Ok(Self {
            scene: first("scene.ply"),
            mesh,
            calibrated: first("report.json")
                .map(|p| p.with_file_name("calibrated.toml"))
                .filter(|p| applies && p.is_file()),
            diagnosis,
            contact,
            run,
            remarks,
        })
    }
}

fn read(path: &Path) -> Result<Value, Failure> {
    let text = fs::read_to_string(path).map_err(|e| about(path, format!("expected a report, found {e}")))?;
    serde_json::from_str(&text).map_err(|e| about(path, format!("expected JSON, found {e}")))
}

/// Paths of the files that a report was made of.
fn inputs(report: &Value) -> Vec<String> {
    let list = report["provenance"]["inputs"].as_array();
    list.into_iter().flatten().filter_map(|input| Some(input["path"].as_str()?.to_owned())).collect()
}

fn is_recording(path: &str) -> bool {
    let name = path.to_lowercase();
    BAGS.iter().any(|ending| name.ends_with(ending)) || name.ends_with("run.csv")
}

/// A path of a report: as it is, or from one of the folders or those above them.
fn at(path: &str, folders: &[PathBuf]) -> Option<PathBuf> {
    let plain = PathBuf::from(path);
    if plain.exists() {
        return Some(plain);
    }
    let real = folders.iter().filter_map(|folder| folder.canonicalize().ok());
    let mut bases = real.flat_map(|folder| folder.ancestors().take(ABOVE).map(Path::to_path_buf).collect::<Vec<_>>());
    bases.find_map(|base| Some(base.join(&plain)).filter(|path| path.exists()))
}

/// The recording that a file is part of.
fn whole(file: &Path) -> PathBuf {
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let is_table = file.file_name().is_some_and(|name| name == "run.csv");
    if is_table || folder.join("metadata.yaml").is_file() { folder.to_path_buf() } else { file.to_path_buf() }
}
