//! Effects that act in a part of the recording only: an outside force for a while, ground of another friction in a
//! region. Where is found from the windows: first by a scan over runs of windows or rectangles, then in the simulator.

use crate::GapError;
use crate::inference::gaussian_evidence::Normal;
use crate::inference::linearised::{EXTRA, LinearisedWindow};
use crate::inference::regions::{
    Outline, around, never_left, overlap, place, rectangles, up_to_feet, whole_and_halves,
};
use crate::inference::search::{Base, Fit, RAN_AWAY, Search, direction, fitted};
use crate::inference::short_windows::feet;
use crate::problem::columns::{Column, Extent, Suspect};
use qv_core::statistics::median;
use qv_fit::linear::{
    add_diagonal, add_scaled, add_scaled_matrix, dot, minus, product, times, transposed_product, transposed_times,
};
use qv_fit::{Cholesky, Matrix};
use qv_rollout::Overrides;
use rayon::prelude::*;

/// Frictions that the ground is asked for.
const FRICTIONS: [f64; 6] = [0.6, 0.45, 0.32, 0.22, 0.14, 0.08];
/// Log evidence of a scan below which the simulator is not asked.
const WORTH_A_LOOK: f64 = 12.0;
/// Log evidence in whole windows that a region needs to be reported: ground on which feet slip has thousands, what a search finds where there is
/// none seldom as much, and to ask pieces of windows takes as long as all else.
const LEAST_REGIONAL: f64 = 30.0;
/// Most that one window counts in a scan for regions: a foot that landed elsewhere outweighs all others otherwise.
const MOST_GAIN: f64 = 40.0;
/// Most regions of a scan that the simulator is asked for.
const MOST_SCANNED: usize = 12;
/// Most events that are looked for in one recording.
const MOST_EVENTS: usize = 8;
/// Rounds of the pattern search; an event touches few windows, and takes little for each.
const ROUNDS: usize = 9;
const EVENT_ROUNDS: usize = 30;
/// Rounds after which the search leaves a region that is no better than none.
const HOPELESS_ROUNDS: usize = 4;
/// Share of the first steps of the search below which nothing is gained by smaller ones: a fraction of a millisecond, a ten thousandth of a range.
const LEAST_STEP: f64 = 0.002;

impl Search<'_, '_> {
    /// Suspects that act in a part of the recording, at their best.
    ///
    /// # Errors
    /// When a value means nothing.
    pub(crate) fn local_suspects(&mut self, base: &Base, without: &[usize]) -> Result<Vec<Fit>, GapError> {
        let mut fits = if self.study.is_relative { Vec::new() } else { self.events(base, without)? };
        // A foot that lands a millimetre early slips elsewhere: the deviations that the sound windows ask for are in all
        // that is simulated now, rather than added to it.
        self.deviant = self.sound_deviations(base);
        for (evidence, suspect) in self.scan_regions(base, without)? {
            if evidence > WORTH_A_LOOK {
                let found = self.refine(base, suspect)?.filter(|fit| fit.evidence > LEAST_REGIONAL);
                fits.extend(found.map(|fit| self.by_pieces(base, fit)).transpose()?);
            }
        }
        self.deviant.clear();
        Ok(fits)
    }

    /// The same fit with the friction and the outline that pieces of windows show.
    fn by_pieces(&mut self, base: &Base, fit: Fit) -> Result<Fit, GapError> {
        let Some(Extent::Region(region)) = fit.suspect.extent else { return Ok(fit) };
        let slip = self.slip(fit.suspect.group, region)?.filter(|s| s.gain > 0.0);
        let Some(slip) = slip else { return Ok(self.ended_at_feet(fit, region)) };
        let [friction, deviation] = slip.friction;
        let Outline { region: outline, deviations: of_edges } = slip.outline;
        let suspect = Suspect { values: vec![friction], extent: Some(Extent::Region(outline)), ..fit.suspect.clone() };
        let deviations: Vec<f64> = std::iter::once(deviation).chain(of_edges).collect();
        let loss = self.loss_at(base, std::slice::from_ref(&suspect))?[0];
        let of_none = self.loss_without(base, &suspect)?;
        let remarks = Fit { held_out: Some(slip.held_out), ..self.weighed(base, suspect, [of_none, loss], deviations) };
        // Where feet slip whole windows are missed by the right friction, too, and a wrong one may fit them better: pieces have the last word.
        if !remarks.loss.is_finite() {
            return Ok(self.ended_at_feet(fit, region));
        }
        let is_better = remarks.evidence > fit.evidence;
        Ok(if is_better { remarks } else { Fit { loss: fit.loss, evidence: fit.evidence, ..remarks } })
    }

