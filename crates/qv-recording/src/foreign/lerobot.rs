//! LeRobot datasets (huggingface/lerobot), versions 2.0, 2.1 and 3.0: `meta/info.json`, and Parquet files below `data/`, one for each episode
//! (version 2) or for many (3). A run is one episode.

use super::{Settings, Table};
use crate::RecordingError;
use serde_json::Value;

/// Columns that are read where nothing else is said: prefix of the table's columns, column of the dataset.
const COLUMNS: [(&str, &str); 4] = [
    ("pos.", "observation.state"),
    ("vel.", "observation.velocity"),
    ("tau.", "observation.effort"),
    ("cmd_pos.", "action"),
];

/// `meta/info.json`, as far as it matters here.
#[derive(Debug, Clone, PartialEq)]
pub struct Info {
    /// Such as `v3.0`.
    pub version: String,
    /// Episodes in all.
    pub episodes: u64,
    features: Value,
}

impl Info {
    /// Reads the text of `meta/info.json`.
    ///
    /// # Errors
    /// It is no JSON, has another version, or no features.
    pub fn read(text: &str) -> Result<Self, RecordingError> {
        const FILE: &str = "meta/info.json";
        let text = text.trim_start_matches('\u{feff}');
        let document: Value =
            serde_json::from_str(text).map_err(|e| RecordingError::file(FILE, "JSON", e.to_string()))?;
        let version = document.get("codebase_version").and_then(Value::as_str).unwrap_or("none").to_string();
        if !["v2.", "v3."].iter().any(|known| version.starts_with(known)) {
            return Err(RecordingError::file(FILE, "codebase_version v2.0, v2.1 or v3.0", version));
        }
        let features = document.get("features").filter(|features| features.is_object());
        let features = features.ok_or_else(|| RecordingError::file(FILE, "features", "none"))?.clone();
        let episodes = document.get("total_episodes").and_then(Value::as_u64).unwrap_or(0);
        Ok(Self { version, episodes, features })
    }

    /// Whether there is a column of numbers.
    fn has(&self, column: &str) -> bool {
        self.features.get(column).is_some()
    }

    /// What a column's numbers are, in one of the forms in which writers name them; `None` without names.
    #[cfg(feature = "parquet")]
    fn numbers(&self, column: &str) -> Option<Vec<NamedNumber>> {
        let mut names = self.features.get(column)?.get("names")?;
        // {"motors": [...]}, [[...]]
        for _ in 0..2 {
            names = match names {
                Value::Object(map) if map.len() == 1 => map.values().next()?,
                Value::Array(list) if list.len() == 1 && list[0].is_array() => &list[0],
                other => other,
            };
        }
        names.as_array()?.iter().map(|name| name.as_str().map(NamedNumber::read)).collect()
    }
}

/// A number of a row: LeRobot names it `shoulder_pan.pos`, others `shoulder_pan`.
#[cfg(feature = "parquet")]
#[derive(Debug, Clone, PartialEq)]
struct NamedNumber {
    joint: String,
    /// Prefix of the table's columns; positions and commands are `pos.`.
    prefix: &'static str,
}

#[cfg(feature = "parquet")]
impl NamedNumber {
    const ENDINGS: [(&'static str, &'static str); 5] =
        [(".pos", "pos."), (".vel", "vel."), (".effort", "tau."), (".torque", "tau."), (".tau", "tau.")];

    fn read(name: &str) -> Self {
        let ending = Self::ENDINGS.iter().find_map(|(end, prefix)| Some((name.strip_suffix(end)?, *prefix)));
        let (joint, prefix) = ending.unwrap_or((name, "pos."));
        Self { joint: joint.to_string(), prefix }
    }
}

/// For each joint, which number of a row of `column` is its own: by names where both columns have them, else by place. `joints` are the
/// names of positions.
///
/// # Errors
/// Names or numbers of some joints are missing; the error says which.
#[cfg(feature = "parquet")]
fn places(
    prefix: &str,
    numbers: Option<&[NamedNumber]>,
    width: usize,
    joints: Option<&[String]>,
    count: usize,
) -> Result<Vec<usize>, String> {
    if let (Some(numbers), Some(joints)) = (numbers, joints) {
        let own = if prefix == "cmd_pos." { "pos." } else { prefix };
        let place = |joint: &String| {
            let of = |prefix: &str| numbers.iter().position(|n| n.joint == *joint && n.prefix == prefix);
            // A column of velocities may name its numbers as the joints.
            of(own).or_else(|| of("pos."))
        };
        let found: Vec<Option<usize>> = joints.iter().map(place).collect();
        if let Some(all) = found.iter().copied().collect::<Option<Vec<usize>>>() {
            return Ok(all);
        }
        if found.iter().any(Option::is_some) {
            let missing: Vec<&str> =
                joints.iter().zip(&found).filter(|(_, at)| at.is_none()).map(|(joint, _)| joint.as_str()).collect();
            let named: Vec<&str> = numbers.iter().map(|n| n.joint.as_str()).collect();
            return Err(format!("expected numbers of {}, found those of {}", missing.join(", "), named.join(", ")));
        }
    }
    match width == count {
        true => Ok((0..count).collect()),
        false => Err(format!("expected {count} numbers a row, or names of the joints, found {width} numbers")),
    }
}

