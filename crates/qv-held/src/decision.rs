//! From evidence to a verdict: tests whose numbers are rates, shares or variances that the data give. Nothing is simulated.

use crate::distribution::{fisher_tail, student_quantile, student_tail};
use crate::evidence::{Change, Event, Evidence, HypothesisTest, PairTest, Square, best_first};
use crate::hypothesis::Tolerances;
use qv_fit::linear::{Cholesky, Matrix, dot};
use serde::{Deserialize, Serialize};

/// References from which on their spread is taken as a covariance of its own.
const MANY: usize = 8;
/// Fewest blocks without an event that say anything.
const FEWEST: usize = 4;

/// Share of recordings in which a size as large as the least one is found.
pub const POWER: f64 = 0.8;
/// Quantile of a normal number at that share.
const AT_POWER: f64 = 0.841_6;

/// What is asked of a decision.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Policy {
    /// Rate of a false accusation per diagnosis, of steady causes; events apart.
    pub alpha: f64,
    /// Rate at which a right size is refused because it moves with the bandwidth.
    pub alpha_bandwidth: f64,
    /// Coverage of the set of what may be the cause.
    pub level: f64,
    /// Least share of the excess over the references that a cause takes away.
    pub least_share: f64,
    /// By how much robots differ from their papers: for those without references.
    pub tolerances: Tolerances,
}

impl Default for Policy {
    fn default() -> Self {
        Self { alpha: 0.05, alpha_bandwidth: 0.01, level: 0.9, least_share: 0.5, tolerances: Tolerances::default() }
    }
}

/// How a hypothesis did in each test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Judgement {
    /// Probability of a size beyond what references show; alpha over the number of hypotheses is asked for.
    pub p_size: f64,
    /// Probability of predicting blocks that its fit has not seen as well by chance.
    pub p_blocks: f64,
    /// Probability of a size that moves as much with the bandwidth.
    pub p_bandwidth: f64,
    /// Whether its values are physical and those that name it are determined from zero.
    pub is_physical: bool,
    /// Share of the excess that it takes away.
    pub share: f64,
    /// Whether no test refuses it.
    pub passed: bool,
    /// Whether none would if it were the only hypothesis.
    #[serde(default)]
    pub passed_alone: bool,
    /// Whether it is as good as the best by chance.
    pub in_set: bool,
    /// Interval of each axis.
    pub ci95: Vec<[f64; 2]>,
    /// Size of each axis that is beyond what references show (test 1) in [`POWER`] of all recordings.
    pub least: Vec<f64>,
}

/// How a pair did.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PairJudgement {
    /// Tests of both numbers together.
    pub tests: Judgement,
    /// Probability of each member's size beside the other's; alpha over the number of hypotheses is asked for.
    pub p_members: [f64; 2],
    /// Probability of predicting blocks by chance so much better than a single cause, the largest over all of these.
    pub p_alone: f64,
    /// Share that it takes of what its better member leaves.
    pub share_beside: f64,
    /// Whether no test refuses it.
    pub passed: bool,
}

/// What is there.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Outcome {
    /// Nothing that references do not show, too.
    None,
    /// A steady cause, by its index, and whether it leaves no gap.
    Cause(usize, bool),
    /// Two steady causes, by the index of their pair, and whether they leave no gap.
    Pair(usize, bool),
    /// Torques from outside, and whether they leave no gap.
    Events(bool),
    /// Something, and nothing passed all tests.
    Unexplained,
}

/// A decision.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Decision {
    /// What is there.
    pub outcome: Outcome,
    /// Of each hypothesis.
    pub judged: Vec<Judgement>,
    /// Of each pair.
    pub pairs: Vec<PairJudgement>,
    /// Indices of hypotheses from the best on.
    pub order: Vec<usize>,
    /// Probability of a gap as large in a robot like its references.
    pub p_gap: f64,
    /// Whether no cause at all is as good as the best by chance.
    pub none_in_set: bool,
    /// Events that are reported.
    pub events: Vec<Event>,
}