    /// The same fit without ground on which nobody stood.
    fn ended_at_feet(&self, mut fit: Fit, region: [f64; 4]) -> Fit {
        let feet = feet(self.study);
        if !never_left(self.study, &feet, region) {
            fit.suspect.extent = Some(Extent::Region(up_to_feet(&feet, region)));
        }
        fit
    }

    /// Deviations, in columns, that the windows with no more than the usual loss ask for; and the loss per number that
    /// these windows keep, over that of all windows.
    fn sound(&self, base: &Base) -> Option<(Vec<f64>, f64)> {
        let of: Vec<f64> =
            base.normals.iter().map(|n| n.as_ref().map_or(f64::INFINITY, |n| n.e / n.count as f64)).collect();
        let most = 1.5 * median(&mut of.clone());
        let sound = |w: usize| self.windows.iter().position(|&x| x == w).is_some_and(|k| of[k] <= most);
        let weight = |s: &LinearisedWindow| {
            let w = self.study.seen.iter().position(|x| std::ptr::eq(x, s));
            if w.is_some_and(sound) { fitted(s) } else { 0.0 }
        };
        let marginal = self.study.marginal(weight).ok()?;
        let sums = self.study.sums(&base.normals, &self.windows, weight);
        let share = (marginal.loss(&sums) / sums.count) / (base.loss / base.sums.count);
        Some((marginal.deviations(&sums), share))
    }

    /// The same as values of the units.
    fn sound_deviations(&self, base: &Base) -> Vec<(usize, f64)> {
        let Some((amounts, _)) = self.sound(base) else { return Vec::new() };
        let columns = self.columns();
        let value = |(c, amount): (&Column, &f64)| {
            let absent = columns.units[c.unit].absent;
            (c.unit, absent + amount * (c.value - absent))
        };
        columns.columns[..columns.tolerated].iter().zip(amounts.iter().skip(EXTRA)).map(value).collect()
    }

    /// Residual of each window of the base with `deviations` taken away, as normal equations.
    fn left(&self, base: &Base, deviations: &[f64]) -> Vec<Option<Normal>> {
        let mut all = deviations.to_vec();
        all.resize(self.study.width(), 0.0);
        let left = |(n, &w): (&Option<Normal>, &usize)| {
            n.as_ref().map(|n| {
                let moved = times(&self.study.seen[w].h, deviations);
                let e = n.e - 2.0 * dot(&n.b, &all) + dot(&moved, &all);
                Normal { e, b: minus(&n.b, &moved), count: n.count }
            })
        };
        base.normals.par_iter().zip(&self.windows).map(left).collect()
    }

