//! The whole diagnosis: from runs to a report.

mod corrected;
mod held;
mod options;
mod progress;
mod refine;
mod report_data;
mod rounds;

use options::PreparedRuns;
pub use options::{Diagnosis, Options};
use progress::Plan;
pub use progress::Progress;
use rounds::RoundResult;

use crate::GapError;
use crate::checks::by_recording::by_recording;
use crate::checks::held_out::{closure, closure_everywhere, held_out_loss};
use crate::decision::evidence::{After, Evidence, Level};
use crate::decision::is_much_left;
use crate::findings::{CanTell, Cause, Correction, Gap, Stage, UNKNOWN, Where};
use crate::inference::intervals::estimates;
use crate::inference::level::{level, level_outside};
use crate::inference::linearised::LinearisedProblem;
use crate::inference::search::Fit;
use crate::null::reference;
use crate::problem::columns::{Columns, Extent, Group};
use crate::problem::{data_quality, one_robot, origin, rollout_of};
use crate::report::{self, Report, attribution, can_tell, cannot_tell};
use qv_recording::Run;
use qv_rollout::{Event, Overrides, Rollout};

use qv_recording::conventions::read_in_ours;

use qv_recording::frozen::without_frozen;

use qv_recording::gaps::without_gaps;

use qv_recording::stale::without_stale;
use qv_sim::{Model, Terrain};

/// A cause with all that the report says of it.
struct ReportedCause {
    /// Round that it was accused in, and which of its candidates it is.
    found: [usize; 2],
    fit: Fit,
    /// On what it acts.
    group: Group,
    cause: Cause,
    corrections: Vec<Correction>,
    /// Whether its size was fitted once more in the corrected robot.
    is_refined: bool,
}

impl ReportedCause {
    /// When it acts, if for a while only \[s\].
    fn time(&self) -> Option<[f64; 2]> {
        match self.fit.suspect.extent {
            Some(Extent::Time(time)) => Some(time),
            _ => None,
        }
    }

    /// What each recording asks of it; `later` is the robot with all that is accused.
    fn note_by_recording(&mut self, later: Option<&LinearisedProblem>) {
        let (Some(study), None) = (later, self.time()) else { return };
        let value = self.cause.parameters.first().map_or(0.0, |p| p.value);
        self.cause.by_recording = by_recording(study, &self.cause.effect, &self.group, (value, true));
    }

    /// The same as something that acts on the robot of a study.
    fn event(&self, study: &LinearisedProblem) -> Option<Event> {
        let time = self.time()?;
        let setting = study.columns.setting_of(&study.rollout, std::slice::from_ref(&self.fit.suspect));
        Some(Event { setting, time })
    }
}

/// Diagnoses `runs` of one robot on one ground, and again without each of the `leave_out` most probable effects.
///
/// # Errors
/// When there are no runs, they are not of this model, or they have too little.
pub fn diagnose(
    runs: &[Run],
    model: &Model,
    terrain: &Terrain,
    options: &Options,
    leave_out: usize,
) -> Result<Diagnosis, GapError> {
    let first = runs.first().ok_or_else(|| GapError::run("runs", "at least one", "none"))?;
    let prepared = prepared(runs, terrain, options)?;
    if held::is_weighed(&prepared)
        && let Some(diagnosis) = held::diagnose(&prepared, model, options, leave_out)?
    {
        return Ok(diagnosis);
    }
    let joint_rows = held::joint_rows(&prepared.usable, model, options);
    let PreparedRuns { usable, reference, mut cannot_tell, fallen } = prepared;
    let mut session = Session::new(usable, &reference, (model, terrain), options, leave_out);
    let begun = session.now();
    let mut nominal = session.nominal(&cannot_tell)?;
    cannot_tell.extend(cannot_tell::missing(&nominal, first, &options.library));
    let can_tell = can_tell::can_tell(&nominal, &options.policy)?;
    let opening = Opening::new(&nominal)?;
    session.begin(progress::SEARCH);
    let closed_to = closed_to(&nominal, &options.without);
    let round = rounds::round(&mut nominal, &closed_to, true, &options.policy)?;
    session.end(&nominal);
    let findings = session.follow(&mut nominal, round, &options.without, &opening, &cannot_tell)?;
    let mut evidence = findings.evidence(&mut session, &mut nominal, begun)?;
    if let Some(data) = &mut evidence.report {
        data.can_tell = can_tell;
        data.joint_rows = joint_rows;
        data.fall = fallen.first().cloned();
    }
    let report = report::report(&evidence, &options.policy)?;
    let mut without = Vec::new();
    let ranked: Vec<String> =
        report.ranking.iter().map(|r| r.effect.clone()).filter(|e| e != UNKNOWN).take(leave_out).collect();
    for effect in ranked {
        let (report, evidence) = session.without(&mut nominal, &effect, &cannot_tell)?;
        without.push((effect, report, evidence));
    }
    Ok(Diagnosis { report, evidence, without })
}

