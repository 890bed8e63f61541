//! Signs that what is accused stands for something else: the right effect is another one, which the library lacks.
//!
//! A wrong cause can close most of a gap and bring the level of all features below what engines differ by. It leaves what it
//! cannot imitate where no engine has a part: in the law of the actuators, and in what another effect of the same joints asks for.

use super::doubt::Doubt;
use super::evidence::{ActsOn, Candidate, CorrectedRobot, Evidence, IdentifiedCause, Level};
use super::judge::Judge;
use super::policy::Policy;
use super::twins::twins;
use crate::checks::actuator_residual::ActuatorResidual;
use crate::checks::stationarity::{Dependence, TIME};

/// The corrected robot, and what it is judged by.
pub struct Checks<'c> {
    /// What decides.
    pub policy: &'c Policy,
    /// What was measured,
    pub evidence: &'c Evidence,
    /// of the robot with all that is accused,
    pub corrected: &'c CorrectedRobot,
    /// whose level is this.
    pub level: Level,
}

/// The actuator whose law leaves most, if that is more than noise and tolerances make of it.
pub fn actuator_left<'l>(
    policy: &Policy,
    now: &'l [ActuatorResidual],
    opening: &[ActuatorResidual],
) -> Option<&'l ActuatorResidual> {
    let excess = |left: &&ActuatorResidual| {
        let before = opening.iter().find(|o| o.joint == left.joint).map_or(0.0, |o| o.ratio - 1.0);
        let untouched = before > 0.0 && left.ratio - 1.0 > (1.0 - policy.touched) * before;
        let most = if untouched { policy.actuator_left_untouched } else { policy.actuator_left };
        let by_chance = policy.actuator_over_chance * left.by_chance;
        left.ratio > most.max(by_chance) && left.ratio - 1.0 > policy.actuator_share * before
    };
    now.iter().filter(excess).max_by(|a, b| a.ratio.total_cmp(&b.ratio))
}