/// Decides.
pub fn decide(evidence: &Evidence, policy: &Policy) -> Decision {
    let moderation = [
        moderation(evidence, |t| quadratic_mean(&t.left_out, &t.information), 1.0),
        moderation(evidence, of_change, 1.0),
    ];
    let mut judged: Vec<Judgement> = evidence.tested.iter().map(|t| judge(evidence, t, policy, moderation)).collect();
    let order = best_first(&evidence.tested, |tested| &tested.losses);
    let best = order.first().copied();
    let l0 = evidence.reference_loss();
    if let Some(best) = best {
        for k in 0..judged.len() {
            judged[k].in_set =
                p_better(&evidence.tested[best].losses, &evidence.tested[k].losses, l0) > 1.0 - policy.level;
        }
    }
    // The best of many is better by chance: none is thrown out at a level for each of them.
    let level = (1.0 - policy.level) / evidence.tested.len().max(1) as f64;
    let none_in_set = best.is_none_or(|b| p_better(&evidence.tested[b].losses, &evidence.none, l0) > level);
    let p_gap = p_gap(evidence, evidence.loss);
    let pairs = evidence.pairs.iter().map(|pair| judge_pair(evidence, pair, policy, moderation)).collect();
    let mut decision =
        Decision { outcome: Outcome::None, judged, pairs, order, p_gap, none_in_set, events: Vec::new() };
    decision.outcome = outcome(evidence, policy, &mut decision);
    if let Some((k, pair)) = pair_in_place_of(evidence, policy, &decision) {
        decision.events = Vec::new();
        decision.outcome = Outcome::Pair(k, crate::decision::p_gap(evidence, pair.test.loss) >= policy.alpha);
    }
    decision
}

/// The best pair that passed, where no single cause explains the gap; none where another pair predicts better than chance.
fn pair_in_place_of<'a>(evidence: &'a Evidence, policy: &Policy, decision: &Decision) -> Option<(usize, &'a PairTest)> {
    if !matches!(decision.outcome, Outcome::Unexplained | Outcome::Cause(_, false) | Outcome::Events(false)) {
        return None;
    }
    let order = best_first(&evidence.pairs, |pair| &pair.test.losses);
    let named = order.iter().copied().find(|&k| decision.pairs[k].passed)?;
    let (best, own) = (&evidence.pairs[order[0]].test.losses, &evidence.pairs[named].test.losses);
    let is_in_set = p_better(best, own, evidence.reference_loss()) > 1.0 - policy.level;
    is_in_set.then(|| (named, &evidence.pairs[named]))
}

/// A pair must need both of its members: each has a size beside the other's, predicts better with it, and leaves much without.
fn judge_pair(evidence: &Evidence, pair: &PairTest, policy: &Policy, moderation: [[f64; 2]; 2]) -> PairJudgement {
    let (test, l0) = (&pair.test, evidence.reference_loss());
    let tests = judge(evidence, test, policy, moderation);
    let (variance, freedom) = variances(evidence, test, moderation[0], 1.0);
    let last = test.size.len() - 1;
    let p_member = |i: usize| 2.0 * student_tail(test.size[i].abs() / variance[i].sqrt().max(1e-300), freedom.max(1.0));
    let p_members = [p_member(0), p_member(last)];
    let alone = pair.members.map(|k| &evidence.tested[k]);
    let single = evidence.tested.iter().map(|one| p_better(&test.losses, &one.losses, l0));
    let p_alone = single.fold(0.0, f64::max);
    let better = alone.iter().map(|one| one.loss).fold(f64::INFINITY, f64::min);
    let share_beside = (better - test.loss) / (better - l0).max(1e-12);
    let asked = policy.alpha / evidence.tested.len().max(1) as f64;
    let is_known = [0, last].iter().all(|&i| tests.ci95[i][0] * tests.ci95[i][1] > 0.0);
    // What lies within the tolerances is no cause of its own.
    let is_large = [0, last].iter().zip(pair.tolerances).all(|(&i, least)| test.size[i].abs() > least);
    let is_quiet = test.events.as_ref().unwrap_or(&evidence.events).is_empty();
    let passed = p_members.iter().all(|p| *p < asked)
        && p_alone < policy.alpha
        && is_known
        && is_large
        && is_within_ranges(test)
        && is_quiet
        && tests.share >= policy.least_share
        && share_beside >= policy.least_share;
    PairJudgement { tests, p_members, p_alone, share_beside, passed }
}