    /// Events, one after the other: each is looked for in what those before it leave.
    fn events(&mut self, base: &Base, without: &[usize]) -> Result<Vec<Fit>, GapError> {
        let mut now = base.clone();
        let (mut found, mut others): (Vec<Fit>, Vec<Fit>) = (Vec::new(), Vec::new());
        while found.len() < MOST_EVENTS {
            // Side by side: each touches few windows, and is too little for all threads.
            let suspects = self.scan_times(&now, without, &found);
            let refined = suspects.into_par_iter().map(|suspect| self.refine(&now, suspect));
            let mut fits: Vec<Fit> = refined.collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect();
            fits.sort_by(|a, b| a.loss.total_cmp(&b.loss));
            let rest = fits.split_off(1.min(fits.len()));
            let Some(best) = fits.pop().filter(|f| f.evidence > 0.0) else { break };
            let setting = self.settings(base, std::slice::from_ref(&best.suspect));
            now.normals = self.evaluate_touched(&now, std::slice::from_ref(&best.suspect), &setting)?.remove(0);
            now.sums = self.study.sums(&now.normals, &self.windows, fitted);
            now.loss = self.loss_of(&self.marginal, &now.normals, &self.windows);
            found.push(best);
            others.extend(rest);
        }
        // What all of them leave is the measure of what chance does.
        let dispersion = (self.dispersion * now.loss / base.loss).max(1.0);
        found.extend(others);
        found.iter_mut().for_each(|f| f.evidence *= self.dispersion / dispersion);
        Ok(found)
    }

    /// The two forces or torques for a while that would explain most, outside the time of those `found` already.
    fn scan_times(&self, base: &Base, without: &[usize], found: &[Fit]) -> Vec<Suspect> {
        // What acts for a while must not be mistaken for what any robot deviates by, nor for what nothing explains.
        let Some((deviations, share)) = self.sound(base) else { return Vec::new() };
        let dispersion = (self.dispersion * share).max(1.0);
        let mut left = self.left(base, &deviations);
        let length = self.study.rollout.cut.window;
        for (part, &w) in left.iter_mut().zip(&self.windows) {
            let start = self.study.seen[w].window.start;
            let during =
                |f: &Fit| matches!(f.suspect.extent, Some(Extent::Time([a, b])) if a < start + length && b > start);
            if found.iter().any(during) {
                *part = None;
            }
        }
        let runs = self.runs(base, &left, dispersion, without);
        let Some(&(_, first, last, _)) = runs.first() else { return Vec::new() };
        let alike = |r: &&(f64, usize, usize, Suspect)| r.0 > WORTH_A_LOOK && r.1 <= last && r.2 >= first;
        runs.iter().filter(alike).take(2).map(|r| r.3.clone()).collect()
    }

    /// For each force or torque the run of windows, first and last, in which it explains most; best first.
    fn runs(
        &self,
        base: &Base,
        left: &[Option<Normal>],
        dispersion: f64,
        without: &[usize],
    ) -> Vec<(f64, usize, usize, Suspect)> {
        let columns = self.columns();
        let length = self.study.rollout.cut.window;
        let start = |k: usize| self.study.seen[self.windows[k]].window.start;
        let of_group = |group: usize| {
            let g = &columns.groups[group];
            let effect = &columns.effects[g.effect];
            let taken = base.suspects.iter().any(|s| columns.groups[s.group].effect == g.effect);
            if !effect.local || without.contains(&g.effect) || taken {
                return None;
            }
            let d = direction(columns, group, 0)?;
            let wide: Vec<f64> = d.steps.iter().map(|s| (0.4 * effect.span() / s).abs()).collect();
            let part = |(n, &w): (&Option<Normal>, &usize)| {
                let n = n.as_ref()?;
                let along = transposed_times(&d.d, &n.b).iter().map(|x| x / dispersion).collect();
                let bent = transposed_product(&d.d, &product(&self.study.seen[w].h, &d.d));
                Some((along, bent * (1.0 / dispersion)))
            };
            let parts: Vec<_> = left.iter().zip(&self.windows).map(part).collect();
            let (evidence, first, last, amounts) = best_run(&parts, &wide)?;
            let clamped = |(a, s): (&f64, &f64)| (a * s).clamp(effect.range[0], effect.range[1]);
            let values = amounts.iter().zip(&d.steps).map(clamped).collect();
            let extent = Some(Extent::Time([start(first), start(last) + length]));
            Some((evidence, first, last, Suspect { group, values, extent }))
        };
        let mut found: Vec<_> = (0..columns.groups.len()).into_par_iter().filter_map(of_group).collect();
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        found
    }

