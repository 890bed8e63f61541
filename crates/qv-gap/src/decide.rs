//! Accuse or abstain. Causes are added one at a time; after each the calibrated simulator is put through the whole test
//! again, with its own sensitivities and its own null: what is explained must then look like no gap.

use crate::GapError;
use crate::closure::{Closure, closure, mean};
use crate::columns::{Extent, Suspect};
use crate::evidence::{Marginal, Normal, Sums};
use crate::local::place;
use crate::problem::Setting;
use crate::regions::is_within_reach;
use crate::search::{Fit, Search, fitted, held_out};
use crate::study::{Seen, Study};
use nalgebra::DVector;

/// Least log evidence of a cause, whatever the null says.
const LEAST_EVIDENCE: f64 = 45.0;
/// The same for one that is confined to a time or a region: there are many of those.
const LEAST_LOCAL_EVIDENCE: f64 = 60.0;
/// The same for an event: a contact that another engine resolves otherwise looks like a short blow.
const LEAST_EVENT_EVIDENCE: f64 = 200.0;
/// The same for a robot that is held, which has no contacts.
const LEAST_HELD_EVENT_EVIDENCE: f64 = 20.0;
/// Shortest event \[s\], of a robot on its feet and of one that is held.
const LEAST_EVENT: f64 = 0.15;
const LEAST_HELD_EVENT: f64 = 0.05;
/// Shortest event \[s\] of a robot on its feet whose evidence is not beyond doubt: a foot that is set down otherwise than in the simulator
/// looks like a push for half a stride. One of 4 recordings of another engine without an effect had one of 0.153 s.
const LEAST_PUSH: f64 = 0.25;
/// Over the largest log evidence that the effect reaches in simulated recordings without one.
const OVER_NULL: f64 = 1.3;
/// Evidence, in units of what a cause needs, from which on something is there though no cause is found: the right one may not be in
/// the library.
const SUSPICIOUS: f64 = 3.0;
/// A size below this many tolerances is no cause.
const LEAST_SIZE: f64 = 3.5;
/// What tolerated deviations imitate has little evidence however much of the gap it closes: the least evidence and size of a
/// cause that closes this share of the held-out gap.
const LEAST_FAINT_EVIDENCE: f64 = 20.0;
const LEAST_FAINT_SIZE: f64 = 3.0;
const FAINT_CLOSED: f64 = 0.5;
/// Log evidence from which on an event need not take a share of the excess: a robot that is pushed often, or stumbles, too.
pub const SURE_EVENT: f64 = 1000.0;
/// Log evidence from which on a steady first cause need take no share of the excess if windows that no fit has seen ask for it, too; and with
/// which, and this share, a cause need not lower the held-out loss, if only that does not rise: held out
/// are a quarter of the windows, and some of a dozen in which feet bounce are missed by the right bounce.
const SURE_EVIDENCE: f64 = 300.0;
const SURE_SHARE: f64 = 0.12;
/// Least share of the excess over the null that a cause takes away, or else of the held-out gap that it closes.
const LEAST_SHARE: f64 = 0.1;
const LEAST_CLOSED: f64 = 0.25;
/// Loss over that of the null up to which a robot has no gap that anyone should look for.
pub const NO_GAP: f64 = 1.45;
/// Loss over that of the null from which on the causes do not explain the recording. Another engine alone, with its contacts,
/// makes 1.2 to 1.4 without an effect, and up to 1.8 beside a large one.
pub const UNEXPLAINED: f64 = 1.8;
/// The same where the quieter windows are below this.
const UNEXPLAINED_AT_CONTACTS: f64 = 2.5;
const UNEXPLAINED_IN_QUIET: f64 = 1.5;
/// Share of the excess that every cause but the first must take away, or else of the held-out gap that the earlier ones left: what
/// engines differ in is no second cause. Tolerated deviations take most of a ground that lies lower upon them at little cost, so
/// that the excess hardly shows it and the held-out gap does.
const LEAST_LATER_SHARE: f64 = 0.3;
const LEAST_LATER_CLOSED: f64 = 0.4;
/// Standard errors by which the held-out loss must fall for a faint cause, and its logarithm where its mean falls by less than two.
const SURE_ERRORS: f64 = 3.0;
/// Log evidence in windows that no fit has seen, tolerated deviations at their best in them, from which on a steady first cause need not
/// lower what is left there without them.
pub const SURE_HELD_OUT: f64 = 5.0;
/// What the law of an actuator must leave beyond the null, and the share of it that a further cause must take away, for one
/// that takes little of the whole excess.
const LEAST_LAW_EXCESS: f64 = 0.5;
const LEAST_LAW_CLOSED: f64 = 0.5;
/// Suspects that are judged in a round, the best first.
const MOST_JUDGED: usize = 4;
/// Share of the windows that are the quieter ones.
const QUIETER: f64 = 0.75;
/// Held-out gap over the floor from which on one more cause is looked for.
const MUCH_LEFT: f64 = 2.0;