/// A table of one episode. `names` are the paths of the Parquet files, `file` gives their contents.
///
/// # Errors
/// A column or the episode is missing, the joints have no names, or a file cannot be read.
pub fn table(
    info: &Info,
    names: &[String],
    file: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>,
    settings: &Settings,
) -> Result<Table, RecordingError> {
    let stated = [&settings.position, &settings.velocity, &settings.torque, &settings.command];
    let mut wanted: Vec<(&'static str, String)> = vec![];
    for ((prefix, usual), stated) in COLUMNS.into_iter().zip(stated) {
        let column = stated.clone().unwrap_or_else(|| usual.to_string());
        match info.has(&column) {
            true => wanted.push((prefix, column)),
            false if stated.is_some() || prefix == "pos." => {
                let all: Vec<&str> =
                    info.features.as_object().into_iter().flatten().map(|(name, _)| name.as_str()).collect();
                let expected = format!("a feature `{column}`");
                return Err(RecordingError::file("meta/info.json", expected, all.join(", ")));
            }
            false => {}
        }
    }
    episode(info, &wanted, names, file, settings)
}

#[cfg(not(feature = "parquet"))]
fn episode(
    _: &Info,
    _: &[(&'static str, String)],
    names: &[String],
    _: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>,
    _: &Settings,
) -> Result<Table, RecordingError> {
    let file = names.first().map_or("data", String::as_str);
    Err(RecordingError::file(file, "a program that was built with the feature `parquet`", "one without"))
}

#[cfg(feature = "parquet")]
fn episode(
    info: &Info,
    wanted: &[(&'static str, String)],
    names: &[String],
    file: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>,
    settings: &Settings,
) -> Result<Table, RecordingError> {
    use super::{JointChannel, join, parquet};
    const TIME: &str = "timestamp";
    const EPISODE: &str = "episode_index";
    let mut columns: Vec<&str> = wanted.iter().map(|(_, column)| column.as_str()).collect();
    columns.extend([TIME, EPISODE]);
    // Of version 2 the name says which one it is.
    let own = settings.episode.map(|number| format!("episode_{number:06}.parquet"));
    let is_own = |name: &&String| own.as_ref().is_none_or(|own| !name.contains("episode_") || name.ends_with(own));
    for name in names.iter().filter(is_own) {
        let read = file(name).and_then(|bytes| parquet::columns(&bytes, &columns));
        let read =
            read.map_err(|found| RecordingError::file(name, "a Parquet file with the columns of the dataset", found))?;
        let (time, episodes) = (&read[columns.len() - 2], &read[columns.len() - 1]);
        let number = settings.episode.map(|number| number as f64).or(episodes.values.first().copied());
        let rows: Vec<usize> = (0..time.values.len()).filter(|row| Some(episodes.values[*row]) == number).collect();
        let (Some(number), false) = (number, rows.is_empty()) else { continue };
        let state = info.numbers(&wanted[0].1).filter(|numbers| numbers.len() == read[0].width);
        // A state may hold velocities and torques beside positions.
        let own: Vec<usize> = match &state {
            Some(numbers) => (0..numbers.len()).filter(|&k| numbers[k].prefix == "pos.").collect(),
            None => (0..read[0].width).collect(),
        };
        let named: Option<Vec<String>> =
            state.as_ref().map(|numbers| own.iter().map(|&k| numbers[k].joint.clone()).collect());
        let joints = settings.names(own.len(), named.clone(), "meta/info.json")?;
        let mut table = Table::default();
        let mut parts = vec![];
        let mut add = |prefix: &'static str, read: &parquet::Column, places: &[usize]| {
            let row = |row: &usize| places.iter().map(|k| read.values[row * read.width + k]).collect::<Vec<f64>>();
            let mut values: Vec<f64> = rows.iter().flat_map(row).collect();
            if prefix != "tau." {
                settings.convert(&joints, &mut values, prefix == "vel.");
            }
            parts.push(JointChannel { prefix, time: rows.iter().map(|row| time.values[*row]).collect(), values });
        };
        add("pos.", &read[0], &own);
        for ((prefix, column), read) in wanted.iter().zip(&read).skip(1) {
            let numbers = info.numbers(column).filter(|numbers| numbers.len() == read.width);
            match places(prefix, numbers.as_deref(), read.width, named.as_deref(), joints.len()) {
                Ok(places) => add(prefix, read, &places),
                Err(found) => {
                    let what = format!("column {column}: {found}");
                    table.lost.push(crate::run::Loss { file: name.clone(), what, span: None });
                }
            }
        }
        for prefix in ["vel.", "tau."] {
            let is_stated = wanted.iter().any(|(other, _)| *other == prefix);
            let of = |joint: &String| state.as_ref()?.iter().position(|n| n.joint == *joint && n.prefix == prefix);
            let places: Option<Vec<usize>> = named.iter().flatten().map(of).collect();
            if let (false, Some(places)) = (is_stated, places.filter(|places| !places.is_empty())) {
                add(prefix, &read[0], &places);
            }
        }
        let (version, all) = (&info.version, info.episodes);
        table.remarks.push(format!(
            "LeRobot dataset {version}, {name}: episode {number} of {all}; [dataset] episode chooses another"
        ));
        table.remarks.extend(settings.unit_remarks());
        table.remarks.extend(percent(&read[0], settings));
        table.csv = join(&joints, &parts);
        return Ok(table);
    }
    let expected = settings.episode.map_or("an episode".to_string(), |number| format!("episode {number}"));
    let found = format!("none in {} Parquet files", names.len());
    Err(RecordingError::file("data", expected, found))
}

/// Values within -100 to 100 that are read as degrees may be parts of a calibrated range, as LeRobot normalises by default.
#[cfg(feature = "parquet")]
fn percent(positions: &super::parquet::Column, settings: &Settings) -> Option<String> {
    let largest = positions.values.iter().filter(|x| x.is_finite()).fold(0.0f64, |a, x| a.max(x.abs()));
    let is_degrees = settings.unit.as_deref() == Some("deg") && settings.joint.is_empty();
    (is_degrees && largest <= 100.0).then(|| {
        format!(
            "positions are read as degrees and stay within -100..100 (up to {largest:.1}): they may be parts of a calibrated range, as LeRobot \
             normalises by default; then [dataset.joint.NAME] needs scale and offset of the calibration"
        )
    })
}

#[cfg(all(test, feature = "parquet"))]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_in_all_their_forms() {
        let info = |names: &str| {
            let text =
                format!("{{\"codebase_version\": \"v2.1\", \"features\": {{\"action\": {{\"names\": {names}}}}}}}");
            Info::read(&text).unwrap().numbers("action")
        };
        let positions = |joints: &[&str]| Some(joints.iter().map(|joint| NamedNumber::read(joint)).collect());
        let expected: Option<Vec<NamedNumber>> = positions(&["a", "b"]);
        for names in ["[\"a.pos\", \"b.pos\"]", "{\"motors\": [\"a\", \"b\"]}", "[[\"a\", \"b\"]]"] {
            assert_eq!(info(names), expected, "{names}");
        }
        assert_eq!(info("null"), None);
        assert_eq!(info("[\"motors\"]"), positions(&["motors"]));
        assert_eq!(info("[\"a.vel\"]").unwrap()[0].prefix, "vel.");
    }

    #[test]
    fn numbers_are_found_by_their_names() {
        let named = |names: &[&str]| names.iter().map(|name| NamedNumber::read(name)).collect::<Vec<_>>();
        let joints = ["a".to_string(), "b".to_string()];
        let of = |names: &[&str]| places("cmd_pos.", Some(&named(names)), names.len(), Some(&joints), 2);
        assert_eq!(of(&["b.pos", "a.pos"]).unwrap(), [1, 0]);
        assert_eq!(of(&["a.vel", "b.vel", "b", "a"]).unwrap(), [3, 2]);
        // Names that are none of joints say nothing.
        assert_eq!(of(&["action_0", "action_1"]).unwrap(), [0, 1]);
        let missing = of(&["a", "gripper"]).unwrap_err();
        assert!(missing.contains("numbers of b") && missing.contains("a, gripper"), "{missing}");
        let wide = of(&["x", "y", "z"]).unwrap_err();
        assert!(wide.contains("expected 2 numbers") && wide.contains("found 3"), "{wide}");
        assert_eq!(places("vel.", None, 2, Some(&joints), 2).unwrap(), [0, 1]);
    }

    #[test]
    fn each_fault_of_the_description_is_named() {
        let fault = |text: &str| Info::read(text).unwrap_err().to_string();
        assert!(fault("{").contains("meta/info.json: expected JSON"));
        assert!(fault("{}").contains("expected codebase_version v2.0, v2.1 or v3.0, found none"));
        assert!(fault("{\"codebase_version\": \"v1.6\"}").contains("found v1.6"));
        assert!(fault("{\"codebase_version\": \"v3.0\"}").contains("expected features"));
        let info = Info::read("{\"codebase_version\": \"v3.0\", \"features\": {\"action\": {}}}").unwrap();
        let error = table(&info, &[], &mut |_| Err("none".into()), &Settings::default()).unwrap_err().to_string();
        assert!(error.contains("expected a feature `observation.state`, found action"), "{error}");
    }
}
