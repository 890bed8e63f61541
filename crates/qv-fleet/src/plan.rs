//! A plan: which recordings are worked on by which command, cut into units that are done one by one.

use crate::error::FleetError;
use crate::hash::sha256;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// What a plan says of its own form.
const FORMAT: &str = "qv-fleet-plan/1";
/// Hexadecimal digits of an identity.
const DIGITS: usize = 16;

/// What is done with each unit.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Command {
    /// `qv diagnose`.
    #[default]
    Diagnose,
    /// `qv contact`.
    Contact,
    /// `qv tune`.
    Tune,
    /// Nothing that is of use: a stand-in for tests, which says so in its report.
    Rehearse,
}

impl Command {
    /// The words that `qv` is called with.
    pub fn words(self) -> &'static [&'static str] {
        match self {
            Self::Diagnose => &["diagnose"],
            Self::Contact => &["contact"],
            Self::Tune => &["tune"],
            Self::Rehearse => &["fleet", "rehearse"],
        }
    }

    /// The file that it leaves for programs.
    pub fn report(self) -> &'static str {
        match self {
            Self::Diagnose | Self::Rehearse => "report.json",
            Self::Contact => "contact.json",
            Self::Tune => "tune.json",
        }
    }

    /// Whether it goes on where it was stopped: then what it left is kept for its next attempt.
    pub fn goes_on(self) -> bool {
        self == Self::Tune
    }
}

/// A file that a result depends on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct InputFile {
    /// Where it is.
    pub path: String,
    /// Its size.
    pub bytes: u64,
    /// Of its contents.
    pub sha256: String,
}

impl InputFile {
    fn name(&self) -> &str {
        self.path.rsplit(['/', '\\']).next().unwrap_or_default()
    }
}

/// A recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Recording {
    /// Where it is.
    pub path: String,
    /// The robot that it is of.
    pub robot: String,
    /// When it begins \[ns since 1970\]; none where it does not say.
    pub start_ns: Option<u64>,
    /// How long it is \[s\].
    pub seconds: f64,
    /// Its files.
    pub files: Vec<InputFile>,
}

impl Recording {
    /// Of its contents and the names of its files, wherever they lie.
    pub fn digest(&self) -> String {
        let mut lines: Vec<String> = self.files.iter().map(|f| format!("{} {}\n", f.sha256, f.name())).collect();
        lines.sort();
        sha256(lines.concat().as_bytes())
    }
}

/// What is done with all units alike.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Task {
    /// Of the program.
    pub version: String,
    /// The command.
    pub command: Command,
    /// Its options, as they are passed on.
    pub options: Vec<String>,
    /// The files that those name.
    pub option_files: Vec<InputFile>,
    /// The folder that the command is started in, since options may name files from there.
    pub folder: String,
}

/// A path that is no recording that can be used.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct RefusedPath {
    /// Which.
    pub path: String,
    /// Why.
    pub reason: String,
}

/// A recording whose contents are those of another one.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct DuplicateRecording {
    /// Which.
    pub path: String,
    /// The one that is worked on.
    pub same_as: String,
}

/// What is worked on at once.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Unit {
    /// A hash of inputs, version, command and options.
    pub id: String,
    /// The robot.
    pub robot: String,
    /// One recording, or all of one robot.
    pub recordings: Vec<Recording>,
}

impl Unit {
    /// When its first recording begins \[ns since 1970\].
    pub fn start_ns(&self) -> Option<u64> {
        self.recordings.iter().filter_map(|r| r.start_ns).min()
    }

    /// Of the contents of all its recordings.
    pub fn inputs(&self) -> String {
        let digests: Vec<String> = self.recordings.iter().map(Recording::digest).collect();
        sha256(digests.join("\n").as_bytes())
    }
}

/// All units.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    format: String,
    /// What is done with each.
    pub task: Task,
    /// In the order of robots, then of paths.
    pub units: Vec<Unit>,
    /// What could not be opened.
    pub refused: Vec<RefusedPath>,
    /// What is there twice.
    pub repeated: Vec<DuplicateRecording>,
}

