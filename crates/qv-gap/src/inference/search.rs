//! Which effect: suspects are ranked by a joint linear fit, then each is followed to its best value in the simulator.

use crate::GapError;
use crate::inference::gaussian_evidence::{Marginal, Normal, Sums, widen};
use crate::inference::linearised::{EXTRA, LinearisedProblem, LinearisedWindow};
use crate::problem::columns::{Columns, Suspect};
use crate::problem::library::{Effect, Scope};
use qv_core::statistics::median;
use qv_fit::linear::{add_outer, add_scaled, diagonal_of, dot, minus, product, squared, times, transposed_times};
use qv_fit::{Cholesky, Matrix};
use qv_rollout::Overrides;
use qv_sim::{ActsOn, JointField};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Groups of one effect that are followed.
const GROUPS_PER_EFFECT: usize = 3;
/// Deviation of the prior of a suspected value, as a share of its range.
pub(crate) const WIDE: f64 = 0.4;
/// Starts along the range of an effect of one axis, as shares of it.
const STARTS: [f64; 6] = [0.06, 0.15, 0.3, 0.5, 0.75, 1.0];
/// Rounds of Gauss-Newton.
const ROUNDS: usize = 3;
/// Steps tried in each round, as shares of the Gauss-Newton step.
const STEPS: [f64; 4] = [1.0, 0.5, 0.25, 1.6];
/// Loss per number of a window whose simulation ran away.
pub(crate) const RAN_AWAY: f64 = 50.0;
/// Windows looked at while starts are chosen; the share of them that all starts are tried in, and how many of a candidate's
/// starts are tried in the others, too.
const COARSE_WINDOWS: usize = 18;
const FIRST_LOOK: usize = 3;
const SECOND_LOOK: usize = 4;
/// Fits that are followed after the first look: this many at least, and those that gain this share of the best.
const FOLLOWED: usize = 8;
const SHARE_OF_BEST: f64 = 0.3;
/// Most fits that are followed.
const MOST_FOLLOWED: usize = 16;
/// Where a fit of one axis is looked round, as shares of the effect's range.
const AROUND: [f64; 8] = [-0.08, -0.04, -0.02, -0.01, 0.01, 0.02, 0.04, 0.08];
/// A round that lowers the loss by less was the last of a fit: half of it is a log evidence.
const SETTLED: f64 = 1.0;
/// After the first round, fits that gain less than this share of the best are left where they are.
const HOPELESS: f64 = 0.1;

/// Whitened residuals by window; `None` where the simulation ran away.
pub(crate) type Residuals = Vec<Option<Vec<f64>>>;

/// How much lower the loss of pieces is in windows that no fit has seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fall {
    /// Mean for each piece that is changed, and its standard error.
    pub mean: f64,
    /// See `mean`.
    pub error: f64,
    /// Share of what these pieces have more than those elsewhere.
    pub closed: f64,
}

/// A suspect at its best values.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// The group and its values.
    pub suspect: Suspect,
    /// Standard deviation of each value, as the curvature of the loss has it.
    pub deviations: Vec<f64>,
    /// The same as the scatter over windows has it (the sandwich: White, Econometrica 50, 1982, theorem 3.2); empty where it was not asked for.
    /// Windows differ by more than noise does where something is not modelled, and the curvature knows nothing of that.
    pub scatter: Vec<f64>,
    /// Loss in the windows of the fit, tolerated deviations at their best.
    pub loss: f64,
    /// Log evidence over that of no effect, divided by the dispersion.
    pub evidence: f64,
    /// Fall of the loss in windows that no fit has seen, where pieces of windows reported it.
    pub held_out: Option<Fall>,
}

/// A start of a candidate, given by its index, and what it leaves in a few windows.
struct Look {
    candidate: usize,
    suspect: Suspect,
    normals: Vec<Option<Normal>>,
}

/// What a search holds on to: effects accused so far, and the losses with them.
#[derive(Clone)]
pub struct Base {
    /// Accused already.
    pub suspects: Vec<Suspect>,
    /// Normal equations by window.
    pub normals: Vec<Option<Normal>>,
    /// Their sums over the windows of the fit.
    pub sums: Sums,
    /// Loss in these windows.
    pub loss: f64,
}

/// The windows of the fit and their weights.
pub fn fitted(seen: &LinearisedWindow) -> f64 {
    if seen.window.held_out { 0.0 } else { seen.weight }
}

/// The windows that no fit sees and their weights.
pub fn held_out(seen: &LinearisedWindow) -> f64 {
    if seen.window.held_out { seen.weight } else { 0.0 }
}

