//! What a diagnosis says in words: what it cannot tell and why, the verdict, what to do next.

use crate::checks::by_recording::{OfRecording, change};
use crate::decision::Policy;
use crate::decision::evidence::{Candidate, Round};
use crate::inference::linearised::LinearisedProblem;
use crate::inference::regions::{EDGES, untested};
use crate::inference::search::{direction, fitted};
use crate::inference::short_windows::feet;
use crate::problem::columns::Suspect;
use crate::problem::library::Effect;
use crate::report::{
    Cause, Gap, Lead, ParameterEstimate, Ranked, RoundSummary, SuspectSummary, Together, TogetherEffect, UNKNOWN,
    Verdict,
};
use qv_fit::linear::{add_scaled, add_scaled_matrix, dot, product, times, transposed_product, transposed_times};
use qv_fit::{Cholesky, Matrix};
use qv_page::significant;
use qv_recording::Run;

/// Cosine of the angle between sensitivities from which effects count as alike.
const ALIKE: f64 = 0.75;

/// Effects that this recording cannot show, and channels whose lack is the reason.
pub fn missing(study: &LinearisedProblem, run: &Run, library: &[Effect]) -> Vec<String> {
    let m = &run.measured;
    let mut told = Vec::new();
    if study.rollout.on_legs {
        told.push(
            "no poses of the base were measured: windows start where its legs and its IMU say that it is, feet that slip at the start of one go \
             unnoticed, and where on the floor a cause lies cannot be told"
                .to_string(),
        );
    }
    if m.torque.is_none() {
        told.push(
            "joint torques were not measured: what the motors do cannot be told from what the links do".to_string(),
        );
    }
    if study.rollout.free && m.orientation.is_none() {
        told.push("there is no IMU orientation: tilt of the IMU and delay of the pose cannot be told".to_string());
    }
    let lacking = lacking(study, library);
    if !lacking.is_empty() {
        told.push(format!("no channel or part of this robot could show {}", lacking.join(", ")));
    }
    told.extend(judged(study, run));
    told.extend(strangers(study, run));
    told.extend(resting(study));
    if study.rollout.free && m.gyro.is_none() {
        told.push("there is no gyroscope: its bias cannot be told".to_string());
    }
    let weak = weak_of_measured(study, run);
    if !weak.is_empty() {
        told.push(format!("too little excitation to tell {}", weak.join(", ")));
    }
    told
}

/// Effects that this recording cannot show, by name: no channel or part could, or there is too little excitation.
pub fn cannot_show(study: &LinearisedProblem, run: &Run, library: &[Effect]) -> Vec<String> {
    let mut names: Vec<String> = lacking(study, library).into_iter().map(str::to_owned).collect();
    names.extend(weak_of_measured(study, run));
    if !study.at_rest.is_empty() && study.at_rest.len() == study.rollout.columns.len() {
        names.push("pose_delay".into());
    }
    names.sort();
    names.dedup();
    names
}

fn lacking<'l>(study: &LinearisedProblem, library: &'l [Effect]) -> Vec<&'l str> {
    let has = |e: &&Effect| study.columns.effects.iter().any(|s| s.name == e.name);
    // What is looked for in other robots alone is no lack of this recording.
    let is_sought = |e: &&Effect| !(study.rollout.free && e.held_only);
    library.iter().filter(|e| is_sought(e) && !has(e)).map(|e| e.name.as_str()).collect()
}

/// Effects with too little excitation. What has no channel of its own lacks none.
fn weak_of_measured(study: &LinearisedProblem, run: &Run) -> Vec<String> {
    let m = &run.measured;
    let is_measured = |effect: &String| match effect.as_str() {
        "gyro_bias" => m.gyro.is_some(),
        "imu_tilt" | "pose_delay" => m.orientation.is_some(),
        _ => true,
    };
    weak(study).into_iter().filter(is_measured).collect()
}

/// How much of the recording could be judged, where that is less than half.
fn judged(study: &LinearisedProblem, run: &Run) -> Option<String> {
    let cut = study.rollout.cut;
    let [first, last] = run.span();
    let windows = study.seen.iter().filter(|s| s.window.run == 0);
    let (count, [from, until]) = windows.fold((0, [f64::INFINITY, f64::NEG_INFINITY]), |(n, [from, until]), s| {
        (n + 1, [from.min(s.window.start), until.max(s.window.start + cut.window)])
    });
    let whole = (((last - first) / cut.window) as usize).min(cut.most);
    (2 * count < whole).then(|| {
        format!(
            "{count} of {whole} windows of {} s could be judged, from {from:.1} to {until:.1} s of {first:.1} to {last:.1} s: the others lack \
             values of a channel or jump",
            cut.window
        )
    })
}

