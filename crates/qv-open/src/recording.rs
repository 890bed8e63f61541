//! Recordings on disk become runs.

use crate::foreign;
use crate::mesh_file::vertices;
use qv_core::Mismatch;
use qv_recording::mapping::Mapping;
use qv_recording::robots;

use qv_recording::robots::{ModelSource, RobotFile};
use qv_recording::run::{Base, Loss, Robot};
use qv_recording::{BagFile, RecordingError, Run};
use qv_sim::mjcf::is_mjcf;
use qv_sim::{BaseKind, Batch, Model, ModelOptions, SimError, SimOptions, Terrain};
use std::cell::Cell;
use std::fs::{self, File};
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

/// How a recording is read where it does not say enough of itself.
#[derive(Debug, Clone, Default)]
pub struct Reading {
    /// Topic of the base pose; `None`: that of the robot, else whichever topic carries poses.
    pub pose_topic: Option<String>,
    /// A robot known by name, a robot file (.toml), or a URDF or MJCF file; `None`: what the recording says.
    pub robot: Option<String>,
    /// First part of the topics of the robot that is read, where a recording has several.
    pub namespace: Option<String>,
}

/// Told the bytes that have been read and those there are.
pub type Seen<'a> = &'a dyn Fn(u64, u64);

/// A source that tells how far its reading is.
struct Counted<'a, R> {
    source: R,
    done: &'a Cell<u64>,
    total: u64,
    seen: Seen<'a>,
}

impl<R: Read> Read for Counted<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let count = self.source.read(buffer)?;
        self.done.set(self.done.get() + count as u64);
        (self.seen)(self.done.get(), self.total);
        Ok(count)
    }
}

/// Opens whatever `path` is.
///
/// # Errors
/// When there is no such file, or nothing usable in it.
pub fn open_run(path: &Path, reading: &Reading, seen: Seen) -> Result<Run, RecordingError> {
    let metadata = fs::metadata(path).map_err(|e| file_error(path, "a recording", &e.to_string()))?;
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
    // A table that somebody made of such a folder goes before it.
    if !path.join("run.csv").exists()
        && let Some(run) = foreign::open(path)
    {
        return run;
    }
    match (metadata.is_dir(), extension) {
        (true, _) if path.join("run.csv").exists() => open_table(&path.join("run.csv"), seen),
        (true, _) if path.join("run.toml").exists() => open_table(&path.join("run.csv"), seen),
        (true, _) => open_split_bag(path, reading, seen),
        (false, "csv") => open_table(path, seen),
        (false, "bag") => open_bag(&[path.to_path_buf()], reading, seen),
        (false, _) if is_bag(path) => open_bag(&[path.to_path_buf()], reading, seen),
        (false, _) => Err(file_error(
            path,
            "a bag (.mcap, .db3, either with .zstd), a .csv file, a .parquet file of a LeRobot dataset, or a directory",
            &format!("`.{extension}`"),
        )),
    }
}

/// An error about a file that cannot be written.
pub fn write_error(what: &Path, error: &std::io::Error) -> RecordingError {
    RecordingError::Write { what: what.display().to_string(), reason: error.to_string() }
}

/// An error about a file.
pub fn file_error(path: &Path, expected: &str, found: &str) -> RecordingError {
    RecordingError::File { file: path.display().to_string(), expected: expected.into(), found: found.into() }
}