/// A search over the suspects of a study.
pub struct Search<'s, 'a> {
    pub(crate) study: &'s mut LinearisedProblem<'a>,
    /// Deviations integrated out over the windows of the fit.
    pub marginal: Marginal,
    pub(crate) windows: Vec<usize>,
    /// What losses are divided by.
    pub dispersion: f64,
    /// Units that deviate in all that is simulated.
    pub(crate) deviant: Vec<(usize, f64)>,
}

impl<'s, 'a> Search<'s, 'a> {
    /// A search in the windows that are not held out.
    ///
    /// # Errors
    /// When the normal equations are no good.
    pub fn new(study: &'s mut LinearisedProblem<'a>, dispersion: f64) -> Result<Self, GapError> {
        let marginal = study.marginal(fitted)?;
        let windows = (0..study.seen.len()).filter(|&w| fitted(&study.seen[w]) > 0.0).collect();
        Ok(Self { study, marginal, windows, dispersion, deviant: Vec::new() })
    }

    pub(crate) fn columns(&self) -> &Columns {
        &self.study.columns
    }

    /// The robot with `suspects` and nothing else.
    ///
    /// # Errors
    /// When a value means nothing.
    pub fn base(&mut self, suspects: &[Suspect]) -> Result<Base, GapError> {
        let windows = self.windows.clone();
        let normals = if suspects.is_empty() {
            windows.iter().map(|&w| Some(self.study.seen[w].nominal())).collect()
        } else {
            let setting = self.columns().setting_of(&self.study.rollout, suspects);
            self.study.evaluate(&[setting], &windows)?.remove(0)
        };
        let sums = self.study.sums(&normals, &windows, fitted);
        let loss = self.marginal.loss(&sums);
        Ok(Base { suspects: suspects.to_vec(), normals, sums, loss })
    }

    /// All suspects but those of the effects named in `without`, followed to their best values, best first.
    ///
    /// # Errors
    /// When a value means nothing.
    pub fn suspects(&mut self, base: &Base, without: &[usize]) -> Result<Vec<Fit>, GapError> {
        let candidates = self.candidates(base, without);
        let mut fits = self.start(base, candidates)?;
        let mut here = self.here(base, &fits)?;
        let mut live: Vec<usize> = (0..fits.len()).collect();
        for _ in 0..ROUNDS {
            self.improve(base, &mut fits, &mut here, &mut live)?;
            let most = fits.iter().map(|f| base.loss - f.loss).fold(0.0, f64::max);
            live.retain(|&k| base.loss - fits[k].loss >= HOPELESS * most);
        }
        self.judge(base, &mut fits, &here)?;
        let best = (0..fits.len()).max_by(|&a, &b| fits[a].evidence.total_cmp(&fits[b].evidence));
        if let Some(best) = best
            && self.polish(base, &mut fits[best], &mut here[best])?
        {
            self.judge(base, &mut fits[best..=best], &here[best..=best])?;
        }
        fits.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        Ok(fits)
    }

    /// Looks round the value of a fit of one axis for as long as that gains, and shows whether it moved. A latency needs it: commands
    /// are held, so that the loss jumps wherever the latency passes a whole tick, and a slope says little of what lies behind.
    fn polish(&mut self, base: &Base, fit: &mut Fit, here: &mut Residuals) -> Result<bool, GapError> {
        let [value] = fit.suspect.values[..] else { return Ok(false) };
        let effect = &self.columns().effects[self.columns().groups[fit.suspect.group].effect];
        let ([low, high], span) = (effect.range, effect.span());
        let windows = self.windows.clone();
        for _ in 0..ROUNDS {
            let at = |share: &f64| (fit.suspect.values[0] + share * span).clamp(low, high);
            let tried: Vec<Suspect> =
                AROUND.iter().map(|s| Suspect { values: vec![at(s)], ..fit.suspect.clone() }).collect();
            let vectors = self.study.raw_vectors(&self.settings(base, &tried), &windows)?;
            let before = fit.loss;
            for (suspect, residuals) in tried.into_iter().zip(vectors) {
                let loss = self.loss_of(&self.marginal, &self.normals(&residuals, &windows), &windows);
                if loss < fit.loss {
                    (fit.loss, fit.suspect, *here) = (loss, suspect, residuals);
                }
            }
            if before - fit.loss <= SETTLED {
                break;
            }
        }
        Ok(fit.suspect.values[0] != value)
    }

