//! A round: one robot is searched for a cause, and all that a decision may ask of the candidates is measured. After an accusation the
//! calibrated simulator is put through the whole again, with its own sensitivities and its own null: what is explained must then
//! look like no gap.

use crate::GapError;
use crate::checks::held_out::{closure, held_out_evidence};
use crate::decision::evidence::{Candidate, HeldOut, Round};
use crate::decision::{Judge, Policy};
use crate::inference::intervals::estimates_of;
use crate::inference::level::level;
use crate::inference::linear_scores::{by_chance, size};
use crate::inference::linearised::LinearisedProblem;
use crate::inference::search::{Fit, Search};
use crate::problem::columns::Extent;

/// Candidates that are looked at in windows that no fit has seen: so many of the best that are no events, and so many events.
const LOOKED_AT: usize = 8;
/// What a round found.
#[derive(Clone)]
pub struct RoundResult {
    /// What was measured, and what is accused.
    pub round: Round,
    /// The fits that the candidates come from, in their order.
    pub fits: Vec<Fit>,
}

/// Searches a study for a cause, the first or one more, among all effects but those in `without`, and judges what is found.
///
/// # Errors
/// When a value means nothing.
pub fn round(
    study: &mut LinearisedProblem,
    without: &[usize],
    is_first: bool,
    policy: &Policy,
) -> Result<RoundResult, GapError> {
    let level = level(study)?;
    let mut search = Search::new(study, 1.0)?;
    let by_chance = by_chance(&search);
    let base = search.base(&[])?;
    let mut fits = search.suspects(&base, without)?;
    let best = fits.iter().map(|f| f.loss).fold(base.loss, f64::min);
    // What even the best leaves is the measure of what chance does in this recording.
    let dispersion = (best / (level.null * level.count)).max(1.0);
    search.dispersion = (base.loss / (level.null * level.count)).max(1.0);
    fits.iter_mut().for_each(|f| f.evidence /= dispersion);
    let mut local = search.local_suspects(&base, without)?;
    let regional = |f: &&mut Fit| matches!(f.suspect.extent, Some(Extent::Region(_)));
    local.iter_mut().filter(regional).for_each(|f| f.evidence *= search.dispersion / dispersion);
    fits.extend(local);
    // Nothing is said of a suspect under which most simulations run away.
    fits.retain(|f| f.evidence.is_finite());
    fits.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    let excess = base.loss - level.null * level.count;
    let candidate = |fit: &Fit| {
        let share = (base.loss - fit.loss) / excess.max(1e-9);
        candidate(study, fit, by_chance[study.columns.groups[fit.suspect.group].effect], share)
    };
    let candidates = fits.iter().map(candidate).collect();
    let mut round = Round { level, excess, is_first, candidates, accused: Vec::new(), after: None };
    look(study, &fits, &mut round.candidates, policy)?;
    round.accused = Judge::new(policy, &round, study.rollout.free).judge().accused;
    Ok(RoundResult { round, fits })
}

fn candidate(study: &LinearisedProblem, fit: &Fit, by_chance: f64, share: f64) -> Candidate {
    let group = &study.columns.groups[fit.suspect.group];
    let effect = &study.columns.effects[group.effect];
    // Limits are searched from next to nothing to far beyond what any motion reaches: a share of that is a large limit.
    let length = |edge: f64| if effect.levels_of.is_some() { 2.0 * edge.abs() } else { effect.span() };
    let from_edge = |value: &f64| effect.range.map(|edge| (value - edge).abs() / length(edge)).into_iter();
    Candidate {
        effect: effect.name.clone(),
        scope: group.names.clone(),
        members: group.members.clone(),
        extent: fit.suspect.extent,
        values: fit.suspect.values.clone(),
        parameters: estimates_of(study, fit),
        log_evidence: fit.evidence + effect.log_prior,
        by_chance,
        least_evidence: effect.least_evidence,
        size: size(study, &fit.suspect),
        from_edge: fit.suspect.values.iter().flat_map(from_edge).fold(f64::INFINITY, f64::min),
        share,
        held_out: None,
    }
}

/// Looks at the best candidates in windows that no fit has seen.
fn look(
    study: &mut LinearisedProblem,
    fits: &[Fit],
    candidates: &mut [Candidate],
    policy: &Policy,
) -> Result<(), GapError> {
    let least = if study.rollout.free { policy.least_event } else { policy.held_windows.least_event };
    let mut looked_at = [0; 2];
    for (fit, candidate) in fits.iter().zip(candidates) {
        if candidate.time().is_some_and(|[from, until]| until - from < least) {
            continue;
        }
        let count = &mut looked_at[usize::from(candidate.time().is_some())];
        *count += 1;
        if *count <= LOOKED_AT {
            candidate.held_out = Some(held_out_of(study, fit)?);
        }
    }
    Ok(())
}

fn held_out_of(study: &mut LinearisedProblem, fit: &Fit) -> Result<HeldOut, GapError> {
    let setting = study.columns.setting_of(&study.rollout, std::slice::from_ref(&fit.suspect));
    let closure = closure(study, &setting)?;
    let pair = |(fall, error): (f64, f64)| [fall, error];
    let is_event = matches!(fit.suspect.extent, Some(Extent::Time(_)));
    let falls = closure.before.iter().zip(&closure.after).map(|(b, a)| (b - a) / b);
    Ok(HeldOut {
        closed: closure.closed(),
        fall: pair(closure.fall(false)),
        fall_of_logarithm: pair(closure.fall(true)),
        fall_of_pieces: fit.held_out.map(|f| [f.mean, f.error]),
        actuator_residual: closure.actuator_residual(study, &setting),
        log_evidence: fit.suspect.extent.is_none().then(|| held_out_evidence(study, &setting)).transpose()?,
        falls: if is_event { falls.collect() } else { Vec::new() },
    })
}