fn open_bag(paths: &[PathBuf], reading: &Reading, seen: Seen) -> Result<Run, RecordingError> {
    let total = paths.iter().filter_map(|p| fs::metadata(p).ok()).map(|m| m.len()).sum();
    let done = Cell::new(0);
    let mut files = Vec::new();
    for path in paths {
        let file = File::open(path).map_err(|e| file_error(path, "a readable file", &e.to_string()))?;
        files.push(BagFile {
            name: path.display().to_string(),
            source: Counted { source: file, done: &done, total, seen },
        });
    }
    let mappings = match reading.robot.as_deref().map(robot_file).transpose()?.flatten() {
        Some(robot) => vec![robot.file.mapping],
        None => robots::told_by_messages(),
    };
    let pose = reading.pose_topic.as_deref();
    let mappings: Vec<Mapping> = mappings.into_iter().map(|m| m.with_pose_topic(pose)).collect();
    let run = qv_recording::read_bag_of(files, &mappings, reading.namespace.as_deref());
    let what = "messages that sqlite3 has not moved into the bag yet: `PRAGMA wal_checkpoint` does";
    let log = |path: &PathBuf| PathBuf::from(format!("{}-wal", path.display()));
    let logs: Vec<PathBuf> = paths.iter().map(log).filter(|log| fs::metadata(log).is_ok_and(|m| m.len() > 0)).collect();
    match (run, logs.first()) {
        // All that the bag has may be in there.
        (Err(error), Some(log)) => Err(file_error(log, "an empty log beside the bag", &format!("{what} ({error})"))),
        (run, _) => run.map(|mut run| {
            let lost = |log: &PathBuf| Loss { file: log.display().to_string(), what: what.into(), span: None };
            run.lost.extend(logs.iter().map(lost));
            run
        }),
    }
}

/// The files of a bag, to be read again for what a run does not hold.
///
/// # Errors
/// No bag is there, or a file cannot be opened.
pub fn bag_files(path: &Path) -> Result<Vec<BagFile<BufReader<File>>>, RecordingError> {
    let paths = if path.is_dir() { split_files(path)?.0 } else { vec![path.to_path_buf()] };
    let open = |path: &PathBuf| {
        let file = File::open(path).map_err(|e| file_error(path, "a readable file", &e.to_string()))?;
        Ok(BagFile { name: path.display().to_string(), source: BufReader::new(file) })
    };
    paths.iter().map(open).collect()
}

fn open_split_bag(directory: &Path, reading: &Reading, seen: Seen) -> Result<Run, RecordingError> {
    let (present, absent) = split_files(directory)?;
    let mut run = open_bag(&present, reading, seen)?;
    let mut lose = |name: String, what: String| run.lost.push(Loss { file: name, what, span: None });
    for name in absent {
        lose(directory.join(name).display().to_string(), "listed in metadata.yaml, but not there".to_string());
    }
    Ok(run)
}

/// Endings of the files of bags.
const BAG_FILES: [&str; 4] = [".mcap", ".db3", ".mcap.zstd", ".db3.zstd"];

fn is_bag(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    BAG_FILES.iter().any(|ending| name.ends_with(ending))
}

/// The files of a bag in the order of time, and names that `metadata.yaml` lists and that are in no way there: a file that was
/// renamed is there under another name.
fn split_files(directory: &Path) -> Result<(Vec<PathBuf>, Vec<String>), RecordingError> {
    let listed = fs::read_to_string(directory.join("metadata.yaml")).map(|t| listed_files(&t)).unwrap_or_default();
    let (mut present, mut absent) = (Vec::new(), Vec::new());
    for name in &listed {
        let path = directory.join(name);
        if path.exists() { present.push(path) } else { absent.push(name.clone()) }
    }
    if absent.is_empty() && !present.is_empty() {
        return Ok((present, absent));
    }
    let entries = fs::read_dir(directory).map_err(|e| file_error(directory, "a readable directory", &e.to_string()))?;
    let all: Vec<PathBuf> = entries.flatten().map(|e| e.path()).filter(|p| is_bag(p)).collect();
    // What lies there both compressed and not is one file.
    let is_copy = |p: &PathBuf| p.extension().is_some_and(|e| e == "zstd") && all.contains(&p.with_extension(""));
    let mut files: Vec<PathBuf> = all.iter().filter(|p| !is_copy(p)).cloned().collect();
    if files.is_empty() {
        let found =
            if absent.is_empty() { "none of them".into() } else { format!("only the names {}", absent.join(", ")) };
        return Err(file_error(directory, "run.csv, or the files of a bag (.mcap, .db3, .zstd)", &found));
    }
    put_in_order(&mut files);
    let renamed = files.len() - present.len().min(files.len());
    Ok((files, absent.into_iter().skip(renamed).collect()))
}