    /// A group followed from what one linear step says; `None` where that says nothing, or it does not gain.
    ///
    /// # Errors
    /// When a value means nothing.
    pub fn refined(&mut self, base: &Base, group: usize) -> Result<Option<Fit>, GapError> {
        let linear = self.linear(&base.sums).into_iter().find(|(_, s)| s.group == group);
        let Some((evidence, mut suspect)) = linear else { return Ok(None) };
        let [low, high] = self.columns().effects[self.columns().groups[group].effect].range;
        suspect.values.iter_mut().for_each(|v| *v = v.clamp(low, high));
        let mut fits = vec![Fit {
            suspect,
            deviations: Vec::new(),
            scatter: Vec::new(),
            loss: f64::INFINITY,
            evidence,
            held_out: None,
        }];
        let mut here = self.here(base, &fits)?;
        let mut live = vec![0];
        for _ in 0..ROUNDS {
            self.improve(base, &mut fits, &mut here, &mut live)?;
        }
        self.judge(base, &mut fits, &here)?;
        Ok(fits.pop().filter(|f| f.loss < base.loss && f.evidence.is_finite()))
    }

    /// Log evidence ratio of each group at each level by one linear step, with the values that it asks for.
    pub fn linear(&self, sums: &Sums) -> Vec<(f64, Suspect)> {
        let force = self.marginal.force(sums);
        let columns = self.columns();
        let mut found = Vec::new();
        let known = columns.groups.iter().enumerate().filter(|(_, g)| self.study.may_be(g));
        for (index, group) in known {
            let effect = &columns.effects[group.effect];
            for level in 0..effect.levels.len() {
                let Some(direction) = direction(columns, index, level) else { continue };
                let wide: Vec<f64> = direction.steps.iter().map(|s| (WIDE * effect.span() / s).abs()).collect();
                let step = widen(&self.marginal.curvature, &force, &direction.d, &wide, self.dispersion);
                let Some((evidence, amounts)) = step else { continue };
                let at = |(a, (step, absent)): (usize, (&f64, &f64))| {
                    if absent.is_finite() { absent + amounts[a] * step } else { direction.levels[a] }
                };
                let values = direction.steps.iter().zip(&direction.absent).enumerate().map(at).collect();
                found.push((evidence, Suspect::everywhere(index, values)));
            }
        }
        found
    }

    /// The most reporting groups of each effect.
    fn candidates(&self, base: &Base, without: &[usize]) -> Vec<Suspect> {
        let mut linear = self.linear(&base.sums);
        linear.sort_by(|a, b| b.0.total_cmp(&a.0));
        let taken: Vec<usize> = base.suspects.iter().map(|s| s.group).collect();
        let columns = self.columns();
        let mut chosen: Vec<Suspect> = Vec::new();
        // What pushes an arm all the time is a constant torque, which the library has for robots that are held.
        let is_steady = |e: &Effect| self.study.rollout.free || !e.local || e.scope != Scope::Joints;
        let sought = columns.effects.iter().enumerate().filter(|(e, x)| !without.contains(e) && is_steady(x));
        for (effect, _) in sought {
            let mut groups: Vec<usize> = Vec::new();
            let late = self.late_groups(effect);
            for (_, suspect) in linear.iter().filter(|(_, s)| columns.groups[s.group].effect == effect) {
                let group = suspect.group;
                // What is late in a replay is followed whatever a slope at a few milliseconds says of it.
                let is_led = groups.len() < GROUPS_PER_EFFECT || late.contains(&group);
                if is_led && !groups.contains(&group) && !taken.contains(&group) {
                    groups.push(group);
                    chosen.push(suspect.clone());
                }
            }
        }
        chosen
    }

    /// How late a group of joints is by the correlation of what was measured with what is simulated \[s\]: the median over its joints. `None`
    /// for effects that are no delay, and for joints that hardly move.
    fn lag_of(&self, group: usize) -> Option<f64> {
        let group = &self.columns().groups[group];
        if !self.is_delay(group.effect) {
            return None;
        }
        let mut lags: Vec<f64> = group.members.iter().filter_map(|&joint| *self.study.lags.get(joint)?).collect();
        // What the simulator was asked at is given by its slope there.
        let least = self.columns().effects[group.effect].levels[0];
        (!lags.is_empty()).then(|| median(&mut lags)).filter(|lag| *lag >= least)
    }