fn outcome(evidence: &Evidence, policy: &Policy, decision: &mut Decision) -> Outcome {
    let is_explained = |loss: f64| p_gap(evidence, loss) >= policy.alpha;
    let cause = decision.order.iter().copied().find(|&k| decision.judged[k].passed);
    let events_beside = |k: usize| evidence.tested[k].events.as_deref().unwrap_or(&evidence.events);
    if cause.is_some_and(|k| has_better_rival(evidence, decision, k)) {
        return Outcome::Unexplained;
    }
    if let Some(k) = cause {
        let left = events_beside(k);
        // What predicts its share of all blocks, events and all, from others is no torque of a moment.
        let is_steady = left.is_empty()
            || predicted_share(evidence, k) >= policy.least_share
            || acts_outside(evidence, k, left, policy, policy.alpha);
        if is_steady {
            decision.events = left.to_vec();
            return Outcome::Cause(k, is_explained(evidence.tested[k].loss) && left.is_empty());
        }
    }
    if !evidence.events.is_empty() {
        let narrow: Vec<usize> = (0..decision.judged.len())
            .filter(|&k| {
                decision.judged[k].p_size < policy.alpha
                    && evidence.tested[k].events.as_ref().is_some_and(Vec::is_empty)
            })
            .collect();
        let asked = policy.alpha / narrow.len().max(1) as f64;
        // What a steady hypothesis predicts, though a test refuses it, does not come from outside.
        let is_predicted = |k: usize| {
            decision.judged[k].p_size < policy.alpha / decision.judged.len() as f64
                && predicted_share(evidence, k) >= policy.least_share
        };
        if (0..decision.judged.len()).any(is_predicted) {
            return Outcome::Unexplained;
        }
        if narrow.iter().any(|&k| acts_outside(evidence, k, &evidence.events, policy, asked)) {
            return Outcome::Unexplained;
        }
        let quiet: Vec<f64> = outside(evidence, &evidence.events).map(|b| evidence.none[b]).collect();
        let (is_everywhere, quiet) = (quiet.len() < FEWEST, mean(&quiet));
        if is_everywhere || evidence.loss - quiet < policy.least_share * (evidence.loss - evidence.reference_loss()) {
            return Outcome::Unexplained;
        }
        decision.events = evidence.events.clone();
        return Outcome::Events(is_explained(quiet));
    }
    // None is thrown out of the set by a best member whose size is beyond the wander, uncorrected.
    let is_thrown_out =
        !decision.none_in_set && decision.order.first().is_some_and(|&k| decision.judged[k].p_size < policy.alpha);
    if decision.p_gap >= policy.alpha && !is_thrown_out { Outcome::None } else { Outcome::Unexplained }
}

/// Whether a hypothesis of another family, with no more numbers, predicts better than the cause and fails by the correction for their number alone:
/// which of the two it is cannot be said.
fn has_better_rival(evidence: &Evidence, decision: &Decision, cause: usize) -> bool {
    let named = &evidence.tested[cause];
    let is_rival = |k: &usize| {
        let other = &evidence.tested[*k];
        decision.judged[*k].passed_alone
            && other.hypothesis.family != named.hypothesis.family
            && other.size.len() <= named.size.len()
    };
    decision.order.iter().take_while(|k| **k != cause).any(is_rival)
}

