//! Recordings on disk become runs.

use crate::description::description_of;
use crate::error::file_error;
use crate::foreign;
use crate::model::robot_file;
use crate::table::run_of_table;
use crate::unread;
use qv_recording::mapping::Mapping;
use qv_recording::run::Loss;
use qv_recording::{BagFile, RecordingError, Run, robots};
use qv_sim::{BaseKind, Batch, Model, SimOptions, Terrain};
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
    /// Whether commands are read as what is found in their conventions says ([`qv_recording::commanded::fix`]).
    pub fix: bool,
}

/// Reported the bytes that have been read and those there are.
pub type ReadProgress<'a> = &'a dyn Fn(u64, u64);

/// A source that shows how far its reading is.
struct CountingReader<'a, R> {
    source: R,
    done: &'a Cell<u64>,
    total: u64,
    seen: ReadProgress<'a>,
}

impl<R: Read> Read for CountingReader<'_, R> {
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
pub fn open_run(path: &Path, reading: &Reading, seen: ReadProgress) -> Result<Run, RecordingError> {
    let mut run = open_logged(path, reading, seen)?;
    qv_recording::frames::report_mount(&mut run);
    Ok(if reading.fix { qv_recording::frames::fix(qv_recording::commanded::fix(run)) } else { run })
}

fn open_logged(path: &Path, reading: &Reading, seen: ReadProgress) -> Result<Run, RecordingError> {
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
        (false, _) if named_at(path).is_some() => {
            Err(file_error(path, "a bag, a table or a dataset", named_at(path).unwrap_or_default()))
        }
        (false, _) => Err(file_error(
            path,
            "a bag (.mcap, .db3, either with .zstd), a .csv file, a .parquet file of a LeRobot dataset, or a directory",
            &format!("`.{extension}`"),
        )),
    }
}

/// What a file is that is not read.
fn named_at(path: &Path) -> Option<&'static str> {
    let mut head = Vec::new();
    File::open(path).ok()?.take(unread::HEAD as u64).read_to_end(&mut head).ok()?;
    unread::named(&head)
}

fn open_bag(paths: &[PathBuf], reading: &Reading, seen: ReadProgress) -> Result<Run, RecordingError> {
    let total = paths.iter().filter_map(|p| fs::metadata(p).ok()).map(|m| m.len()).sum();
    let done = Cell::new(0);
    let mut files = Vec::new();
    for path in paths {
        let file = File::open(path).map_err(|e| file_error(path, "a readable file", &e.to_string()))?;
        files.push(BagFile {
            name: path.display().to_string(),
            source: CountingReader { source: file, done: &done, total, seen },
        });
    }
    let mappings = match reading.robot.as_deref().map(robot_file).transpose()?.flatten() {
        Some(robot) => vec![robot.file.mapping],
        None => robots::found_by_messages(),
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

fn open_split_bag(directory: &Path, reading: &Reading, seen: ReadProgress) -> Result<Run, RecordingError> {
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

/// What is reported for how a recording and its robot were read, a line each: nothing is lost by it.
pub fn remarks_of(run: &Run, model: &Model) -> Vec<String> {
    // Links of a robot that is held seldom touch anything.
    let shapes = left_out_shapes(model).filter(|_| model.base == BaseKind::Fixed);
    run.remarks.iter().chain(&model.remarks).cloned().chain(shapes).collect()
}

/// What a model lacks of its file, a line each; collision shapes share one. Those of a fixed base are no loss, see [`remarks_of`].
pub fn lost_from_model(model: &Model) -> Vec<String> {
    let others = model.left_out.iter().filter(|part| !is_shape(part));
    let others = others.map(|part| format!("left out of the model: {part}"));
    let shapes = left_out_shapes(model).filter(|_| model.base != BaseKind::Fixed);
    others.chain(shapes).collect()
}

fn is_shape(part: &str) -> bool {
    part.starts_with("collision shape of link ")
}

/// Collision shapes that were not read, in one line.
fn left_out_shapes(model: &Model) -> Option<String> {
    let parts: Vec<&String> = model.left_out.iter().filter(|part| is_shape(part)).collect();
    match parts[..] {
        [] => None,
        [one] => Some(format!("left out of the model: {one}; its contacts are not simulated")),
        [first, ..] => {
            let count = parts.len();
            Some(format!(
                "left out of the model: {count} collision shapes, whose contacts are not simulated; the first: {first}"
            ))
        }
    }
}

/// What was lost of a recording or could not be used as it is, a line each.
pub fn lost_from(run: &Run) -> Vec<String> {
    let mut lost: Vec<String> = run.lost.iter().map(|l| format!("lost from {}: {}", l.file, l.what)).collect();
    let faults = run.faults.iter().filter(|f| f.kind.is_partial());
    lost.extend(faults.map(|f| format!("{:.3} s: {} in {}: {}", f.time, f.kind, f.channel, f.detail)));
    lost
}

fn open_table(csv: &Path, seen: ReadProgress) -> Result<Run, RecordingError> {
    if let Some(run) = foreign::open_motor_csv(csv) {
        return run;
    }
    let toml_path = description_of(csv);
    let toml_text =
        fs::read_to_string(&toml_path).map_err(|e| file_error(&toml_path, "a run description", &e.to_string()))?;
    let file = File::open(csv).map_err(|e| file_error(csv, "a readable file", &e.to_string()))?;
    let (total, done) = (file.metadata().map_or(0, |m| m.len()), Cell::new(0));
    run_of_table(BufReader::new(CountingReader { source: file, done: &done, total, seen }), &toml_path, &toml_text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_share_a_line_and_are_no_loss_of_an_arm() {
        let link = |name: &str| {
            format!(
                "<link name=\"{name}\"><inertial><mass value=\"1\"/><inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" izz=\"1\"/></inertial>\
                     <collision><geometry><mesh filename=\"{name}.stl\"/></geometry></collision></link>"
            )
        };
        let joint = "<joint name=\"j\" type=\"continuous\"><parent link=\"a\"/><child link=\"b\"/><axis xyz=\"0 0 1\"/></joint>";
        let urdf = format!("<robot name=\"r\">{}{}{joint}</robot>", link("a"), link("b"));
        for base in [BaseKind::Fixed, BaseKind::Floating] {
            let model = Model::from_urdf(&urdf, &qv_sim::ModelOptions { base, ..Default::default() }).unwrap();
            let lost = lost_from_model(&model);
            assert_eq!(lost.len(), usize::from(base == BaseKind::Floating), "{base:?}: {lost:?}");
            let said = left_out_shapes(&model).unwrap();
            assert!(said.contains("`a`") || said.contains("`b`"), "{said}");
        }
    }

    #[test]
    fn metadata_lists_files_and_numbers_sort() {
        let yaml = "rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths:\n    - run_0.mcap\n    - \"run_1.mcap\"\n  files:\n    - path: x\n";
        assert_eq!(listed_files(yaml), ["run_0.mcap", "run_1.mcap"]);
        assert_eq!(numbered(Path::new("a/run_10.mcap.zstd")), ("run_".to_string(), Some(10)));
        assert_eq!(numbered(Path::new("a/part_b.db3")), ("part_b".to_string(), None));
    }
}
