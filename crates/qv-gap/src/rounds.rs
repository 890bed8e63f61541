//! A round: one robot is searched for a cause, and all that a decision may ask of the candidates is measured. After an accusation the
//! calibrated simulator is put through the whole again, with its own sensitivities and its own null: what is explained must then
//! look like no gap.

use crate::GapError;
use crate::closure::{closure, mean};
use crate::columns::{Extent, Suspect};
use crate::decision::evidence::{Candidate, HeldOut, Level, Round};
use crate::decision::{Judge, Policy};
use crate::estimates::estimates_of;
use crate::evidence::{Marginal, Normal, Sums};
use crate::local::place;
use crate::problem::Setting;
use crate::regions::is_within_reach;
use crate::search::{Fit, Search, fitted, held_out};
use crate::study::{Seen, Study};
use nalgebra::DVector;

/// Candidates that are looked at in windows that no fit has seen: so many of the best that are no events, and so many events.
const LOOKED_AT: usize = 8;
/// Share of the windows that are the quieter ones.
const QUIETER: f64 = 0.75;

/// What a round found.
#[derive(Clone)]
pub struct Found {
    /// What was measured, and what is accused.
    pub round: Round,
    /// The fits that the candidates come from, in their order.
    pub fits: Vec<Fit>,
    /// Why the best was not accused; empty if it was.
    pub reason: String,
}

/// The level of a study.
///
/// # Errors
/// When the normal equations are no good.
pub fn level(study: &Study) -> Result<Level, GapError> {
    level_outside(study, &[])
}

/// The level in the windows outside some regions. Where feet slip, the residuals of a right model are not small: whether
/// a foot lets go is decided by what no recording shows.
///
/// # Errors
/// When the normal equations are no good.
pub fn level_outside(study: &Study, regions: &[[f64; 4]]) -> Result<Level, GapError> {
    let inside = |seen: &Seen| regions.iter().any(|r| is_within_reach(*r, place(&seen.window)));
    let outside = study.seen.iter().filter(|s| fitted(s) > 0.0 && !inside(s)).count();
    let loss = |seen: &Seen| seen.residual.norm_squared() / seen.residual.len() as f64;
    let mut losses: Vec<f64> = study.seen.iter().filter(|s| fitted(s) > 0.0).map(loss).collect();
    losses.sort_by(f64::total_cmp);
    let middle = losses.get(losses.len() / 2).copied().unwrap_or(0.0);
    // A robot that was on that ground all the time is judged by the quieter half of its windows.
    let counts = |seen: &Seen| if outside < 8 { loss(seen) <= middle } else { !inside(seen) };
    let fitted = |seen: &Seen| if regions.is_empty() || counts(seen) { fitted(seen) } else { 0.0 };
    let marginal = study.marginal(fitted)?;
    let of = |sums: &Sums| marginal.loss(sums) / sums.count.max(1.0);
    let all: Vec<usize> = (0..study.seen.len()).collect();
    let nulls: Vec<f64> =
        study.ghosts.iter().map(|g| of(&study.sums(g, &all, fitted))).filter(|x| x.is_finite()).collect();
    let null = nulls.iter().sum::<f64>() / nulls.len().max(1) as f64;
    let sums = study.nominal(fitted);
    let ratio = of(&sums) / null;
    // One that is held has no feet.
    let quiet = if study.problem.free { quiet(study, &marginal, fitted) } else { ratio };
    Ok(Level { ratio, quiet, null, count: sums.count })
}

/// Loss per number in the quieter windows, deviations at their best in all, over that of the null in its own.
fn quiet(study: &Study, marginal: &Marginal, weight: impl Fn(&Seen) -> f64 + Copy) -> f64 {
    let of = |residuals: &[Option<&DVector<f64>>]| {
        let left = study.without_deviations(marginal, residuals, weight);
        let mut losses: Vec<f64> = left.iter().flatten().map(|r| r.norm_squared() / r.len() as f64).collect();
        losses.sort_by(f64::total_cmp);
        losses.truncate((QUIETER * losses.len() as f64).ceil() as usize);
        mean(&losses)
    };
    let null: Vec<f64> = study.residuals_of_ghosts().map(|g| of(&g)).filter(|x| x.is_finite()).collect();
    of(&study.residuals()) / mean(&null)
}

/// Searches a study for a cause, the first or one more, among all effects but those in `without`, and judges what is found.
///
/// # Errors
/// When a value means nothing.
pub fn round(study: &mut Study, without: &[usize], is_first: bool, policy: &Policy) -> Result<Found, GapError> {
    let level = level(study)?;
    let mut search = Search::new(study, 1.0)?;
    let by_chance = by_chance(&search);
    let base = search.base(&[])?;
    let mut fits = search.suspects(&base, without)?;
    let best = fits.iter().map(|f| f.loss).fold(base.loss, f64::min);
    // What even the best leaves is the measure of what chance does in this recording.
    let temper = (best / (level.null * level.count)).max(1.0);
    search.temper = (base.loss / (level.null * level.count)).max(1.0);
    fits.iter_mut().for_each(|f| f.evidence /= temper);
    let mut local = search.local_suspects(&base, without)?;
    let regional = |f: &&mut Fit| matches!(f.suspect.extent, Some(Extent::Region(_)));
    local.iter_mut().filter(regional).for_each(|f| f.evidence *= search.temper / temper);
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
    let judgement = Judge::new(policy, &round, study.problem.free).judge();
    round.accused = judgement.accused;
    Ok(Found { round, fits, reason: judgement.reason })
}