/// The least sizes of effects that `runs` would show, before anything is looked for in them.
///
/// # Errors
/// As [`diagnose`].
pub fn can_tell(runs: &[Run], model: &Model, terrain: &Terrain, options: &Options) -> Result<Vec<CanTell>, GapError> {
    study(runs, model, terrain, options, |nominal| can_tell::can_tell(nominal, &options.policy))
}

/// How much of the gap of other recordings of the same robot `corrections` close: in all of their windows, none of which a fit has seen.
///
/// # Errors
/// As [`diagnose`]; or where the simulator refuses a correction.
pub fn validate(
    runs: &[Run],
    model: &Model,
    terrain: &Terrain,
    options: &Options,
    corrections: &[Correction],
) -> Result<Gap, GapError> {
    let PreparedRuns { usable, reference, cannot_tell, .. } = prepared(runs, terrain, options)?;
    let mut session = Session::new(usable, &reference, (model, terrain), options, 0);
    let mut nominal = session.nominal(&cannot_tell)?;
    let setting = setting(&nominal, corrections);
    let closure = closure_everywhere(&mut nominal, &setting)?;
    Ok(closure.gap(&nominal, options.effort.seed))
}

/// Shows `look` the study of `runs` and of the robot of which nothing is said yet.
pub(crate) fn study<T>(
    runs: &[Run],
    model: &Model,
    terrain: &Terrain,
    options: &Options,
    look: impl FnOnce(&LinearisedProblem) -> Result<T, GapError>,
) -> Result<T, GapError> {
    let PreparedRuns { usable, reference, cannot_tell, .. } = prepared(runs, terrain, options)?;
    let mut session = Session::new(usable, &reference, (model, terrain), options, 0);
    look(&session.nominal(&cannot_tell)?)
}

fn prepared(runs: &[Run], terrain: &Terrain, options: &Options) -> Result<PreparedRuns, GapError> {
    let first = runs.first().ok_or_else(|| GapError::run("runs", "at least one", "none"))?;
    one_robot::check(first, runs.iter().chain(&options.reference))?;
    let (mended, remarks): (Vec<Run>, Vec<Vec<String>>) = runs.iter().map(mended).unzip();
    let mut reference: Vec<Run> = options.reference.iter().map(|run| self::mended(run).0).collect();
    let mut cannot_tell = data_quality::faults(runs, &mended);
    cannot_tell.extend(remarks.into_iter().flatten());
    let (mut usable, fallen) = data_quality::upright(&mended);
    let moved = origin::brought_near(&mut usable, &mut reference, terrain, &options.given);
    cannot_tell.extend(fallen.iter().chain(&moved).cloned());
    Ok(PreparedRuns { usable, reference, cannot_tell, fallen })
}

/// A recording without what is broken in it, and in words what was done.
fn mended(run: &Run) -> (Run, Vec<String>) {
    let (run, mut remarks) = without_stale(read_in_ours(without_frozen(run)));
    let (run, gaps) = without_gaps(run);
    remarks.extend(gaps);
    (run, remarks)
}

/// Effects of a study by name.
fn closed_to(study: &LinearisedProblem, names: &[String]) -> Vec<usize> {
    (0..study.columns.effects.len()).filter(|&e| names.contains(&study.columns.effects[e].name)).collect()
}

/// What the nominal simulator shows before anything is accused.
#[derive(Clone)]
struct Opening {
    level: Level,
    /// Mean loss in windows that no fit has seen, and what noise alone gives.
    held_out: [f64; 2],
    places: Where,
}