    /// Rectangles of the ground that another friction would explain.
    fn scan_regions(&mut self, base: &Base, without: &[usize]) -> Result<Vec<(f64, Suspect)>, GapError> {
        let columns = self.columns();
        let is_friction = |e: usize| {
            columns.effects[e].axes.iter().any(|a| a.moves.contains_key("{ground}.friction")) && !without.contains(&e)
        };
        let Some(group) = columns.groups.iter().position(|g| is_friction(g.effect)) else { return Ok(Vec::new()) };
        if !self.study.rollout.free {
            return Ok(Vec::new());
        }
        let in_region = |mu: f64, region: [f64; 4]| {
            let extent = Some(Extent::Region(region));
            Suspect { group, values: vec![mu], extent }
        };
        let windows = self.windows.clone();
        let places: Vec<[f64; 2]> = windows.iter().map(|&w| place(&self.study.seen[w].window)).collect();
        // Without poses nobody knows where a region is.
        if places.iter().flatten().all(|x| !x.is_finite()) {
            return Ok(Vec::new());
        }
        let grounds = whole_and_halves(&places);
        let asked = grounds.iter().flat_map(|ground| FRICTIONS.map(|mu| (mu, *ground)));
        let asked: Vec<(f64, [f64; 4])> = std::iter::once((FRICTIONS[0], [0.0; 4])).chain(asked).collect();
        let all: Vec<Suspect> = asked.iter().map(|&(mu, region)| in_region(mu, region)).collect();
        let settings: Vec<Overrides> = self.settings(base, &all);
        let mut normals = self.study.evaluate(&settings, &windows)?;
        let before = normals.remove(0);
        let mut found: Vec<(f64, Suspect)> = Vec::new();
        for ((mu, ground), of_ground) in asked[1..].iter().zip(&normals) {
            // What each window gains or loses by this friction.
            let gains: Vec<f64> = (0..windows.len())
                .map(|k| match (&before[k], &of_ground[k]) {
                    (Some(b), Some(n)) => {
                        let count = n.count as f64;
                        let gain = 0.5 * count * ((1.0 + b.e / count) / (1.0 + n.e / count)).ln();
                        gain.clamp(-MOST_GAIN, MOST_GAIN)
                    }
                    _ => 0.0,
                })
                .collect();
            let regions = rectangles(&places, &gains).into_iter();
            found.extend(regions.map(|(gain, region)| (gain, in_region(*mu, overlap(region, *ground)))));
        }
        found.retain(|f| f.0 > WORTH_A_LOOK);
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        found.truncate(MOST_SCANNED);
        // The place of a window is that of the trunk, from which feet stand away in all directions.
        let moved = found.iter().flat_map(|(gain, s)| around(s).into_iter().map(|s| (*gain, s)));
        let moved: Vec<(f64, Suspect)> = moved.filter(|(_, s)| s.extent.is_some_and(|e| e.is_open())).collect();
        let suspects: Vec<Suspect> = moved.iter().map(|m| m.1.clone()).collect();
        let losses = self.loss_at(base, &suspects)?;
        let best = (0..losses.len()).min_by(|&a, &b| losses[a].total_cmp(&losses[b]));
        Ok(best.map(|k| moved[k].clone()).into_iter().collect())
    }

