//! A recording, its robot and its ground from disk.

use qv_recording::robots;

use qv_recording::robots::ModelSource;
use qv_recording::run::{Base, Robot};
use qv_recording::{BagFile, Run, limits};
use qv_sim::mjcf::is_mjcf;
use qv_sim::{BaseKind, Model, ModelOptions, Terrain};
use std::error::Error;
use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// How far off a mesh may be under a foot \[m\].
pub const GROUND_ERROR: f64 = 0.003;

/// The recording in a bag, or in a folder with a table.
///
/// # Errors
/// There is no such file, or nothing usable in it.
pub fn run(path: &Path) -> Result<Run, Box<dyn Error>> {
    if path.is_dir() {
        return table(path);
    }
    let source = BufReader::new(File::open(path).map_err(|e| format!("{}: {e}", path.display()))?);
    let file = BagFile { name: path.display().to_string(), source };
    Ok(qv_recording::read_bag_of([file], &robots::told_by_messages(), None)?)
}

fn table(folder: &Path) -> Result<Run, Box<dyn Error>> {
    let description = text(&folder.join("run.toml"))?;
    let robot = qv_recording::robot_of(&description)?;
    let mapping = robots::built_in(&robot).map(|r| r.mapping).filter(|m| !m.joint_names.is_empty());
    let urdf = if mapping.is_none() { Some(text(&folder.join(&robot))?) } else { None };
    let csv = File::open(folder.join("run.csv")).map_err(|e| format!("{}: {e}", folder.display()))?;
    Ok(qv_recording::read_table(BufReader::new(csv), &description, urdf.as_deref(), mapping.as_ref())?)
}

fn text(path: &Path) -> Result<String, Box<dyn Error>> {
    Ok(fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?)
}

/// The model of the robot of a run that was read from `path`: that of `robot` when it is given, else the recording's own.
///
/// # Errors
/// There is none, or it is neither a URDF nor an MJCF.
pub fn model(run: &Run, path: &Path, robot: Option<&Path>) -> Result<Model, Box<dyn Error>> {
    let is_of = |name: &str, owner: &str| {
        let file = robots::built_in(name);
        file.is_some_and(|file| file.model == ModelSource::BuiltIn(owner.into()))
    };
    let (text, beside, is_built_in) = match (robot, &run.robot) {
        (Some(file), _) => (text(file)?, file.parent().unwrap_or(Path::new("")).to_path_buf(), false),
        (None, Robot::Urdf(text)) => (text.clone(), folder_of(path), false),
        (None, Robot::Named(name)) if is_of(name, "go2") => (qv_go2::model::urdf(), PathBuf::new(), true),
        (None, Robot::Named(name)) => {
            return Err(format!("model of `{name}`: expected --robot FILE, found none").into());
        }
    };
    let base = match run.base {
        Base::Free => BaseKind::Floating,
        Base::Fixed => BaseKind::Fixed,
    };
    let armature = if is_built_in { qv_go2::model::ARMATURE } else { 0.0 };
    let include = |name: &str| fs::read_to_string(beside.join(name)).map_err(|e| e.to_string());
    let read = |held: &[(String, f64)]| {
        let options = ModelOptions { base, armature, mesh_vertices: None, held };
        if is_mjcf(&text) { Model::from_mjcf(&text, &options, &include) } else { Model::from_urdf(&text, &options) }
    };
    let mut model = read(&[])?;
    // What a robot that is built in can do is known; files often state less than their robots do.
    if !is_built_in {
        let held = limits::held(run, &model);
        if !held.is_empty() {
            model = read(&held)?;
        }
    }
    qv_recording::imu::in_trunk_axes(&mut model);
    if !is_built_in {
        limits::lift(run, &mut model);
    }
    Ok(model)
}

fn folder_of(path: &Path) -> PathBuf {
    if path.is_dir() { path.to_path_buf() } else { path.parent().unwrap_or(Path::new("")).to_path_buf() }
}

/// The ground that `--terrain` names.
///
/// # Errors
/// There is no such file, or it holds no mesh that can be walked on.
pub fn terrain(name: &str) -> Result<Terrain, Box<dyn Error>> {
    if name == "plane" {
        return Ok(Terrain::plane());
    }
    let bytes = fs::read(name).map_err(|e| format!("{name}: expected plane, or a .glb file, found {e}"))?;
    Ok(Terrain::from_mesh(&qv_mesh::files::glb::read(&bytes)?)?)
}