impl Plan {
    /// A plan; `grouped` makes one unit of all recordings of a robot. The order of `recordings` and `refused` is of no matter.
    pub fn new(task: Task, recordings: Vec<Recording>, mut refused: Vec<RefusedPath>, grouped: bool) -> Self {
        let (recordings, mut repeated) = apart(recordings);
        let mut by_robot: BTreeMap<String, Vec<Recording>> = BTreeMap::new();
        recordings.into_iter().for_each(|r| by_robot.entry(r.robot.clone()).or_default().push(r));
        let mut units = Vec::new();
        for (robot, of_it) in by_robot {
            let groups: Vec<Vec<Recording>> =
                if grouped { vec![of_it] } else { of_it.into_iter().map(|r| vec![r]).collect() };
            let unit = |recordings: Vec<Recording>| Unit {
                id: identity(&task, &recordings),
                robot: robot.clone(),
                recordings,
            };
            units.extend(groups.into_iter().map(unit));
        }
        refused.sort();
        repeated.sort();
        Self { format: FORMAT.into(), task, units, refused, repeated }
    }

    /// Reads what [`Plan::to_text`] wrote; `file` is named in errors.
    ///
    /// # Errors
    /// It is no plan of this version of the form, or has a unit with another kind of identity.
    pub fn parse(text: &str, file: &str) -> Result<Self, FleetError> {
        let wrong = |found: String| FleetError::File {
            file: file.into(),
            expected: format!("a plan of `qv fleet plan` ({FORMAT})"),
            found,
        };
        let plan: Self = serde_json::from_str(text).map_err(|e| wrong(e.to_string()))?;
        if plan.format != FORMAT {
            return Err(wrong(format!("the format {}", plan.format)));
        }
        let mut known = BTreeSet::new();
        for unit in &plan.units {
            // It is the name of a folder, and stands in scripts.
            if !is_identity(&unit.id) {
                return Err(wrong(format!(
                    "the unit {:?}, whose identity is not u and {DIGITS} hexadecimal digits",
                    unit.id
                )));
            }
            if !known.insert(&unit.id) {
                return Err(wrong(format!("the unit {} twice", unit.id)));
            }
        }
        Ok(plan)
    }

    /// As text, with a line at its end.
    pub fn to_text(&self) -> String {
        serde_json::to_string_pretty(self).expect("a plan is plain data") + "\n"
    }

    /// The places in `units` that `asked` means: an identity, an index, or two indices with a minus between them.
    ///
    /// # Errors
    /// There is no such unit.
    pub fn find(&self, asked: &str) -> Result<Vec<usize>, FleetError> {
        let none = || FleetError::Unit {
            asked: asked.into(),
            expected: match self.units.len() {
                0 => "a plan with units".into(),
                n => format!("an index from 0 to {}, two of them as 0-9, or an identity of plan.json", n - 1),
            },
        };
        if let Some(at) = self.units.iter().position(|unit| unit.id == asked) {
            return Ok(vec![at]);
        }
        let (from, to) = asked.split_once('-').unwrap_or((asked, asked));
        let (from, to): (usize, usize) = from.parse().ok().zip(to.parse().ok()).ok_or_else(none)?;
        // The last task of a job array may reach beyond the last unit.
        let is_range = asked.contains('-');
        if from > to || from >= self.units.len() || (!is_range && to >= self.units.len()) {
            return Err(none());
        }
        Ok((from..=to.min(self.units.len() - 1)).collect())
    }
}

/// Recordings in order of their paths, each once, and those that are there again.
fn apart(mut recordings: Vec<Recording>) -> (Vec<Recording>, Vec<DuplicateRecording>) {
    recordings.sort_by(|a, b| a.path.cmp(&b.path));
    let mut first: BTreeMap<String, String> = BTreeMap::new();
    let mut repeated = Vec::new();
    recordings.retain(|r| match first.get(&r.digest()) {
        None => {
            first.insert(r.digest(), r.path.clone());
            true
        }
        Some(same_as) => {
            repeated.push(DuplicateRecording { path: r.path.clone(), same_as: same_as.clone() });
            false
        }
    });
    (recordings, repeated)
}

/// Whether text is an identity of a unit: `u` and 16 hexadecimal digits.
fn is_identity(text: &str) -> bool {
    let is_digit = |c: u8| c.is_ascii_digit() || (b'a'..=b'f').contains(&c);
    text.strip_prefix('u').is_some_and(|digits| digits.len() == DIGITS && digits.bytes().all(is_digit))
}