    /// Whether an effect makes joints late: in what they are reported, in what they do, or in what they report.
    fn is_delay(&self, effect: usize) -> bool {
        use JointField::{CommandLatency, EncoderLatency, Lag};
        let of = &self.columns().effects[effect];
        if of.scope != Scope::Joints || of.axes.len() != 1 {
            return false;
        }
        let units = self.columns().units.iter().filter(|u| u.effect == effect);
        let mut parts = units.flat_map(|u| &u.moves).map(|m| self.study.rollout.acts_on(m.0)).peekable();
        let is_late = |part| matches!(part, ActsOn::Joint(_, CommandLatency | EncoderLatency | Lag));
        parts.peek().is_some() && parts.all(is_late)
    }

    /// The groups of an effect that is a delay whose joints are late and whose others are not, by the squares that one lag of a group
    /// leaves, each more joint that needs one of its own counted against it: the best few.
    fn late_groups(&self, effect: usize) -> Vec<usize> {
        let columns = self.columns();
        let groups = (0..columns.groups.len()).filter(|&g| columns.groups[g].effect == effect);
        let left = |group: usize| {
            let lag = self.lag_of(group)?;
            let members = &columns.groups[group].members;
            let of_joint = |(joint, found): (usize, &Option<f64>)| {
                let expected = if members.contains(&joint) { lag } else { 0.0 };
                found.map_or(0.0, |found| (found - expected).powi(2))
            };
            Some((self.study.lags.iter().enumerate().map(of_joint).sum::<f64>(), group))
        };
        let mut by_rest: Vec<(f64, usize)> = groups.filter_map(left).collect();
        by_rest.sort_by(|a, b| a.0.total_cmp(&b.0));
        by_rest.into_iter().take(GROUPS_PER_EFFECT).map(|found| found.1).collect()
    }

    /// The best of several starts for each candidate, by a look at some of the windows: all starts in a few, the best of
    /// them in the others, too. Those candidates stay that promise most.
    fn start(&mut self, base: &Base, candidates: Vec<Suspect>) -> Result<Vec<Fit>, GapError> {
        let every = (self.windows.len() / COARSE_WINDOWS).max(1);
        let some: Vec<usize> = self.windows.iter().copied().step_by(every).collect();
        let few: Vec<usize> = some.iter().copied().step_by(FIRST_LOOK).collect();
        let others: Vec<usize> = some.iter().copied().filter(|w| !few.contains(w)).collect();
        let looks = self.first_look(base, &candidates, &few)?;
        let mut fits = self.second_look(base, looks, [few, others])?;
        fits.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        let most = fits.first().map_or(0.0, |f| f.evidence);
        let mut kept = 0;
        fits.retain(|f| {
            kept += 1;
            kept <= FOLLOWED || (kept <= MOST_FOLLOWED && f.evidence > SHARE_OF_BEST * most)
        });
        Ok(fits)
    }

    /// The starts of each candidate that lose least in a few windows, with what they leave there.
    fn first_look(&mut self, base: &Base, candidates: &[Suspect], few: &[usize]) -> Result<Vec<Look>, GapError> {
        let Some(marginal) = self.marginal_in(few) else { return Ok(Vec::new()) };
        let of_candidate = |c: &Suspect| {
            let starts = starts(self.columns(), c, self.lag_of(c.group));
            starts.into_iter().map(|v| Suspect::everywhere(c.group, v)).collect::<Vec<_>>()
        };
        let tried: Vec<Vec<Suspect>> = candidates.iter().map(of_candidate).collect();
        let mut normals = self.normals_of(base, &tried.concat(), few)?.into_iter();
        let mut looks = Vec::new();
        for (candidate, suspects) in tried.into_iter().enumerate() {
            let of_candidate = suspects.into_iter().zip(normals.by_ref());
            let mut by_loss: Vec<(f64, Look)> = of_candidate
                .map(|(suspect, normals)| {
                    (self.penalised(&marginal, &normals, few), Look { candidate, suspect, normals })
                })
                .collect();
            by_loss.sort_by(|a, b| a.0.total_cmp(&b.0));
            looks.extend(by_loss.into_iter().take(SECOND_LOOK).map(|x| x.1));
        }
        Ok(looks)
    }