/// Blocks that no event touches.
fn outside<'a>(evidence: &'a Evidence, events: &'a [Event]) -> impl Iterator<Item = usize> + 'a {
    let is_free = |b: &usize| {
        let [from, until] = evidence.blocks[*b];
        events.iter().all(|e| e.time[1] < from || e.time[0] > until)
    };
    (0..evidence.blocks.len()).filter(is_free)
}

/// Share of the excess over the references that a hypothesis takes away in blocks that its fit has not seen.
fn predicted_share(evidence: &Evidence, k: usize) -> f64 {
    let (own, none) = (mean(&evidence.tested[k].losses), mean(&evidence.none));
    (none - own) / (none - evidence.reference_loss()).max(1e-12)
}

/// Whether a hypothesis predicts blocks outside of the events, and takes its share there.
fn acts_outside(evidence: &Evidence, k: usize, events: &[Event], policy: &Policy, alpha: f64) -> bool {
    let picked: Vec<usize> = outside(evidence, events).collect();
    let of = |all: &[f64]| -> Vec<f64> { picked.iter().map(|&b| all[b]).collect() };
    let (own, none, l0) = (of(&evidence.tested[k].losses), of(&evidence.none), evidence.reference_loss());
    let share = (mean(&none) - mean(&own)) / (mean(&none) - l0).max(1e-12);
    picked.len() >= FEWEST && p_better(&own, &none, l0) < alpha && share >= policy.least_share
}

/// Whether all numbers are values that are physical.
fn is_within_ranges(t: &HypothesisTest) -> bool {
    t.hypothesis.axes.iter().zip(&t.size).all(|(axis, size)| (axis.range[0]..=axis.range[1]).contains(size))
}

fn judge(evidence: &Evidence, t: &HypothesisTest, policy: &Policy, [of_size, of_change]: [[f64; 2]; 2]) -> Judgement {
    let l0 = evidence.reference_loss();
    let p_size = p_size(evidence, (&t.size, &t.sandwich, &t.left_out), (&t.information, &t.drift), of_size);
    let p_bandwidth = t.change.as_ref().map_or(1.0, |c| p_size_of_change(evidence, c, &t.information, of_change));
    let p_blocks = p_better(&t.acted[1], &t.acted[0], t.reference_acted);
    let ci95 = intervals(evidence, t, of_size, l0);
    let least = least_sizes(evidence, t, of_size, policy);
    // The mass of a load names it: the other numbers are its place. Of joints with a number each every one must be there.
    let names = match t.hypothesis.effect.as_str() {
        "com_offset" => 0,
        _ if t.hypothesis.load_on.is_some() => 1,
        _ => t.size.len(),
    };
    let is_known = (0..names).all(|i| ci95[i][0] * ci95[i][1] > 0.0);
    let is_physical = is_known && is_within_ranges(t);
    let share = if evidence.loss > l0 { (evidence.loss - t.loss) / (evidence.loss - l0) } else { 0.0 };
    let count = evidence.tested.len().max(1) as f64;
    let passed_alone = p_size < policy.alpha
        && p_blocks < policy.alpha
        && (p_bandwidth >= policy.alpha_bandwidth || stays(t, policy))
        && is_physical
        && evidence.loss > l0
        && share >= policy.least_share;
    let passed = passed_alone && p_size < policy.alpha / count;
    Judgement { p_size, p_blocks, p_bandwidth, is_physical, share, passed, passed_alone, in_set: false, ci95, least }
}

/// Whether the part of a size that does not move with the bandwidth is its share: references, which have none, do not say how far
/// a large size wanders in proportion.
fn stays(t: &HypothesisTest, policy: &Policy) -> bool {
    let moved = t.change.as_ref().map_or(0.0, |c| quadratic(&c.size, &t.information));
    moved.sqrt() <= (1.0 - policy.least_share) * quadratic(&t.size, &t.information).sqrt()
}

