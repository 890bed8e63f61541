//! Which candidates of a round are accused.

use super::doubt::Objection;
use super::evidence::{Candidate, Round};
use super::policy::Policy;
use crate::problem::columns::Extent;

/// Relative change of a held-out window that is none: the event lies elsewhere.
const ROUNDING: f64 = 1e-9;

/// What a round comes to.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Judgement {
    /// The accused candidate, and other events that stand beside an accused event.
    pub accused: Vec<usize>,
    /// The best candidate that was not accused, and why; `None` if it was.
    pub refused: Option<(String, Objection)>,
}

/// A round, judged by a policy.
pub struct Judge<'j> {
    policy: &'j Policy,
    round: &'j Round,
    /// Whether the base is free.
    is_free: bool,
}

impl<'j> Judge<'j> {
    /// Judges a round of a robot whose base is free or not.
    pub fn new(policy: &'j Policy, round: &'j Round, is_free: bool) -> Self {
        Self { policy, round, is_free }
    }

    /// Accuses the best candidate to which there is no objection. A better one that is no cause does not make a worse one
    /// a cause, unless it is a trifle, or chance alone reaches as much for it.
    pub fn judge(&self) -> Judgement {
        let Policy { least_share, most_judged, .. } = *self.policy;
        let mut refused = None;
        let mut judged = 0;
        for k in self.by_evidence() {
            let candidate = &self.round.candidates[k];
            // Blows of the contact stand beside any cause.
            let (is_blow, is_event) = (self.is_too_short(candidate), candidate.time().is_some());
            let has_evidence = candidate.whole_evidence() >= self.needed(candidate);
            judged += usize::from(!is_blow && (has_evidence || !is_event));
            if judged > most_judged {
                break;
            }
            let Some(objection) = self.any_objection(candidate) else {
                return Judgement { accused: self.with_other_events(k), refused: None };
            };
            refused.get_or_insert_with(|| (candidate.effect.clone(), objection));
            // Nor does a faint push that was looked at: stumbles look like pushes beside any cause.
            let is_stumble = self.is_free && is_event && candidate.share < least_share;
            // Nor does one of a robot that is held whose size is none that is looked for: it stands in for something else.
            let is_beyond = !self.is_free && self.is_at_edge(candidate);
            if has_evidence && !is_blow && !is_stumble && !is_beyond && !self.policy.is_trifle(candidate.size) {
                break;
            }
        }
        Judgement { accused: Vec::new(), refused }
    }

    /// Candidates by the evidence of the whole recording, the best first.
    fn by_evidence(&self) -> Vec<usize> {
        let candidates = &self.round.candidates;
        let mut order: Vec<usize> = (0..candidates.len()).collect();
        order.sort_by(|&a, &b| candidates[b].whole_evidence().total_cmp(&candidates[a].whole_evidence()));
        order
    }

    /// Whether something steady that is no trifle has far more evidence than a cause needs.
    pub(crate) fn is_suspicious(&self) -> bool {
        let is_one = |c: &Candidate| {
            let is_trifle = self.policy.is_trifle(c.size) || self.is_part_of_trifle(c).is_some();
            c.extent.is_none() && !is_trifle && c.whole_evidence() > self.policy.suspicious * self.needed(c)
        };
        self.round.candidates.iter().any(is_one)
    }

    /// Log evidence that a candidate of its kind needs.
    fn needed(&self, candidate: &Candidate) -> f64 {
        let policy = self.policy;
        let least = match candidate.extent {
            Some(Extent::Time(_)) if self.is_free => policy.least_event_evidence,
            Some(Extent::Time(_)) => policy.held_windows.least_event_evidence,
            _ if self.is_free => self.own_least(candidate).unwrap_or(policy.least_evidence),
            _ => policy.held_windows.least_evidence,
        };
        least.max(candidate.by_chance)
    }

    /// Log evidence that the library states for an effect of a robot on its feet.
    fn own_least(&self, candidate: &Candidate) -> Option<f64> {
        candidate.least_evidence.filter(|_| self.is_free && candidate.extent.is_none())
    }

    /// Whether a candidate is an event too short to be a push.
    fn is_too_short(&self, candidate: &Candidate) -> bool {
        let least = if self.is_free { self.policy.least_event } else { self.policy.held_windows.least_event };
        candidate.time().is_some_and(|[from, until]| until - from < least)
    }

    fn any_objection(&self, candidate: &Candidate) -> Option<Objection> {
        self.objection(candidate).or_else(|| self.held_out_objection(candidate))
    }