    /// The start of each candidate that loses least in all windows that are looked at, the few and the others.
    fn second_look(
        &mut self,
        base: &Base,
        looks: Vec<Look>,
        [few, others]: [Vec<usize>; 2],
    ) -> Result<Vec<Fit>, GapError> {
        let suspects: Vec<Suspect> = looks.iter().map(|l| l.suspect.clone()).collect();
        let normals = self.normals_of(base, &suspects, &others)?;
        let all = [few, others].concat();
        let Some(marginal) = self.marginal_in(&all) else { return Ok(Vec::new()) };
        let of_base = self.loss_in(&marginal, base, &all);
        let mut best: BTreeMap<usize, Fit> = BTreeMap::new();
        for (Look { candidate, suspect, normals: first }, second) in looks.into_iter().zip(normals) {
            let loss = self.loss_of(&marginal, &[first, second].concat(), &all);
            if loss.is_finite() && best.get(&candidate).is_none_or(|b| loss < b.loss) {
                let evidence = of_base - loss;
                best.insert(
                    candidate,
                    Fit { suspect, deviations: Vec::new(), scatter: Vec::new(), loss, evidence, held_out: None },
                );
            }
        }
        Ok(best.into_values().collect())
    }

    /// Loss of the base in some of the windows of the fit.
    fn loss_in(&self, marginal: &Marginal, base: &Base, some: &[usize]) -> f64 {
        let of = |w: &usize| base.normals[self.windows.iter().position(|x| x == w).expect("one of them")].clone();
        self.loss_of(marginal, &some.iter().map(of).collect::<Vec<_>>(), some)
    }

    pub(crate) fn settings(&self, base: &Base, suspects: &[Suspect]) -> Vec<Overrides> {
        let beside = |s: &Suspect| [&base.suspects[..], std::slice::from_ref(s)].concat();
        let of = |s| self.columns().setting_beside(&self.study.rollout, &self.deviant, &beside(s));
        suspects.iter().map(of).collect()
    }

    /// Normal equations of each suspect beside the base, in some windows.
    fn normals_of(
        &mut self,
        base: &Base,
        suspects: &[Suspect],
        windows: &[usize],
    ) -> Result<Vec<Vec<Option<Normal>>>, GapError> {
        let settings = self.settings(base, suspects);
        self.study.evaluate(&settings, windows)
    }

    /// Deviations integrated out over some of the windows of the fit.
    fn marginal_in(&self, some: &[usize]) -> Option<Marginal> {
        let is_one = |s: &LinearisedWindow| some.iter().any(|&w| std::ptr::eq(&self.study.seen[w], s));
        self.study.marginal(|s| if is_one(s) { fitted(s) } else { 0.0 }).ok()
    }

    /// A window whose simulation ran away counts as one that is missed by far; where many do, the loss is infinite.
    pub(crate) fn loss_of(&self, marginal: &Marginal, normals: &[Option<Normal>], windows: &[usize]) -> f64 {
        let missing = normals.iter().filter(|n| n.is_none()).count();
        if 10 * missing > normals.len() { f64::INFINITY } else { self.penalised(marginal, normals, windows) }
    }

    /// The same however many windows are missed.
    fn penalised(&self, marginal: &Marginal, normals: &[Option<Normal>], windows: &[usize]) -> f64 {
        let lost = normals.iter().zip(windows).filter(|(n, _)| n.is_none());
        let penalty: f64 = lost.map(|(_, &w)| self.penalty(w)).sum();
        marginal.loss(&self.study.sums(normals, windows, fitted)) + penalty
    }

    /// What a window counts whose simulation ran away.
    fn penalty(&self, window: usize) -> f64 {
        let seen = &self.study.seen[window];
        fitted(seen) * RAN_AWAY * seen.residual.len() as f64
    }

    /// Whitened residuals of each fit at its present values.
    fn here(&mut self, base: &Base, fits: &[Fit]) -> Result<Vec<Residuals>, GapError> {
        let suspects: Vec<Suspect> = fits.iter().map(|f| f.suspect.clone()).collect();
        let settings = self.settings(base, &suspects);
        self.study.raw_vectors(&settings, &self.windows)
    }

    /// One round of Gauss-Newton for the fits that are `live`, all of them simulated together. Those stay live that moved
    /// by more than a trifle.
    fn improve(
        &mut self,
        base: &Base,
        fits: &mut [Fit],
        here: &mut [Residuals],
        live: &mut Vec<usize>,
    ) -> Result<(), GapError> {
        let windows = self.windows.clone();
        let tangents = self.tangents(base, fits, here, live)?;
        let mut tried = Vec::new();
        for (&k, tangent) in live.iter().zip(&tangents) {
            let fit = &mut fits[k];
            fit.loss = tangent.loss;
            fit.deviations = tangent.deviations(self.dispersion);
            let whole = tangent.step();
            for share in STEPS {
                let mut suspect = fit.suspect.clone();
                let effect = &self.columns().effects[self.columns().groups[suspect.group].effect];
                for (value, step) in suspect.values.iter_mut().zip(&whole) {
                    *value = (*value + share * step).clamp(effect.range[0], effect.range[1]);
                }
                tried.push(suspect);
            }
        }
        // Taken by reference in turn: the marginal stays whole while the study simulates.
        let settings = self.settings(base, &tried);
        let mut vectors = self.study.raw_vectors(&settings, &windows)?.into_iter();
        let mut tried = tried.into_iter();
        let mut moved = Vec::new();
        for (&k, tangent) in live.iter().zip(&tangents) {
            for (trial, residuals) in tried.by_ref().zip(vectors.by_ref()).take(STEPS.len()) {
                let loss = self.loss_of(&self.marginal, &self.normals(&residuals, &windows), &windows);
                if loss < fits[k].loss {
                    (fits[k].loss, fits[k].suspect, here[k]) = (loss, trial, residuals);
                }
            }
            if tangent.loss - fits[k].loss > SETTLED {
                moved.push(k);
            }
        }
        *live = moved;
        Ok(())
    }

