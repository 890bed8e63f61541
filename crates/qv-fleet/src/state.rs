//! What became of a unit: `done.json` or `failed.json` in its folder, or neither.

use crate::hash::sha256;
use crate::plan::{Plan, Unit};
use serde::{Deserialize, Serialize};

/// What a record of a unit that is done says of its own form.
const DONE: &str = "qv-fleet-done/1";
/// The same of one that failed.
const FAILED: &str = "qv-fleet-failed/1";

/// What a unit cost. Not in `fleet.json`, since it is another each time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// How often it was started.
    pub attempts: u32,
    /// From its first start to its end \[s\].
    pub seconds: f64,
    /// Time of processors, in all attempts \[s\].
    pub cpu_seconds: f64,
    /// Most memory that it was seen to have \[MiB\]; 0 where nobody looked.
    pub peak_mib: f64,
}

/// A unit that is done.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct UnitRecord {
    format: String,
    /// Its identity.
    pub unit: String,
    /// Hash of the contents of its recordings.
    pub inputs: String,
    /// Of the program.
    pub version: String,
    /// Options of the command.
    pub options: Vec<String>,
    /// What the command ended with: 0, or 3 for a finding that is no correction or for input of which a part was lost.
    pub exit_code: i32,
    /// Hash of the report.
    pub report_sha256: String,
    /// What it cost.
    pub cost: Cost,
}

impl UnitRecord {
    /// The record of a unit whose command ended with `exit_code` and left `report`.
    pub fn new(plan: &Plan, unit: &Unit, exit_code: i32, report: &[u8], cost: Cost) -> Self {
        Self {
            format: DONE.into(),
            unit: unit.id.clone(),
            inputs: unit.inputs(),
            version: plan.task.version.clone(),
            options: plan.task.options.clone(),
            exit_code,
            report_sha256: sha256(report),
            cost,
        }
    }

    /// The record in `text`, if it is of this unit, version, options and report; any other one counts for nothing.
    pub fn read(text: &str, plan: &Plan, unit: &Unit, report: &[u8]) -> Option<Self> {
        let found: Self = serde_json::from_str(text).ok()?;
        let right = Self::new(plan, unit, found.exit_code, report, found.cost);
        (found == right).then_some(found)
    }

    /// As text.
    pub fn to_text(&self) -> String {
        serde_json::to_string_pretty(self).expect("a record is plain data") + "\n"
    }
}

/// In what way a unit failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// The command said why.
    Failed,
    /// The command was called in a wrong way.
    Usage,
    /// It took longer than it may.
    Timeout,
    /// It took more memory than it may.
    Memory,
    /// A signal of somebody else ended it.
    Killed,
    /// It ended well and left no report.
    NoReport,
    /// A recording is not what it was when the plan was made.
    InputChanged,
    /// The program could not be started.
    NotStarted,
}

impl Kind {
    /// Whether another attempt may end otherwise. What a command says of its input, it will say again.
    pub fn may_pass(self) -> bool {
        matches!(self, Self::Timeout | Self::Memory | Self::Killed | Self::NoReport | Self::NotStarted)
    }

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Failed => "the command failed",
            Self::Usage => "usage error",
            Self::Timeout => "too slow",
            Self::Memory => "too much memory",
            Self::Killed => "killed",
            Self::NoReport => "no report",
            Self::InputChanged => "the recording changed",
            Self::NotStarted => "not started",
        }
    }
}

/// A unit that failed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FailedUnit {
    format: String,
    /// Its identity.
    pub unit: String,
    /// In what way.
    pub kind: Kind,
    /// Why, in words.
    pub reason: String,
    /// What it cost.
    pub cost: Cost,
}

impl FailedUnit {
    /// The record of a unit that failed.
    pub fn new(unit: &Unit, kind: Kind, reason: String, cost: Cost) -> Self {
        Self { format: FAILED.into(), unit: unit.id.clone(), kind, reason, cost }
    }

    /// The record in `text`, if it is one of this unit.
    pub fn read(text: &str, unit: &Unit) -> Option<Self> {
        let found: Self = serde_json::from_str(text).ok()?;
        (found.format == FAILED && found.unit == unit.id).then_some(found)
    }

    /// As text.
    pub fn to_text(&self) -> String {
        serde_json::to_string_pretty(self).expect("a record is plain data") + "\n"
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{InputFile, Recording, Task};

    fn plan(options: &[&str]) -> Plan {
        let file = InputFile { path: "a".into(), bytes: 1, sha256: "0".repeat(64) };
        let run = Recording { path: "a".into(), robot: "arm".into(), start_ns: None, seconds: 1.0, files: vec![file] };
        let options = options.iter().map(|o| (*o).to_string()).collect();
        Plan::new(Task { options, ..Task::default() }, vec![run], vec![], false)
    }

    #[test]
    fn only_the_record_of_this_very_work_counts() {
        let (mine, other) = (plan(&[]), plan(&["--seed", "2"]));
        let unit = &mine.units[0];
        let text = UnitRecord::new(&mine, unit, 3, b"{}", Cost::default()).to_text();
        assert_eq!(UnitRecord::read(&text, &mine, unit, b"{}").unwrap().exit_code, 3);
        assert!(UnitRecord::read(&text, &mine, unit, b"{ }").is_none(), "another report");
        assert!(UnitRecord::read(&text, &other, &other.units[0], b"{}").is_none(), "other options");
        assert!(UnitRecord::read(&text[1..], &mine, unit, b"{}").is_none(), "a damaged record");
    }

    #[test]
    fn failures_are_read_again() {
        let plan = plan(&[]);
        let failed = FailedUnit::new(&plan.units[0], Kind::Memory, "above 10 MiB".into(), Cost::default());
        assert_eq!(FailedUnit::read(&failed.to_text(), &plan.units[0]).unwrap(), failed);
        assert!(Kind::Memory.may_pass() && !Kind::Failed.may_pass() && !Kind::InputChanged.may_pass());
    }
}
