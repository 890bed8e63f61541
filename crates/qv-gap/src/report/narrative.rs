//! What a diagnosis says in words: the verdict, what to do next.

use crate::checks::by_recording::change;
use crate::decision::evidence::{Candidate, CauseData, Evidence, ReportData, Round};
use crate::decision::{Decision, Judgement, Policy};
use crate::report::{
    Cause, Gap, Lead, OfRecording, ParameterEstimate, RankedEffect, RoundSummary, SuspectSummary, Together,
    TogetherEffect, UNKNOWN, Verdict,
};
use qv_page::significant;

/// Share of the evidence of what is accused from which on another effect does nearly as well.
const NEARLY_AS_GOOD: f64 = 0.95;
/// Gap over floor from which on advice begins with the model: of 157 recordings of one or two effects the largest had 143.
const HUGE_GAP: f64 = 200.0;
/// The same where no effect explains it: a model with all masses times 3 makes 60 to 90, with half as much again 30.
const LARGE_UNEXPLAINED: f64 = 25.0;

/// Effects that nothing shows from each other where the base goes as its legs say: a tilted IMU walks on a slope, and a foot that slips or
/// bounces makes a start that is wrong.
const ONE_WITHOUT_POSES: [&[&str]; 2] =
    [&["imu_tilt", "terrain_slope"], &["ground_friction", "contact_restitution", "contact_compliance"]];

/// The others of an effect's set of those.
pub fn one_without_poses(effect: &str) -> impl Iterator<Item = &'static str> {
    let set = ONE_WITHOUT_POSES.into_iter().find(|set| set.contains(&effect)).unwrap_or_default();
    set.iter().copied().filter(move |other| *other != effect)
}

/// What is to be said beside the verdict on a walk without poses.
fn beside_verdict(causes: &[Cause]) -> Vec<String> {
    let words = |cause: &Cause| {
        let others: Vec<String> = one_without_poses(&cause.effect).map(|o| o.replace('_', " ")).collect();
        let effect = cause.effect.replace('_', " ");
        (!others.is_empty()).then(|| format!("Without poses {effect} cannot be stated from {}.", others.join(" or ")))
    };
    causes.iter().filter_map(words).collect()
}

/// An amount in the unit that people use for it.
pub fn amount(estimate: &ParameterEstimate) -> String {
    let (factor, unit) = match estimate.unit.as_str() {
        "s" if !["start", "end"].contains(&estimate.name.as_str()) => (1e3, "ms"),
        "rad" => (1e3, "mrad"),
        "m" if estimate.name == "radius_offset" => (1e3, "mm"),
        "1" if estimate.name != "friction" && estimate.name != "restitution" => (100.0, "%"),
        "1" => (1.0, ""),
        unit => (1.0, unit),
    };
    format!("{} {:.3} {unit}", estimate.name.replace('_', " "), factor * estimate.value).trim_end().to_string()
}

/// Size of the first effect of a lead, and on what it acts.
pub fn amounts(lead: &Lead) -> String {
    let amounts: Vec<String> = lead.parameters.iter().map(amount).collect();
    format!("{}{}", amounts.join(", "), whereabouts(&lead.scope))
}

/// On what an effect acts, as a part of a sentence; nothing if it acts on all there is.
fn whereabouts(scope: &[String]) -> String {
    match scope {
        [one] if one == "all" => String::new(),
        [one] if one == "region" => " in a part of the floor".into(),
        some => format!(" at {}", some.join(", ")),
    }
}

/// A sentence with one mark at its end.
fn ended(sentence: &str) -> String {
    if sentence.ends_with('?') { sentence.into() } else { format!("{sentence}.") }
}

/// What a gap that nothing explains looks most like.
fn nearest(lead: &Lead) -> String {
    let names: Vec<String> = lead.effects.iter().map(|e| e.replace('_', " ")).collect();
    format!(
        "Nearest candidate, not identified: {} ({}), which would remove {:.0} % of the gap. To separate: {}",
        names.join(" or "),
        amounts(lead),
        100.0 * lead.closed,
        ended(&lead.separating_experiment)
    )
}

/// Share of the gap below which nothing is said to be closed.
const NOTHING: f64 = 0.005;
/// Share of the gap from which on an effect is not said to leave it unexplained.
const MUCH: f64 = 0.5;

/// The verdict and all that is to be said beside it.
pub fn whole(
    evidence: &Evidence,
    data: &ReportData,
    decision: &Decision,
    (causes, leads, several, gap): (&[Cause], &[Lead], Option<&Together>, &Gap),
) -> String {
    let sentence = sentence(decision.verdict, (causes, gap), (leads, &data.dead), &decision.ranking);
    let as_good = as_good(evidence.rounds.first(), causes);
    let all = [Some(sentence), as_good, several.map(together), disagree(causes, leads, &decision.policy)];
    let of_legs = if data.on_legs { beside_verdict(causes) } else { Vec::new() };
    let fall = data.fall.iter().map(|fall| format!("({fall}.)"));
    all.into_iter().flatten().chain(of_legs).chain(fall).collect::<Vec<_>>().join(" ")
}