    /// Normal equations of whitened residuals.
    pub(crate) fn normals(&self, residuals: &Residuals, windows: &[usize]) -> Vec<Option<Normal>> {
        let of = |(r, &w): (&Option<Vec<f64>>, &usize)| r.as_ref().map(|r| self.study.seen[w].normal_of(r));
        residuals.par_iter().zip(windows).map(of).collect()
    }

    /// Losses and slopes of the fits that are `live` at their present values, where residuals are `here`.
    fn tangents(
        &mut self,
        base: &Base,
        fits: &[Fit],
        here: &[Residuals],
        live: &[usize],
    ) -> Result<Vec<Tangent>, GapError> {
        let windows = self.windows.clone();
        let mut points = Vec::new();
        for fit in live.iter().map(|&k| &fits[k]) {
            let effect = &self.columns().effects[self.columns().groups[fit.suspect.group].effect];
            let step = 0.04 * effect.span();
            for axis in 0..fit.suspect.values.len() {
                let mut moved = fit.suspect.clone();
                let inwards = moved.values[axis] + step > effect.range[1];
                moved.values[axis] += if inwards { -step } else { step };
                points.push(moved);
            }
        }
        let settings = self.settings(base, &points);
        let raw = self.study.raw_vectors(&settings, &windows)?;
        // Where the moved points of each fit begin.
        let mut first = 0;
        let mut begins = Vec::new();
        for &k in live {
            begins.push((k, first));
            first += fits[k].suspect.values.len();
        }
        let tangent = |&(k, first): &(usize, usize)| {
            let values = &fits[k].suspect.values;
            let steps: Vec<f64> = (0..values.len()).map(|a| points[first + a].values[a] - values[a]).collect();
            let moved = raw[first..first + steps.len()].iter();
            let vectors: Vec<&Residuals> = std::iter::once(&here[k]).chain(moved).collect();
            let mut tangent = self.tangent(&vectors, &windows, &steps);
            if values.len() > 1 {
                // Of several axes one may show in nothing.
                let effect = &self.columns().effects[self.columns().groups[fits[k].suspect.group].effect];
                tangent.add_prior(values, &vec![WIDE * effect.span(); values.len()], self.dispersion);
            }
            tangent
        };
        let tangents = begins.par_iter().map(tangent).collect();
        Ok(tangents)
    }

    /// From residuals at the present values, and with each value moved by one of `steps`.
    pub(crate) fn tangent(&self, vectors: &[&Residuals], windows: &[usize], steps: &[f64]) -> Tangent {
        let axes = steps.len();
        let width = self.study.width();
        let mut gradient = vec![0.0; axes];
        let mut curvature = Matrix::zeros(axes, axes);
        let (mut b, mut along) = (vec![0.0; width], vec![vec![0.0; width]; axes]);
        let mut e = 0.0;
        let mut parts = Vec::new();
        for (i, &w) in windows.iter().enumerate() {
            let seen = &self.study.seen[w];
            let weight = fitted(seen);
            let of_window: Option<Vec<&Vec<f64>>> = vectors.iter().map(|v| v[i].as_ref()).collect();
            let Some(of_window) = of_window else {
                e += self.penalty(w);
                continue;
            };
            let slope = |a: usize| minus(of_window[0], of_window[1 + a]).iter().map(|d| d / steps[a]).collect();
            let slopes: Vec<Vec<f64>> = (0..axes).map(slope).collect();
            e += weight * squared(of_window[0]);
            let part = WindowSlopes::new(weight, seen, of_window[0], &slopes);
            add_scaled(&mut b, weight, &part.b);
            for a in 0..axes {
                add_scaled(&mut along[a], weight, &part.along[a]);
                gradient[a] += weight * dot(&slopes[a], of_window[0]);
                for c in 0..axes {
                    curvature[(a, c)] += weight * dot(&slopes[a], &slopes[c]);
                }
            }
            parts.push((w, part));
        }
        let scores = self.scores(&parts, &b, &along);
        for a in 0..axes {
            gradient[a] = self.marginal.inner(gradient[a], &along[a], &b);
            for c in 0..axes {
                curvature[(a, c)] = self.marginal.inner(curvature[(a, c)], &along[a], &along[c]);
            }
        }
        let loss = self.marginal.loss(&Sums { b, e, count: 0.0 });
        Tangent { loss, gradient, curvature, scores }
    }

