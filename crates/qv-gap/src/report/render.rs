//! From evidence and a decision to a report. Nothing is simulated.

use super::camera::join;
use super::{Cause, FORMAT, Gap, Remainder, Report, Share, Sight, TorqueBalance, Verdict, Where, narrative};
use crate::GapError;
use crate::decision::evidence::{Evidence, ReportData};
use crate::decision::{Decision, Divergence, Policy, decide};

/// A gap of no more than so many times the floor is none that could be explained.
const NEAR_FLOOR: f64 = 1.02;
/// Least that a cause counts among interfaces, and least that all causes do.
const LEAST_SHARES: [f64; 2] = [0.01, 0.6];

/// Decides on evidence, and renders what comes of it.
///
/// # Errors
/// The policy would have led to other simulations than those of the evidence; as [`render`].
pub fn report(evidence: &Evidence, policy: &Policy) -> Result<Report, GapError> {
    if let (Some(held), Some(data)) = (&evidence.held, &evidence.report) {
        return Ok(super::held::report(evidence, held, data, policy));
    }
    let decision = decide(evidence, policy).map_err(|Divergence(round)| {
        let found = format!("one that would have gone another way in round {}", round + 1);
        GapError::run("policy", "the one under which the evidence was measured", found)
    })?;
    render(evidence, &decision)
}

/// The report of a decision.
///
/// # Errors
/// The evidence is of the format before, which decides and shows nothing.
pub fn render(evidence: &Evidence, decision: &Decision) -> Result<Report, GapError> {
    let data = evidence.report.as_ref().ok_or_else(|| {
        let found = format!("{}, of which no report can be made: run `qv diagnose` again", evidence.format);
        GapError::run("evidence", crate::decision::evidence::FORMAT, found)
    })?;
    let verdict = decision.verdict;
    let shown = data.corrected.as_ref().filter(|_| decision.accuses()).unwrap_or(&data.stated);
    let causes = causes(data, decision);
    let is_open = verdict == Verdict::Unexplained && data.dead.is_empty();
    let leads = if is_open { data.leads.clone() } else { Vec::new() };
    let together = data.together.clone().filter(|_| is_open);
    let gap = &shown.gap;
    let rounds = evidence.rounds.iter().zip(&decision.rounds);
    let mut report = Report {
        format: FORMAT.into(),
        verdict,
        sentence: narrative::whole(evidence, data, decision, (&causes, &leads, together.as_ref(), gap)),
        gap: gap.clone(),
        place: place(evidence, data, &causes, gap),
        ranking: decision.ranking.clone(),
        rounds: rounds.map(|(round, judgement)| narrative::round(round, judgement)).collect(),
        visual: None,
        torque_balance: (!data.joint_rows.is_empty())
            .then(|| TorqueBalance { joints: data.joint_rows.clone(), ..Default::default() }),
        unexplained: Remainder { share: left(verdict, gap), depends_on: shown.depends_on.clone() },
        cannot_tell: data.cannot_tell.iter().cloned().chain(doubt_of_null(evidence, verdict, gap, decision)).collect(),
        next: narrative::next(evidence, data, decision, (&causes, &leads, gap)),
        corrections: shown.corrections.clone(),
        corrections_apply: causes.is_empty() || gap.after <= gap.before,
        cannot_show: data.cannot_show.clone(),
        can_tell: data.can_tell.clone(),
        heat_map: shown.heat_map.clone(),
        floor_plan: shown.floor_plan.clone(),
        curves: shown.curves.clone(),
        traces: data.traces.clone(),
        stages: data.stages.clone(),
        timing: data.timing.clone(),
        policy: decision.policy.clone(),
        provenance: data.provenance.clone(),
        causes,
        leads,
        together,
    };
    if let (Some(camera), Some(decision)) = (&evidence.camera, &decision.camera) {
        join(&mut report, Sight::new(camera, decision));
    }
    Ok(report)
}

/// What is accused, with its score.
fn causes(data: &ReportData, decision: &Decision) -> Vec<Cause> {
    let score = |effect: &str| decision.ranking.iter().find(|r| r.effect == effect).map_or(0.0, |r| r.score);
    let accused = data.causes.iter().filter(|_| decision.accuses()).map(|data| &data.cause);
    accused.map(|cause| Cause { score: score(&cause.effect), ..cause.clone() }).collect()
}

/// What a held robot without a gap is not: replicates of one joint that run away take the null with them, and say nothing of the others.
fn doubt_of_null(evidence: &Evidence, verdict: Verdict, gap: &Gap, decision: &Decision) -> Option<String> {
    let is_beyond = gap.before > decision.policy.held_windows.no_gap * gap.floor;
    (verdict == Verdict::NoGap && !evidence.is_free && is_beyond).then(|| {
        format!(
            "Held-out windows lie {:.1} times above the noise floor, and their joints {:.0} mrad off: simulated replicates may have spoiled the null. \
             Give recordings of the robot as it should be (--reference).",
            gap.before / gap.floor,
            1e3 * gap.joint_rms[0]
        )
    })
}

/// Share of the gap that is left.
fn left(verdict: Verdict, gap: &Gap) -> f64 {
    let is_none = verdict == Verdict::NoGap || gap.before <= gap.floor * NEAR_FLOOR;
    if is_none { 0.0 } else { (1.0 - gap.closed).min(1.0) }
}

fn place(evidence: &Evidence, data: &ReportData, causes: &[Cause], gap: &Gap) -> Where {
    let found = data.causes.iter().filter(|_| !causes.is_empty()).filter_map(|c| c.region.clone());
    let regions = found.chain(data.place.regions.iter().cloned()).collect();
    Where { interfaces: interfaces(evidence, data, causes, gap.closed), regions, ..data.place.clone() }
}

/// Shares of the interfaces: those of the causes by what they close, the rest by what speaks for each interface.
fn interfaces(evidence: &Evidence, data: &ReportData, causes: &[Cause], closed: f64) -> Vec<Share> {
    let [least, least_of_all] = LEAST_SHARES;
    let total: f64 = causes.iter().map(|c| c.closed_alone.max(least)).sum();
    let explained = if causes.is_empty() { 0.0 } else { closed.max(least_of_all) };
    let share = |Share { name, share }: &Share| {
        let is_of = |c: &&Cause| evidence.effect(&c.effect).is_some_and(|e| e.interface == *name);
        let of_causes: f64 = causes.iter().filter(is_of).map(|c| c.closed_alone.max(least) / total).sum();
        Share { name: name.clone(), share: explained * of_causes + (1.0 - explained) * share }
    };
    let visual = Share { name: "visual".into(), share: 0.0 };
    data.interfaces.iter().map(share).chain([visual]).collect()
}
