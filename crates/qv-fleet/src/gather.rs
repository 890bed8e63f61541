//! What all units say together. The same units give the same summary, in whichever order and by whomever they were done.

use crate::finding::{Finding, Key, Size, read};
use crate::fit::{Estimate, OUTLIER, mean, robust_z, slope};
use crate::plan::{Command, DuplicateRecording, Plan, RefusedPath, Unit};
use crate::state::Kind;
use serde::Serialize;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// What the file says of its own form.
const FORMAT: &str = "qv-fleet/1";
/// Nanoseconds of a day.
const DAY: f64 = 86_400e9;

/// What became of a unit.
#[derive(Debug, Clone, PartialEq)]
pub enum State {
    /// Its command ended with this exit code (0 or 3) and left this report.
    Done(i32, Value),
    /// It failed, in this way and for this reason.
    Failed(Kind, String),
    /// Nothing yet.
    Missing,
}

/// A unit in the summary.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Line {
    /// Its identity.
    pub id: String,
    /// Its robot.
    pub robot: String,
    /// Its recordings.
    pub recordings: Vec<String>,
    /// When the first of them begins, in UTC; none where they do not say.
    pub start: Option<String>,
    /// `done`, `finding` (exit code 3), `failed`, `missing`.
    pub state: &'static str,
    /// Why it failed.
    pub reason: Option<String>,
    /// What was found.
    #[serde(flatten)]
    pub finding: Finding,
}

/// A robot in the summary.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Robot {
    /// Its name.
    pub robot: String,
    /// How many units it has.
    pub units: usize,
    /// How many of them are done.
    pub done: usize,
    /// How many have which verdict.
    pub verdicts: BTreeMap<String, usize>,
}

/// A cause, and who has it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SharedCause {
    /// The effect.
    pub effect: String,
    /// How many units of which robot accuse it: robot, units with it, units that are done.
    pub robots: Vec<(String, usize, usize)>,
}

/// The size of a cause on one robot.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SizeOf {
    /// The robot.
    pub robot: String,
    /// The effect.
    pub cause: String,
    /// What it acts on.
    pub scope: String,
    /// Which of its parameters.
    pub parameter: String,
    /// Unit of the values.
    pub unit: String,
    /// How many units show it.
    pub units: usize,
    /// Mean, with what recordings differ by in its interval.
    pub mean: Estimate,
    /// Change for each day; none for fewer than three recordings with dates.
    pub per_day: Option<Estimate>,
    /// Whether that interval leaves zero out.
    pub drifts: bool,
    /// First and last date; empty without any.
    pub dates: Vec<String>,
}

/// A unit that stands apart from the others.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Outlier {
    /// Its identity.
    pub id: String,
    /// Its robot.
    pub robot: String,
    /// By what it stands apart.
    pub what: String,
    /// Its value.
    pub value: f64,
    /// Its robust z-score.
    pub z: f64,
}

/// Failures with one reason.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Failure {
    /// In what way.
    pub kind: Kind,
    /// Why; the paths of recordings are left out.
    pub reason: String,
    /// Which units.
    pub units: Vec<String>,
}

/// All of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Fleet {
    format: &'static str,
    /// Of the program.
    pub version: String,
    /// The command.
    pub command: Command,
    /// Its options.
    pub options: Vec<String>,
    /// How many units are `done`, `finding`, `failed`, `missing`.
    pub counts: BTreeMap<&'static str, usize>,
    /// By name.
    pub robots: Vec<Robot>,
    /// Causes, that of most robots first.
    pub causes: Vec<SharedCause>,
    /// By cause, then by robot.
    pub sizes: Vec<SizeOf>,
    /// The threshold of `outliers`: |z| above this.
    pub outlier_z: f64,
    /// The farthest first.
    pub outliers: Vec<Outlier>,
    /// The most frequent first.
    pub failures: Vec<Failure>,
    /// What could not be opened when the plan was made.
    pub refused: Vec<RefusedPath>,
    /// What is there twice.
    pub repeated: Vec<DuplicateRecording>,
    /// In the order of the plan.
    pub units: Vec<Line>,
}

impl Fleet {
    /// As text, with a line at its end.
    pub fn to_text(&self) -> String {
        serde_json::to_string_pretty(self).expect("a summary is plain data") + "\n"
    }
}