    /// A pattern search over values and extent (Hooke and Jeeves, Journal of the ACM 8, 1961), all points of a round
    /// simulated together.
    fn refine(&self, base: &Base, suspect: Suspect) -> Result<Option<Fit>, GapError> {
        let Some(extent) = suspect.extent else { return Ok(None) };
        let (group, columns) = (suspect.group, self.columns());
        let effect = columns.effects[columns.groups[group].effect].clone();
        let axes = suspect.values.len();
        let mut at: Vec<f64> = suspect.values.iter().copied().chain(extent.numbers()).collect();
        let mut steps: Vec<f64> = suspect.values.iter().map(|v| (0.4 * v.abs()).max(0.04 * effect.span())).collect();
        let edge = if matches!(extent, Extent::Time(_)) { 0.15 } else { 0.2 };
        steps.extend(extent.numbers().iter().map(|_| edge));
        let as_suspect = |at: &[f64]| {
            let values = at[..axes].iter().map(|v| v.clamp(effect.range[0], effect.range[1])).collect();
            Suspect { group, values, extent: Some(extent.with(&at[axes..])) }
        };
        let first_steps = steps.clone();
        let mut loss = self.loss_at(base, &[as_suspect(&at)])?[0];
        let of_none = self.loss_without(base, &as_suspect(&at))?;
        let is_region = matches!(extent, Extent::Region(_));
        let rounds = if is_region { ROUNDS } else { EVENT_ROUNDS };
        for round in 0..rounds {
            let is_settled = steps.iter().zip(&first_steps).all(|(s, first)| *s < LEAST_STEP * first);
            let is_hopeless = is_region && round == HOPELESS_ROUNDS && loss >= of_none;
            if is_settled || is_hopeless {
                break;
            }
            if round % 3 == 1 && is_region {
                // Whether a foot slips is a threshold: no slope leads from one side of it to the other.
                (at, loss) = self.best_friction(base, at, loss, &as_suspect)?;
            }
            let mut points = Vec::new();
            for k in 0..at.len() {
                for sign in [-1.0, 1.0] {
                    let mut moved = at.clone();
                    moved[k] += sign * steps[k];
                    points.push(moved);
                }
            }
            let suspects: Vec<Suspect> = points.iter().map(|p| as_suspect(p)).collect();
            let losses = self.loss_at(base, &suspects)?;
            // All that helps, together; the best alone if that is too much.
            let mut together = at.clone();
            let mut helped = false;
            for k in 0..at.len() {
                let (down, up) = (losses[2 * k], losses[2 * k + 1]);
                if down.min(up) < loss {
                    together[k] = points[2 * k + usize::from(up < down)][k];
                    helped = true;
                } else {
                    steps[k] *= 0.5;
                }
            }
            if !helped {
                continue;
            }
            let joint = self.loss_at(base, &[as_suspect(&together)])?[0];
            let best = (0..points.len()).min_by(|&a, &b| losses[a].total_cmp(&losses[b])).unwrap_or(0);
            if joint < losses[best] {
                (at, loss) = (together, joint);
            } else {
                (at, loss) = (points[best].clone(), losses[best]);
                steps.iter_mut().for_each(|s| *s *= 0.7);
            }
        }
        let deviations = self.spreads(base, &as_suspect(&at), loss, &steps)?;
        let fit = self.weighed(base, as_suspect(&at), [of_none, loss], deviations);
        Ok(fit.loss.is_finite().then_some(fit))
    }

    /// A suspect that is confined to an extent, by the losses without it and with it: with the evidence that it gains, less what its freedom
    /// costs.
    fn weighed(&self, base: &Base, suspect: Suspect, [before, loss]: [f64; 2], deviations: Vec<f64>) -> Fit {
        let axes = suspect.values.len();
        let columns = self.columns();
        let span = columns.effects[columns.groups[suspect.group].effect].span();
        let range = |k: usize| if k < axes { span } else { 10.0 };
        let cost =
            |(k, d): (usize, &f64)| (d.max(1e-6 * range(k)) * std::f64::consts::TAU.sqrt() / range(k)).ln().min(0.0);
        let volume: f64 = deviations.iter().enumerate().map(cost).sum();
        let regional = matches!(suspect.extent, Some(Extent::Region(_)));
        let dispersion = if regional { 1.0 } else { self.dispersion };
        let evidence = 0.5 * (before - loss) / dispersion + volume;
        // Reported on the scale of the other fits.
        let loss = base.loss - (before - loss);
        Fit { suspect, deviations, scatter: Vec::new(), loss, evidence, held_out: None }
    }