    /// Half the slope of each window's loss along each axis, tolerated deviations at their best, shape `[windows][axes]`.
    fn scores(&self, parts: &[(usize, WindowSlopes)], b: &[f64], along: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let best = self.marginal.best(b);
        let answers: Vec<Vec<f64>> = along.iter().map(|a| self.marginal.best(a)).collect();
        let tolerated = best.len();
        let score = |(w, part): &(usize, WindowSlopes)| {
            let of_best = &times(&self.study.seen[*w].h, &best)[..tolerated];
            let b = &part.b[..tolerated];
            let of_axis = |a: usize| {
                let along = &part.along[a][..tolerated];
                // (slope - J answer)' (r - J best), without J.
                let left = part.products[a] - dot(along, &best) - dot(&answers[a], b) + dot(&answers[a], of_best);
                part.weight * left
            };
            (0..along.len()).map(of_axis).collect()
        };
        parts.iter().map(score).collect()
    }

    /// Evidence of each fit: what its loss gains, less what its freedom costs.
    fn judge(&mut self, base: &Base, fits: &mut [Fit], here: &[Residuals]) -> Result<(), GapError> {
        let all: Vec<usize> = (0..fits.len()).collect();
        let tangents = self.tangents(base, fits, here, &all)?;
        for (fit, tangent) in fits.iter_mut().zip(tangents) {
            fit.deviations = tangent.deviations(self.dispersion);
            fit.scatter = tangent.scatter();
            let group = &self.columns().groups[fit.suspect.group];
            let effect = &self.columns().effects[group.effect];
            let groups = self.columns().groups.iter().filter(|g| g.effect == group.effect).count();
            let range = effect.span();
            let volume: f64 = fit
                .deviations
                .iter()
                .map(|d| (d.max(1e-9 * range) * std::f64::consts::TAU.sqrt() / range).ln().min(0.0))
                .sum();
            let gain = 0.5 * (base.loss - fit.loss) / self.dispersion;
            fit.evidence = gain + volume - (groups as f64).ln();
        }
        Ok(())
    }
}

/// What a window gives to the slopes of a suspect.
struct WindowSlopes {
    weight: f64,
    /// `J'r`.
    b: Vec<f64>,
    /// `J's` of the slope `s` along each axis.
    along: Vec<Vec<f64>>,
    /// `s'r`.
    products: Vec<f64>,
}

impl WindowSlopes {
    fn new(weight: f64, seen: &LinearisedWindow, residual: &[f64], slopes: &[Vec<f64>]) -> Self {
        Self {
            weight,
            b: transposed_times(&seen.j, residual),
            along: slopes.iter().map(|s| transposed_times(&seen.j, s)).collect(),
            products: slopes.iter().map(|s| dot(s, residual)).collect(),
        }
    }
}

/// Slopes of the loss along the axes of a suspect.
pub(crate) struct Tangent {
    loss: f64,
    /// Half of the slope of the loss, downwards.
    pub(crate) gradient: Vec<f64>,
    /// Half of the curvature of the loss.
    pub(crate) curvature: Matrix,
    /// Half the slope of the loss of each window, shape `[windows][axes]`.
    scores: Vec<Vec<f64>>,
}

impl Tangent {
    /// The Gauss-Newton step; none where an axis shows in nothing.
    fn step(&self) -> Vec<f64> {
        let factor = Cholesky::new(&self.curvature);
        factor.map_or(vec![0.0; self.gradient.len()], |c| c.solve(&self.gradient))
    }

    /// Adds what normal priors about 0 of deviations `wide` say at `values`, for losses in units of `dispersion`.
    pub(crate) fn add_prior(&mut self, values: &[f64], wide: &[f64], dispersion: f64) {
        for (k, (value, wide)) in values.iter().zip(wide).enumerate() {
            let weight = dispersion / (wide * wide);
            self.gradient[k] -= weight * value;
            self.curvature[(k, k)] += weight;
        }
    }

