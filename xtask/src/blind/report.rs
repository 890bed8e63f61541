//! What `qv diagnose` writes, as far as it is scored.

use anyhow::{Context, Result, bail};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// The name that stands for none of the library's effects.
pub const UNKNOWN: &str = "unknown";

/// `report.json`.
#[derive(Debug, Clone, Default, Deserialize)]
pub struct Report {
    format: String,
    /// `no_gap`, `explained`, `partly_explained` or `unexplained`.
    pub verdict: String,
    #[serde(default)]
    pub gap: Gap,
    #[serde(default, rename = "where")]
    pub place: Place,
    /// What is accused, best first.
    #[serde(default)]
    pub causes: Vec<Cause>,
    /// All effects with their probabilities.
    #[serde(default)]
    pub ranking: Vec<RankedEffect>,
    /// How long it took.
    #[serde(default)]
    pub timing: Timing,
}

/// How long a diagnosis took.
#[derive(Debug, Clone, Default, Deserialize)]
pub struct Timing {
    /// All of it \[s\].
    #[serde(default)]
    pub runtime_s: Option<f64>,
}

/// The gap before and after.
#[derive(Debug, Clone, Default, Deserialize)]
pub struct Gap {
    /// Share that is closed on segments that no fit has seen.
    #[serde(default)]
    pub closed: Option<f64>,
    /// Its interval.
    #[serde(default)]
    pub closed_ci95: Option<[Option<f64>; 2]>,
    /// Share that is closed in the windows of the fit.
    #[serde(default)]
    pub closed_in_fit: Option<f64>,
}

impl Gap {
    /// Whether the interval holds the share that is closed in the other windows; nothing where either is missing.
    pub fn interval_holds(&self) -> Option<bool> {
        let [Some(low), Some(high)] = self.closed_ci95? else { return None };
        Some((low..=high).contains(&self.closed_in_fit?))
    }
}

/// Where the gap lies.
#[derive(Debug, Clone, Default, Deserialize)]
pub struct Place {
    #[serde(default)]
    pub interfaces: Vec<Share>,
    #[serde(default)]
    pub regions: Vec<Region>,
}

/// A share of the gap.
#[derive(Debug, Clone, Deserialize)]
pub struct Share {
    pub name: String,
    pub share: f64,
}

/// A rectangle of the floor \[m\].
#[derive(Debug, Clone, Deserialize)]
pub struct Region {
    pub name: String,
    pub x: [f64; 2],
    pub y: [f64; 2],
}

/// One accused effect.
#[derive(Debug, Clone, Default, Deserialize)]
pub struct Cause {
    pub effect: String,
    #[serde(default, alias = "probability")]
    pub score: f64,
    #[serde(default)]
    pub scope: Vec<String>,
    #[serde(default)]
    pub parameters: Vec<Estimate>,
}

/// An estimated size.
#[derive(Debug, Clone, Deserialize)]
pub struct Estimate {
    pub name: String,
    pub value: f64,
    #[serde(default)]
    pub ci95: Option<[f64; 2]>,
}

/// An effect's score.
#[derive(Debug, Clone, Deserialize)]
pub struct RankedEffect {
    pub effect: String,
    #[serde(alias = "probability")]
    pub score: f64,
}

/// What a diagnosis says first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VerdictClass<'a> {
    /// There is no gap.
    NoGap,
    /// There is one, and none of the library's effects makes it.
    Unknown,
    /// This effect makes it.
    Named(&'a str),
}

impl Report {
    /// Reads a report.
    ///
    /// # Errors
    /// The file is missing or malformed.
    pub fn read(file: &Path) -> Result<Self> {
        let text = fs::read_to_string(file).with_context(|| format!("reading {}", file.display()))?;
        let report: Self = serde_json::from_str(&text).with_context(|| format!("in {}", file.display()))?;
        if report.format != "qv-diagnosis/1" {
            bail!("{}: expected the format qv-diagnosis/1, found {:?}", file.display(), report.format);
        }
        Ok(report)
    }