/// Joints of the recording that the model lacks, and joints of the model that nothing commands: one name written in two ways makes both.
fn strangers(study: &LinearisedProblem, run: &Run) -> Vec<String> {
    let columns = &study.rollout.columns;
    let unknown =
        run.joint_names.iter().enumerate().filter(|(k, _)| !columns.contains(k)).map(|(_, name)| name.as_str());
    let unknown: Vec<&str> = unknown.collect();
    let is_used = |name: &&str| columns.iter().any(|k| run.joint_names[*k] == *name);
    let silent: Vec<&str> = run.uncommanded().into_iter().filter(is_used).collect();
    let mut told = Vec::new();
    if !unknown.is_empty() {
        told.push(format!("joints of the recording that the model lacks are left out: {}", unknown.join(", ")));
    }
    if !silent.is_empty() {
        told.push(format!("no commands were recorded of {}: they are taken for 0", silent.join(", ")));
    }
    told
}

/// Joints at rest, and what they cannot show.
fn resting(study: &LinearisedProblem) -> Option<String> {
    let names = study.rollout.model.joint_names();
    let resting: Vec<&str> = study.at_rest.iter().map(|&j| names[j].as_str()).collect();
    let (whose, what) = match resting.len() {
        0 => return None,
        all if all == study.rollout.columns.len() => ("no joint moves: no delay of the pose,".to_string(), ""),
        _ => (format!("{} hardly move: no", resting.join(", ")), " of them"),
    };
    Some(format!("{whose} latency, lag, velocity gain, viscous friction or rotor inertia{what} is accused"))
}

/// Effects whose value this recording leaves open by more than half of their range.
fn weak(study: &LinearisedProblem) -> Vec<String> {
    let Ok(marginal) = study.marginal(fitted) else { return Vec::new() };
    let mut weak: Vec<String> = Vec::new();
    for (index, effect) in study.columns.effects.iter().enumerate() {
        let group = study.columns.groups.iter().position(|g| g.effect == index);
        let open = |level: usize| {
            let Some(d) = group.and_then(|g| direction(&study.columns, g, level)) else { return true };
            let h = transposed_product(&d.d, &product(&marginal.curvature, &d.d));
            // A limit that never bites has no curvature at any level.
            (0..d.steps.len()).all(|a| {
                h[(a, a)] < 1e-9 || d.steps[a].abs() / h[(a, a)].sqrt() > 0.25 * effect.span().max(d.steps[a].abs())
            })
        };
        if (0..effect.levels.len()).all(open) {
            weak.push(effect.name.clone());
        }
    }
    weak
}

/// Effects whose sensitivities point nearly the same way as a suspect's.
pub fn confusable(study: &LinearisedProblem, suspect: &Suspect) -> Vec<String> {
    let columns = &study.columns;
    let Some(own) = direction(columns, suspect.group, 0) else { return Vec::new() };
    let mut h = Matrix::zeros(study.width(), study.width());
    study.seen.iter().for_each(|s| add_scaled_matrix(&mut h, fitted(s), &s.h));
    // Along the values that were found.
    let mut along = vec![0.0; study.width()];
    for (axis, value) in suspect.values.iter().enumerate() {
        let absent = if own.absent[axis].is_finite() { own.absent[axis] } else { value - own.steps[axis] };
        add_scaled(&mut along, (value - absent) / own.steps[axis], own.d.col_as_slice(axis));
    }
    let length = dot(&along, &times(&h, &along)).sqrt();
    let names = &columns.groups[suspect.group].names;
    let mut alike: Vec<(f64, String)> = Vec::new();
    for (index, group) in columns.groups.iter().enumerate() {
        let effect = &columns.effects[group.effect];
        if group.effect == columns.groups[suspect.group].effect || (group.names != *names && group.names != ["all"]) {
            continue;
        }
        let Some(other) = direction(columns, index, 0) else { continue };
        // The angle to the space that the other effect's axes span.
        let hd = product(&h, &other.d);
        let projection = transposed_times(&hd, &along);
        let Some(factor) = Cholesky::new(&transposed_product(&other.d, &hd)) else { continue };
        let cosine = factor.length(&projection).sqrt() / length.max(1e-300);
        if cosine > ALIKE && !alike.iter().any(|(_, name)| *name == effect.name) {
            alike.push((cosine, effect.name.clone()));
        }
    }
    alike.sort_by(|a, b| b.0.total_cmp(&a.0));
    let own = &columns.effects[columns.groups[suspect.group].effect].name;
    let mut names: Vec<String> = alike.into_iter().map(|a| a.1).collect();
    for other in one_without_poses(own).filter(|_| study.rollout.on_legs) {
        if columns.effects.iter().any(|e| e.name == other) && !names.iter().any(|n| n == other) {
            names.push(other.into());
        }
    }
    names
}