/// Losses per number in the windows of the fit, tolerated deviations at their best, over the mean of the null.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level {
    /// Of the recording.
    pub ratio: f64,
    /// The same in the quieter windows: feet that met the ground otherwise are in the others.
    pub quiet: f64,
    /// Mean loss per number of the null.
    pub null: f64,
    /// Numbers, weighted.
    pub count: f64,
}

impl Level {
    /// Whether what is left is what engines differ in: everywhere, or but for the windows in which feet met the ground otherwise.
    pub fn is_explained(&self) -> bool {
        self.ratio < UNEXPLAINED || (self.ratio < UNEXPLAINED_AT_CONTACTS && self.quiet < UNEXPLAINED_IN_QUIET)
    }
}

/// A round: one study and what was found in it.
#[derive(Clone)]
pub struct Round {
    /// Level before the round's causes.
    pub level: Level,
    /// All suspects that were followed, best first.
    pub fits: Vec<Fit>,
    /// Largest log evidence of each effect in recordings without one.
    pub by_chance: Vec<f64>,
    /// Loss before.
    pub base: f64,
    /// Whether nothing was accused before.
    pub is_first: bool,
    /// The accused one, as an index into `fits`.
    pub accused: Option<usize>,
    /// Other events that stand beside an accused event.
    pub also: Vec<usize>,
    /// Why the best was not accused.
    pub reason: String,
    /// Whether something steady has far more evidence than a cause needs.
    pub is_suspicious: bool,
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

/// Searches a study for a cause, the first or one more, among all effects but those in `without`.
///
/// # Errors
/// When a value means nothing.
pub fn round(study: &mut Study, without: &[usize], is_first: bool) -> Result<Round, GapError> {
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
    let (accused, also, reason) = (None, Vec::new(), String::new());
    let base = base.loss;
    let mut round = Round { level, fits, by_chance, base, is_first, accused, also, reason, is_suspicious: false };
    round.judge(study)?;
    Ok(round)
}

impl Round {
    /// Accuses the best suspect to which there is no objection. A better one that is no cause does not make a worse one
    /// a cause, unless it is a trifle, or chance alone reaches as much for it.
    fn judge(&mut self, study: &mut Study) -> Result<(), GapError> {
        let excess = self.base - self.level.null * self.level.count;
        self.is_suspicious =
            self.fits.iter().any(|f| f.suspect.extent.is_none() && f.evidence > SUSPICIOUS * self.needed(study, f));
        let mut judged = 0;
        for (k, fit) in self.fits.iter().enumerate() {
            // Blows of the contact stand beside any cause.
            let (is_blow, is_event) = (is_too_short(study, fit), is_event(fit));
            let has_evidence = fit.evidence >= self.needed(study, fit);
            let share = (self.base - fit.loss) / excess.max(1e-9);
            judged += usize::from(!is_blow && (has_evidence || !is_event));
            if judged > MOST_JUDGED {
                break;
            }
            let effect = study.columns.groups[fit.suspect.group].effect;
            let by_chance = self.by_chance[effect];
            let is_faint = self.is_first && is_faint(study, fit, by_chance);
            let mut reason = if is_faint { faint_objection(study, fit)? } else { objection(study, fit, by_chance) };
            if reason.is_none() && !is_faint {
                let later = !(self.is_first || (is_event && !study.problem.free));
                reason = held_out_objection(study, fit, share, later)?;
            }
            let Some(reason) = reason else {
                self.accused = Some(k);
                self.also = self.other_events(study, k);
                return Ok(());
            };
            if self.reason.is_empty() {
                self.reason = format!("{}: {reason}", study.columns.effects[effect].name);
            }
            // Nor does a faint push that was looked at: stumbles look like pushes beside any cause.
            let is_stumble = study.problem.free && is_event && fit.evidence < SURE_EVENT && share < LEAST_SHARE;
            if has_evidence && !is_blow && !is_stumble && !is_trifle(study, &fit.suspect) {
                return Ok(());
            }
        }
        Ok(())
    }

    /// Whether a fit is steady, larger than what any robot has, and has more evidence than a cause needs.
    pub fn speaks_for(&self, study: &Study, fit: &Fit) -> bool {
        let needed = self.needed(study, fit);
        fit.suspect.extent.is_none() && fit.evidence > needed && !is_trifle(study, &fit.suspect)
    }

    /// Log evidence that a cause of its kind needs.
    fn needed(&self, study: &Study, fit: &Fit) -> f64 {
        threshold(study, fit, self.by_chance[study.columns.groups[fit.suspect.group].effect])
    }