/// Test 1: a size beyond what references show.
fn p_size(
    evidence: &Evidence,
    (size, sandwich, left_out): (&[f64], &Square, &[Vec<f64>]),
    (information, drift): (&Square, &[f64]),
    [freedom, prior]: [f64; 2],
) -> f64 {
    let (k, r) = (size.len() as f64, left_out.len() as f64);
    if evidence.references >= MANY {
        // Hotelling's: the spread of references in physical units, and the recording's own error.
        let spread = sum(&mean_outer(left_out), sandwich);
        return match Cholesky::new(&spread) {
            Some(factor) if r > k => fisher_tail(factor.length(size) * (r - k + 1.0) / (k * r), k, r - k + 1.0),
            _ => 1.0,
        };
    }
    let phi = moderated(quadratic_mean(left_out, information), r * k, [freedom, prior])
        .max(trace_of_product(information, sandwich) / k);
    let Some(inverse) = Cholesky::new(&matrix(information)).map(|f| f.inverse()) else { return 1.0 };
    let spread =
        Matrix::from_fn(size.len(), size.len(), |i, j| phi * inverse[(i, j)] + if i == j { drift[i] } else { 0.0 });
    Cholesky::new(&spread).map_or(1.0, |factor| fisher_tail(factor.length(size) / k, k, r + freedom))
}

fn p_size_of_change(evidence: &Evidence, change: &Change, information: &Square, moderation: [f64; 2]) -> f64 {
    let drift = vec![0.0; change.size.len()];
    p_size(evidence, (&change.size, &change.sandwich, &change.left_out), (information, &drift), moderation)
}

fn of_change(t: &HypothesisTest) -> f64 {
    t.change.as_ref().map_or(f64::NAN, |c| quadratic_mean(&c.left_out, &t.information))
}

/// Intervals of 95 %.
fn intervals(evidence: &Evidence, t: &HypothesisTest, moderation: [f64; 2], l0: f64) -> Vec<[f64; 2]> {
    // What the cause leaves over the references is as uncertain (Birge, Physical Review 40, 1932).
    let (variance, freedom) = variances(evidence, t, moderation, (t.loss / l0.max(1e-12)).max(1.0));
    let quantile = student_quantile(0.025, freedom.max(1.0));
    let of = |(i, (x, v)): (usize, (&f64, f64))| {
        let half = quantile * (v + t.unseen[i][i]).sqrt();
        [x - half, x + half]
    };
    t.size.iter().zip(variance).enumerate().map(of).collect()
}

/// Sizes that test 1 finds with [`POWER`], each axis by itself: `(t + z) sigma`.
fn least_sizes(evidence: &Evidence, t: &HypothesisTest, moderation: [f64; 2], policy: &Policy) -> Vec<f64> {
    let (variance, freedom) = variances(evidence, t, moderation, 1.0);
    let level = policy.alpha / (2.0 * evidence.tested.len().max(1) as f64);
    let quantile = student_quantile(level, freedom.max(1.0));
    variance.iter().map(|v| (quantile + AT_POWER) * v.sqrt()).collect()
}

/// Variances of the axes by how sizes wander in references, `scale` times where these are few; their degrees of freedom.
fn variances(evidence: &Evidence, t: &HypothesisTest, [freedom, prior]: [f64; 2], scale: f64) -> (Vec<f64>, f64) {
    let (k, r) = (t.size.len(), t.left_out.len() as f64);
    if evidence.references >= MANY {
        let spread = sum(&mean_outer(&t.left_out), &t.sandwich);
        return ((0..k).map(|i| spread[(i, i)]).collect(), r);
    }
    let own = quadratic_mean(&t.left_out, &t.information);
    let floor = trace_of_product(&t.information, &t.sandwich) / k as f64;
    let phi = moderated(own, r * k as f64, [freedom, prior]).max(floor) * scale;
    let inverse = Cholesky::new(&matrix(&t.information)).map(|f| f.inverse());
    let of = |i: usize| inverse.as_ref().map_or(f64::INFINITY, |m| phi * m[(i, i)]) + t.drift[i];
    ((0..k).map(of).collect(), r + freedom)
}