fn identity(task: &Task, recordings: &[Recording]) -> String {
    let files: Vec<[&str; 2]> = task.option_files.iter().map(|f| [f.name(), f.sha256.as_str()]).collect();
    let inputs: Vec<String> = recordings.iter().map(Recording::digest).collect();
    let all = serde_json::json!([task.version, task.command, task.options, files, inputs]);
    // A letter first: an identity is never taken for an index.
    format!("u{}", &sha256(all.to_string().as_bytes())[..DIGITS])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    fn recording(path: &str, robot: &str, sha256: char) -> Recording {
        let file = InputFile { path: format!("{path}/run.csv"), bytes: 1, sha256: sha256.to_string().repeat(64) };
        Recording { path: path.into(), robot: robot.into(), start_ns: None, seconds: 1.0, files: vec![file] }
    }

    fn three() -> Vec<Recording> {
        vec![recording("c", "arm", '3'), recording("a", "leg", '1'), recording("b", "arm", '2')]
    }

    #[test]
    fn units_are_the_same_in_any_order_and_place() {
        let plan = Plan::new(Task::default(), three(), vec![], false);
        let mut other = three();
        other.reverse();
        assert_eq!(Plan::new(Task::default(), other.clone(), vec![], false), plan);
        let paths: Vec<&str> = plan.units.iter().map(|u| u.recordings[0].path.as_str()).collect();
        assert_eq!(paths, ["b", "c", "a"], "by robot, then by path");
        other.iter_mut().for_each(|r| {
            r.path = format!("elsewhere/{}", r.path);
            r.files[0].path = format!("elsewhere/{}", r.files[0].path);
        });
        let moved = Plan::new(Task::default(), other, vec![], false);
        let ids = |plan: &Plan| plan.units.iter().map(|u| u.id.clone()).collect::<Vec<_>>();
        assert_eq!(ids(&moved), ids(&plan));
    }

    #[test]
    fn what_a_result_depends_on_is_in_its_identity() {
        let id = |task: &Task| Plan::new(task.clone(), three(), vec![], false).units[0].id.clone();
        let task = Task::default();
        let file = |digit: &str| InputFile { path: "yard.glb".into(), bytes: 1, sha256: digit.repeat(64) };
        let others = [
            Task { version: "9".into(), ..task.clone() },
            Task { command: Command::Contact, ..task.clone() },
            Task { options: vec!["--seed".into(), "2".into()], ..task.clone() },
            Task { option_files: vec![file("1")], ..task.clone() },
            Task { option_files: vec![file("2")], ..task.clone() },
        ];
        let mut all: Vec<String> = others.iter().chain([&task]).map(id).collect();
        all.sort();
        all.dedup();
        assert_eq!(all.len(), 6);
        // Where the command is started is no part of it.
        assert_eq!(id(&Task { folder: "x".into(), ..task.clone() }), id(&task));
    }

    #[test]
    fn groups_and_repeats() {
        let mut twice = three();
        twice.push(recording("d", "leg", '2'));
        let plan = Plan::new(Task::default(), twice, vec![], true);
        assert_eq!(plan.units.iter().map(|u| u.recordings.len()).collect::<Vec<_>>(), [2, 1]);
        assert_eq!(plan.repeated, [DuplicateRecording { path: "d".into(), same_as: "b".into() }]);
    }

    #[test]
    fn units_are_found_by_index_range_and_identity() {
        let plan = Plan::new(Task::default(), three(), vec![], false);
        assert_eq!(plan.find("2").unwrap(), [2]);
        assert_eq!(plan.find("1-7").unwrap(), [1, 2]);
        assert_eq!(plan.find(&plan.units[1].id).unwrap(), [1]);
        for odd in ["3", "3-4", "2-1", "u12", "", "-1", "x"] {
            assert!(plan.find(odd).unwrap_err().to_string().states("from 0 2"), "{odd}");
        }
    }

    #[test]
    fn what_is_no_plan_is_told() {
        let text = Plan::new(Task::default(), three(), vec![], false).to_text();
        let of = |text: &str| Plan::parse(text, "f/plan.json").unwrap_err().to_string();
        assert!(of("{}").states("f/plan.json `qv plan`"));
        assert!(of(&text.replace("plan/1", "plan/7")).states("qv-fleet-plan/7"));
        assert!(of(&text[..text.len() / 2]).contains("EOF"));
        let plan = Plan::parse(&text, "f/plan.json").unwrap();
        for odd in
            ["../../elsewhere", "/etc", "u0123", "u0123456789ABCDEF", "u012345678/bcdef0", "u$(touch xxxxxx)", ""]
        {
            let hostile = text.replacen(&plan.units[0].id, odd, 1);
            assert!(of(&hostile).states("hexadecimal 16"), "{odd}");
        }
        assert!(of(&text.replace(&plan.units[0].id, &plan.units[1].id)).contains("twice"));
    }
}