    /// What speaks against a candidate without a look at other windows.
    fn objection(&self, candidate: &Candidate) -> Option<Objection> {
        if let (Some([from, until]), true) = (candidate.time(), self.is_too_short(candidate)) {
            return Some(Objection::TooShort(until - from));
        }
        let (evidence, needed) = (candidate.whole_evidence(), self.needed(candidate));
        if evidence < needed {
            return Some(Objection::LittleEvidence([evidence, needed]));
        }
        if self.policy.is_trifle(candidate.size) {
            return Some(Objection::Trifle(candidate.size));
        }
        if let Some(size) = self.is_part_of_trifle(candidate) {
            return Some(Objection::PartOfTrifle(size));
        }
        self.is_at_edge(candidate).then_some(Objection::AtEdge)
    }

    /// Size in tolerances of the same effect on more than a steady candidate, where that has more evidence and is a trifle: the trifle explains
    /// the candidate, whose larger size on fewer joints takes upon it what all of them share.
    fn is_part_of_trifle(&self, candidate: &Candidate) -> Option<f64> {
        let is_whole = |other: &&Candidate| {
            other.effect == candidate.effect
                && other.extent.is_none()
                && self.policy.is_trifle(other.size)
                && other.whole_evidence() > candidate.whole_evidence()
                && candidate.members.iter().all(|member| other.members.contains(member))
        };
        let whole = self.round.candidates.iter().find(is_whole)?;
        candidate.extent.is_none().then_some(whole.size)
    }

    /// Whether a steady candidate would be larger than what is looked for. What lies just within and closes most of the gap of a robot that is
    /// held, in windows that no fit has seen, stands in for nothing else.
    fn is_at_edge(&self, candidate: &Candidate) -> bool {
        let closes = candidate.held_out.as_ref().is_some_and(|h| h.closed > self.policy.held_windows.mostly_closed);
        let is_within = !self.is_free && candidate.from_edge > 0.0 && closes;
        candidate.extent.is_none() && candidate.from_edge < self.policy.edge && !is_within
    }

    /// Objections that take windows which no fit has seen.
    fn held_out_objection(&self, candidate: &Candidate) -> Option<Objection> {
        let policy = self.policy;
        let Some(held_out) = &candidate.held_out else { return Some(Objection::NotLookedAt) };
        if candidate.time().is_some() {
            // An event may lie between the windows that are held out, or touch the edge of one: nothing is said then.
            let seen = || held_out.falls.iter().filter(|fall| fall.abs() > ROUNDING);
            if seen().count() > 1 && seen().sum::<f64>() < 0.0 {
                return Some(Objection::Worsens(seen().count()));
            }
            let takes_little = self.is_free && candidate.share < policy.least_share;
            return takes_little.then_some(Objection::LittleExcess(candidate.share));
        }
        if policy.closes_actuator_residual(held_out.actuator_residual) {
            return None;
        }
        // No contact hides a gap of a robot that is held: where there is hardly one, its cause closes it.
        let is_slight = !self.is_free && self.policy.is_faultless(&self.round.level, false);
        if is_slight && self.round.is_first && held_out.closed < policy.least_share {
            return Some(Objection::LittleClosed(held_out.closed));
        }
        let asked_for = held_out.log_evidence.is_some_and(|e| e > policy.held_windows.sure_held_out);
        if !self.is_free && self.round.is_first && candidate.extent.is_none() && asked_for {
            return None;
        }
        // Tolerated deviations can take most of a small effect upon them in the windows of the fit: what it closes elsewhere counts, too.
        if candidate.share.max(held_out.closed) < policy.least_share {
            return Some(Objection::LittleClosed(candidate.share.max(held_out.closed)));
        }
        // In a region few windows have a part: their logarithms say more than their mean.
        let is_everywhere = candidate.extent.is_none();
        let in_windows = if is_everywhere { held_out.fall } else { held_out.fall_of_logarithm };
        let [fall, error] = held_out.fall_of_pieces.unwrap_or(in_windows);
        (fall < policy.least_errors * error).then_some(Objection::LittleFall([fall, error]))
    }

    /// A candidate, and if it is an event, those at other times than it and than better ones.
    fn with_other_events(&self, first: usize) -> Vec<usize> {
        let candidates = &self.round.candidates;
        let mut accused = vec![first];
        let Some(time) = candidates[first].time() else { return accused };
        let mut taken = vec![time];
        for (k, candidate) in candidates.iter().enumerate() {
            let Some([from, until]) = candidate.time() else { continue };
            let apart = taken.iter().all(|t| until <= t[0] || from >= t[1]);
            if apart && self.objection(candidate).is_none() {
                taken.push([from, until]);
                accused.push(k);
            }
        }
        accused
    }
}
