//! What a gap that nothing explains looks most like: no accusation, but where to look, how far it would get one, and the
//! experiment that shows those apart which this recording cannot.

use crate::GapError;
use crate::checks::by_recording::by_recording;
use crate::checks::held_out::closure;
use crate::inference::linearised::LinearisedProblem;
use crate::inference::search::Fit;
use crate::problem::columns::Group;
use crate::report::cannot_tell;
use crate::report::{Lead, ParameterEstimate};

/// Suspects that are looked at.
const SUSPECTS: usize = 8;
/// Least share of the gap that a lead closes.
const LEAST_CLOSED: f64 = 0.05;
/// Suspects that close at least this share of what the best of a group closes belong to it, if they look alike.
const NEARLY: f64 = 0.4;
/// Most leads.
const LEADS: usize = 3;

/// A suspect alone, judged in windows that no fit has seen.
struct Alone {
    effect: String,
    lead: Lead,
    alike: Vec<String>,
}

/// Groups of suspects that look alike, the one that closes most first. `estimates` gives the values of a fit.
///
/// # Errors
/// When a value means nothing.
pub fn leads(
    study: &mut LinearisedProblem,
    fits: &[Fit],
    seed: u64,
    estimates: impl Fn(&LinearisedProblem, &Fit) -> Vec<ParameterEstimate>,
) -> Result<Vec<Lead>, GapError> {
    let mut all = Vec::new();
    for fit in one_of_each(study, fits) {
        let setting = study.columns.setting_of(&study.rollout, std::slice::from_ref(&fit.suspect));
        let gap = closure(study, &setting)?.gap(study, seed);
        let group = &study.columns.groups[fit.suspect.group];
        let effect = &study.columns.effects[group.effect];
        let lead = Lead {
            effects: vec![effect.name.clone()],
            scope: group.names.clone(),
            parameters: estimates(study, fit),
            closed: gap.closed,
            closed_ci95: gap.closed_ci95,
            joint_rms: gap.joint_rms,
            separating_experiment: effect.experiment.clone(),
            by_recording: by_recording(study, &effect.name, group, (absent(study, group), false)),
        };
        all.push(Alone { effect: effect.name.clone(), alike: cannot_tell::confusable(study, &fit.suspect), lead });
    }
    all.retain(|a| a.lead.closed >= LEAST_CLOSED);
    all.sort_by(|a, b| b.lead.closed.total_cmp(&a.lead.closed));
    Ok(grouped(all))
}

/// Value of an effect's first axis in the study's robot.
fn absent(study: &LinearisedProblem, group: &Group) -> f64 {
    study.columns.units_of(group, 0).next().map_or(0.0, |u| study.columns.units[u].absent)
}

/// The best fit of each effect, by what it leaves in its own windows.
fn one_of_each<'f>(study: &LinearisedProblem, fits: &'f [Fit]) -> Vec<&'f Fit> {
    let mut sorted: Vec<&Fit> = fits.iter().filter(|f| f.loss.is_finite()).collect();
    sorted.sort_by(|a, b| a.loss.total_cmp(&b.loss));
    let mut seen = Vec::new();
    sorted.retain(|f| {
        let effect = study.columns.groups[f.suspect.group].effect;
        let is_new = !seen.contains(&effect);
        seen.push(effect);
        is_new
    });
    sorted.truncate(SUSPECTS);
    sorted
}

fn grouped(all: Vec<Alone>) -> Vec<Lead> {
    let mut rest = all;
    let mut leads: Vec<Lead> = Vec::new();
    while leads.len() < LEADS && !rest.is_empty() {
        let best = rest.remove(0);
        let mut lead = best.lead;
        rest.retain(|other| {
            let alike = best.alike.contains(&other.effect) || other.alike.contains(&best.effect);
            let belongs = alike && other.lead.closed >= NEARLY * lead.closed;
            if belongs {
                lead.effects.push(other.effect.clone());
            }
            !belongs
        });
        leads.push(lead);
    }
    leads
}
