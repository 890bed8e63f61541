//! Recordings of other programs on disk: LeRobot datasets, SAGE folders, CSV files of Unitree's LowState.

pub use crate::description::root;
use crate::description::{Kind, description_of, kind};
use crate::error::file_error;
use crate::table::{mapping_of, run_of_table, urdf_beside};
use qv_recording::foreign::lerobot::Info;
use qv_recording::foreign::motor_csv::{Motors, is_motor_csv};
use qv_recording::foreign::{Settings, Table, lerobot, motor_csv, sage};
use qv_recording::{RecordingError, Run};
use qv_sim::{Model, ModelOptions};
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

/// Longest first line of a CSV file that is looked at, bytes.
const LONGEST_HEADER: u64 = 1 << 20;

/// Reads a path that is a dataset of LeRobot or a folder of SAGE; `None` where it is neither.
pub fn open(path: &Path) -> Option<Result<Run, RecordingError>> {
    let kind = kind(path)?;
    Some(match &kind {
        Kind::LeRobot(root, file) => run_of(root, |settings| dataset(root, file.as_deref(), settings)),
        Kind::Sage(root) => run_of(root, |settings| {
            let text = |name: &str| text(&root.join(name));
            let beside = |name: &str| root.join(name).is_file().then(|| text(name)).transpose();
            let (control, joints) = (beside("control.csv")?, beside("joint_list.txt")?);
            sage::table(&text("state_motor.csv")?, control.as_deref(), joints.as_deref(), settings)
        }),
    })
}

fn run_of(root: &Path, table: impl Fn(&Settings) -> Result<Table, RecordingError>) -> Result<Run, RecordingError> {
    let file = root.join("run.toml");
    let expected = "a run description with robot = \"NAME or FILE.urdf\" and, where need be, [dataset]";
    let toml = fs::read_to_string(&file).map_err(|e| file_error(&file, expected, &e.to_string()))?;
    let table = table(&Settings::of(&toml)?)?;
    finish(table, &file, &toml)
}

fn finish(table: Table, toml_path: &Path, toml: &str) -> Result<Run, RecordingError> {
    let mut run = run_of_table(table.csv.as_bytes(), toml_path, toml)?;
    run.remarks.splice(0..0, table.remarks);
    run.lost.splice(0..0, table.lost);
    Ok(run)
}

fn text(path: &Path) -> Result<String, RecordingError> {
    let bytes = fs::read(path).map_err(|e| file_error(path, "a readable file", &e.to_string()))?;
    String::from_utf8(bytes).map_err(|e| file_error(path, "text", &e.to_string()))
}

fn dataset(root: &Path, file: Option<&Path>, settings: &Settings) -> Result<Table, RecordingError> {
    let info = Info::read(&text(&root.join("meta/info.json"))?)?;
    let all = match file {
        Some(file) => vec![file.to_path_buf()],
        None => parquet_files(&root.join("data"), 2),
    };
    let name = |path: &PathBuf| path.strip_prefix(root).unwrap_or(path).to_string_lossy().replace('\\', "/");
    let names: Vec<String> = all.iter().map(name).collect();
    let mut contents = |name: &str| fs::read(root.join(name)).map_err(|e| e.to_string());
    lerobot::table(&info, &names, &mut contents, settings)
}

/// Parquet files below a folder, by name.
fn parquet_files(folder: &Path, depth: usize) -> Vec<PathBuf> {
    let mut entries: Vec<PathBuf> = fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
    entries.sort();
    let inside = entries.into_iter().flat_map(|path| match path.is_dir() && depth > 0 {
        true => parquet_files(&path, depth - 1),
        false if path.extension().is_some_and(|e| e == "parquet") => vec![path],
        false => vec![],
    });
    inside.collect()
}

/// Reads a CSV file whose columns are those of LowState; `None` where they are not, or nothing says which robot it is of.
pub(crate) fn open_motor_csv(csv: &Path) -> Option<Result<Run, RecordingError>> {
    let description = description_of(csv);
    let toml = fs::read_to_string(&description).ok()?;
    let mut header = Vec::new();
    BufReader::new(fs::File::open(csv).ok()?).take(LONGEST_HEADER).read_until(b'\n', &mut header).ok()?;
    let motors = motors(&description, &toml)?;
    if !is_motor_csv(&String::from_utf8_lossy(&header), &motors) {
        return None;
    }
    Some(
        text(csv)
            .and_then(|text| motor_csv::table(&text, &motors))
            .and_then(|table| finish(table, &description, &toml)),
    )
}

/// The motors of the robot that `run.toml` names: in the order that it states, else in that of its messages, else in the model's.
fn motors(description: &Path, toml: &str) -> Option<Motors> {
    if let Some(joints) = Settings::of(toml).ok()?.joints {
        return Some(Motors { joints, wire: None, first: None });
    }
    let robot = qv_recording::robot_of(toml).ok()?;
    if let Some(mapping) = mapping_of(&robot) {
        return Some(Motors::of(&mapping));
    }
    let (urdf, _) = urdf_beside(description, &robot).ok()?;
    let model = Model::from_urdf(&urdf, &ModelOptions::default()).ok()?;
    Some(Motors { joints: model.joint_names().to_vec(), wire: None, first: None })
}