    /// Loss without a suspect that is confined to an extent.
    fn loss_without(&self, base: &Base, suspect: &Suspect) -> Result<f64, GapError> {
        if !matches!(suspect.extent, Some(Extent::Region(_))) {
            return Ok(base.loss);
        }
        let nowhere = Suspect { extent: Some(Extent::Region([0.0; 4])), ..suspect.clone() };
        let settings = self.settings(base, &[nowhere]);
        let windows = self.windows.clone();
        let normals = self.study.evaluate(&settings, &windows)?.remove(0);
        Ok(self.robust_loss(&normals))
    }

    /// The friction of a grid, with the same region, that leaves least.
    fn best_friction(
        &self,
        base: &Base,
        at: Vec<f64>,
        loss: f64,
        as_suspect: &dyn Fn(&[f64]) -> Suspect,
    ) -> Result<(Vec<f64>, f64), GapError> {
        let points: Vec<Vec<f64>> = FRICTIONS.iter().map(|mu| [&[*mu], &at[1..]].concat()).collect();
        let suspects: Vec<Suspect> = points.iter().map(|p| as_suspect(p)).collect();
        let losses = self.loss_at(base, &suspects)?;
        let best = (0..points.len()).min_by(|&a, &b| losses[a].total_cmp(&losses[b])).unwrap_or(0);
        Ok(if losses[best] < loss { (points[best].clone(), losses[best]) } else { (at, loss) })
    }

    /// Loss of suspects beside the base, all confined to extents of one kind. Where feet slip, a window that the right
    /// model misses is missed by far: such windows count by the logarithm (as with Student's t), so that a few do not
    /// outweigh all others.
    fn loss_at(&self, base: &Base, suspects: &[Suspect]) -> Result<Vec<f64>, GapError> {
        let open: Vec<bool> = suspects.iter().map(|s| s.extent.is_none_or(|e| e.is_open())).collect();
        let settings = self.settings(base, suspects);
        let windows = self.windows.clone();
        let normals = self.evaluate_touched(base, suspects, &settings)?;
        let regional = suspects.iter().any(|s| matches!(s.extent, Some(Extent::Region(_))));
        let loss = |(n, open): (&Vec<Option<Normal>>, &bool)| match (*open, regional) {
            (false, _) => f64::INFINITY,
            (true, true) => self.robust_loss(n),
            (true, false) => self.loss_of(&self.marginal, n, &windows),
        };
        Ok(normals.iter().zip(&open).map(loss).collect())
    }

    /// Normal equations under settings; of windows that no event touches, those of the base.
    fn evaluate_touched(
        &self,
        base: &Base,
        suspects: &[Suspect],
        settings: &[Overrides],
    ) -> Result<Vec<Vec<Option<Normal>>>, GapError> {
        let length = self.study.rollout.cut.window;
        let touches = |s: &Suspect, start: f64| match s.extent {
            Some(Extent::Time([from, until])) => from < start + length && until > start,
            _ => true,
        };
        let start = |w: usize| self.study.seen[w].window.start;
        let touched: Vec<usize> =
            (0..self.windows.len()).filter(|&k| suspects.iter().any(|s| touches(s, start(self.windows[k])))).collect();
        let some: Vec<usize> = touched.iter().map(|&k| self.windows[k]).collect();
        let of_some = self.study.evaluate(settings, &some)?;
        let whole = |normals: Vec<Option<Normal>>| {
            let mut all = base.normals.clone();
            touched.iter().zip(normals).for_each(|(&k, n)| all[k] = n);
            all
        };
        Ok(of_some.into_iter().map(whole).collect())
    }

    fn robust_loss(&self, normals: &[Option<Normal>]) -> f64 {
        let of = |(n, &w): (&Option<Normal>, &usize)| match n {
            None => {
                let seen = &self.study.seen[w];
                fitted(seen) * seen.residual.len() as f64 * (1.0 + RAN_AWAY).ln()
            }
            Some(n) => {
                let count = n.count as f64;
                fitted(&self.study.seen[w]) * count * (1.0 + n.e / count).ln()
            }
        };
        normals.iter().zip(&self.windows).map(of).sum()
    }