    /// Events at other times than that of the accused fit, if it is one, and than those of better ones.
    fn other_events(&self, study: &Study, accused: usize) -> Vec<usize> {
        let time = |k: usize| match self.fits[k].suspect.extent {
            Some(Extent::Time(t)) => Some(t),
            _ => None,
        };
        let Some(first) = time(accused) else { return Vec::new() };
        let (mut taken, mut others) = (vec![first], Vec::new());
        for k in 0..self.fits.len() {
            let Some([from, until]) = time(k) else { continue };
            let effect = study.columns.groups[self.fits[k].suspect.group].effect;
            let apart = taken.iter().all(|t| until <= t[0] || from >= t[1]);
            if apart && objection(study, &self.fits[k], self.by_chance[effect]).is_none() {
                taken.push([from, until]);
                others.push(k);
            }
        }
        others
    }
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

/// Whether a suspect deviates by no more than any robot may.
pub fn is_trifle(study: &Study, suspect: &Suspect) -> bool {
    size(study, suspect) < LEAST_SIZE
}

/// Log evidence that a suspect needs, given the most that chance alone reached for its effect.
fn threshold(study: &Study, fit: &Fit, by_chance: f64) -> f64 {
    let least = match fit.suspect.extent {
        None => own_threshold(study, fit).unwrap_or(LEAST_EVIDENCE),
        Some(Extent::Region(_)) => LEAST_LOCAL_EVIDENCE,
        Some(Extent::Time(_)) if study.problem.free => LEAST_EVENT_EVIDENCE,
        Some(Extent::Time(_)) => LEAST_HELD_EVENT_EVIDENCE,
    };
    least.max(OVER_NULL * by_chance)
}

/// Log evidence that the library states for an effect of a robot on its feet.
fn own_threshold(study: &Study, fit: &Fit) -> Option<f64> {
    let effect = &study.columns.effects[study.columns.groups[fit.suspect.group].effect];
    effect.least_evidence.filter(|_| study.problem.free && fit.suspect.extent.is_none())
}

/// Whether a fit is confined to a time.
fn is_event(fit: &Fit) -> bool {
    matches!(fit.suspect.extent, Some(Extent::Time(_)))
}

/// Whether a fit is an event too short to be a push.
fn is_too_short(study: &Study, fit: &Fit) -> bool {
    let least = match study.problem.free {
        true if fit.evidence < SURE_EVENT => LEAST_PUSH,
        true => LEAST_EVENT,
        false => LEAST_HELD_EVENT,
    };
    matches!(fit.suspect.extent, Some(Extent::Time([from, until])) if until - from < least)
}

/// Whether a fit of a robot on its feet is steady and has too little evidence, or too small a size, for a cause that closes little.
fn is_faint(study: &Study, fit: &Fit, by_chance: f64) -> bool {
    let size = size(study, &fit.suspect);
    let lacks = fit.evidence < threshold(study, fit, by_chance) || size < LEAST_SIZE;
    let enough = fit.evidence >= LEAST_FAINT_EVIDENCE.max(OVER_NULL * by_chance) && size >= LEAST_FAINT_SIZE;
    study.problem.free && fit.suspect.extent.is_none() && size.is_finite() && lacks && enough
}

/// What speaks against a faint cause: it closes little of a gap that no fit has seen.
fn faint_objection(study: &mut Study, fit: &Fit) -> Result<Option<String>, GapError> {
    let setting = study.columns.setting_of(&study.problem, std::slice::from_ref(&fit.suspect));
    let closure = closure(study, &setting)?;
    let (fall, error) = closure.fall(false);
    let (size, closed) = (size(study, &fit.suspect), 100.0 * closure.closed());
    let is_much = closure.closed() > FAINT_CLOSED && fall > SURE_ERRORS * error;
    Ok((!is_much).then(|| {
        format!(
            "log evidence {:.0} of a size of {size:.1} tolerances, which closes {closed:.0} % held out",
            fit.evidence
        )
    }))
}

fn objection(study: &Study, fit: &Fit, by_chance: f64) -> Option<String> {
    let effect = &study.columns.effects[study.columns.groups[fit.suspect.group].effect];
    if let (Some(Extent::Time([from, until])), true) = (fit.suspect.extent, is_too_short(study, fit)) {
        return Some(format!("an event of {:.0} ms is a blow of the contact, or noise", 1e3 * (until - from)));
    }
    let threshold = threshold(study, fit, by_chance);
    if fit.evidence < threshold {
        return Some(format!("log evidence {:.0} of the {threshold:.0} that a cause of its kind needs", fit.evidence));
    }
    if is_trifle(study, &fit.suspect) {
        return Some(format!("a size of {:.1} tolerances", size(study, &fit.suspect)));
    }
    // Limits are searched from next to nothing to far beyond what any motion reaches: a share of that is a large limit.
    let near = |edge: f64| if effect.levels_of.is_some() { 0.02 * edge.abs() } else { 0.01 * effect.span() };
    let at_edge = |v: &f64| effect.range.iter().any(|&edge| (v - edge).abs() < near(edge));
    // The edge may be the absence itself, for what cannot be negative.
    let values = fit.suspect.values.iter().filter(|v| at_edge(v));
    (values.count() > 0 && fit.suspect.extent.is_none()).then(|| "its value lies at the edge of its range".into())
}

/// Objections that take windows which no fit has seen. `share` is what the fit takes of the excess in its own windows.
/// `later` is whether causes were accused before.
fn held_out_objection(study: &mut Study, fit: &Fit, share: f64, later: bool) -> Result<Option<String>, GapError> {
    let setting = study.columns.setting_of(&study.problem, std::slice::from_ref(&fit.suspect));
    let closure = closure(study, &setting)?;
    let whole = closure.fall(matches!(fit.suspect.extent, Some(Extent::Region(_))));
    let (fall, error) = fit.held_out.map_or(whole, |f| (f.mean, f.error));
    if is_event(fit) {
        // An event may lie between the windows that are held out, or touch the edge of one: nothing is said then.
        let changes = closure.before.iter().zip(&closure.after).map(|(b, a)| (b - a) / b);
        let seen: Vec<f64> = changes.filter(|c| c.abs() > 0.02).collect();
        // One window alone may hold more than the event.
        let worse = seen.len() >= 2 && seen.iter().sum::<f64>() < 0.0;
        let worse = worse.then(|| format!("it makes {} windows that no fit has seen worse", seen.len()));
        let least = if later { LEAST_LATER_SHARE } else { LEAST_SHARE };
        let is_sure = !later && (fit.evidence > SURE_EVENT || !study.problem.free);
        return Ok(worse.or_else(|| (share < least && !is_sure).then(|| too_little(share, &closure))));
    }
    let by_law = fit.suspect.extent.is_none() && closes_law(closure.law(study, &setting));
    if later && by_law {
        return Ok(None);
    }
    if later && share < LEAST_LATER_SHARE && closure.closed() < LEAST_LATER_CLOSED {
        return Ok(Some(too_little(share, &closure)));
    }
    let has_own = own_threshold(study, fit).is_some();
    let has_much = share >= LEAST_SHARE || fit.evidence > SURE_EVIDENCE || has_own;
    if !later && fit.suspect.extent.is_none() && has_much && held_out_evidence(study, &setting)? > SURE_HELD_OUT {
        return Ok(None);
    }
    // Tolerated deviations can take most of a small effect upon them: what it closes without them counts, too. Most of the
    // excess of feet that slip is left by the right friction.
    let (in_logarithms, its_error) = closure.fall(true);
    let falls_all_over = in_logarithms > SURE_ERRORS * its_error;
    if fit.suspect.extent.is_none() && share < LEAST_SHARE && closure.closed() < LEAST_CLOSED && !falls_all_over {
        return Ok(Some(format!("it explains {:.0} % of the excess", 100.0 * share)));
    }
    let needed = if fit.suspect.extent.is_some() { 0.5 } else { 2.0 };
    // A few windows in which a foot missed a step make the mean fall uncertain, where nearly all windows fall.
    let nearly_all = fit.suspect.extent.is_none() && fall > 0.0 && falls_all_over;
    let is_sure = fit.evidence > SURE_EVIDENCE && share > SURE_SHARE && fall > -error;
    Ok((fall < needed * error && !nearly_all && !by_law && !is_sure)
        .then(|| format!("the held-out loss falls by {fall:.3} only, with error {error:.3}")))
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

/// Whether a correction takes away most of what the law of its actuators leaves. No contact has a part in that, so that what
/// engines differ in is no excuse.
pub fn closes_law([before, after]: [f64; 2]) -> bool {
    before > 1.0 + LEAST_LAW_EXCESS && after - 1.0 < (1.0 - LEAST_LAW_CLOSED) * (before - 1.0)
}

fn too_little(share: f64, closure: &Closure) -> String {
    let [share, closed] = [share, closure.closed()].map(|x| 100.0 * x);
    format!(
        "as a further cause it explains {share:.0} % of the excess and closes {closed:.0} % of what is left held out"
    )
}

/// Whether the corrected robot is far enough from the recording to look for one more cause.
///
/// # Errors
/// When a value means nothing.
pub fn is_much_left(study: &mut Study, level: &Level) -> Result<bool, GapError> {
    Ok(level.ratio >= NO_GAP || mean(&closure(study, &Setting::new())?.before) >= MUCH_LEFT * study.floor)
}