impl Opening {
    fn new(study: &LinearisedProblem) -> Result<Self, GapError> {
        let held_out = [held_out_loss(study), study.floor];
        Ok(Self { level: level(study)?, held_out, places: attribution::places(study) })
    }
}

struct Session<'a> {
    runs: Vec<Run>,
    /// Recordings of the same robot without what is looked for.
    reference: &'a [Run],
    model: &'a Model,
    terrain: &'a Terrain,
    options: &'a Options<'a>,
    /// What the reference recordings say of actuators and sensors.
    calibrated: Vec<Correction>,
    /// Effects that the library is taken never to have heard of.
    ablated: Vec<String>,
    stages: Vec<Stage>,
    /// Seconds of each.
    stages_s: Vec<f64>,
    /// The stages to come, for those who watch.
    plan: Plan,
    since: f64,
}

impl<'a> Session<'a> {
    fn new(
        runs: Vec<Run>,
        reference: &'a [Run],
        (model, terrain): (&'a Model, &'a Terrain),
        options: &'a Options<'a>,
        leave_out: usize,
    ) -> Self {
        Self {
            runs,
            reference,
            model,
            terrain,
            options,
            calibrated: Vec::new(),
            ablated: Vec::new(),
            stages: Vec::new(),
            stages_s: Vec::new(),
            plan: Plan::new(!options.reference.is_empty(), leave_out),
            since: 0.0,
        }
    }