/// The verdict in a sentence; `dead` are joints whose positions are not known.
fn sentence(
    verdict: Verdict,
    (causes, gap): (&[Cause], &Gap),
    (leads, dead): (&[Lead], &[String]),
    ranking: &[RankedEffect],
) -> String {
    let described = |c: &Cause| {
        let amounts: Vec<String> = c.parameters.iter().map(amount).collect();
        format!("{}{} ({})", c.effect.replace('_', " "), whereabouts(&c.scope), amounts.join(", "))
    };
    let all: Vec<String> = causes.iter().map(described).collect();
    let closed = format!("{:.0} % of the excess error in held-out windows", 100.0 * gap.closed);
    match verdict {
        Verdict::NoGap => "No gap: simulator and robot agree within sensor noise and tolerances.".into(),
        Verdict::Explained => {
            let them = if all.len() > 1 { "them" } else { "it" };
            format!("Cause: {}. Correcting {them} removes {closed}.", all.join(" and "))
        }
        Verdict::PartlyExplained if gap.closed < NOTHING => {
            let alone = causes.iter().filter(|c| c.scope == ["region"]).map(|c| c.closed_alone).fold(0.0, f64::max);
            let pieces = if alone < NOTHING {
                String::new()
            } else {
                // Feet that slip go their own way: two simulations of a window differ by more than the window from either.
                format!(" (it removes {:.0} % in windows a third as long)", 100.0 * alone)
            };
            let no_closer = "correcting it does not reduce the error of whole held-out windows";
            format!("A part of the gap is {}, but {no_closer}{pieces}; the rest has another cause.", all.join(" and "))
        }
        Verdict::PartlyExplained => {
            let part = if gap.closed < 0.5 { "A part" } else { "Most" };
            let sizes = all.join(" and ");
            format!("{part} of the gap is {sizes}. Correcting it removes {closed}; the rest has another cause.")
        }
        // Whatever is nearest may be due to that alone.
        Verdict::Unexplained if !dead.is_empty() => format!(
            "There is a gap, and {} did not change throughout the recording: repair that before any diagnosis.",
            dead.join(", ")
        ),
        Verdict::Unexplained => {
            let runner_up = ranking.iter().map(|r| &r.effect).find(|e| *e != UNKNOWN);
            let nearest = match leads.first() {
                Some(lead) if lead.closed > MUCH => Some(format!(
                    " The nearest candidate, {}, would remove {:.0} % of it, but is not identified: see the next steps.",
                    lead.effects.first().map_or(String::new(), |e| e.replace('_', " ")),
                    100.0 * lead.closed
                )),
                lead => lead.and_then(|l| l.effects.first()).or(runner_up).map(|effect| {
                    format!(" The nearest candidate, {}, does not explain it.", effect.replace('_', " "))
                }),
            };
            format!("There is a gap that no single effect of the library explains.{}", nearest.unwrap_or_default())
        }
    }
}

/// That recordings ask for different sizes of a cause, or else of the first lead; `None` where they agree.
fn disagree(causes: &[Cause], leads: &[Lead], policy: &Policy) -> Option<String> {
    let of_cause = |c: &Cause| (c.effect.clone(), c.parameters.first().cloned(), c.by_recording.clone());
    let of_lead = |l: &Lead| (l.effects[0].clone(), l.parameters.first().cloned(), l.by_recording.clone());
    let all = causes.iter().map(of_cause).chain(leads.iter().take(1).filter(|_| causes.is_empty()).map(of_lead));
    all.filter_map(|(effect, parameter, of)| {
        let change = change(&of, policy)?;
        let with = |value: f64| {
            parameter.as_ref().map_or(String::new(), |p| amount(&ParameterEstimate { value, ..p.clone() }))
        };
        let place = of.iter().position(|o| o.recording == change.since)?;
        let numbers = |some: &[OfRecording]| {
            let all: Vec<String> = some.iter().map(|o| (o.recording + 1).to_string()).collect();
            all.join(", ")
        };
        let plural = |some: &[OfRecording]| if some.len() > 1 { "recordings" } else { "recording" };
        let [before, after] = [&of[..place], &of[place..]];
        Some(format!(
            "The recordings disagree about {}: {} {} ask for {}, {} {} for {}.",
            effect.replace('_', " "),
            plural(before),
            numbers(before),
            with(change.values[0]),
            plural(after),
            numbers(after),
            with(change.values[1])
        ))
    })
    .next()
}

