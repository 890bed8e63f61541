//! The verdict and the ranking, from what was measured.

use super::camera::{CameraDecision, decide_camera};
use super::checks::{Checks, actuator_left};
use super::doubt::Doubt;
use super::evidence::{Candidate, CorrectedRobot, Evidence, Level, Round};
use super::judge::{Judge, Judgement};
use super::policy::Policy;
use crate::checks::actuator_residual::ActuatorResidual;
use crate::findings::{RankedEffect, UNKNOWN, Verdict};
use std::collections::BTreeMap;

/// What a diagnosis comes to.
#[derive(Debug, Clone, PartialEq)]
pub struct Decision {
    /// The outcome, the camera left aside.
    pub verdict: Verdict,
    /// Why what was accused does not explain the recording all the same.
    pub doubt: Option<Doubt>,
    /// Effects and `unknown` by probability.
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
            let is_full = effects.len() >= policy.most_causes || k + 1 >= policy.most_rounds;
            !is_full && is_much_left(policy, &after.level, after.held_out)
        });
        if goes_on != (k + 1 < evidence.rounds.len()) {
            return Some(k + 1);
        }
    }
    None
}

/// Whether the corrected robot is far enough from the recording to look for one more cause.
pub fn is_much_left(policy: &Policy, level: &Level, [held_out, floor]: [f64; 2]) -> bool {
    level.ratio >= policy.no_gap || held_out >= policy.much_left * floor
}