/// By the numbers at the ends of names that are alike otherwise, else by the times of their first messages.
fn put_in_order(files: &mut [PathBuf]) {
    let numbered: Vec<(String, Option<u64>)> = files.iter().map(|p| numbered(p)).collect();
    let mut numbers: Vec<Option<u64>> = numbered.iter().map(|(_, n)| *n).collect();
    numbers.sort_unstable();
    numbers.dedup();
    let is_alike = numbered.iter().all(|(head, n)| *head == numbered[0].0 && n.is_some());
    if is_alike && numbers.len() == files.len() {
        return files.sort_by_key(|p| numbered_key(p));
    }
    let first = |p: &PathBuf| File::open(p).ok().and_then(qv_recording::container::first_log_time);
    files.sort_by_cached_key(|p| (first(p).unwrap_or(u64::MAX), numbered_key(p), p.clone()));
}

fn numbered_key(path: &Path) -> u64 {
    numbered(path).1.unwrap_or(0)
}

/// `relative_file_paths` of a bag's metadata.
fn listed_files(yaml: &str) -> Vec<String> {
    let after = yaml.lines().map(str::trim).skip_while(|l| !l.starts_with("relative_file_paths:")).skip(1);
    let items = after.take_while(|l| l.starts_with('-'));
    items.map(|l| l[1..].trim().trim_matches(['"', '\'']).to_string()).filter(|n| is_bag(Path::new(n))).collect()
}

/// A file's name without its endings and the number before them, and that number: `bag_10` comes after `bag_9`.
fn numbered(path: &Path) -> (String, Option<u64>) {
    let name = path.file_name().and_then(|s| s.to_str()).unwrap_or_default();
    let stem = BAG_FILES.iter().rev().find_map(|ending| name.strip_suffix(ending)).unwrap_or(name);
    let head = stem.trim_end_matches(|c: char| c.is_ascii_digit());
    (head.to_owned(), stem[head.len()..].parse().ok())
}

/// The mapping of a built-in robot whose joints are known.
pub fn mapping_of(robot: &str) -> Option<Mapping> {
    robots::built_in(robot).map(|robot| robot.mapping).filter(|m| !m.joint_names.is_empty())
}

/// A robot file and the folder that its files lie in.
struct FoundRobot {
    file: RobotFile,
    folder: PathBuf,
}

