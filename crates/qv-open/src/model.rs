//! Models of robots, from what a recording or a caller names.

use crate::description::description_of;
use crate::error::file_error;
use crate::mesh_file::read_mesh;
use qv_core::Mismatch;
use qv_policy::velocity::{self, known_robot};
use qv_recording::mapping::Mapping;
use qv_recording::robots::{ModelSource, RobotFile};
use qv_recording::run::{Base, Robot};
use qv_recording::{RecordingError, Run, robots};
use qv_sim::mjcf::is_mjcf;
use qv_sim::{BaseKind, Model, ModelOptions, SimError};
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

/// A robot file and the folder that its files lie in.
pub(crate) struct FoundRobot {
    pub file: RobotFile,
    folder: PathBuf,
}

/// The robot file that a name stands for: a built-in one, or a `.toml`; `None` for what else a robot may be.
pub(crate) fn robot_file(name: &str) -> Result<Option<FoundRobot>, RecordingError> {
    if let Some(file) = robots::built_in(name) {
        return Ok(Some(FoundRobot { file, folder: PathBuf::new() }));
    }
    let path = Path::new(name);
    if path.extension().is_none_or(|e| e != "toml") {
        return Ok(None);
    }
    let text = fs::read_to_string(path).map_err(|e| file_error(path, "a robot file", &e.to_string()))?;
    let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
    let beside = |file: &str| {
        let bytes = named_by_another(&folder.join(file))?;
        String::from_utf8(bytes).map_err(|e| e.to_string())
    };
    let file = robots::parse(name, &text, &beside)?;
    Ok(Some(FoundRobot { file, folder }))
}

/// The topics of a robot and what they mean, by the name of `qv robots` or a `.toml` file; `None` for what else a robot may be.
///
/// # Errors
/// The file cannot be read.
pub fn robot_mapping(name: &str) -> Result<Option<Mapping>, RecordingError> {
    Ok(robot_file(name)?.map(|found| found.file.mapping))
}

/// The text of a robot's model.
pub(crate) struct ModelText {
    /// Its file, or what stands for it in messages.
    name: String,
    pub(crate) text: String,
    /// Whether the program has it, so that all of the robot is known.
    is_built_in: bool,
    /// Rotor inertia of every joint \[kg m²\], where the model states none.
    pub(crate) armature: f64,
    remarks: Option<String>,
}

/// The model of a robot that comes with the program for walking: go1, a1, a2, anymal_c.
pub(crate) fn walking_robot(name: &str) -> Option<ModelText> {
    let (file, model) = known_robot(name)?;
    let armature = velocity::RobotFile::parse(file).ok().and_then(|file| file.armature).unwrap_or(0.0);
    Some(ModelText { name: name.into(), text: model.into(), is_built_in: false, armature, remarks: None })
}

/// The model that `robot` names, else that of the recording.
fn model_text(recorded_robot: &Robot, path: &Path, robot: Option<&str>) -> Result<ModelText, RecordingError> {
    let recorded = |text: &String| {
        // A recording that carries its robot has it beside it, if anywhere, and its meshes.
        let file = own_urdf(path).unwrap_or_else(|| path.with_file_name("robot.urdf"));
        ModelText {
            name: file.display().to_string(),
            text: text.clone(),
            is_built_in: false,
            armature: 0.0,
            remarks: None,
        }
    };
    let read = |file: &Path| {
        let (text, remarks) = read_urdf(file, "a robot of `qv robots`, a robot file, or a URDF or MJCF file")?;
        Ok(ModelText { name: file.display().to_string(), text, is_built_in: false, armature: 0.0, remarks })
    };
    let found = match (robot, recorded_robot) {
        (None, Robot::Urdf(text)) => return Ok(recorded(text)),
        (Some(name), _) => match robot_file(name)? {
            Some(found) => found,
            None => return walking_robot(name).map_or_else(|| read(Path::new(name)), Ok),
        },
        (None, Robot::Named(name)) => robot_file(name)?.ok_or_else(|| {
            let known: Vec<&str> = robots::names().collect();
            let expected = format!("a robot known by name ({})", known.join(", "));
            Mismatch::new("robot", expected, name)
        })?,
    };
    let name = &found.file.mapping.robot;
    match (&found.file.model, recorded_robot) {
        (ModelSource::File(file), _) => read(&found.folder.join(file)),
        (ModelSource::BuiltIn(owner), _) if owner == GO2 => {
            let (text, armature) = (qv_go2::model::urdf(), qv_go2::model::ARMATURE);
            Ok(ModelText { name: owner.clone(), text, is_built_in: true, armature, remarks: None })
        }
        (_, Robot::Urdf(text)) => Ok(recorded(text)),
        _ => {
            if let Some(model) = walking_robot(name) {
                return Ok(model);
            }
            let expected = format!(
                "`--robot FILE` with its URDF or MJCF, or with a robot file that has `like = \"{name}\"`, a `name` and `urdf = \"FILE\"`"
            );
            Err(Mismatch::new(format!("model of `{name}`"), expected, "none: it is not built in").into())
        }
    }
}

