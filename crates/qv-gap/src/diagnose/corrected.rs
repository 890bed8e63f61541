//! What is measured of the robot with all that is accused, and all of the evidence.

use super::{Findings, ReportedCause, Session, progress, setting};
use crate::GapError;
use crate::checks::held_out::{closure, held_out_evidence};
use crate::checks::stationarity;
use crate::decision::decide;
use crate::decision::evidence::{self, ActsOn, Closure, CorrectedRobot, EffectFacts, Evidence, LinearCandidate};
use crate::findings::Verdict;
use crate::inference::level::mean;
use crate::inference::linear_scores::size;
use crate::inference::linearised::LinearisedProblem;
use crate::inference::search::Search;
use crate::problem::library::{Effect, Scope};
use std::collections::BTreeMap;

/// Other effects of the accused joints that are kept, the best first.
const MOST_ASKED: usize = 20;

impl Findings<'_> {
    /// All that decisions go by, and all that a report shows beyond that: the last that is simulated.
    pub(super) fn evidence(
        mut self,
        session: &mut Session,
        nominal: &mut LinearisedProblem,
        begun: f64,
    ) -> Result<Evidence, GapError> {
        session.begin(progress::CLOSURE);
        let effects = &nominal.columns.effects;
        let effects = effects.iter().enumerate().map(|(e, effect)| facts(effect, !nominal.ablated.contains(&e)));
        let mut evidence = Evidence {
            format: evidence::FORMAT.into(),
            is_free: self.on_feet,
            joints: nominal.rollout.model.joint_names().to_vec(),
            effects: effects.collect(),
            level: self.opening.level,
            held_out: self.opening.held_out,
            corrected: self.corrected(nominal)?,
            rounds: self.rounds.iter().map(|r| r.round.clone()).collect(),
            report: None,
            camera: None,
            held: None,
        };
        // Joint fits take as long as all before them: as rounds, they are measured as far as the policy asks for them.
        let policy = &session.options.policy;
        let is_open = decide(&evidence, policy).is_ok_and(|d| d.verdict == Verdict::Unexplained);
        evidence.report = Some(self.report_data(session, nominal, is_open && !self.on_feet, begun)?);
        Ok(evidence)
    }

    fn corrected(&mut self, nominal: &mut LinearisedProblem) -> Result<Option<CorrectedRobot>, GapError> {
        if self.later.is_none() {
            return Ok(None);
        }
        let closed = self.closed(nominal)?;
        let level = self.rounds.iter().rev().find_map(|r| r.round.after).map_or(1.0, |after| after.level.ratio);
        let Some(study) = self.later.as_mut() else { return Ok(None) };
        let accused = self.accused.iter().map(|a| accused(nominal, study, a)).collect();
        let (same_joints, beside) = asked(study, &self.accused, level.max(1.0))?;
        Ok(Some(CorrectedRobot { accused, same_joints, beside, closed }))
    }

    /// How far the gap shrinks in windows that no fit has seen.
    fn closed(&self, nominal: &mut LinearisedProblem) -> Result<Closure, GapError> {
        let setting = setting(nominal, &self.corrections);
        let alone = closure(nominal, &setting)?;
        let log_evidence = held_out_evidence(nominal, &setting)?;
        let before = std::mem::replace(&mut nominal.rollout.events, self.events.clone());
        let with_events = if self.events.is_empty() { alone.closed() } else { closure(nominal, &setting)?.closed() };
        nominal.rollout.events = before;
        let (fall, error) = alone.fall(false);
        Ok(Closure {
            loss: [mean(&alone.before), mean(&alone.after)],
            floor: alone.floor,
            share: alone.closed(),
            share_with_events: with_events,
            fall: [fall, error],
            actuator_residual: alone.actuator_residual(nominal, &setting),
            log_evidence,
        })
    }
}

/// What decisions may ask of an effect of the library.
fn facts(effect: &Effect, is_known: bool) -> EffectFacts {
    EffectFacts {
        name: effect.name.clone(),
        acts_on: match effect.scope {
            Scope::Joints => ActsOn::Joints,
            Scope::Links => ActsOn::Links,
            _ => ActsOn::Other,
        },
        is_known,
        interface: effect.interface.name().into(),
        experiment: effect.experiment.clone(),
    }
}

fn accused(
    nominal: &LinearisedProblem,
    study: &LinearisedProblem,
    accused: &ReportedCause,
) -> evidence::IdentifiedCause {
    let ReportedCause { found: [round, candidate], fit, group, cause, .. } = accused;
    let values = fit.suspect.values.clone();
    let is_of_joints = study.columns.effects.iter().any(|e| e.name == cause.effect && e.scope == Scope::Joints);
    let is_steady = fit.suspect.extent.is_none();
    // One event takes the place of any other in the simulator, so that it is asked of the robot without it.
    let fading = accused.time().and_then(|t| stationarity::fading(nominal, &cause.effect, group, &values, t));
    let depends_on = match is_steady && is_of_joints {
        true => stationarity::dependences(study, &cause.effect, group),
        false => Vec::new(),
    };
    let parameters = cause.parameters.clone();
    evidence::IdentifiedCause { round: *round, candidate: *candidate, values, parameters, fading, depends_on }
}

/// Effects that are not accused and that the corrected robot asks for by one linear step, over its `level`: those of the accused joints, and the
/// most of every one.
fn asked(
    study: &mut LinearisedProblem,
    accused: &[ReportedCause],
    level: f64,
) -> Result<(Vec<LinearCandidate>, BTreeMap<String, f64>), GapError> {
    let mut search = Search::new(study, 1.0)?;
    let base = search.base(&[])?;
    let linear = search.linear(&base.sums);
    let columns = &study.columns;
    let of_joints =
        |a: &&ReportedCause| columns.effects.iter().any(|e| e.name == a.cause.effect && e.scope == Scope::Joints);
    let (mut same_joints, mut beside) = (Vec::new(), BTreeMap::new());
    for (evidence, suspect) in linear {
        let group = &columns.groups[suspect.group];
        let effect = &columns.effects[group.effect];
        if !evidence.is_finite() || accused.iter().any(|a| a.cause.effect == effect.name) {
            continue;
        }
        let log_evidence = evidence / level;
        let most = beside.entry(effect.name.clone()).or_insert(f64::NEG_INFINITY);
        *most = log_evidence.max(*most);
        let shares = |a: &ReportedCause| a.group.members.iter().any(|m| group.members.contains(m));
        if effect.scope == Scope::Joints && accused.iter().filter(of_joints).any(shares) {
            let (members, size) = (group.members.clone(), size(study, &suspect));
            same_joints.push(LinearCandidate { effect: effect.name.clone(), members, log_evidence, size });
        }
    }
    same_joints.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    same_joints.truncate(MOST_ASKED);
    Ok((same_joints, beside))
}