/// The robot file that a name stands for: a built-in one, or a `.toml`; `None` for what else a robot may be.
fn robot_file(name: &str) -> Result<Option<FoundRobot>, RecordingError> {
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

/// The text of a robot's model.
struct ModelText {
    /// Its file, or what stands for it in messages.
    name: String,
    text: String,
    /// Whether the program has it, so that all of the robot is known.
    is_built_in: bool,
    told: Option<String>,
}

/// The model that `robot` names, else that of the recording.
fn model_text(recorded_robot: &Robot, path: &Path, robot: Option<&str>) -> Result<ModelText, RecordingError> {
    let recorded = |text: &String| {
        // A recording that carries its robot has it beside it, if anywhere, and its meshes.
        let file = own_urdf(path).unwrap_or_else(|| path.with_file_name("robot.urdf"));
        ModelText { name: file.display().to_string(), text: text.clone(), is_built_in: false, told: None }
    };
    let read = |file: &Path| {
        let (text, told) = read_urdf(file, "a robot of `qv robots`, a robot file, or a URDF or MJCF file")?;
        Ok(ModelText { name: file.display().to_string(), text, is_built_in: false, told })
    };
    let found = match (robot, recorded_robot) {
        (None, Robot::Urdf(text)) => return Ok(recorded(text)),
        (Some(name), _) => match robot_file(name)? {
            Some(found) => found,
            None => return read(Path::new(name)),
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
            Ok(ModelText { name: owner.clone(), text: qv_go2::model::urdf(), is_built_in: true, told: None })
        }
        (_, Robot::Urdf(text)) => Ok(recorded(text)),
        _ => {
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
    let ModelText { name, text, is_built_in, .. } = model_text(&Robot::Named(name.into()), Path::new(""), Some(name))?;
    let armature = if is_built_in { qv_go2::model::ARMATURE } else { 0.0 };
    let beside = Path::new(&name).parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let meshes = |mesh: &str| vertices(beside, mesh);
    let options = ModelOptions { base, armature, mesh_vertices: Some(&meshes), held: &[] };
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
    let ModelText { name, text: urdf, is_built_in, told } = model_text(&run.robot, path, robot)?;
    let mut told: Vec<String> = told.into_iter().collect();
    let base = match run.base {
        Base::Free => BaseKind::Floating,
        Base::Fixed => BaseKind::Fixed,
    };
    // URDF has no tag for rotor inertia: a named robot's is known, any other's comes with the recording.
    let armature = if is_built_in { qv_go2::model::ARMATURE } else { 0.0 };
    // Meshes lie where the URDF does, wherever the recording is.
    let beside = Path::new(&name).parent().unwrap_or(Path::new(""));
    let beside = if beside.as_os_str().is_empty() { Path::new(".") } else { beside };
    let beside = beside.canonicalize().unwrap_or_else(|_| beside.to_path_buf());
    let meshes = |mesh: &str| vertices(&beside, mesh);
    let read = |held: &[(String, f64)]| {
        let options = ModelOptions { base, armature, mesh_vertices: Some(&meshes), held };
        read_model(&urdf, &beside, &options).map_err(|e| file_error(Path::new(&name), "a robot", &e.to_string()))
    };
    let mut model = read(&[])?;
    let held = if !is_built_in { qv_recording::limits::held(run, &model) } else { Vec::new() };
    if !held.is_empty() {
        model = read(&held)?;
        let one = |(name, position): &(String, f64)| format!("{name} at {position:.3}");
        let names: Vec<String> = held.iter().map(one).collect();
        told.push(format!("joints without positions in the recording are held [rad or m]: {}", names.join(", ")));
    }
    model.told.splice(0..0, told);
    qv_rollout::with_stated_rotors(run, &mut model);
    qv_recording::imu::in_trunk_axes(&mut model);
    let known = qv_rollout::feet_of(run, &model).names;
    let absent: Vec<&str> = run.foot_names.iter().filter(|f| !known.contains(f)).map(String::as_str).collect();
    if !absent.is_empty() {
        let links: Vec<String> = absent.iter().map(|f| format!("{f}_")).collect();
        model.told.push(format!(
            "feet {} are not in the model: no sphere is on a link whose name begins with {}",
            absent.join(" "),
            links.join(" or ")
        ));
    }
    // What a robot that is built in can do is known; files often state less than their robots do.
    if !is_built_in {
        let lifted = qv_recording::limits::lift(run, &mut model);
        model.told.extend(lifted);
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

/// Turns the channels of an IMU that the site of an MJCF says is mounted at an angle: a table alone cannot, as the site may be
/// in an included file.
fn turn_imu(run: &mut Run, text: &str, beside: &Path) {
    // What is wrong with a robot is said where it is used.
    let model = read_model(text, beside, &ModelOptions::default()).ok();
    if let Some(rotation) = model.as_ref().and_then(qv_recording::imu::mount_of).filter(|_| run.base == Base::Free) {
        let told = qv_recording::imu::to_trunk(run, rotation, false);
        run.told.extend(told);
    }
}

/// The text of a URDF or MJCF, and a sentence where some of it is not in its encoding.
pub fn read_urdf(path: &Path, expected: &str) -> Result<(String, Option<String>), RecordingError> {
    let bytes = bounded(path).map_err(|e| file_error(path, expected, &e))?;
    qv_sim::urdf::decode(&bytes).map_err(|e| file_error(path, "a robot", &e.to_string()))
}

/// The description of the table at `path`, its CSV file or its directory.
pub fn description_of(path: &Path) -> PathBuf {
    if let Some(root) = foreign::root(path) {
        return root.join("run.toml");
    }
    if path.is_dir() {
        return path.join("run.toml");
    }
    let own = path.with_extension("toml");
    if own.exists() { own } else { path.parent().unwrap_or(Path::new("")).join("run.toml") }
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

/// Parameters outside the range that is worth searching, a line each. They are used as they are: many a one means something there, but a
/// slip of the decimal point looks the same.
pub fn beyond_range(parameters: &[(String, f64)], model: &Model, terrain: &Terrain) -> Vec<String> {
    let Ok(probe) = Batch::<f32>::new(model, terrain, &SimOptions::default(), 1) else { return Vec::new() };
    let outside = |(name, value): &(String, f64)| {
        let info = &probe.catalogue()[probe.parameter_index(name).ok()?];
        let (low, high) = info.range;
        let usual = (low..=high).contains(value) || *value == info.neutral;
        (!usual)
            .then(|| format!("parameter {name} = {value} {} is outside its usual range, {low} to {high}", info.unit))
    };
    parameters.iter().filter_map(outside).collect()
}

/// What is told of how a recording and its robot were read, a line each: nothing is lost by it.
pub fn told_of(run: &Run, model: &Model) -> Vec<String> {
    run.told.iter().chain(&model.told).cloned().collect()
}

/// What was lost of a recording or could not be used as it is, a line each.
pub fn lost_from(run: &Run) -> Vec<String> {
    let mut lost: Vec<String> = run.lost.iter().map(|l| format!("lost from {}: {}", l.file, l.what)).collect();
    let faults = run.faults.iter().filter(|f| f.kind.is_partial());
    lost.extend(faults.map(|f| format!("{:.3} s: {} in {}: {}", f.time, f.kind, f.channel, f.detail)));
    lost
}

fn open_table(csv: &Path, seen: Seen) -> Result<Run, RecordingError> {
    if let Some(run) = foreign::open_motor_csv(csv) {
        return run;
    }
    let toml_path = description_of(csv);
    let toml_text =
        fs::read_to_string(&toml_path).map_err(|e| file_error(&toml_path, "a run description", &e.to_string()))?;
    let file = File::open(csv).map_err(|e| file_error(csv, "a readable file", &e.to_string()))?;
    let (total, done) = (file.metadata().map_or(0, |m| m.len()), Cell::new(0));
    run_of_table(BufReader::new(Counted { source: file, done: &done, total, seen }), &toml_path, &toml_text)
}

/// The run of a table with the text of its description, and where that lies.
pub fn run_of_table(csv: impl Read, toml_path: &Path, toml_text: &str) -> Result<Run, RecordingError> {
    let robot = qv_recording::robot_of(toml_text)?;
    let mapping = mapping_of(&robot);
    let (urdf, told) = match &mapping {
        Some(_) => (None, None),
        None => urdf_beside(toml_path, &robot).map(|(text, note)| (Some(text), note))?,
    };
    let mut run = qv_recording::read_table(csv, toml_text, urdf.as_deref(), mapping.as_ref())?;
    run.told.extend(told);
    if let Some(text) = urdf.filter(|text| is_mjcf(text))
        && !qv_recording::states_imu(toml_text)?
    {
        let path = toml_path.parent().unwrap_or(Path::new(".")).join(&robot);
        turn_imu(&mut run, &text, path.parent().unwrap_or(Path::new(".")));
    }
    Ok(run)
}

/// The text of the URDF that a description names, and a sentence where some of it is not in its encoding.
pub fn urdf_beside(toml_path: &Path, robot: &str) -> Result<(String, Option<String>), RecordingError> {
    let path = toml_path.parent().unwrap_or(Path::new(".")).join(robot);
    read_urdf(&path, "a robot known by name (go2), or a URDF or MJCF file")
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

    #[test]
    fn metadata_lists_files_and_numbers_sort() {
        let yaml = "rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths:\n    - run_0.mcap\n    - \"run_1.mcap\"\n  files:\n    - path: x\n";
        assert_eq!(listed_files(yaml), ["run_0.mcap", "run_1.mcap"]);
        assert_eq!(numbered(Path::new("a/run_10.mcap.zstd")), ("run_".to_string(), Some(10)));
        assert_eq!(numbered(Path::new("a/part_b.db3")), ("part_b".to_string(), None));
    }
}