    /// The study of the robot of which nothing is said yet.
    fn nominal(&mut self, cannot_tell: &[String]) -> Result<LinearisedProblem<'a>, GapError> {
        let (rollout, columns) = self.robot(&[], &[]).map_err(|e| e.beside(cannot_tell))?;
        columns.check(&rollout)?;
        drop((rollout, columns));
        self.calibrate()?;
        self.study(&[], &[]).map_err(|e| e.beside(cannot_tell))
    }

    fn now(&self) -> f64 {
        self.options.clock.map_or(0.0, |clock| clock())
    }

    fn begin(&mut self, stage: &str) {
        let at = self.plan.begin(stage);
        if let Some(progress) = self.options.progress {
            progress(&at);
        }
        self.since = self.now();
        self.stages.push(Stage { name: stage.into(), steps: 0 });
        self.stages_s.push(0.0);
    }

    fn end(&mut self, study: &LinearisedProblem) {
        let seconds = self.now() - self.since;
        self.stages_s.last_mut().into_iter().for_each(|s| *s = seconds);
        if let Some(stage) = self.stages.last_mut() {
            stage.steps += study.steps_since();
        }
    }

    /// Fits actuators and sensors to the reference recordings.
    fn calibrate(&mut self) -> Result<(), GapError> {
        let (reference, Options { given, cut, library, .. }) = (self.reference, self.options);
        let Some(first) = reference.first() else { return Ok(()) };
        self.begin(progress::REFERENCE);
        let rollout = rollout_of(first, self.model, self.terrain, given, *cut)?;
        self.calibrated = reference::calibrate(&rollout, reference, library)?;
        let seconds = self.now() - self.since;
        self.stages_s.last_mut().into_iter().for_each(|s| *s = seconds);
        Ok(())
    }

    /// A study of the robot as it is said to be so far, with what is said to have acted on it.
    fn study(&mut self, corrections: &[Correction], events: &[Event]) -> Result<LinearisedProblem<'a>, GapError> {
        self.begin(progress::STUDY);
        let (rollout, columns) = self.robot(corrections, events)?;
        let effort = &self.options.effort;
        let mut study = LinearisedProblem::new(rollout, columns, &self.runs, self.reference, effort)?;
        if !self.ablated.is_empty() {
            study.ablate(&closed_to(&study, &self.ablated));
        }
        self.end(&study);
        Ok(study)
    }

    /// The same study, or one of the robot with the sizes that it asks for.
    fn refined(
        &mut self,
        mut study: LinearisedProblem<'a>,
        findings: &mut Findings,
    ) -> Result<LinearisedProblem<'a>, GapError> {
        self.begin(progress::SIZES);
        let is_moved = findings.refine(&mut study)?;
        self.end(&study);
        if !is_moved {
            return Ok(study);
        }
        let (rollout, columns) = self.robot(&findings.corrections, &findings.events)?;
        match study.moved(rollout, columns)? {
            Some(study) => {
                self.end(&study);
                Ok(study)
            }
            None => {
                self.plan.add(&[progress::STUDY]);
                self.study(&findings.corrections, &findings.events)
            }
        }
    }

    /// The robot as it is said to be so far.
    fn robot(&self, corrections: &[Correction], events: &[Event]) -> Result<(Rollout<'a>, Columns), GapError> {
        let mut given = self.options.given.clone();
        given.extend(self.calibrated.iter().chain(corrections).map(|c| (c.parameter.clone(), c.value)));
        let mut rollout = rollout_of(&self.runs[0], self.model, self.terrain, &given, self.options.cut)?;
        rollout.events = events.to_vec();
        let columns = Columns::new(&rollout, &self.runs[0], &self.options.library)?;
        Ok((rollout, columns))
    }

    /// Accuses what the first round found, puts the calibrated simulator through the test again, and so on.
    fn follow(
        &mut self,
        nominal: &mut LinearisedProblem<'a>,
        first: RoundResult,
        without: &[String],
        opening: &Opening,
        cannot_tell: &[String],
    ) -> Result<Findings<'a>, GapError> {
        let mut findings = Findings {
            accused: Vec::new(),
            rounds: vec![first],
            corrections: Vec::new(),
            events: Vec::new(),
            on_feet: nominal.rollout.free,
            opening: opening.clone(),
            cannot_tell: cannot_tell.to_vec(),
            cannot_show: cannot_tell::cannot_show(nominal, &self.runs[0], &self.options.library),
            later: None,
        };
        loop {
            let (round, number) = (findings.rounds.last().expect("there is a first"), findings.rounds.len() - 1);
            if round.round.accused.is_empty() {
                return Ok(findings);
            }
            self.plan.add(if findings.on_feet { &[progress::STUDY, progress::SIZES] } else { &[progress::STUDY] });
            let fits: Vec<(usize, Fit)> = round.round.accused.iter().map(|&k| (k, round.fits[k].clone())).collect();
            let study = findings.later.as_mut().unwrap_or(nominal);
            let is_free = study.rollout.free;
            for (candidate, fit) in fits {
                let one = self.accuse(study, [number, candidate], fit, &findings.corrections)?;
                match one.event(study) {
                    Some(event) => findings.events.push(event),
                    None => merge(&mut findings.corrections, &one.corrections),
                }
                findings.accused.push(one);
            }
            let mut next = self.study(&findings.corrections, &findings.events)?;
            if findings.on_feet {
                next = self.refined(next, &mut findings)?;
            }
            let level = level_outside(&next, &findings.regions())?;
            let after = After { level, held_out: [held_out_loss(&next), next.floor] };
            findings.rounds[number].round.after = Some(after);
            let policy = &self.options.policy;
            let full = findings.effects().len() >= policy.most_causes || findings.rounds.len() > policy.most_causes;
            if full || !is_much_left(policy, &level, after.held_out, is_free) {
                findings.later = Some(next);
                return Ok(findings);
            }
            self.plan.add(&[progress::SEARCH]);
            self.begin(progress::SEARCH);
            let names: Vec<String> = findings.settled().into_iter().chain(without.iter().cloned()).collect();
            let closed = closed_to(&next, &names);
            let round = rounds::round(&mut next, &closed, false, policy)?;
            self.end(&next);
            findings.rounds.push(round);
            findings.later = Some(next);
        }
    }

    /// The diagnosis that a library would have come to that has never heard of an effect.
    fn without(
        &mut self,
        nominal: &mut LinearisedProblem<'a>,
        effect: &str,
        cannot_tell: &[String],
    ) -> Result<(Report, Evidence), GapError> {
        let begun = self.now();
        self.ablated = vec![effect.into()];
        let kept = nominal.ablate(&closed_to(nominal, &self.ablated));
        let opening = Opening::new(nominal)?;
        self.begin(progress::SEARCH);
        let left_out = [&self.options.without[..], &self.ablated[..]].concat();
        let round = rounds::round(nominal, &closed_to(nominal, &left_out), true, &self.options.policy)?;
        self.end(nominal);
        let findings = self.follow(nominal, round, &left_out, &opening, cannot_tell)?;
        let evidence = findings.evidence(self, nominal, begun)?;
        nominal.restore(kept);
        self.ablated.clear();
        Ok((report::report(&evidence, &self.options.policy)?, evidence))
    }

    /// All that a report says of a cause.
    fn accuse(
        &self,
        study: &mut LinearisedProblem,
        found: [usize; 2],
        fit: Fit,
        before: &[Correction],
    ) -> Result<ReportedCause, GapError> {
        let group = study.columns.groups[fit.suspect.group].clone();
        let effect = study.columns.effects[group.effect].clone();
        let remarks = attribution::as_stated(study, &fit.suspect);
        let setting = study.columns.setting_of(&study.rollout, std::slice::from_ref(&remarks));
        let alone = closure(study, &setting)?;
        let corrections = setting
            .iter()
            .map(|&(id, value)| {
                let info = &study.rollout.catalogue[id];
                let nominal =
                    before.iter().find(|c| c.parameter == info.name).map_or(study.rollout.nominal[id], |c| c.nominal);
                Correction { parameter: info.name.clone(), value, nominal, unit: info.unit.into() }
            })
            .collect();
        let cause = Cause {
            effect: effect.name.clone(),
            score: 0.0,
            scope: match remarks.extent {
                Some(Extent::Region(_)) => vec!["region".into()],
                _ => group.names.clone(),
            },
            parameters: estimates(&effect, &fit, remarks.extent),
            closed_alone: fit.held_out.map_or_else(|| alone.closed(), |f| f.closed),
            confusable_with: cannot_tell::confusable(study, &fit.suspect),
            separating_experiment: effect.experiment.clone(),
            by_recording: Vec::new(),
        };
        Ok(ReportedCause { found, fit, group, cause, corrections, is_refined: false })
    }
}