impl Checks<'_> {
    /// Why the corrected robot is not explained; `None` if nothing speaks against it.
    pub fn doubt(&self) -> Option<Doubt> {
        self.twins()
            .or_else(|| self.pulled())
            .or_else(|| self.fading())
            .or_else(|| self.weight())
            .or_else(|| self.too_little_of_the_excess())
            .or_else(|| self.rises())
            .or_else(|| self.actuator_residual())
            .or_else(|| self.changing())
            .or_else(|| self.beside_trunk())
            .or_else(|| self.another())
    }

    /// Doubts causes that act all the time and everywhere and close too little in windows that no fit has seen.
    pub fn closes_too_little(&self) -> Option<Doubt> {
        let (policy, closed) = (self.policy, &self.corrected.closed);
        let [before, after] = closed.loss;
        // No contact has a part in the law of an actuator, where what is accused takes most of that.
        let by_law = policy.closes_actuator_residual(closed.actuator_residual);
        let left = after / closed.floor;
        if left > policy.large_gap && closed.share < policy.large_gap_closed && !by_law {
            return Some(Doubt::LittleClosed(closed.share, Some(left)));
        }
        // Windows that are held out are few, and feet that bounce fall otherwise in each.
        let [at_first, now] = [self.evidence.level.ratio, self.level.ratio];
        if policy.is_explained(&self.level) && now - 1.0 < policy.most_left * (at_first - 1.0) {
            return None;
        }
        let [fall, error] = closed.fall;
        // Tolerated deviations may make most of a gap in which a bias of the gyroscope makes a small part of every window.
        let is_quiet = now < policy.no_gap;
        let is_sure = is_quiet && (fall > policy.sure_fall * error || closed.log_evidence > policy.sure_held_out);
        let closable = before - policy.engines_leave * closed.floor;
        (before - after < policy.least_gap_closed * closable && !by_law && !is_sure)
            .then_some(Doubt::LittleClosed(closed.share, None))
    }

    /// What is accused, as it was found.
    fn accused(&self) -> impl Iterator<Item = (&IdentifiedCause, &Candidate)> {
        self.evidence.accused()
    }

    /// Largest log evidence of what is accused.
    fn most_evidence(&self) -> f64 {
        self.accused().map(|(_, c)| c.log_evidence).fold(0.0, f64::max)
    }

    /// Whether any of it is confined to a time or a place.
    fn is_local(&self) -> bool {
        self.accused().any(|(_, c)| c.extent.is_some())
    }

    fn acts_on(&self, effect: &str) -> Option<ActsOn> {
        self.evidence.effect(effect).map(|e| e.acts_on)
    }

    fn twins(&self) -> Option<Doubt> {
        let all: Vec<(&Candidate, f64)> = self.accused().map(|(a, c)| (c, a.values[0])).collect();
        twins(self.policy.alike, |effect| self.evidence.effect(effect).is_some_and(|e| e.is_factor), &all)
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
        let Policy { change_errors, fading_share, .. } = *self.policy;
        let fades = |d: &&Dependence| d.errors.abs() > change_errors && d.change.abs() > fading_share;
        let all = self.accused().filter_map(|(a, _)| a.fading.as_ref()).filter(fades);
        let most = all.max_by(|a, b| a.errors.abs().total_cmp(&b.errors.abs()))?;
        Some(Doubt::Fading([most.change.abs(), most.errors.abs()]))
    }

    /// A steady force that is all but vertical is what something weighs, where no mass is known that was asked, too.
    fn weight(&self) -> Option<Doubt> {
        if self.evidence.effects.iter().any(|e| e.is_payload && e.is_known) {
            return None;
        }
        let upwards = |(a, c): (&IdentifiedCause, &Candidate)| {
            let up = self.evidence.effect(&c.effect)?.upwards?;
            let length = a.values.iter().map(|v| v * v).sum::<f64>().sqrt();
            (c.extent.is_none() && a.values[up].abs() > self.policy.vertical * length).then_some(a.values[up])
        };
        self.accused().find_map(upwards).map(Doubt::Weight)
    }

    fn too_little_of_the_excess(&self) -> Option<Doubt> {
        let [before, after] = [self.evidence.level.ratio, self.level.ratio];
        let has_events = self.accused().any(|(_, c)| c.time().is_some());
        let is_sure = self.most_evidence() > self.policy.sure_event;
        let takes_little = before - after < self.policy.events_share * (before - 1.0);
        (has_events && !is_sure && after > self.policy.no_gap && takes_little)
            .then(|| Doubt::LittleExcess((before - after) / (before - 1.0)))
    }

    fn rises(&self) -> Option<Doubt> {
        let [before, after] = [self.evidence.level.ratio, self.level.ratio];
        (!self.is_local() && after > before + self.policy.rise).then_some(Doubt::Rises([before, after]))
    }

    fn actuator_residual(&self) -> Option<Doubt> {
        let left = actuator_left(self.policy, &self.corrected.actuator_residuals, &self.evidence.actuator_residuals)?;
        Some(Doubt::ActuatorResidual(self.evidence.joints[left.joint].clone(), left.ratio))
    }

    /// What is accused of joints and is no one size.
    fn changing(&self) -> Option<Doubt> {
        let policy = self.policy;
        let of_joints = |c: &Candidate| c.extent.is_none() && self.acts_on(&c.effect) == Some(ActsOn::Joints);
        let steady = self.accused().filter(|(_, c)| of_joints(c));
        let all = steady.flat_map(|(a, _)| {
            let share = |d: &Dependence| if d.on == TIME { policy.drift_share } else { policy.change_share };
            let changes = move |d: &&Dependence| d.change.abs() > share(d) * a.values[0].abs();
            a.depends_on.iter().filter(|d| d.errors.abs() > policy.change_errors).filter(changes)
        });
        let most = all.max_by(|a, b| a.errors.abs().total_cmp(&b.errors.abs()))?;
        Some(Doubt::Changing(most.on.clone(), most.errors.abs()))
    }

    /// The round after the last accusation, if there was one.
    fn last_round(&self) -> Option<Judge<'_>> {
        let last = self.evidence.rounds.last().filter(|r| r.accused.is_empty())?;
        Some(Judge::new(self.policy, last, self.evidence.is_free))
    }

    /// A steady effect that has much of the evidence left beside what is accused of the trunk, the ground or the sensors.
    fn beside_trunk(&self) -> Option<Doubt> {
        let judge = self.last_round()?;
        let of_joints = |c: &Candidate| matches!(self.acts_on(&c.effect), Some(ActsOn::Joints | ActsOn::Links));
        if self.is_local() || self.accused().any(|(_, c)| of_joints(c)) {
            return None;
        }
        // What is mounted beside the centre of mass moves it: that is no rival of its weight.
        let of_links = |effect: &str| self.evidence.effect(effect).is_some_and(|e| e.is_of_links);
        let is_mounted = self.accused().all(|(_, c)| of_links(&c.effect));
        let Policy { trunk_evidence_left, trunk_evidence_share, .. } = *self.policy;
        let least = trunk_evidence_left.max(trunk_evidence_share * self.most_evidence());
        let is_one =
            |c: &&Candidate| c.log_evidence > least && judge.speaks_for(c) && !(is_mounted && of_links(&c.effect));
        let candidates = self.evidence.rounds.last()?.candidates.iter();
        let most = candidates.filter(is_one).max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))?;
        Some(Doubt::BesideTrunk(most.effect.clone(), most.log_evidence))
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
