//! The verdict and the ranking, from what was measured.

use super::camera::{CameraDecision, decide_camera};
use super::checks::Checks;
use super::doubt::Doubt;
use super::evidence::{Candidate, CorrectedRobot, Evidence, Level, Round};
use super::judge::{Judge, Judgement};
use super::policy::Policy;
use crate::findings::{RankedEffect, UNKNOWN, Verdict};
use std::collections::BTreeMap;

/// What a diagnosis comes to.
#[derive(Debug, Clone, PartialEq)]
pub struct Decision {
    /// The outcome, the camera left aside.
    pub verdict: Verdict,
    /// Why what was accused does not explain the recording all the same.
    pub doubt: Option<Doubt>,
    /// Effects and `unknown` by score.
    pub ranking: Vec<RankedEffect>,
    /// What each round came to, as far as this policy goes.
    pub rounds: Vec<Judgement>,
    /// What comes of the camera, where images were compared.
    pub camera: Option<CameraDecision>,
    /// The numbers that decided.
    pub policy: Policy,
}

impl Decision {
    /// Whether what was accused is reported as the cause.
    pub fn accuses(&self) -> bool {
        matches!(self.verdict, Verdict::Explained | Verdict::PartlyExplained)
    }
}

/// In this round a policy would have accused something else than what was measured: what follows is not known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Divergence(pub usize);

/// Decides. Nothing is simulated, and the same evidence and policy give the same decision.
///
/// # Errors
/// The policy would have led to other simulations than that under which the evidence was measured.
pub fn decide(evidence: &Evidence, policy: &Policy) -> Result<Decision, Divergence> {
    match path(evidence, policy) {
        Some(0) if judge(evidence, policy, 0).accused.is_empty() => {
            // Whatever was measured of a robot that this policy would not have corrected says nothing.
            let first = evidence.rounds.first().map(|r| Round { accused: Vec::new(), after: None, ..r.clone() });
            let alone = Evidence { rounds: first.into_iter().collect(), corrected: None, ..evidence.clone() };
            Ok(decision(&alone, policy))
        }
        Some(round) => Err(Divergence(round)),
        None => Ok(decision(evidence, policy)),
    }
}

fn judge(evidence: &Evidence, policy: &Policy, round: usize) -> Judgement {
    Judge::new(policy, &evidence.rounds[round], evidence.is_free).judge()
}

/// The first round in which the policy goes another way than the one that was measured.
fn path(evidence: &Evidence, policy: &Policy) -> Option<usize> {
    let mut effects: Vec<&str> = Vec::new();
    for (k, round) in evidence.rounds.iter().enumerate() {
        let accused = judge(evidence, policy, k).accused;
        if accused != round.accused {
            return Some(k);
        }
        effects.extend(accused.iter().map(|&c| round.candidates[c].effect.as_str()));
        effects.sort_unstable();
        effects.dedup();
        let goes_on = round.after.as_ref().is_some_and(|after| {
            let is_full = effects.len() >= policy.most_causes || k >= policy.most_causes;
            !is_full && is_much_left(policy, &after.level, after.held_out, evidence.is_free)
        });
        if goes_on != (k + 1 < evidence.rounds.len()) {
            return Some(k + 1);
        }
    }
    None
}

/// Whether the corrected robot is far enough from the recording to look for one more cause.
pub fn is_much_left(policy: &Policy, level: &Level, [held_out, floor]: [f64; 2], is_free: bool) -> bool {
    !policy.is_faultless(level, is_free) || held_out >= policy.much_left * floor
}

fn decision(evidence: &Evidence, policy: &Policy) -> Decision {
    let case = Case { evidence, policy };
    let doubt = evidence.corrected.as_ref().and_then(|corrected| case.doubt(corrected));
    let verdict = case.verdict(doubt.is_some());
    let ranking = case.ranking(verdict);
    let rounds = (0..evidence.rounds.len()).map(|k| judge(evidence, policy, k)).collect();
    let camera = evidence.camera.as_ref().map(|camera| decide_camera(camera, policy));
    Decision { verdict, doubt, ranking, rounds, camera, policy: policy.clone() }
}

struct Case<'c> {
    evidence: &'c Evidence,
    policy: &'c Policy,
}