    /// What it says first.
    pub fn said(&self) -> VerdictClass<'_> {
        match self.causes.first() {
            Some(cause) if cause.effect == UNKNOWN => VerdictClass::Unknown,
            Some(cause) => VerdictClass::Named(&cause.effect),
            None if self.verdict == "no_gap" => VerdictClass::NoGap,
            None => VerdictClass::Unknown,
        }
    }

    /// What it accuses, whichever place it has.
    pub fn accused(&self) -> impl Iterator<Item = &Cause> {
        self.causes.iter().filter(|cause| cause.effect != UNKNOWN)
    }

    /// The `count` likeliest effects of the library: what is accused, then the ranking in the order of score.
    pub fn likeliest(&self, count: usize) -> Vec<&str> {
        let mut ranking: Vec<&RankedEffect> = self.ranking.iter().collect();
        ranking.sort_by(|a, b| b.score.total_cmp(&a.score));
        let mut names: Vec<&str> = Vec::new();
        let all = self.causes.iter().map(|c| c.effect.as_str()).chain(ranking.iter().map(|r| r.effect.as_str()));
        for name in all.filter(|name| *name != UNKNOWN) {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        names.truncate(count);
        names
    }

    /// The interface with the largest share of the gap.
    pub fn interface(&self) -> Option<&str> {
        let largest = self.place.interfaces.iter().max_by(|a, b| a.share.total_cmp(&b.share))?;
        Some(&largest.name)
    }

    /// How much it leans to `unknown`: the score of that in ranking or causes; where it is listed in neither, what the
    /// likeliest effect leaves of 1.
    pub fn leans_to_unknown(&self) -> f64 {
        let listed = self.ranking.iter().map(|r| (r.effect.as_str(), r.score));
        let accused = self.causes.iter().map(|c| (c.effect.as_str(), c.score));
        let mut by_name: BTreeMap<&str, f64> = BTreeMap::new();
        for (name, probability) in listed.chain(accused) {
            let known = by_name.entry(name).or_insert(probability);
            *known = known.max(probability);
        }
        match by_name.get(UNKNOWN) {
            Some(probability) => *probability,
            None => 1.0 - by_name.values().copied().fold(0.0, f64::max),
        }
    }
}

/// What one baseline says: `baselines.json` holds some by name.
#[derive(Debug, Clone, Deserialize)]
pub struct Baseline {
    /// The effect that it names, if it names any.
    pub effect: Option<String>,
    /// Share of the held-out gap that it closes.
    #[serde(default)]
    pub closed: Option<f64>,
}

/// Reads `baselines.json`; nothing where there is no such file.
///
/// # Errors
/// The file is malformed.
pub fn read_baselines(file: &Path) -> Result<BTreeMap<String, Baseline>> {
    let Ok(text) = fs::read_to_string(file) else { return Ok(BTreeMap::new()) };
    serde_json::from_str(&text).with_context(|| format!("in {}", file.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(causes: &[&str], ranking: &[(&str, f64)]) -> Report {
        let cause = |name: &&str| Cause { effect: (*name).into(), ..Default::default() };
        let ranked = |(name, p): &(&str, f64)| RankedEffect { effect: (*name).into(), score: *p };
        Report {
            causes: causes.iter().map(cause).collect(),
            ranking: ranking.iter().map(ranked).collect(),
            ..Default::default()
        }
    }

    #[test]
    fn what_is_said_first() {
        assert_eq!(report(&["a", "b"], &[]).said(), VerdictClass::Named("a"));
        assert_eq!(report(&["unknown", "b"], &[]).said(), VerdictClass::Unknown);
        assert_eq!(report(&[], &[]).said(), VerdictClass::Unknown);
        assert_eq!(Report { verdict: "no_gap".into(), ..Default::default() }.said(), VerdictClass::NoGap);
        assert_eq!(report(&["unknown", "b"], &[]).accused().count(), 1);
    }

    #[test]
    fn likeliest_are_accused_then_ranked_without_unknown() {
        let found = report(&["b"], &[("a", 0.1), ("unknown", 0.5), ("c", 0.3), ("b", 0.1)]);
        assert_eq!(found.likeliest(3), ["b", "c", "a"]);
        assert_eq!(found.leans_to_unknown(), 0.5);
        assert!((report(&[], &[("a", 0.9), ("b", 0.1)]).leans_to_unknown() - 0.1).abs() < 1e-12);
        assert_eq!(report(&[], &[]).leans_to_unknown(), 1.0);
    }
}