/// Corrections after those of a reference, which are what is nominal for them.
fn merged(reference: &[Correction], after: &[Correction]) -> Vec<Correction> {
    let mut all = reference.to_vec();
    let before =
        |c: &Correction| reference.iter().find(|r| r.parameter == c.parameter).map_or(c.nominal, |r| r.nominal);
    let after: Vec<Correction> = after.iter().map(|c| Correction { nominal: before(c), ..c.clone() }).collect();
    merge(&mut all, &after);
    all
}

/// Later corrections of a parameter replace earlier ones.
fn merge(all: &mut Vec<Correction>, new: &[Correction]) {
    for correction in new {
        all.retain(|c| c.parameter != correction.parameter);
        all.push(correction.clone());
    }
    all.sort_by(|a, b| a.parameter.cmp(&b.parameter));
}

/// Corrections as the setting of a study.
fn setting(study: &LinearisedProblem, corrections: &[Correction]) -> Overrides {
    let mut setting: Overrides =
        corrections.iter().filter_map(|c| study.rollout.parameter(&c.parameter).map(|id| (id, c.value))).collect();
    setting.sort_by_key(|s| s.0);
    setting
}

/// All that was found.
struct Findings<'a> {
    accused: Vec<ReportedCause>,
    rounds: Vec<RoundResult>,
    corrections: Vec<Correction>,
    events: Vec<Event>,
    /// Whether the base is free.
    on_feet: bool,
    opening: Opening,
    cannot_tell: Vec<String>,
    cannot_show: Vec<String>,
    /// The robot with all that is accused.
    later: Option<LinearisedProblem<'a>>,
}

impl Findings<'_> {
    /// Names of the accused effects.
    fn effects(&self) -> Vec<String> {
        let mut names: Vec<String> = self.accused.iter().map(|a| a.cause.effect.clone()).collect();
        names.sort();
        names.dedup();
        names
    }

    /// Effects of which there is no more: all that are accused, but for what acts on an arm for a while.
    fn settled(&self) -> Vec<String> {
        let settled = |a: &&ReportedCause| self.on_feet || a.time().is_none();
        self.accused.iter().filter(settled).map(|a| a.cause.effect.clone()).collect()
    }

    /// Regions that are accused.
    fn regions(&self) -> Vec<[f64; 4]> {
        let region = |a: &ReportedCause| match a.fit.suspect.extent {
            Some(Extent::Region(r)) => Some(r),
            _ => None,
        };
        self.accused.iter().filter_map(region).collect()
    }
}