fn decision(evidence: &Evidence, policy: &Policy) -> Decision {
    let case = Case { evidence, policy };
    let doubt = evidence.corrected.as_ref().and_then(|corrected| case.doubt(corrected));
    let (verdict, decided_by) = case.verdict(doubt.is_some());
    let ranking = case.ranking(decided_by, doubt.is_some());
    let doubt = doubt.or_else(|| case.too_far().filter(|_| verdict == Verdict::Unexplained));
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
        if !self.evidence.is_free {
            return None;
        }
        let checks = Checks { policy: self.policy, evidence: self.evidence, corrected, level: self.level() };
        let is_local = self.accused().any(|c| c.extent.is_some());
        checks.doubt().or_else(|| if is_local { None } else { checks.closes_too_little() })
    }

    /// The verdict, and what it is before windows that no fit has seen are asked whether most of the gap is closed there: the ranking goes by
    /// that.
    fn verdict(&self, is_doubted: bool) -> (Verdict, Verdict) {
        let verdict = self.beyond_null(is_doubted);
        let closed = self.evidence.corrected.as_ref().map_or(0.0, |c| c.closed.share_with_events);
        // What looks like nothing is left in the windows of the fit, and is there in those that no fit has seen.
        let is_left = verdict == Verdict::Explained && closed < self.policy.mostly;
        (if is_left { Verdict::PartlyExplained } else { verdict }, verdict)
    }

    /// No gap where windows that no fit has seen show no more than the null, and all windows together hardly more: a gap is
    /// what exceeds the null, and there is none, whatever fits a part of the noise better.
    fn beyond_null(&self, is_doubted: bool) -> Verdict {
        let verdict = self.by_level(is_doubted);
        // Nothing but its motors moves a robot that is held, and replicates without an effect are farther from the simulator than it is.
        let are_pushes = self.taken_by_pushes().is_some();
        if !self.evidence.is_free && !are_pushes && self.evidence.level.ratio < 1.0 {
            return Verdict::NoGap;
        }
        let closed = self.evidence.corrected.as_ref().map_or(0.0, |c| c.closed.share);
        if verdict == Verdict::NoGap || (verdict == Verdict::Explained && closed >= self.policy.mostly) {
            return verdict;
        }
        let [before, floor] = self.evidence.held_out;
        let is_within_null = before <= floor && self.evidence.level.ratio < self.policy.no_gap;
        if is_within_null { Verdict::NoGap } else { verdict }
    }

    fn by_level(&self, is_doubted: bool) -> Verdict {
        let Evidence { is_free, corrected, level, actuator_residuals, rounds, .. } = self.evidence;
        if is_doubted {
            return Verdict::Unexplained;
        }
        let is_faint = |taken: f64| taken < self.policy.pushes_take && level.ratio < self.policy.no_gap;
        if self.taken_by_pushes().is_some_and(is_faint) {
            return Verdict::NoGap;
        }
        let law = |of: &ActuatorResidual| of.ratio > self.policy.faultless_law;
        let actuators_agree = !is_free || !actuator_left(self.policy, actuator_residuals, &[]).is_some_and(law);
        let calm = if *is_free { self.policy.faultless_level } else { self.policy.no_gap };
        let suspicious = |round: &Round| Judge::new(self.policy, round, *is_free).is_suspicious();
        let is_suspicious = *is_free && rounds.first().is_some_and(suspicious);
        match (corrected.is_none(), self.policy.is_explained(&self.level())) {
            (true, _) if level.ratio < calm && actuators_agree && !is_suspicious => Verdict::NoGap,
            (true, _) => Verdict::Unexplained,
            (false, true) => Verdict::Explained,
            (false, false) => self.partly(),
        }
    }

    /// Share of the excess that pushes of a robot that is held take; `None` where something else is accused, or nothing.
    fn taken_by_pushes(&self) -> Option<f64> {
        let mut all = self.accused().peekable();
        let are_pushes = !self.evidence.is_free && all.peek().is_some() && all.all(|c| c.time().is_some());
        let before = self.evidence.level.ratio;
        are_pushes.then(|| (before - self.level().ratio) / (before - 1.0).max(f64::MIN_POSITIVE))
    }

    /// Several effects can be there and one unknown: what was found stays only if it took nearly all of the excess. What
    /// pushed an arm at one time is reported whatever the arm lacks at all others.
    fn partly(&self) -> Verdict {
        let policy = self.policy;
        let now = self.level().ratio;
        if let Some(taken) = self.taken_by_pushes() {
            let is_quiet = now < policy.quiet_enough && taken >= policy.least_closed;
            let is_told = is_quiet || taken >= policy.pushes_take;
            return if is_told { Verdict::PartlyExplained } else { Verdict::Unexplained };
        }
        let (before, after) = (self.evidence.level.ratio - 1.0, now - 1.0);
        let nearly_all = after < policy.nearly_all * before && now < policy.unexplained_beside;
        let is_local = self.accused().any(|c| c.extent.is_some());
        let closed = match &self.evidence.corrected {
            Some(corrected) if !is_local => corrected.closed.share,
            _ => 0.0,
        };
        if nearly_all || (closed > policy.mostly_closed && now < self.most_beside()) {
            Verdict::PartlyExplained
        } else {
            Verdict::Unexplained
        }
    }

    /// Level up to which causes are reported beside something unknown. No stumble leaves a level of its own in a robot that is held, but what its
    /// joints lack does.
    fn most_beside(&self) -> f64 {
        if self.evidence.is_free { self.policy.unexplained_beside } else { self.policy.quiet_enough }
    }

    /// What was accused leaves too much.
    fn too_far(&self) -> Option<Doubt> {
        self.evidence.corrected.as_ref().map(|_| Doubt::TooFar([self.level().ratio, self.most_beside()]))
    }

    /// Probability of `unknown` by what is left.
    fn unknown_by_level(&self) -> f64 {
        sigmoid((self.level().ratio - self.policy.unexplained) / self.policy.unexplained_width)
    }

    /// Probabilities of the effects and of `unknown`.
    fn ranking(&self, verdict: Verdict, is_doubted: bool) -> Vec<RankedEffect> {
        let policy = self.policy;
        let best = self.rivals(verdict);
        let most = best.values().copied().fold(0.0, f64::max);
        let weight = |evidence: f64| ((evidence - most) / policy.nats).exp();
        let total: f64 = best.values().map(|e| weight(*e)).sum::<f64>().max(1e-300);
        let unknown = match verdict {
            // What is there may be too small to be seen.
            Verdict::NoGap => {
                policy.unknown_in_no_gap * sigmoid((self.level().ratio - policy.no_gap) / policy.no_gap_width)
            }
            Verdict::Unexplained if is_doubted => policy.unknown_doubted,
            // What is nearest was not good enough to be accused.
            Verdict::Unexplained => self.unknown_by_level().max(policy.unknown_unexplained),
            _ => self.unknown_by_level(),
        };
        // Something is accused beside what is unknown.
        let unknown = if verdict == Verdict::PartlyExplained { unknown.min(policy.unknown_beside) } else { unknown };
        let known = if verdict == Verdict::NoGap { policy.known_in_no_gap } else { 1.0 - unknown };
        let accused: Vec<&str> = self.accused().map(|c| c.effect.as_str()).collect();
        let mut ranking: Vec<RankedEffect> = best
            .iter()
            .map(|(effect, evidence)| {
                let share = known * weight(*evidence) / total;
                // One that was found in a later round has no rival left in the first; what is asked for beside it and was not
                // accused is no more than even.
                let probability = match accused.contains(effect) {
                    true => share.max(policy.accused_share * known),
                    false if !accused.is_empty() => share.min(policy.beside_share * known),
                    false => share,
                };
                RankedEffect { effect: effect.to_string(), probability }
            })
            .collect();
        // What is accused takes most: the others share the rest.
        let is_accused = |r: &RankedEffect| accused.contains(&r.effect.as_str());
        let largest = ranking.iter().filter(|r| is_accused(r)).map(|r| r.probability).fold(0.0, f64::max);
        let others: f64 = ranking.iter().filter(|r| !is_accused(r)).map(|r| r.probability).sum();
        let rest = ((known - largest).max(0.0) / others.max(1e-300)).min(1.0);
        ranking.iter_mut().filter(|r| !is_accused(r)).for_each(|r| r.probability *= rest);
        ranking.push(RankedEffect { effect: UNKNOWN.into(), probability: unknown });
        // Thousands of nats below the best all probabilities are 0, and evidence still shows.
        let evidence = |r: &RankedEffect| best.get(r.effect.as_str()).copied().unwrap_or(f64::NEG_INFINITY);
        ranking.sort_by(|a, b| b.probability.total_cmp(&a.probability).then(evidence(b).total_cmp(&evidence(a))));
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

/// The logistic function.
fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
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