/// What several effects do together, in a sentence: no accusation.
fn together(together: &Together) -> String {
    let described = |e: &TogetherEffect| {
        let amounts: Vec<String> = e.parameters.iter().map(amount).collect();
        let names: Vec<String> = e.names().map(|name| name.replace('_', " ")).collect();
        format!("{}{} ({})", names.join(" or "), whereabouts(&e.scope), amounts.join(", "))
    };
    let all: Vec<String> = together.effects.iter().map(described).collect();
    format!(
        "Fitted together, these would remove {:.0} % and change joint position errors from {} to {} mrad: {}. None of them is identified.",
        100.0 * together.closed,
        significant(1e3 * together.joint_rms[0], 3),
        significant(1e3 * together.joint_rms[1], 3),
        all.join("; ")
    )
}

/// Steady effects that have nearly the evidence of the one that is accused, in words; `None` if there are none, or if more is accused.
fn as_good(first: Option<&Round>, causes: &[Cause]) -> Option<String> {
    let ([cause], round) = (causes, first?) else { return None };
    let accused = &round.candidates[*round.accused.first()?];
    let is_as_good = |c: &&Candidate| {
        let has_evidence = c.log_evidence > NEARLY_AS_GOOD * accused.log_evidence;
        c.extent.is_none() && c.effect != cause.effect && has_evidence
    };
    let mut others: Vec<String> = Vec::new();
    for other in round.candidates.iter().filter(is_as_good).map(|c| c.effect.replace('_', " ")) {
        if !others.contains(&other) {
            others.push(other);
        }
    }
    let is_steady = accused.extent.is_none();
    (is_steady && !others.is_empty()).then(|| {
        format!("In this recording {} would explain it nearly as well: treat them as one group.", others.join(" or "))
    })
}

/// A round in words, and what it came to.
pub fn round(round: &Round, judgement: &Judgement) -> RoundSummary {
    let mut suspects: Vec<SuspectSummary> = Vec::new();
    for candidate in &round.candidates {
        if suspects.iter().all(|s| s.effect != candidate.effect) {
            suspects.push(SuspectSummary {
                effect: candidate.effect.clone(),
                scope: candidate.scope.clone(),
                parameters: candidate.parameters.clone(),
                log_evidence: candidate.log_evidence,
                // Of nothing there is no share.
                share: if round.excess > 0.0 { candidate.share } else { 0.0 },
            });
        }
    }
    let accused = judgement.accused.iter().map(|&k| round.candidates[k].effect.clone()).collect();
    let reason = judgement.refused.as_ref().map_or(String::new(), |(effect, why)| format!("{effect}: {why}"));
    RoundSummary { level: round.level.ratio, suspects, accused, reason }
}

/// What to look at before any effect: broken encoders, `dead`, and a model that is another robot's.
fn first_of_all(verdict: Verdict, gap: &Gap, dead: &[String]) -> Vec<String> {
    let mut first = Vec::new();
    if !dead.is_empty() {
        first.push(format!(
            "Repair {} and record again: without the position of a joint the links near it cannot be simulated.",
            dead.join(", ")
        ));
    }
    if verdict != Verdict::NoGap && gap.before > HUGE_GAP * gap.floor {
        first.push(format!(
            "The gap is {:.0} times the noise floor. Check the model first: masses and lengths of the URDF, names and order of the \
             joints, gains, units and signs of every channel.",
            gap.before / gap.floor
        ));
    } else if verdict == Verdict::Unexplained && dead.is_empty() && gap.before > LARGE_UNEXPLAINED * gap.floor {
        first.push(format!(
            "The gap is {:.0} times the noise floor, and no effect explains it: the model may be wrong. Check masses and lengths of \
             the URDF, gains and units first.",
            gap.before / gap.floor
        ));
    }
    first
}

/// Edges of a slippery part of the floor that no foot came to.
fn beyond_feet(data: &CauseData) -> Option<String> {
    data.region.as_ref()?;
    let which = if data.untested.is_empty() {
        "Its edges lie".into()
    } else {
        format!("Beyond {} no foot stood: the ground may go on there. All edges lie", data.untested.join(", "))
    };
    Some(format!("{which} in the frame of this recording's poses: odometry that begins elsewhere moves them."))
}

/// What another recording would say of the corrections.
fn once_more(verdict: Verdict, causes: &[Cause]) -> &'static str {
    let is_event = |c: &Cause| c.parameters.iter().any(|p| p.name == "start");
    if causes.iter().any(is_event) {
        "A disturbance belongs to this recording: remove external.* from calibrated.toml before you use it for another one."
    } else if verdict == Verdict::Explained {
        "Record once more and diagnose with --params calibrated.toml: the verdict should be no_gap."
    } else {
        "Record once more and diagnose with --params calibrated.toml: what remains has another cause."
    }
}