    /// Standard deviations of values and extent by the curvature of the loss on either side.
    fn spreads(&self, base: &Base, at: &Suspect, loss: f64, last: &[f64]) -> Result<Vec<f64>, GapError> {
        let Some(extent) = at.extent else { return Ok(Vec::new()) };
        let numbers: Vec<f64> = at.values.iter().copied().chain(extent.numbers()).collect();
        let axes = at.values.len();
        let group = at.group;
        let span = self.columns().effects[self.columns().groups[group].effect].span();
        let steps: Vec<f64> = (0..numbers.len())
            .map(|k| {
                last[k].max(if k < axes {
                    0.02 * span
                } else if axes + 2 == numbers.len() {
                    0.03
                } else {
                    0.05
                })
            })
            .collect();
        let mut points = Vec::new();
        for k in 0..numbers.len() {
            for sign in [-1.0, 1.0] {
                let mut moved = numbers.clone();
                moved[k] += sign * steps[k];
                points.push(Suspect {
                    group,
                    values: moved[..axes].to_vec(),
                    extent: Some(extent.with(&moved[axes..])),
                });
            }
        }
        let losses = self.loss_at(base, &points)?;
        let spread = |k: usize| {
            let rise = 0.5 * (losses[2 * k] + losses[2 * k + 1]) - loss;
            let flat =
                if rise.is_finite() && rise > 0.0 { steps[k] * (self.dispersion / rise).sqrt() } else { steps[k] };
            flat.min(4.0 * steps[k])
        };
        Ok((0..numbers.len()).map(spread).collect())
    }
}

/// The run of windows whose common amounts have most evidence, less what choosing it costs.
fn best_run(parts: &[Option<(Vec<f64>, Matrix)>], wide: &[f64]) -> Option<(f64, usize, usize, Vec<f64>)> {
    let axes = wide.len();
    let mut best: Option<(f64, usize, usize, Vec<f64>)> = None;
    let stiffness: Vec<f64> = wide.iter().map(|w| 1.0 / (w * w)).collect();
    let narrow: f64 = wide.iter().map(|w| w.ln()).sum();
    let longest = (parts.len() / 3).max(1);
    for first in 0..parts.len() {
        let (mut g, mut h) = (vec![0.0; axes], Matrix::zeros(axes, axes));
        add_diagonal(&mut h, &stiffness);
        for last in first..parts.len().min(first + longest) {
            let Some((dg, dh)) = &parts[last] else { continue };
            add_scaled(&mut g, 1.0, dg);
            add_scaled_matrix(&mut h, 1.0, dh);
            let Some(factor) = Cholesky::new(&h) else { continue };
            let amounts = factor.solve(&g);
            let volume = 0.5 * factor.log_determinant() + narrow;
            let evidence = 0.5 * dot(&g, &amounts) - volume - (parts.len() as f64 * longest as f64).ln();
            if best.as_ref().is_none_or(|b| evidence > b.0) {
                best = Some((evidence, first, last, amounts));
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_of_windows_with_one_force_is_found() {
        let part = |k: usize| {
            let force = if (6..9).contains(&k) { 5.0 } else { 0.01 * k as f64 };
            Some((vec![4.0 * force], Matrix::from_fn(1, 1, |_, _| 4.0)))
        };
        let parts: Vec<_> = (0..20).map(part).collect();
        let (evidence, first, last, amounts) = best_run(&parts, &[3.0]).unwrap();
        assert_eq!((first, last), (6, 8));
        assert!((amounts[0] - 5.0).abs() < 0.1 && evidence > 100.0);
        let silent: Vec<_> = (0..20).map(|_| Some((vec![0.0], Matrix::from_fn(1, 1, |_, _| 4.0)))).collect();
        assert!(best_run(&silent, &[3.0]).unwrap().0 < 0.0, "nothing is no evidence");
    }
}