/// Effects that nothing tells from each other where the base goes as its legs say: a tilted IMU walks on a slope, and a foot that slips or
/// bounces makes a start that is wrong.
const ONE_WITHOUT_POSES: [&[&str]; 2] =
    [&["imu_tilt", "terrain_slope"], &["ground_friction", "contact_restitution", "contact_compliance"]];

/// The others of an effect's set of those.
fn one_without_poses(effect: &str) -> impl Iterator<Item = &'static str> {
    let set = ONE_WITHOUT_POSES.into_iter().find(|set| set.contains(&effect)).unwrap_or_default();
    set.iter().copied().filter(move |other| *other != effect)
}

/// What is to be said beside the verdict on a walk without poses.
pub fn beside_verdict(causes: &[Cause]) -> Vec<String> {
    let words = |cause: &Cause| {
        let others: Vec<String> = one_without_poses(&cause.effect).map(|o| o.replace('_', " ")).collect();
        let effect = cause.effect.replace('_', " ");
        (!others.is_empty()).then(|| format!("Without poses {effect} cannot be told from {}.", others.join(" or ")))
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
pub fn nearest(lead: &Lead) -> String {
    let names: Vec<String> = lead.effects.iter().map(|e| e.replace('_', " ")).collect();
    format!(
        "Nearest, not accused: {} ({}), which would close {:.0} % of the gap. To tell: {}",
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

/// The verdict in a sentence; `dead` are joints whose positions are not known.
pub fn sentence(
    verdict: Verdict,
    (causes, gap): (&[Cause], &Gap),
    (leads, dead): (&[Lead], &[&str]),
    ranking: &[Ranked],
) -> String {
    let described = |c: &Cause| {
        let amounts: Vec<String> = c.parameters.iter().map(amount).collect();
        format!("{}{} ({})", c.effect.replace('_', " "), whereabouts(&c.scope), amounts.join(", "))
    };
    let all: Vec<String> = causes.iter().map(described).collect();
    let closed = format!("{:.0} % of the gap in windows that no fit has seen", 100.0 * gap.closed);
    match verdict {
        Verdict::NoGap => {
            "Simulator and robot agree as well as sensor noise and the tolerances of any robot let them.".into()
        }
        Verdict::Explained => {
            let them = if all.len() > 1 { "them" } else { "it" };
            format!("The gap is {}; with {them} the simulator closes {closed}.", all.join(" and "))
        }
        Verdict::PartlyExplained if gap.closed < NOTHING => {
            let alone = causes.iter().filter(|c| c.scope == ["region"]).map(|c| c.closed_alone).fold(0.0, f64::max);
            let pieces = if alone < NOTHING {
                String::new()
            } else {
                // Feet that slip go their own way: two simulations of a window differ by more than the window from either.
                format!(" (of pieces a third as long it closes {:.0} %)", 100.0 * alone)
            };
            let no_closer = "whole windows that no fit has seen come no closer with it";
            format!(
                "A part of the gap is {}, but {no_closer}{pieces}; something else is there, too.",
                all.join(" and ")
            )
        }
        Verdict::PartlyExplained => {
            let part = if gap.closed < 0.5 { "A part" } else { "Most" };
            format!("{part} of the gap is {}, which closes {closed}; something else is there, too.", all.join(" and "))
        }
        // Whatever is nearest may be due to that alone.
        Verdict::Unexplained if !dead.is_empty() => format!(
            "There is a gap, and {} stood still throughout: nothing can be told before that is mended.",
            dead.join(", ")
        ),
        Verdict::Unexplained => {
            let runner_up = ranking.iter().map(|r| &r.effect).find(|e| *e != UNKNOWN);
            let nearest = match leads.first() {
                Some(lead) if lead.closed > MUCH => Some(format!(
                    " The nearest, {}, would close {:.0} % of it, but is not accused: see what to do next.",
                    lead.effects.first().map_or(String::new(), |e| e.replace('_', " ")),
                    100.0 * lead.closed
                )),
                lead => lead
                    .and_then(|l| l.effects.first())
                    .or(runner_up)
                    .map(|effect| format!(" The nearest, {}, does not explain it.", effect.replace('_', " "))),
            };
            format!("There is a gap that no single effect of the library explains.{}", nearest.unwrap_or_default())
        }
    }
}

/// That recordings ask for different sizes of a cause, or else of the first lead; `None` where they agree.
pub fn disagree(causes: &[Cause], leads: &[Lead], policy: &Policy) -> Option<String> {
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
pub fn together(together: &Together) -> String {
    let described = |e: &TogetherEffect| {
        let amounts: Vec<String> = e.parameters.iter().map(amount).collect();
        let names: Vec<String> = e.names().map(|name| name.replace('_', " ")).collect();
        format!("{}{} ({})", names.join(" or "), whereabouts(&e.scope), amounts.join(", "))
    };
    let all: Vec<String> = together.effects.iter().map(described).collect();
    format!(
        "Fitted at once, these would close {:.0} % and take positions of joints from {} to {} mrad: {}. None of them is accused.",
        100.0 * together.closed,
        significant(1e3 * together.joint_rms[0], 3),
        significant(1e3 * together.joint_rms[1], 3),
        all.join("; ")
    )
}

/// Share of the evidence of what is accused from which on another effect does nearly as well.
const NEARLY_AS_GOOD: f64 = 0.95;

/// Steady effects that have nearly the evidence of the one that is accused, in words; `None` if there are none, or if more is accused.
pub fn as_good(first: Option<&Round>, causes: &[Cause]) -> Option<String> {
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
    (is_steady && !others.is_empty())
        .then(|| format!("In this recording {} would do nearly as well: take them as one group.", others.join(" or ")))
}

/// A round in words; `reason` is why the best was not accused.
pub fn round(round: &Round, reason: &str) -> RoundSummary {
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
    let accused = round.accused.iter().map(|&k| round.candidates[k].effect.clone()).collect();
    RoundSummary { level: round.level.ratio, suspects, accused, reason: reason.to_owned() }
}

/// Gap over floor from which on it is more than effects of the library make: of 157 recordings of one or two of them the largest had 143.
const HUGE: f64 = 200.0;
/// The same where no effect explains it: a model with all masses times 3 makes 60 to 90, with half as much again 30.
const LARGE: f64 = 25.0;

/// What to look at before any effect: broken encoders, `dead`, and a model that is another robot's.
pub fn first_of_all(verdict: Verdict, gap: &Gap, dead: &[&str]) -> Vec<String> {
    let mut first = Vec::new();
    if !dead.is_empty() {
        first.push(format!(
            "Mend {} and record again: without a joint's position nothing near it can be simulated, and what is left may be due to that alone.",
            dead.join(", ")
        ));
    }
    if verdict != Verdict::NoGap && gap.before > HUGE * gap.floor {
        first.push(format!(
            "The gap is {:.0} times what noise makes. Check the model before anything else: masses and lengths of the URDF, names and order of the \
             joints, gains, units and signs of every channel.",
            gap.before / gap.floor
        ));
    } else if verdict == Verdict::Unexplained && dead.is_empty() && gap.before > LARGE * gap.floor {
        first.push(format!(
            "The gap is {:.0} times what noise makes, and no effect explains it: it may be the model's. Weigh the robot, and check masses and lengths of \
             the URDF, gains and units, before you look for what the robot does.",
            gap.before / gap.floor
        ));
    }
    first
}

/// Edges of a slippery part of the floor that no foot came to.
fn beyond_feet(cause: &Cause, study: &LinearisedProblem) -> Option<String> {
    let edge = |name: &str| cause.parameters.iter().find(|p| p.name == name).map(|p| p.value);
    let [x0, x1, y0, y1] = EDGES.map(edge);
    let region = [x0?, x1?, y0?, y1?];
    let untested = untested(&feet(study), region);
    let which = if untested.is_empty() {
        "Its edges lie".into()
    } else {
        format!("Beyond {} no foot stood: the ground may go on there. All edges lie", untested.join(", "))
    };
    Some(format!("{which} in the frame of this recording's poses: odometry that begins elsewhere moves them."))
}

/// What another recording would say of the corrections.
fn once_more(verdict: Verdict, causes: &[Cause]) -> &'static str {
    let is_event = |c: &Cause| c.parameters.iter().any(|p| p.name == "start");
    if causes.iter().any(is_event) {
        "What acted for a while belongs to this recording: take its external.* out of calibrated.toml before you use it for another one."
    } else if verdict == Verdict::Explained {
        "Record once more and diagnose with --params calibrated.toml: the verdict should be no_gap."
    } else {
        "Record once more and diagnose with --params calibrated.toml: what is left then is what is not known yet."
    }
}

/// The experiment of a cause, and those of the first two effects that it looks like.
fn apart(cause: &Cause, study: &LinearisedProblem) -> String {
    let of = |name: &String| study.columns.effects.iter().find(|e| e.name == *name).map(|e| &e.experiment);
    let mut all = vec![&cause.separating_experiment];
    for other in cause.confusable_with.iter().take(2).filter_map(of) {
        if !other.is_empty() && !all.contains(&other) {
            all.push(other);
        }
    }
    ended(&all.iter().map(|e| e.trim_end_matches(['.', '?'])).collect::<Vec<_>>().join("; or "))
}

/// What to do next. `dead` are joints whose positions are not known; `slips` is the share that a slippery region closes in pieces of windows;
/// `best` the best candidate of the first round; `not_accused` why the last round accused nothing.
pub fn next(
    verdict: Verdict,
    (causes, gap): (&[Cause], &Gap),
    (leads, dead): (&[Lead], &[&str]),
    slips: Option<f64>,
    (best, not_accused): (Option<&Candidate>, Option<&str>),
    study: &LinearisedProblem,
) -> Vec<String> {
    let mut next = Vec::new();
    if let Some(closed) = slips {
        next.push(format!(
            "Where feet slip nobody foretells whole windows: a foot that lands a little earlier slips elsewhere. In pieces of 0.1 s \
             this friction closes {:.0} % of what feet do there and nowhere else.",
            100.0 * closed
        ));
    }
    match verdict {
        Verdict::NoGap => next.push("Nothing to correct. For a sharper test record faster and larger motions.".into()),
        Verdict::Explained | Verdict::PartlyExplained => {
            next.push(if gap.after > gap.before {
                format!(
                    "Take what was found as a finding, not as a correction: with it the loss of whole windows is {:.2}, without it {:.2}. No file applies it.",
                    gap.after, gap.before
                )
            } else {
                "Use calibrated.toml (`qv replay --params`), or the corrections for MuJoCo, URDF and Isaac Lab beside it.".into()
            });
            next.extend(causes.iter().filter_map(|c| beyond_feet(c, study)));
            next.push(once_more(verdict, causes).into());
            for cause in causes.iter().filter(|c| !c.confusable_with.is_empty()) {
                let likes = cause.confusable_with.join(", ");
                next.push(format!(
                    "{} looks like {likes} here. To tell them apart: {}",
                    cause.effect,
                    apart(cause, study)
                ));
            }
        }
        Verdict::Unexplained => {
            next.push(
                "Look at what is left and what it goes along with; add an effect of your own with --library.".into(),
            );
            if study.parts.len() > 1 {
                next.push("Diagnose each recording by itself, too: one robot is looked for that explains all of them, and they may differ.".into());
            }
            next.extend(leads.first().map(nearest));
            let is_blind = !dead.is_empty();
            let of = |best: &Candidate| study.columns.effects.iter().find(|e| e.name == best.effect);
            if let Some(effect) = best.filter(|_| leads.is_empty() && !is_blind).and_then(of) {
                next.push(format!("To rule {} out or in: {}", effect.name, ended(&effect.experiment)));
            }
        }
    }
    next.extend(not_accused.map(|reason| format!("Not accused: {reason}.")));
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
            probability: 0.9,
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
        let told = |alone, closed| sentence(Verdict::PartlyExplained, (&[cause(alone)], &gap(closed)), (&[], &[]), &[]);
        let slips = told(0.24, 0.0);
        assert!(slips.states("closer 24"), "{slips}");
        assert!(!told(0.0, 0.0).contains('%') && !slips.contains("closes 0 %"));
        assert!(told(0.24, 0.3).states("windows 30"));
    }
}