/// The experiment of a cause, and those of the first two effects that it looks like.
fn apart(cause: &Cause, evidence: &Evidence) -> String {
    let of = |name: &String| evidence.effect(name).map(|e| &e.experiment);
    let mut all = vec![&cause.separating_experiment];
    for other in cause.confusable_with.iter().take(2).filter_map(of) {
        if !other.is_empty() && !all.contains(&other) {
            all.push(other);
        }
    }
    ended(&all.iter().map(|e| e.trim_end_matches(['.', '?'])).collect::<Vec<_>>().join("; or "))
}

/// Share that a slippery region closes in pieces of windows, if one was found.
fn slips<'c>(evidence: &Evidence, causes: impl Iterator<Item = &'c Cause>) -> Option<f64> {
    let in_pieces = |c: &Candidate| c.held_out.as_ref().is_some_and(|h| h.fall_of_pieces.is_some());
    evidence.accused().zip(causes).find(|((_, c), _)| in_pieces(c)).map(|(_, cause)| cause.closed_alone)
}

/// What to do next.
pub fn next(
    evidence: &Evidence,
    data: &ReportData,
    decision: &Decision,
    (causes, leads, gap): (&[Cause], &[Lead], &Gap),
) -> Vec<String> {
    let verdict = decision.verdict;
    let mut next = first_of_all(verdict, gap, &data.dead);
    if let Some(closed) = slips(evidence, causes.iter()) {
        next.push(format!(
            "Whole windows cannot be predicted where feet slip. In windows of 0.1 s this friction removes {:.0} % of the error \
             of the feet in that region.",
            100.0 * closed
        ));
    }
    match verdict {
        Verdict::NoGap => next.push("Nothing to correct. Faster and larger motions test more.".into()),
        Verdict::Explained | Verdict::PartlyExplained => {
            next.push(if gap.after > gap.before {
                format!(
                    "The effect is present, but correcting it alone raises the error of held-out windows from {1:.2} to {0:.2}. No file applies it.",
                    gap.after, gap.before
                )
            } else {
                "Use calibrated.toml, or the corrections for MuJoCo, URDF and Isaac Lab beside it: `qv replay NEW_RUN --params calibrated.toml --out replay`.".into()
            });
            next.extend(data.causes.iter().filter_map(beyond_feet));
            next.push(once_more(verdict, causes).into());
            for cause in causes.iter().filter(|c| !c.confusable_with.is_empty()) {
                let likes = cause.confusable_with.join(", ");
                next.push(format!(
                    "{} looks like {likes} here. To separate them: {}",
                    cause.effect,
                    apart(cause, evidence)
                ));
            }
        }
        Verdict::Unexplained => {
            next.push(
                "Check the recording and the model first: docs/guide/troubleshooting.md lists symptom, check and command. An effect of your own goes into --library.".into(),
            );
            if data.recordings > 1 {
                next.push("Diagnose each recording separately, too: one cause is assumed for all of them.".into());
            }
            next.extend(leads.first().map(nearest));
            let best = evidence.rounds.first().and_then(|r| r.candidates.first());
            let is_open = leads.is_empty() && data.dead.is_empty();
            if let Some(effect) = best.filter(|_| is_open).and_then(|best| evidence.effect(&best.effect)) {
                next.push(format!("To rule {} out or in: {}", effect.name, ended(&effect.experiment)));
            }
        }
    }
    if let Some((effect, why)) = decision.rounds.last().and_then(|r| r.refused.as_ref()) {
        next.push(format!("Not identified: {effect}: {why}."));
    }
    if let (Some(doubt), Some(first)) = (&decision.doubt, data.causes.first()) {
        next.push(format!("Not identified: {}: {doubt}.", first.cause.effect));
    }
    next
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn what_closes_nothing_of_whole_windows_is_not_said_to_close_it() {
        let cause = |closed_alone| Cause {
            effect: "ground_friction".into(),
            score: 0.9,
            scope: vec!["region".into()],
            parameters: vec![],
            closed_alone,
            confusable_with: vec![],
            separating_experiment: String::new(),
            by_recording: vec![],
        };
        let gap = |closed| Gap {
            before: 1.4,
            after: 7.3,
            floor: 0.8,
            closed,
            closed_ci95: [0.0, closed],
            closed_in_fit: None,
            unit: "1".into(),
            heldout: true,
            joint_rms: [0.007, 0.018],
            joint_rms_apart: None,
        };
        let remarks =
            |alone, closed| sentence(Verdict::PartlyExplained, (&[cause(alone)], &gap(closed)), (&[], &[]), &[]);
        let slips = remarks(0.24, 0.0);
        assert!(slips.states("held-out 24"), "{slips}");
        assert!(!remarks(0.0, 0.0).contains('%') && !slips.contains("removes 0 %"));
        assert!(remarks(0.24, 0.3).states("windows 30"));
    }
}