    /// Standard deviation of each value by how much windows differ in what they ask for: `H^-1 S H^-1`, where `S` is the sum of the squares of
    /// the scores about their mean.
    pub(crate) fn scatter(&self) -> Vec<f64> {
        let (axes, count) = (self.gradient.len(), self.scores.len() as f64);
        let Some(inverse) = Cholesky::new(&self.curvature).map(|c| c.inverse()).filter(|_| count > 1.0) else {
            return vec![f64::INFINITY; axes];
        };
        let mut mean = vec![0.0; axes];
        self.scores.iter().for_each(|s| add_scaled(&mut mean, 1.0 / count, s));
        let mut squares = Matrix::zeros(axes, axes);
        self.scores.iter().for_each(|s| add_outer(&mut squares, count / (count - 1.0), &minus(s, &mean)));
        let variance = product(&product(&inverse, &squares), &inverse);
        diagonal_of(&variance).iter().map(|v| v.max(0.0).sqrt()).collect()
    }

    fn deviations(&self, dispersion: f64) -> Vec<f64> {
        let axes = self.gradient.len();
        match Cholesky::new(&self.curvature) {
            Some(c) => diagonal_of(&c.inverse()).iter().map(|v| (dispersion * v).sqrt()).collect(),
            None => vec![f64::INFINITY; axes],
        }
    }
}

/// A group at a level in terms of columns.
pub struct Direction {
    /// Shape `[columns, axes]`.
    pub d: Matrix,
    /// From absent to the level, by axis; 1 for limits.
    pub steps: Vec<f64>,
    /// Value when absent, by axis.
    pub absent: Vec<f64>,
    /// The level, by axis.
    pub levels: Vec<f64>,
}

/// `None` when a level of the group was not simulated.
pub fn direction(columns: &Columns, group: usize, level: usize) -> Option<Direction> {
    let group = &columns.groups[group];
    let axes = columns.effects[group.effect].axes.len();
    let width = EXTRA + columns.columns.len();
    let mut direction =
        Direction { d: Matrix::zeros(width, axes), steps: Vec::new(), absent: Vec::new(), levels: Vec::new() };
    for axis in 0..axes {
        let mut levels = Vec::new();
        let mut absent = 0.0;
        for unit in columns.units_of(group, axis) {
            let Some(column) = columns.column(unit, level) else { continue };
            direction.d[(EXTRA + column, axis)] = 1.0;
            levels.push(columns.columns[column].value);
            absent = columns.units[unit].absent;
        }
        if levels.is_empty() {
            return None;
        }
        let mean = levels.iter().sum::<f64>() / levels.len() as f64;
        direction.steps.push(if absent.is_finite() { mean - absent } else { 1.0 });
        direction.absent.push(absent);
        direction.levels.push(mean);
    }
    Some(direction)
}

/// Values to start a candidate from: what the linear step says, how late its joints are, and for a single axis points along the range.
fn starts(columns: &Columns, candidate: &Suspect, lag: Option<f64>) -> Vec<Vec<f64>> {
    let group = &columns.groups[candidate.group];
    let effect = &columns.effects[group.effect];
    let [low, high] = effect.range;
    let clamped: Vec<f64> = candidate.values.iter().map(|v| v.clamp(low, high)).collect();
    let mut starts = vec![clamped.clone()];
    starts.extend(lag.map(|lag| vec![lag.clamp(low, high)]));
    if candidate.values.len() > 1 {
        starts.push(clamped.iter().map(|v| 0.5 * v).collect());
        starts.push(clamped.iter().map(|v| (2.0 * v).clamp(low, high)).collect());
        return starts;
    }
    let absent = columns.units_of(group, 0).next().map_or(0.0, |u| columns.units[u].absent);
    if !absent.is_finite() {
        let levels = columns.units_of(group, 0).flat_map(|u| columns.columns.iter().filter(move |c| c.unit == u));
        let largest = levels.map(|c| c.value / effect.levels[c.level]).fold(0.0, f64::max);
        starts.extend([0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.25, 0.12].map(|s| vec![(s * largest).clamp(low, high)]));
        return starts;
    }
    for share in STARTS {
        for end in [low, high] {
            // Towards both ends of the range, as far as they are from absent.
            let value = absent + share * (end - absent);
            if (end - absent).abs() > 1e-9 * effect.span() {
                starts.push(vec![value]);
            }
        }
    }
    starts
}