/// The model of a robot without a recording of it: one of `qv robots` whose model is built in, a robot file, or a URDF or MJCF file.
///
/// # Errors
/// As [`model_of`].
pub fn model_named(name: &str, base: BaseKind) -> Result<Model, RecordingError> {
    let ModelText { name, text, armature, .. } = model_text(&Robot::Named(name.into()), Path::new(""), Some(name))?;
    let beside = Path::new(&name).parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let meshes = |mesh: &str| read_mesh(beside, mesh);
    let options = ModelOptions { base, armature, mesh_reader: Some(&meshes), held: &[] };
    read_model(&text, beside, &options).map_err(|e| file_error(Path::new(&name), "a robot", &e.to_string()))
}

/// The robot whose model is built in.
const GO2: &str = "go2";

/// The model to replay `run` (read from `path`) with: that of `robot` when it is given, else the recording's own. Meshes
/// are looked for beside the URDF; what cannot be read is in `Model::left_out`.
///
/// # Errors
/// When the name is unknown, the file cannot be read, or it holds no good URDF or MJCF.
pub fn model_of(run: &Run, path: &Path, robot: Option<&str>) -> Result<Model, RecordingError> {
    let ModelText { name, text: urdf, is_built_in, armature, remarks } = model_text(&run.robot, path, robot)?;
    let mut remarks: Vec<String> = remarks.into_iter().collect();
    let base = match run.base {
        Base::Free => BaseKind::Floating,
        Base::Fixed => BaseKind::Fixed,
    };
    // Meshes lie where the URDF does, wherever the recording is.
    let beside = Path::new(&name).parent().unwrap_or(Path::new(""));
    let beside = if beside.as_os_str().is_empty() { Path::new(".") } else { beside };
    let beside = beside.canonicalize().unwrap_or_else(|_| beside.to_path_buf());
    let meshes = |mesh: &str| read_mesh(&beside, mesh);
    let read = |held: &[(String, f64)]| {
        let options = ModelOptions { base, armature, mesh_reader: Some(&meshes), held };
        read_model(&urdf, &beside, &options).map_err(|e| file_error(Path::new(&name), "a robot", &e.to_string()))
    };
    let mut model = read(&[])?;
    let held = if !is_built_in { qv_recording::limits::held(run, &model) } else { Vec::new() };
    if !held.is_empty() {
        model = read(&held)?;
        let one = |(name, position): &(String, f64)| format!("{name} at {position:.3}");
        let names: Vec<String> = held.iter().map(one).collect();
        remarks.push(format!("joints without positions in the recording are held [rad or m]: {}", names.join(", ")));
    }
    model.remarks.splice(0..0, remarks);
    qv_rollout::with_stated_rotors(run, &mut model);
    qv_recording::imu::in_trunk_axes(&mut model);
    let known = qv_rollout::feet_of(run, &model).names;
    let absent: Vec<&str> = run.foot_names.iter().filter(|f| !known.contains(f)).map(String::as_str).collect();
    if !absent.is_empty() {
        let links: Vec<String> = absent.iter().map(|f| format!("{f}_")).collect();
        model.remarks.push(format!(
            "feet {} are not in the model: no sphere is on a link whose name begins with {}",
            absent.join(" "),
            links.join(" or ")
        ));
    }
    // What a robot that is built in can do is known; files often state less than their robots do.
    if !is_built_in {
        let lifted = qv_recording::limits::lift(run, &mut model);
        model.remarks.extend(lifted);
    }
    Ok(model)
}