/// The summary of a plan; `state` gives what became of each unit.
pub fn gather(plan: &Plan, mut state: impl FnMut(&Unit) -> State) -> Fleet {
    let mut failures: BTreeMap<(Kind, String), Vec<String>> = BTreeMap::new();
    let mut lines = Vec::new();
    for unit in &plan.units {
        let mut line = line_of(unit);
        match state(unit) {
            State::Missing => line.state = "missing",
            State::Failed(kind, reason) => {
                line.state = "failed";
                failures.entry((kind, without_paths(&reason, unit))).or_default().push(unit.id.clone());
                line.reason = Some(format!("{}: {reason}", kind.words()));
            }
            State::Done(exit_code, report) => {
                line.state = if exit_code == 3 { "finding" } else { "done" };
                line.finding = read(plan.task.command, &report);
            }
        }
        lines.push(line);
    }
    let mut failures: Vec<Failure> =
        failures.into_iter().map(|((kind, reason), units)| Failure { kind, reason, units }).collect();
    failures.sort_by_key(|f| std::cmp::Reverse(f.units.len()));
    let mut counts: BTreeMap<&'static str, usize> = ["done", "finding", "failed", "missing"].map(|s| (s, 0)).into();
    lines.iter().for_each(|line| *counts.entry(line.state).or_default() += 1);
    let robots = robots(&lines);
    Fleet {
        format: FORMAT,
        version: plan.task.version.clone(),
        command: plan.task.command,
        options: plan.task.options.clone(),
        counts,
        causes: causes(&lines, &robots),
        sizes: sizes(plan, &lines),
        outlier_z: OUTLIER,
        outliers: outliers(&lines),
        robots,
        failures,
        refused: plan.refused.clone(),
        repeated: plan.repeated.clone(),
        units: lines,
    }
}

fn line_of(unit: &Unit) -> Line {
    Line {
        id: unit.id.clone(),
        robot: unit.robot.clone(),
        recordings: unit.recordings.iter().map(|r| r.path.clone()).collect(),
        start: unit.start_ns().map(utc),
        state: "missing",
        reason: None,
        finding: Finding::default(),
    }
}

/// The reason without what only this unit has, so that the same reasons are found to be the same.
fn without_paths(reason: &str, unit: &Unit) -> String {
    let paths = unit.recordings.iter().flat_map(|r| r.files.iter().map(|f| &f.path).chain([&r.path]));
    let mut paths: Vec<&String> = paths.collect();
    // Longer ones first: a folder is the beginning of its files.
    paths.sort_by_key(|path| std::cmp::Reverse(path.len()));
    paths.iter().fold(reason.to_owned(), |text, path| text.replace(path.as_str(), "RECORDING"))
}

fn is_done(line: &Line) -> bool {
    matches!(line.state, "done" | "finding")
}

fn robots(lines: &[Line]) -> Vec<Robot> {
    let mut found: BTreeMap<&str, Robot> = BTreeMap::new();
    for line in lines {
        let robot = found.entry(&line.robot).or_default();
        robot.robot.clone_from(&line.robot);
        robot.units += 1;
        if is_done(line) {
            robot.done += 1;
            *robot.verdicts.entry(line.finding.verdict.clone()).or_default() += 1;
        }
    }
    found.into_values().collect()
}

fn causes(lines: &[Line], robots: &[Robot]) -> Vec<SharedCause> {
    let mut found: BTreeMap<&str, BTreeMap<&str, usize>> = BTreeMap::new();
    for line in lines {
        // One that is accused of two scopes counts once.
        let mut names: Vec<&str> = line.finding.causes.iter().map(String::as_str).collect();
        names.sort_unstable();
        names.dedup();
        names.into_iter().for_each(|name| *found.entry(name).or_default().entry(&line.robot).or_default() += 1);
    }
    let done = |name: &str| robots.iter().find(|r| r.robot == name).map_or(0, |r| r.done);
    let shared = |(effect, by): (&str, BTreeMap<&str, usize>)| SharedCause {
        effect: effect.into(),
        robots: by.into_iter().map(|(robot, with)| (robot.to_owned(), with, done(robot))).collect(),
    };
    let mut all: Vec<SharedCause> = found.into_iter().map(shared).collect();
    let units = |s: &SharedCause| s.robots.iter().map(|r| r.1).sum::<usize>();
    all.sort_by_key(|s| std::cmp::Reverse((s.robots.len(), units(s))));
    all
}

/// Sizes of all lines by what they are of.
fn by_key(lines: &[Line]) -> BTreeMap<Key, Vec<(usize, &Size)>> {
    let mut found: BTreeMap<_, Vec<(usize, &Size)>> = BTreeMap::new();
    for (k, line) in lines.iter().enumerate() {
        line.finding.sizes.iter().for_each(|size| found.entry(size.key()).or_default().push((k, size)));
    }
    found
}

