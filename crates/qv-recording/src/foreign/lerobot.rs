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

    /// Names of a column's numbers, in one of the forms that writers give them, without LeRobot's `.pos`.
    #[cfg(feature = "parquet")]
    fn names(&self, column: &str) -> Option<Vec<String>> {
        let mut names = self.features.get(column)?.get("names")?;
        // {"motors": [...]}, [[...]]
        for _ in 0..2 {
            names = match names {
                Value::Object(map) if map.len() == 1 => map.values().next()?,
                Value::Array(list) if list.len() == 1 && list[0].is_array() => &list[0],
                other => other,
            };
        }
        let list = names.as_array()?;
        list.iter().map(|name| name.as_str().map(|name| name.trim_end_matches(".pos").to_string())).collect()
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
        let position = &read[0];
        let joints = settings.names(position.width, info.names(&wanted[0].1), "meta/info.json")?;
        let mut table = Table::default();
        let mut parts = vec![];
        for ((prefix, column), read) in wanted.iter().zip(&read) {
            if read.width != joints.len() {
                let (expected, found) = (joints.len(), read.width);
                let what =
                    format!("column {column}: expected {expected} numbers a row as {} has, found {found}", wanted[0].1);
                table.lost.push(crate::run::Loss { file: name.clone(), what, span: None });
                continue;
            }
            let row = |row: &usize| read.values[row * read.width..(row + 1) * read.width].iter().copied();
            let mut values: Vec<f64> = rows.iter().flat_map(row).collect();
            if *prefix != "tau." {
                settings.convert(&joints, &mut values, *prefix == "vel.");
            }
            parts.push(JointChannel { prefix, time: rows.iter().map(|row| time.values[*row]).collect(), values });
        }
        let (version, all) = (&info.version, info.episodes);
        table.remarks.push(format!(
            "LeRobot dataset {version}, {name}: episode {number} of {all}; [dataset] episode chooses another"
        ));
        table.remarks.extend(settings.unit_remarks());
        table.csv = join(&joints, &parts);
        return Ok(table);
    }
    let expected = settings.episode.map_or("an episode".to_string(), |number| format!("episode {number}"));
    let found = format!("none in {} Parquet files", names.len());
    Err(RecordingError::file("data", expected, found))
}

#[cfg(all(test, feature = "parquet"))]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_in_all_their_forms() {
        let info = |names: &str| {
            let text =
                format!("{{\"codebase_version\": \"v2.1\", \"features\": {{\"action\": {{\"names\": {names}}}}}}}");
            Info::read(&text).unwrap().names("action")
        };
        let expected = Some(vec!["a".to_string(), "b".to_string()]);
        for names in ["[\"a.pos\", \"b.pos\"]", "{\"motors\": [\"a\", \"b\"]}", "[[\"a\", \"b\"]]"] {
            assert_eq!(info(names), expected, "{names}");
        }
        assert_eq!(info("null"), None);
        assert_eq!(info("[\"motors\"]"), Some(vec!["motors".to_string()]));
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
