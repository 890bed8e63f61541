//! One report against its answer.

use super::answers::{Answer, Case, Effect, Parameter};
use super::report::{self, Baseline, Cause, Estimate, Report, VerdictClass};
use anyhow::Result;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Half-width of a 90 % interval over that of a 95 % one, of a normal estimate.
const NINETY_OF_95: f64 = 1.644_853_6 / 1.959_964;

/// How one diagnosis did.
#[derive(Debug, Clone, Serialize)]
pub struct DiagnosisScore {
    /// Name of the recording.
    pub name: String,
    #[serde(skip)]
    pub case: Case,
    /// What made the recording.
    pub origin: String,
    /// Effects that are there.
    pub truth: Vec<String>,
    /// `no_gap`, `unknown`, the effect accused first, or `failed`.
    pub said: String,
    /// All effects accused.
    pub accused: Vec<String>,
    /// Whether the first effect accused is (one of) the truth.
    pub named: bool,
    /// Whether all of the truth is among the three likeliest.
    pub among_three: bool,
    /// Whether all of the truth is accused.
    pub all_accused: bool,
    /// Whether the first effect accused is in the group that the truth is confused with.
    pub in_group: bool,
    /// Whether it describes a withheld effect in part.
    pub is_relative: bool,
    /// Whether the gap is found at the right interface.
    pub interface: Option<bool>,
    /// Whether exactly the right joints are accused, where the right effect is.
    pub scope: Option<bool>,
    /// Errors of the sizes asked for, as shares of their ranges, where the right effect is accused; 1 of a missing one.
    pub errors: Vec<f64>,
    /// Whether the 90 % and the 95 % interval of each holds the truth.
    pub inside: Vec<[bool; 2]>,
    /// Largest error of a region's edges that the robot came to \[m\]; infinite (null in JSON) when no region is given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outline: Option<f64>,
    /// Share of the held-out gap that is closed.
    pub closed: Option<f64>,
    /// Whether its interval holds the share that is closed in the windows of the fit, the best word there is on the true one.
    pub closure_holds: Option<bool>,
    /// How much the report leans to `unknown`.
    pub leans: f64,
    /// The same recording diagnosed without the right effect in the library, when there is such a report.
    pub left_out: Option<LeftOut>,
    /// Time of the diagnosis \[s\].
    pub runtime: Option<f64>,
    /// What the baselines say.
    #[serde(skip)]
    pub baselines: BTreeMap<String, Baseline>,
    /// Why there is no report.
    pub failure: Option<String>,
}

/// A diagnosis whose library lacks the right effect.
#[derive(Debug, Clone, Serialize)]
pub struct LeftOut {
    /// What it says first.
    pub said: String,
    /// Whether that is in the group of the effect left out.
    pub in_group: bool,
    /// How much it leans to `unknown`.
    pub leans: f64,
}

fn word(said: VerdictClass) -> String {
    match said {
        VerdictClass::NoGap => "no_gap".into(),
        VerdictClass::Unknown => report::UNKNOWN.into(),
        VerdictClass::Named(name) => name.into(),
    }
}

/// Scores what lies in `folder`: `report.json`, `without/EFFECT/report.json` and `baselines.json`. A report that is
/// missing or malformed is a failure of the diagnosis, and says nothing right.
///
/// # Errors
/// `baselines.json` or a report without the effect is there and malformed.
pub fn score(name: &str, answer: &Answer, folder: &Path) -> Result<DiagnosisScore> {
    let truth: Vec<String> = answer.effects.iter().map(|effect| effect.effect.clone()).collect();
    let (report, failure) = match Report::read(&folder.join("report.json")) {
        Ok(report) => (report, None),
        Err(error) => (Report::default(), Some(format!("{error:#}"))),
    };
    let said = if failure.is_some() { "failed".into() } else { word(report.said()) };
    let accused: Vec<String> = report.accused().map(|cause| cause.effect.clone()).collect();
    let likeliest = report.likeliest(3);
    let of_groups =
        |list: fn(&Effect) -> &Vec<String>| answer.effects.iter().any(|effect| list(effect).contains(&said));
    let mut scored = DiagnosisScore {
        name: name.into(),
        case: answer.case,
        origin: answer.origin.clone(),
        named: truth.contains(&said),
        among_three: truth.iter().all(|effect| likeliest.contains(&effect.as_str())),
        all_accused: truth.iter().all(|effect| accused.contains(effect)),
        in_group: of_groups(|effect| &effect.group),
        is_relative: of_groups(|effect| &effect.relatives),
        interface: interface(answer, &report),
        scope: None,
        errors: Vec::new(),
        inside: Vec::new(),
        outline: None,
        closed: report.gap.closed,
        closure_holds: report.gap.interval_holds(),
        leans: report.leans_to_unknown(),
        left_out: left_out(answer, folder)?,
        runtime: report.timing.runtime_s,
        baselines: report::read_baselines(&folder.join("baselines.json"))?,
        truth,
        said,
        accused,
        failure,
    };
    for effect in &answer.effects {
        if let Some(cause) = report.causes.iter().find(|cause| cause.effect == effect.effect) {
            compare(answer, effect, cause, &report, &mut scored);
        }
    }
    Ok(scored)
}