fn sizes(plan: &Plan, lines: &[Line]) -> Vec<SizeOf> {
    let mut all = Vec::new();
    for ((cause, scope, parameter, unit), of_it) in by_key(lines) {
        let mut by_robot: BTreeMap<&str, Vec<(usize, &Size)>> = BTreeMap::new();
        of_it.into_iter().for_each(|(k, size)| by_robot.entry(&lines[k].robot).or_default().push((k, size)));
        for (robot, found) in by_robot {
            let values: Vec<f64> = found.iter().map(|(_, s)| s.value).collect();
            let deviations: Vec<f64> = found.iter().map(|(_, s)| s.deviation()).collect();
            let Some(mean) = mean(&values, &deviations) else { continue };
            let dated: Vec<(u64, f64, f64)> =
                found.iter().filter_map(|(k, s)| Some((plan.units[*k].start_ns()?, s.value, s.deviation()))).collect();
            let first = dated.iter().map(|d| d.0).min();
            let last = dated.iter().map(|d| d.0).max();
            let days: Vec<f64> = dated.iter().map(|d| (d.0 - first.unwrap_or(0)) as f64 / DAY).collect();
            let [values, deviations] =
                [1, 2].map(|c| dated.iter().map(|d| if c == 1 { d.1 } else { d.2 }).collect::<Vec<f64>>());
            let per_day = slope(&values, &deviations, &days);
            all.push(SizeOf {
                robot: robot.into(),
                cause: cause.clone(),
                scope: scope.clone(),
                parameter: parameter.clone(),
                unit: unit.clone(),
                units: found.iter().map(|(k, _)| k).collect::<BTreeSet<_>>().len(),
                mean,
                per_day,
                drifts: per_day.is_some_and(|slope| !slope.may_be_zero()),
                dates: first.into_iter().chain(last).map(utc).collect(),
            });
        }
    }
    all
}

fn outliers(lines: &[Line]) -> Vec<Outlier> {
    let mut all = Vec::new();
    let mut look = |what: String, found: Vec<(usize, f64)>| {
        let values: Vec<f64> = found.iter().map(|f| f.1).collect();
        for ((k, value), z) in found.iter().zip(robust_z(&values).unwrap_or_default()) {
            if z.abs() > OUTLIER {
                let (id, robot) = (lines[*k].id.clone(), lines[*k].robot.clone());
                all.push(Outlier { id, robot, what: what.clone(), value: *value, z });
            }
        }
    };
    for ((cause, scope, parameter, unit), found) in by_key(lines) {
        let unit = if unit.is_empty() { unit } else { format!(" [{unit}]") };
        look(format!("{cause} ({scope}): {parameter}{unit}"), found.iter().map(|(k, s)| (*k, s.value)).collect());
    }
    let gaps = lines.iter().enumerate().filter_map(|(k, line)| Some((k, line.finding.gap_after?)));
    look("gap that is left".into(), gaps.collect());
    all.sort_by(|a, b| b.z.abs().total_cmp(&a.z.abs()).then_with(|| (&a.id, &a.what).cmp(&(&b.id, &b.what))));
    all
}

/// Nanoseconds since 1970 as a date and time of UTC.
pub fn utc(ns: u64) -> String {
    let seconds = ns / 1_000_000_000;
    let (mut day, rest) = ((seconds / 86_400) as i64, seconds % 86_400);
    // Days since the first of March of the year 0: leap days are last then (H. Hinnant's civil_from_days).
    day += 719_468;
    let era = day / 146_097;
    let of_era = day % 146_097;
    let year = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year + year / 4 - year / 100);
    let shifted = (5 * of_year + 2) / 153;
    let (date, month) = (of_year - (153 * shifted + 2) / 5 + 1, if shifted < 10 { shifted + 3 } else { shifted - 9 });
    let year = year + 400 * era + i64::from(month <= 2);
    format!("{year:04}-{month:02}-{date:02}T{:02}:{:02}:{:02}Z", rest / 3600, rest / 60 % 60, rest % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_as_calendars_have_them() {
        assert_eq!(utc(0), "1970-01-01T00:00:00Z");
        assert_eq!(utc(951_782_400_000_000_000), "2000-02-29T00:00:00Z");
        assert_eq!(utc(1_700_000_000_000_000_000), "2023-11-14T22:13:20Z");
        assert_eq!(utc(4_107_542_399_999_999_999), "2100-02-28T23:59:59Z");
    }
}