/// Prior degrees of freedom and value of the spread of hypotheses, by its spread over all (Smyth, Statistical Applications in Genetics and
/// Molecular Biology 3, 2004, section 6.2), no more than hypotheses have themselves.
fn moderation(evidence: &Evidence, of: impl Fn(&HypothesisTest) -> f64, least: f64) -> [f64; 2] {
    let r = evidence.references as f64;
    let all: Vec<(f64, f64)> = evidence
        .tested
        .iter()
        .map(|t| (of(t), r * t.size.len() as f64))
        .filter(|(phi, _)| phi.is_finite() && *phi > 0.0)
        .map(|(phi, d)| (phi.ln() - digamma(0.5 * d) + (0.5 * d).ln(), d))
        .collect();
    if all.len() < 3 {
        return [0.0, 0.0];
    }
    let centre = all.iter().map(|x| x.0).sum::<f64>() / all.len() as f64;
    let variance = all.iter().map(|x| (x.0 - centre).powi(2)).sum::<f64>() / (all.len() - 1) as f64;
    let beyond = variance - all.iter().map(|x| trigamma(0.5 * x.1)).sum::<f64>() / all.len() as f64;
    let freedom = if beyond <= 0.0 { f64::INFINITY } else { 2.0 * inverse_trigamma(beyond) };
    let freedom = freedom.min(all.len() as f64).max(least);
    [freedom, (centre + digamma(0.5 * freedom) - (0.5 * freedom).ln()).exp()]
}

fn moderated(own: f64, d: f64, [freedom, prior]: [f64; 2]) -> f64 {
    (d * own + freedom * prior) / (d + freedom)
}

/// Test 2: probability that losses as much lower than others come by chance; blocks after one another may be alike (Newey and West,
/// Econometrica 55, 1987, one lag).
pub(crate) fn p_better(own: &[f64], other: &[f64], l0: f64) -> f64 {
    let gain: Vec<f64> = own.iter().zip(other).map(|(a, b)| ((b + l0) / (a + l0)).ln()).collect();
    let count = gain.len() as f64;
    if count < 3.0 {
        return 1.0;
    }
    let middle = mean(&gain);
    let about: Vec<f64> = gain.iter().map(|g| g - middle).collect();
    let variance = (dot(&about, &about) / count).max(0.0);
    let lagged = dot(&about[1..], &about[..about.len() - 1]) / count;
    let whole = (variance + lagged).max(variance * 0.5).max(1e-300);
    student_tail(middle / (whole / (count - 1.0)).sqrt(), count - 1.0)
}

/// Probability of a loss as large in a robot that is as its references are.
fn p_gap(evidence: &Evidence, loss: f64) -> f64 {
    let r = evidence.left_out.len() as f64;
    if evidence.references >= MANY {
        let most_free = evidence.left_out.iter().map(|l| l[1]).fold(0.0, f64::max);
        let log = |l: f64, free: f64| (l / free.min(most_free).max(1e-12)).max(1e-12).ln();
        let over_free = evidence.left_out.iter().map(|l| log(l[0], l[1])).collect::<Vec<f64>>();
        let alone = evidence.left_out.iter().map(|l| l[0].max(1e-12).ln()).collect::<Vec<f64>>();
        // A robot that is quieter than the fleet leaves much over its freest fit, and yet no more than the fleet leaves.
        return p_above(log(loss, evidence.free), &over_free).max(p_above(loss.max(1e-12).ln(), &alone));
    }
    let most_free = evidence.left_out.iter().map(|l| l[1]).fold(0.0, f64::max);
    let own = loss - evidence.free.min(most_free);
    let excess = evidence.left_out.iter().map(|l| l[0] - l[1]).sum::<f64>() / r;
    fisher_tail(own / excess.max(1e-12), 1.0, r)
}

