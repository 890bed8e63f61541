//! Signs that what is accused stands for something else: the right effect is another one, which the library lacks.
//!
//! A wrong cause can close most of a gap. It leaves what it cannot imitate: in what another effect of the same joints asks for, and in a size that
//! changes with speed, load or time.

use super::doubt::Doubt;
use super::evidence::{ActsOn, Candidate, CorrectedRobot, Evidence, IdentifiedCause};
use super::policy::Policy;
use crate::checks::stationarity::Dependence;

/// The corrected robot, and what it is judged by.
pub struct Checks<'c> {
    /// What decides.
    pub policy: &'c Policy,
    /// What was measured,
    pub evidence: &'c Evidence,
    /// of the robot with all that is accused.
    pub corrected: &'c CorrectedRobot,
}

impl Checks<'_> {
    /// Why what is accused does not explain the recording; `None` if nothing speaks against it.
    pub fn doubt(&self) -> Option<Doubt> {
        self.pulled().or_else(|| self.fading()).or_else(|| self.changing()).or_else(|| self.another())
    }

    /// What is accused, as it was found.
    fn accused(&self) -> impl Iterator<Item = (&IdentifiedCause, &Candidate)> {
        self.evidence.accused()
    }

    /// Largest log evidence of what is accused.
    fn most_evidence(&self) -> f64 {
        self.accused().map(|(_, c)| c.log_evidence).fold(0.0, f64::max)
    }

    fn acts_on(&self, effect: &str) -> Option<ActsOn> {
        self.evidence.effect(effect).map(|e| e.acts_on)
    }

    /// Forces of their own in several long pieces are one that changes: a cable, or wind.
    fn pulled(&self) -> Option<Doubt> {
        let events: Vec<[f64; 2]> = self.accused().filter_map(|(_, c)| c.time()).collect();
        let together: f64 = events.iter().map(|t| t[1] - t[0]).sum();
        let pieces = events.len();
        (pieces > 1 && together > self.policy.longest_pushes).then_some(Doubt::Pulled(pieces, together))
    }

    /// A push that grows or fades is none: a cable, which pulls the harder the farther the robot goes.
    fn fading(&self) -> Option<Doubt> {
        // Whatever else is accused is there in the robot without it, too.
        if self.accused().any(|(_, c)| c.time().is_none()) {
            return None;
        }
        let Policy { change_errors, change_share, .. } = *self.policy;
        let fades = |d: &&Dependence| d.errors.abs() > change_errors && d.change.abs() > change_share;
        let all = self.accused().filter_map(|(a, _)| a.fading.as_ref()).filter(fades);
        let most = all.max_by(|a, b| a.errors.abs().total_cmp(&b.errors.abs()))?;
        Some(Doubt::Fading([most.change.abs(), most.errors.abs()]))
    }

    /// What is accused of joints and is no one size.
    fn changing(&self) -> Option<Doubt> {
        let policy = self.policy;
        let of_joints = |c: &Candidate| c.extent.is_none() && self.acts_on(&c.effect) == Some(ActsOn::Joints);
        let steady = self.accused().filter(|(_, c)| of_joints(c));
        let all = steady.flat_map(|(a, _)| {
            let changes = move |d: &&Dependence| d.change.abs() > policy.change_share * a.values[0].abs();
            a.depends_on.iter().filter(|d| d.errors.abs() > policy.change_errors).filter(changes)
        });
        let most = all.max_by(|a, b| a.errors.abs().total_cmp(&b.errors.abs()))?;
        Some(Doubt::Changing(most.on.clone(), most.errors.abs()))
    }

    /// Another steady effect of the accused joints that has evidence left.
    fn another(&self) -> Option<Doubt> {
        let least = self.policy.evidence_left.max(self.policy.evidence_share * self.most_evidence());
        let linear = self.corrected.same_joints.iter().map(|a| (a.log_evidence, a.size, &a.effect));
        let last = self.evidence.rounds.last().filter(|r| r.accused.is_empty());
        let steady = last.iter().flat_map(|r| &r.candidates).filter(|c| c.extent.is_none() && self.is_rival(c));
        let followed = steady.map(|c| (c.log_evidence, c.size, &c.effect));
        let has_evidence =
            |(evidence, size, _): &(f64, f64, &String)| *evidence > least && !self.policy.is_trifle(*size);
        let most = linear.chain(followed).filter(has_evidence).max_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(Doubt::SameJoints(most.2.clone(), most.0))
    }

    /// Whether a candidate is another effect of joints of which something is accused.
    fn is_rival(&self, candidate: &Candidate) -> bool {
        let shares = |c: &Candidate| c.members.iter().any(|m| candidate.members.contains(m));
        self.acts_on(&candidate.effect) == Some(ActsOn::Joints)
            && self.accused().all(|(_, c)| c.effect != candidate.effect)
            && self.accused().any(|(_, c)| self.acts_on(&c.effect) == Some(ActsOn::Joints) && shares(c))
    }
}
