//! What of a corrected robot fails a policy: each correction is scaled from none of it to several times what was identified, the others kept.

use super::trial::{Trial, TrialPolicy, figures_of};
use crate::Failure;
use qv_gap::report::{Correction, ParameterEstimate};
use qv_page::{Table, escape, significant};
use qv_sim::{Model, Terrain};
use serde::Serialize;
use std::fmt::Write;

/// Shares of an identified deviation at which a policy walks.
const SCALES: [f64; 8] = [0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0];

/// A policy on robots that have more and more of one deviation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Ladder {
    /// The parameter, such as `command_latency`; of all joints that were corrected.
    pub parameter: String,
    /// Unit of its values.
    pub unit: String,
    /// Value of the nominal robot, and the identified one of the member that deviates most.
    pub nominal: f64,
    /// See `nominal`.
    pub identified: f64,
    /// Walks, from none of the deviation outwards.
    pub rungs: Vec<Rung>,
    /// Last value without a fall, and first with one; `None` where it never falls, or falls without the deviation.
    pub cliff: Option<[f64; 2]>,
    /// Share of the corrected robot's larger error of velocity that goes when this deviation alone is taken away; `None` where the correction makes
    /// the error no larger.
    pub share: Option<f64>,
}

/// One of them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Rung {
    /// Share of the identified deviation.
    pub scale: f64,
    /// Value of the parameter.
    pub value: f64,
    /// Whether it lies in the interval of the size.
    pub in_interval: bool,
    /// Commands under which it fell.
    pub falls: usize,
    /// Mean error of velocity \[m/s\] over all commands, a fall counted as standing still.
    pub velocity_error: f64,
}

/// Ladders of all corrections that act all the time, beside a `trial` with all of them. `sizes` are those of the causes.
///
/// # Errors
/// When the policy gives no actions, or the simulator refuses what was identified.
pub fn ladders(
    policy: &mut TrialPolicy,
    (model, terrain): (&Model, &Terrain),
    (sizes, corrections): (&[ParameterEstimate], &[Correction]),
    trial: &Trial,
) -> Result<Vec<Ladder>, Failure> {
    let (_, nominal_error) = figures_of(&trial.nominal);
    let mut kinds: Vec<&str> = Vec::new();
    for kind in corrections.iter().filter(|c| !c.parameter.starts_with("external.")).map(|c| kind_of(&c.parameter)) {
        if !kinds.contains(&kind) {
            kinds.push(kind);
        }
    }
    kinds.into_iter().map(|kind| one(policy, (model, terrain), (sizes, corrections), (kind, nominal_error))).collect()
}

fn one(
    policy: &mut TrialPolicy,
    place: (&Model, &Terrain),
    (sizes, corrections): (&[ParameterEstimate], &[Correction]),
    (kind, nominal_error): (&str, f64),
) -> Result<Ladder, Failure> {
    let of_kind = corrections.iter().filter(|c| kind_of(&c.parameter) == kind);
    let deviation = |c: &&Correction| (c.value - c.nominal).abs();
    let most = of_kind.max_by(|a, b| deviation(a).total_cmp(&deviation(b))).expect("a kind has corrections");
    let interval = interval_of(sizes, kind, most);
    let mut scales = SCALES.to_vec();
    scales.extend(interval.into_iter().flatten().filter(|s| *s > 0.0));
    scales.sort_by(f64::total_cmp);
    let mut rungs: Vec<Rung> = Vec::new();
    for scale in scales {
        let scaled = |c: &Correction| match kind_of(&c.parameter) == kind {
            true => Correction { value: c.nominal + scale * (c.value - c.nominal), ..c.clone() },
            false => c.clone(),
        };
        let setting: Vec<Correction> = corrections.iter().map(scaled).collect();
        let walks = match policy.walks(place.0, place.1, &setting) {
            Ok(walks) => walks,
            // Beyond what was identified a value may be none that a robot can have.
            Err(_) if scale > 1.0 => break,
            Err(error) => return Err(error),
        };
        let (falls, velocity_error) = figures_of(&walks);
        let value = most.nominal + scale * (most.value - most.nominal);
        let in_interval = interval.is_some_and(|[low, high]| (low..=high).contains(&scale));
        rungs.push(Rung { scale, value, in_interval, falls, velocity_error });
        if 2 * falls > walks.len() {
            break;
        }
    }
    Ok(Ladder {
        parameter: kind.to_owned(),
        unit: most.unit.clone(),
        nominal: most.nominal,
        identified: most.value,
        cliff: cliff(&rungs),
        share: share(&rungs, nominal_error),
        rungs,
    })
}

/// Last part of a parameter's name: what it is, of whatever joint.
fn kind_of(parameter: &str) -> &str {
    parameter.rsplit('.').next().unwrap_or(parameter)
}

/// Bounds of the identified size as shares of the deviation; `None` where none is stated.
fn interval_of(sizes: &[ParameterEstimate], kind: &str, most: &Correction) -> Option<[f64; 2]> {
    let stated = sizes.iter().find(|p| p.name == kind)?;
    // Limits and frictions are stated as they are, all else as what it differs by.
    let is_absolute = (stated.value - most.value).abs() <= 1e-9 * most.value.abs();
    let from = if is_absolute { most.nominal } else { 0.0 };
    let mut bounds = stated.ci95.map(|bound| (bound - from) / (stated.value - from));
    bounds.sort_by(f64::total_cmp);
    bounds.iter().all(|b| b.is_finite()).then_some(bounds)
}

