//! One recording, compared with the calibration.

use crate::Outcome;
use crate::provenance::provenance;
use qv_gap::drift::{Answer, Difference, Drift};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// One recording, as it was checked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Check {
    /// Its path, as it was given.
    pub run: String,
    /// Hashes of its files.
    pub sha256: Vec<String>,
    /// When it begins \[ns since the epoch\]; 0 where that is not known.
    pub start_ns: u64,
    /// What was lost of it.
    pub lost: Vec<String>,
    /// What was found.
    #[serde(flatten)]
    pub drift: Drift,
}

impl Check {
    pub fn outcome(&self) -> Outcome {
        match self.drift.answer {
            Answer::Changed => Outcome::Changed,
            Answer::Inconclusive => Outcome::Partial,
            Answer::Same if !self.lost.is_empty() => Outcome::Partial,
            Answer::Same => Outcome::Done,
        }
    }
}

/// Hashes of the files of a recording.
pub fn hashes(path: &Path) -> Vec<String> {
    let found = provenance([path]);
    let inputs = found["inputs"].as_array().cloned().unwrap_or_default();
    inputs.iter().filter_map(|input| Some(input["sha256"].as_str()?.to_string())).collect()
}

/// Parameters of a table: those that changed, and of every other effect the one with the least p.
pub fn rows(drift: &Drift) -> Vec<&Difference> {
    let mut rows: Vec<&Difference> = drift.changes().collect();
    let mut others: Vec<&Difference> = Vec::new();
    for one in drift.parameters.iter().filter(|p| !p.changed) {
        match others.iter_mut().find(|o| o.effect == one.effect && o.parameter == one.parameter) {
            Some(other) if one.p < other.p => *other = one,
            Some(_) => {}
            None => others.push(one),
        }
    }
    others.sort_by(|a, b| a.p.total_cmp(&b.p));
    rows.extend(others);
    rows
}

/// As a table has it.
pub fn p_value(p: f64) -> String {
    if p < 1e-4 { "< 0.0001".into() } else { format!("{p:.4}") }
}