/// Probability that another value of a normal sample is as large.
fn p_above(value: f64, sample: &[f64]) -> f64 {
    let (count, middle) = (sample.len() as f64, mean(sample));
    let variance = sample.iter().map(|x| (x - middle).powi(2)).sum::<f64>() / (count - 1.0);
    student_tail((value - middle) / (variance * (1.0 + 1.0 / count)).sqrt().max(1e-12), count - 1.0)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn matrix(a: &Square) -> Matrix {
    Matrix::from_fn(a.len(), a.len(), |i, k| a[i][k])
}

fn sum(a: &Matrix, b: &Square) -> Matrix {
    Matrix::from_fn(a.nrows(), a.ncols(), |i, k| a[(i, k)] + b[i][k])
}

fn mean_outer(all: &[Vec<f64>]) -> Matrix {
    let size = all.first().map_or(0, Vec::len);
    let mut out = Matrix::zeros(size, size);
    all.iter().for_each(|x| qv_fit::linear::add_outer(&mut out, 1.0 / all.len() as f64, x));
    out
}

fn quadratic(x: &[f64], a: &Square) -> f64 {
    x.iter().zip(a).map(|(xi, row)| xi * dot(row, x)).sum()
}

fn quadratic_mean(all: &[Vec<f64>], information: &Square) -> f64 {
    let k = information.len().max(1) as f64;
    all.iter().map(|h| quadratic(h, information) / k).sum::<f64>() / all.len().max(1) as f64
}

fn trace_of_product(a: &Square, b: &Square) -> f64 {
    (0..a.len()).map(|i| (0..a.len()).map(|k| a[i][k] * b[k][i]).sum::<f64>()).sum()
}

/// By recurrence and the asymptotic series (Abramowitz and Stegun, 6.3.18).
fn digamma(mut x: f64) -> f64 {
    let mut value = 0.0;
    while x < 8.0 {
        value -= 1.0 / x;
        x += 1.0;
    }
    let s = 1.0 / (x * x);
    value + x.ln() - 0.5 / x - s * (1.0 / 12.0 - s * (1.0 / 120.0 - s / 252.0))
}

/// The same (6.4.12).
fn trigamma(mut x: f64) -> f64 {
    let mut value = 0.0;
    while x < 8.0 {
        value += 1.0 / (x * x);
        x += 1.0;
    }
    let s = 1.0 / (x * x);
    value + 1.0 / x + 0.5 * s + s / x * (1.0 / 6.0 - s * (1.0 / 30.0 - s / 42.0))
}

/// By bisection of the logarithm.
fn inverse_trigamma(value: f64) -> f64 {
    let (mut low, mut high) = (1e-6f64.ln(), 1e9f64.ln());
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if trigamma(middle.exp()) > value { low = middle } else { high = middle }
    }
    (0.5 * (low + high)).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gamma_functions_are_those_of_the_tables() {
        let euler = 0.577_215_664_901_532_9;
        assert!((digamma(1.0) + euler).abs() < 1e-9 && (digamma(0.5) + euler + 2.0 * 2f64.ln()).abs() < 1e-9);
        assert!((trigamma(1.0) - std::f64::consts::PI.powi(2) / 6.0).abs() < 1e-8);
        assert!((inverse_trigamma(trigamma(3.7)) - 3.7).abs() < 1e-9);
    }

    #[test]
    fn lower_losses_are_better_and_equal_ones_are_not() {
        let other: Vec<f64> = (0..20).map(|k| 2.0 + 0.1 * f64::from(k % 5)).collect();
        let own: Vec<f64> = other.iter().enumerate().map(|(k, x)| x - 0.8 + 0.05 * (k % 3) as f64).collect();
        assert!(p_better(&own, &other, 1.0) < 1e-6);
        assert!(p_better(&other, &own, 1.0) > 0.999);
        assert!(p_better(&other, &other, 1.0) >= 0.5);
    }
}