/// Of one effect of the library; two may act at two interfaces, and what is withheld may act at any.
fn interface(answer: &Answer, report: &Report) -> Option<bool> {
    let [effect] = answer.effects.as_slice() else { return None };
    let expected = effect.interface.as_deref()?;
    Some(report.interface() == Some(expected))
}

fn left_out(answer: &Answer, folder: &Path) -> Result<Option<LeftOut>> {
    let (Case::Single, [effect]) = (answer.case, answer.effects.as_slice()) else { return Ok(None) };
    let file = folder.join("without").join(&effect.effect).join("report.json");
    if !file.is_file() {
        return Ok(None);
    }
    let report = Report::read(&file)?;
    let said = word(report.said());
    Ok(Some(LeftOut { in_group: effect.group.contains(&said), said, leans: report.leans_to_unknown() }))
}

/// Sizes, joints and outline of an effect that is rightly accused.
fn compare(answer: &Answer, effect: &Effect, cause: &Cause, report: &Report, scored: &mut DiagnosisScore) {
    let asked: Vec<&Parameter> = effect.parameters.iter().filter(|p| p.asked).collect();
    for parameter in &asked {
        let Some([least, most]) = parameter.range else { continue };
        let named = |name: &str| name == parameter.name || name.ends_with(&format!(".{}", parameter.name));
        let alone = asked.len() == 1 && cause.parameters.len() == 1;
        // One estimate for all joints, or one for each.
        let found: Vec<_> = cause.parameters.iter().filter(|estimate| alone || named(&estimate.name)).collect();
        if found.is_empty() {
            scored.errors.push(1.0);
            continue;
        }
        let off: f64 = found.iter().map(|estimate| (estimate.value - parameter.value).abs()).sum();
        scored.errors.push(off / found.len() as f64 / (most - least));
        scored.inside.extend(found.iter().filter_map(|estimate| inside(estimate, parameter.value)));
    }
    if !effect.joints.is_empty() {
        let meant = answer.joints_meant(&cause.scope);
        let right = meant.len() == effect.joints.len() && meant.iter().all(|joint| effect.joints.contains(joint));
        scored.scope = Some(right && scored.scope.unwrap_or(true));
    }
    if effect.region.is_some() {
        scored.outline = Some(outline(effect, cause, report));
    }
}

/// Whether the 90 % and the 95 % interval of an estimate hold the truth; nothing without an interval.
fn inside(estimate: &Estimate, truth: f64) -> Option<[bool; 2]> {
    let [low, high] = estimate.ci95?;
    let holds = |share: f64| {
        let (below, above) = (share * (estimate.value - low), share * (high - estimate.value));
        (estimate.value - below..=estimate.value + above).contains(&truth)
    };
    Some([holds(NINETY_OF_95), holds(1.0)])
}

/// Largest error of the edges that the robot came to \[m\].
fn outline(effect: &Effect, cause: &Cause, report: &Report) -> f64 {
    let (Some(truth), Some([x, y])) = (&effect.region, region(cause, report)) else { return f64::INFINITY };
    let axes = [(truth.x, x, truth.met[0]), (truth.y, y, truth.met[1])];
    let edges = axes.into_iter().flat_map(|(truth, found, met)| (0..2).map(move |i| (truth[i] - found[i], met[i])));
    edges.filter(|(_, met)| *met).map(|(error, _)| error.abs()).fold(0.0, f64::max)
}

/// Least and greatest x, and y, of a cause's region: its own parameters, or the region that its scope names.
fn region(cause: &Cause, report: &Report) -> Option<[[f64; 2]; 2]> {
    let own = |name: &str| cause.parameters.iter().find(|p| p.name == name).map(|p| p.value);
    if let (Some(x0), Some(x1), Some(y0), Some(y1)) = (own("x_min"), own("x_max"), own("y_min"), own("y_max")) {
        return Some([[x0, x1], [y0, y1]]);
    }
    let named = report.place.regions.iter().find(|region| cause.scope.contains(&region.name))?;
    Some([named.x, named.y])
}