/// The model of a URDF or an MJCF; the latter's `<include>`s are looked for in `beside`.
///
/// # Errors
/// What is wrong with the text.
pub fn read_model(text: &str, beside: &Path, options: &ModelOptions) -> Result<Model, SimError> {
    if !is_mjcf(text) {
        return Model::from_urdf(text, options);
    }
    Model::from_mjcf(text, options, &|name: &str| included(beside, name))
}

/// Bytes of a file that is text: those of robots have a thousandth of it.
const MOST_TEXT: u64 = 64 << 20;

/// The bytes of a file that should be text, which may be a pipe without an end.
fn bounded(path: &Path) -> Result<Vec<u8>, String> {
    let file = File::open(path).map_err(|e| e.to_string())?;
    let mut bytes = Vec::new();
    file.take(MOST_TEXT + 1).read_to_end(&mut bytes).map_err(|e| e.to_string())?;
    match bytes.len() as u64 > MOST_TEXT {
        true => Err(format!("more than {} MiB", MOST_TEXT >> 20)),
        false => Ok(bytes),
    }
}

/// The bytes of a file that another one names: a regular one, as nobody chose to wait for it.
fn named_by_another(path: &Path) -> Result<Vec<u8>, String> {
    match fs::metadata(path).map_err(|e| e.to_string())?.is_file() {
        true => bounded(path),
        false => Err("no regular file".into()),
    }
}

/// The text of a file that an MJCF in `beside` includes: a regular one, of 64 MiB at most.
///
/// # Errors
/// Why there is none.
pub fn included(beside: &Path, name: &str) -> Result<String, String> {
    let bytes = named_by_another(&beside.join(name))?;
    qv_sim::urdf::decode(&bytes).map(|(text, _)| text).map_err(|e| e.to_string())
}

/// The text of a URDF or MJCF, and a sentence where some of it is not in its encoding.
pub fn read_urdf(path: &Path, expected: &str) -> Result<(String, Option<String>), RecordingError> {
    let bytes = bounded(path).map_err(|e| file_error(path, expected, &e))?;
    qv_sim::urdf::decode(&bytes).map_err(|e| file_error(path, "a robot", &e.to_string()))
}

/// The URDF that the description of a table names.
fn own_urdf(path: &Path) -> Option<PathBuf> {
    let description = description_of(path);
    let robot = qv_recording::robot_of(&fs::read_to_string(&description).ok()?).ok()?;
    Some(description.parent().unwrap_or(Path::new("")).join(robot))
}

/// The text of the URDF that [`model_of`] reads; `None` when it cannot be read.
pub fn urdf_of(run: &Run, path: &Path, robot: Option<&str>) -> Option<String> {
    model_text(&run.robot, path, robot).ok().map(|found| found.text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[cfg(unix)]
    #[test]
    fn a_file_that_another_one_names_is_a_regular_one_of_a_size() {
        let folder = std::env::temp_dir().join(format!("qv-included-{}", std::process::id()));
        fs::create_dir_all(folder.join("folder.xml")).unwrap();
        fs::write(folder.join("good.xml"), "<mujoco/>").unwrap();
        // Without blocks on the disk.
        File::create(folder.join("large.xml")).unwrap().set_len(MOST_TEXT + 1).unwrap();
        assert_eq!(included(&folder, "good.xml").unwrap(), "<mujoco/>");
        for (name, word) in
            [("/dev/zero", "no regular file"), ("folder.xml", "no regular file"), ("large.xml", "more than 64 MiB")]
        {
            let error = included(&folder, name).unwrap_err();
            assert!(error.contains(word), "{name}: {error}");
        }
        // A robot that somebody names may come through a pipe, but it ends.
        let error = read_urdf(Path::new("/dev/zero"), "a robot").unwrap_err().to_string();
        assert!(error.states("64 MiB"), "{error}");
        fs::remove_dir_all(folder).unwrap();
    }
}