impl Case<'_> {
    /// Level with all that is accused.
    fn level(&self) -> Level {
        let after = self.evidence.rounds.iter().rev().find_map(|r| r.after);
        after.map_or(self.evidence.level, |a| a.level)
    }

    fn accused(&self) -> impl Iterator<Item = &Candidate> {
        self.evidence.accused().map(|(_, candidate)| candidate)
    }

    fn doubt(&self, corrected: &CorrectedRobot) -> Option<Doubt> {
        let checks = Checks { policy: self.policy, evidence: self.evidence, corrected };
        if self.evidence.is_free { checks.doubt() } else { None }
    }

    /// Share of the held-out gap that all that is accused closes.
    fn closed(&self) -> f64 {
        self.evidence.corrected.as_ref().map_or(0.0, |c| c.closed.share_with_events)
    }

    fn verdict(&self, is_doubted: bool) -> Verdict {
        if self.is_within_null() {
            return Verdict::NoGap;
        }
        match (&self.evidence.corrected, self.evidence.is_free) {
            (None, _) => self.without_cause(),
            (Some(_), _) if is_doubted => Verdict::Unexplained,
            (Some(_), true) => self.with_cause(),
            (Some(_), false) => self.with_cause_of_held(),
        }
    }

    /// Windows that no fit has seen show no more than the null, and what is accused closes little of it: a gap is what exceeds the null, whatever
    /// fits a part of the noise better.
    fn is_within_null(&self) -> bool {
        // Nothing but its motors moves a robot that is held, and replicates without an effect are farther from the simulator than it is.
        let are_pushes = self.taken_by_pushes().is_some();
        if !self.evidence.is_free && !are_pushes && self.evidence.level.ratio < 1.0 {
            return true;
        }
        let [before, floor] = self.evidence.held_out;
        let is_faultless = self.policy.is_faultless(&self.evidence.level, self.evidence.is_free);
        before <= floor && is_faultless && self.evidence.corrected.is_some() && self.closed() < self.policy.explained
    }

    /// Nothing is accused: there is no gap, or none of the library.
    fn without_cause(&self) -> Verdict {
        let Evidence { is_free, level, rounds, .. } = self.evidence;
        let suspicious = |round: &Round| Judge::new(self.policy, round, *is_free).is_suspicious();
        let is_suspicious = *is_free && rounds.first().is_some_and(suspicious);
        let is_faultless = self.policy.is_faultless(level, *is_free) && !is_suspicious;
        if is_faultless { Verdict::NoGap } else { Verdict::Unexplained }
    }

    /// Nothing speaks against what is accused.
    fn with_cause(&self) -> Verdict {
        let is_all = self.policy.is_faultless(&self.level(), true) && self.closed() >= self.policy.explained;
        if is_all { Verdict::Explained } else { Verdict::PartlyExplained }
    }

    /// The same of a robot that is held: what pushed an arm at one time is reported whatever the arm lacks at all others.
    fn with_cause_of_held(&self) -> Verdict {
        let Policy { held_windows: of_held, least_share, explained, .. } = self.policy;
        let level = self.level();
        let is_faultless = self.policy.is_faultless(&level, false);
        if let Some(taken) = self.taken_by_pushes() {
            let was_faultless = self.policy.is_faultless(&self.evidence.level, false);
            let is_told = taken >= of_held.pushes_take || (level.ratio < of_held.quiet_enough && taken >= *least_share);
            return match (taken < of_held.pushes_take && was_faultless, is_told) {
                (true, _) => Verdict::NoGap,
                (_, true) if is_faultless && self.closed() >= *explained => Verdict::Explained,
                (_, true) => Verdict::PartlyExplained,
                _ => Verdict::Unexplained,
            };
        }
        let is_mostly = self.closed() > of_held.mostly_closed && level.ratio < of_held.quiet_enough;
        match (is_faultless, self.closed() >= *explained) {
            (true, true) => Verdict::Explained,
            (true, false) => Verdict::PartlyExplained,
            _ if is_mostly => Verdict::PartlyExplained,
            _ => Verdict::Unexplained,
        }
    }

    /// Share of the excess that pushes of a robot that is held take; `None` where something else is accused, or nothing.
    fn taken_by_pushes(&self) -> Option<f64> {
        let mut all = self.accused().peekable();
        let are_pushes = !self.evidence.is_free && all.peek().is_some() && all.all(|c| c.time().is_some());
        let before = self.evidence.level.ratio;
        are_pushes.then(|| (before - self.level().ratio) / (before - 1.0).max(f64::MIN_POSITIVE))
    }

    /// Scores of the effects and of `unknown`, at most 1 together: what is accused is known by the share of the gap that it closes, and rivals share
    /// by their evidence; without a cause at least half is unknown, and without a gap nothing is asked for.
    fn ranking(&self, verdict: Verdict) -> Vec<RankedEffect> {
        let policy = self.policy;
        let best = self.rivals(verdict);
        let closed = self.closed().clamp(0.0, 1.0);
        let known = match verdict {
            Verdict::NoGap => 0.0,
            Verdict::Unexplained => (1.0 - policy.explained) * closed,
            Verdict::Explained | Verdict::PartlyExplained => closed.max(policy.explained),
        };
        let is_reported = matches!(verdict, Verdict::Explained | Verdict::PartlyExplained);
        let accused: Vec<&str> = self.accused().map(|c| c.effect.as_str()).filter(|_| is_reported).collect();
        let most = best.values().copied().fold(0.0, f64::max);
        let weight = |(effect, evidence): (&&str, &f64)| {
            let by_evidence = ((evidence - most) / policy.nats).exp();
            // One that was found in a later round has no rival left in the first; what was not accused is no more than even.
            let weight = match accused.contains(effect) {
                true => 1.0,
                false if is_reported => by_evidence.min(1.0 - policy.explained),
                false => by_evidence,
            };
            (effect.to_string(), weight)
        };
        let weights: Vec<(String, f64)> = best.iter().map(weight).collect();
        let total: f64 = weights.iter().map(|w| w.1).sum::<f64>().max(1e-300);
        let mut ranking: Vec<RankedEffect> = weights
            .into_iter()
            .map(|(effect, weight)| RankedEffect { effect, score: known * weight / total })
            .collect();
        let unknown = if verdict == Verdict::NoGap { 0.0 } else { 1.0 - known };
        ranking.push(RankedEffect { effect: UNKNOWN.into(), score: unknown });
        // Thousands of nats below the best all scores are 0, and evidence still shows.
        let evidence = |r: &RankedEffect| best.get(r.effect.as_str()).copied().unwrap_or(f64::NEG_INFINITY);
        let key = |r: &RankedEffect| (accused.contains(&r.effect.as_str()), r.score, evidence(r));
        ranking.sort_by(|a, b| {
            let (a, b) = (key(a), key(b));
            b.0.cmp(&a.0).then(b.1.total_cmp(&a.1)).then(b.2.total_cmp(&a.2))
        });
        ranking
    }

    /// Log evidence of the effects by name. Beside causes that explain the recording counts what the corrected robot asks for: a
    /// rival that imitates them had much evidence before, and a second effect has some now. Where they do not, their rivals count.
    fn rivals(&self, verdict: Verdict) -> BTreeMap<&str, f64> {
        let rounds = &self.evidence.rounds;
        let Some(corrected) = &self.evidence.corrected else { return best_of(rounds.first()) };
        let explains = matches!(verdict, Verdict::Explained | Verdict::PartlyExplained);
        let mut best = match explains {
            true => corrected.beside.iter().map(|(effect, evidence)| (effect.as_str(), *evidence)).collect(),
            false => best_of(rounds.first()),
        };
        best.extend(best_of(rounds.last().filter(|r| r.accused.is_empty())));
        for candidate in self.accused() {
            let evidence = best.entry(&candidate.effect).or_insert(candidate.whole_evidence());
            *evidence = evidence.max(candidate.whole_evidence());
        }
        best
    }
}

/// The best log evidence of each effect in a round.
fn best_of(round: Option<&Round>) -> BTreeMap<&str, f64> {
    let mut best: BTreeMap<&str, f64> = BTreeMap::new();
    for candidate in round.iter().flat_map(|r| &r.candidates) {
        let evidence = best.entry(candidate.effect.as_str()).or_insert(f64::NEG_INFINITY);
        *evidence = evidence.max(candidate.whole_evidence());
    }
    best
}