fn candidate(study: &Study, fit: &Fit, by_chance: f64, share: f64) -> Candidate {
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
        log_evidence: fit.evidence,
        by_chance,
        least_evidence: effect.least_evidence,
        size: size(study, &fit.suspect),
        from_edge: fit.suspect.values.iter().flat_map(from_edge).fold(f64::INFINITY, f64::min),
        share,
        held_out: None,
    }
}

/// Looks at the best candidates in windows that no fit has seen.
fn look(study: &mut Study, fits: &[Fit], candidates: &mut [Candidate], policy: &Policy) -> Result<(), GapError> {
    let least = if study.problem.free { policy.least_event } else { policy.least_held_event };
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

fn held_out_of(study: &mut Study, fit: &Fit) -> Result<HeldOut, GapError> {
    let setting = study.columns.setting_of(&study.problem, std::slice::from_ref(&fit.suspect));
    let closure = closure(study, &setting)?;
    let pair = |(fall, error): (f64, f64)| [fall, error];
    let is_event = matches!(fit.suspect.extent, Some(Extent::Time(_)));
    let falls = closure.before.iter().zip(&closure.after).map(|(b, a)| (b - a) / b);
    Ok(HeldOut {
        closed: closure.closed(),
        fall: pair(closure.fall(false)),
        fall_of_logarithm: pair(closure.fall(true)),
        fall_of_pieces: fit.held_out.map(|f| [f.mean, f.error]),
        law: closure.law(study, &setting),
        log_evidence: fit.suspect.extent.is_none().then(|| held_out_evidence(study, &setting)).transpose()?,
        falls: if is_event { falls.collect() } else { Vec::new() },
    })
}

/// Largest log evidence of each effect in recordings without one, 0 at least.
fn by_chance(search: &Search) -> Vec<f64> {
    let most = vec![0.0; search.study.columns.effects.len()];
    let larger = |most: Vec<f64>, ghost: Vec<f64>| most.iter().zip(ghost).map(|(m, e)| e.max(*m)).collect();
    of_ghosts(search).into_iter().fold(most, larger)
}

/// Log evidence of each effect by one linear step, its best group's, in each recording without one: shape `[ghosts][effects]`.
pub fn of_ghosts(search: &Search) -> Vec<Vec<f64>> {
    let study = &search.study;
    let all: Vec<usize> = (0..study.seen.len()).collect();
    study.ghosts.iter().map(|ghost| by_effect(search, &study.sums(ghost, &all, fitted))).collect()
}

/// Log evidence of each effect by one linear step, its best group's; minus infinity of one that may not be.
pub fn by_effect(search: &Search, sums: &Sums) -> Vec<f64> {
    let columns = &search.study.columns;
    let mut best = vec![f64::NEG_INFINITY; columns.effects.len()];
    for (evidence, suspect) in search.linear(sums) {
        let effect = columns.groups[suspect.group].effect;
        best[effect] = evidence.max(best[effect]);
    }
    best
}

/// Deviation of a fit from absent, in tolerances; infinite for effects of which nothing is tolerated.
pub fn size(study: &Study, suspect: &Suspect) -> f64 {
    let group = &study.columns.groups[suspect.group];
    let effect = &study.columns.effects[group.effect];
    if effect.tolerance == 0.0 {
        return f64::INFINITY;
    }
    let of = |(axis, value): (usize, &f64)| {
        let absent = study.columns.units_of(group, axis).next().map_or(0.0, |u| study.columns.units[u].absent);
        (value - absent).abs() / effect.tolerance
    };
    suspect.values.iter().enumerate().map(of).fold(0.0, f64::max)
}

/// Log of how much likelier a setting makes the windows that no fit has seen, tolerated deviations integrated out over them, in units of
/// what is left in them.
///
/// # Errors
/// When a value means nothing.
pub fn held_out_evidence(study: &mut Study, setting: &Setting) -> Result<f64, GapError> {
    let windows: Vec<usize> = (0..study.seen.len()).filter(|&w| held_out(&study.seen[w]) > 0.0).collect();
    let marginal = study.marginal(held_out)?;
    let under = study.evaluate(std::slice::from_ref(setting), &windows)?.remove(0);
    let nominal: Vec<Option<Normal>> = windows
        .iter()
        .zip(&under)
        // What ran away is left out of both.
        .map(|(&w, n)| n.as_ref().map(|_| study.seen[w].nominal()))
        .collect();
    let [before, after] = [&nominal, &under].map(|n| study.sums(n, &windows, held_out));
    let level = marginal.loss(&after) / after.count.max(1.0);
    Ok(0.5 * (marginal.loss(&before) - marginal.loss(&after)) / level.max(1.0))
}