fn cliff(rungs: &[Rung]) -> Option<[f64; 2]> {
    let first = rungs.iter().position(|r| r.falls > 0)?;
    (first > 0).then(|| [rungs[first - 1].value, rungs[first].value])
}

fn share(rungs: &[Rung], nominal_error: f64) -> Option<f64> {
    let error = |scale: f64| rungs.iter().find(|r| r.scale == scale).map(|r| r.velocity_error);
    let (without, with) = (error(0.0)?, error(1.0)?);
    (with > nominal_error).then(|| ((with - without) / (with - nominal_error)).clamp(0.0, 1.0))
}

/// Where the policy fails, a sentence for each ladder.
pub fn sentences(ladders: &[Ladder]) -> Vec<String> {
    let of = |l: &Ladder| {
        let name = l.parameter.replace('_', " ");
        let value = |x: f64| format!("{} {}", significant(x, 3), l.unit).trim_end_matches(" 1").to_owned();
        let carries =
            l.share.map_or_else(String::new, |s| format!(" and carries {:.0} % of the added error", 100.0 * s));
        let falls = match l.cliff {
            Some([stands, falls]) => format!("the policy falls between {} and {}", value(stands), value(falls)),
            None if l.rungs.first().is_some_and(|r| r.falls > 0) => "the policy falls without it, too".into(),
            None => format!("the policy never fell up to {}", value(l.rungs.last().map_or(l.nominal, |r| r.value))),
        };
        format!("{name} {} (nominal {}){carries}: {falls}.", value(l.identified), value(l.nominal))
    };
    ladders.iter().map(of).collect()
}

/// A section of the report's page.
pub fn section(ladders: &[Ladder], trial: &Trial) -> String {
    if ladders.is_empty() {
        return String::new();
    }
    let mut text = String::from("<h2>Which deviation fails the policy?</h2><div class=\"card\">");
    for (ladder, sentence) in ladders.iter().zip(sentences(ladders)) {
        let _ = write!(text, "<p>{}</p>", escape(&sentence));
        let worst = ladder.rungs.iter().map(|r| r.velocity_error).fold(1e-9, f64::max);
        let value = format!("{} ({})", ladder.parameter.replace('_', " "), ladder.unit);
        let mut table =
            Table::new(&[&value, "share of the identified", "in its interval", "falls", "error of velocity (m/s)"]);
        for r in &ladder.rungs {
            let cells = [
                significant(r.value, 3),
                format!("{:.2}", r.scale),
                if r.in_interval { "yes".into() } else { String::new() },
                format!("{} of {}", r.falls, trial.nominal.len()),
                format!("{:.3}", r.velocity_error),
            ];
            table.row_with_bar(&cells, 4, r.velocity_error / worst);
        }
        text += &table.to_html();
    }
    text + "</div>"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use crate::walk::trial::TrialWalk;

    fn rung(scale: f64, falls: usize, velocity_error: f64) -> Rung {
        Rung { scale, value: 0.01 * scale, in_interval: scale == 1.0, falls, velocity_error }
    }

    #[test]
    fn a_cliff_lies_between_the_last_walk_and_the_first_fall() {
        let rungs = [rung(0.0, 0, 0.05), rung(1.0, 0, 0.15), rung(2.0, 1, 0.3)];
        assert_eq!(cliff(&rungs), Some([0.01, 0.02]));
        assert_eq!(cliff(&rungs[..2]), None);
        assert_eq!(cliff(&rungs[2..]), None, "it falls without the deviation");
        // Alone it makes all of the error, beside another half of it.
        assert_eq!(share(&rungs, 0.05), Some(1.0));
        assert!((share(&[rung(0.0, 0, 0.1), rung(1.0, 0, 0.15)], 0.05).unwrap() - 0.5).abs() < 1e-9);
        assert_eq!(share(&rungs, 0.2), None);
    }

    #[test]
    fn intervals_are_shares_of_the_deviation() {
        let correction =
            |value, nominal| Correction { parameter: "actuator.hip.kp_scale".into(), value, nominal, unit: "1".into() };
        let size = |value, ci95| ParameterEstimate { name: "kp_scale".into(), value, ci95, unit: "1".into() };
        let [low, high] = interval_of(&[size(-0.2, [-0.25, -0.15])], "kp_scale", &correction(0.8, 1.0)).unwrap();
        assert!((low - 0.75).abs() < 1e-9 && (high - 1.25).abs() < 1e-9);
        let [low, high] = interval_of(&[size(0.4, [0.3, 0.5])], "kp_scale", &correction(0.4, 0.8)).unwrap();
        assert!((low - 0.75).abs() < 1e-9 && (high - 1.25).abs() < 1e-9);
        assert_eq!(interval_of(&[], "kp_scale", &correction(0.4, 0.8)), None);
    }

    #[test]
    fn each_ladder_is_a_sentence_and_a_table() {
        let ladder = Ladder {
            parameter: "command_latency".into(),
            unit: "s".into(),
            nominal: 0.0,
            identified: 0.01,
            rungs: vec![rung(0.0, 0, 0.05), rung(1.0, 0, 0.15), rung(2.0, 4, 0.3)],
            cliff: Some([0.01, 0.02]),
            share: Some(1.0),
        };
        let all = [ladder];
        assert!(sentences(&all)[0].states("0.0100 0.0200 100"), "{:?}", sentences(&all));
        let walk = TrialWalk { command: [0.5, 0.0, 0.0], fell: None, velocity: None };
        let trial = Trial { policy: "trot".into(), nominal: vec![walk; 6], corrected: Vec::new() };
        assert!(section(&all, &trial).states("falls 4 of 6") && section(&[], &trial).is_empty());
    }
}
