//! The stages, one after the other.

use super::inputs::{Inputs, picked};
use super::keep::{Event, Keep};
use super::report::{Candidate, HeldOut, Outcome, Report};
use super::scored::ScoredWalks;
use super::settings::is_held;
use crate::ResidualError;
use crate::compensation::Compensation;
use crate::fitting::{Fit, Windows, fit, fit_shared_first};
use crate::footing::Footing;
use crate::identify::{Coordinate, coordinates};
use crate::paths::PathScore;
use crate::study::Study;
use crate::training_windows::TrainingWindows;
use crate::tune::{CorrectedSimulator, train_on, with_calibrated_commands};
use crate::windows::{Errors, Replayer, Window};
use qv_policy::policy::Policy;
use qv_policy::score::mean_with_error;
use qv_rollout::WindowOptions;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Mean over stretches, one entry each.
fn by_stretch(errors: &Errors, held: &[Window]) -> Vec<f64> {
    let lanes = errors.by_lane();
    let mut stretches: Vec<usize> = held.iter().map(|w| w.stretch).collect();
    stretches.dedup();
    let of = |stretch: usize| {
        let own: Vec<f64> = held.iter().zip(&lanes).filter(|(w, _)| w.stretch == stretch).map(|(_, e)| *e).collect();
        own.iter().sum::<f64>() / own.len() as f64
    };
    stretches.into_iter().map(of).collect()
}

/// Names of the stages.
const STAGES: [&str; 8] = [
    "held-out error of the simulator as it is",
    "fitting parameters",
    "fitting parameters at the step of the training",
    "fitting parameters and torques",
    "fitting to held-out recordings alone",
    "training on in the simulator as it is",
    "training on with what stayed",
    "training on with all that stayed",
];

/// What the stages share.
pub struct Loop<'a, 'b> {
    pub inputs: &'a Inputs<'a>,
    pub replayer: Replayer<'a>,
    /// Where the ground is known to be right; `None` = everywhere.
    pub footing: Option<Footing>,
    /// What was left out of the recordings.
    pub remarks: Vec<String>,
    /// Windows by which candidates are compared, and their decisions.
    pub held: Vec<Window>,
    pub length: usize,
    pub tops: Vec<f64>,
    pub keep: &'a dyn Keep,
    pub notify: &'b mut dyn FnMut(Event),
}

/// Candidates so far, and the errors on each stretch of the last that stayed.
struct CandidateSet {
    candidates: Vec<Candidate>,
    /// Index of the candidate whose parameters are the robot's.
    calibrated: usize,
    best: Vec<f64>,
}

impl CandidateSet {
    /// Indices of those that stay, beyond the simulator as it is.
    fn staying(&self) -> Vec<usize> {
        (1..self.candidates.len()).filter(|&k| self.candidates[k].held_out.stays).collect()
    }
}

impl Loop<'_, '_> {
    fn begin(&mut self, stage: usize) {
        (self.notify)(Event::Stage(STAGES[stage], stage + 1, STAGES.len()));
    }

    pub fn run(mut self) -> Result<Outcome, ResidualError> {
        let Inputs { robot, start, settings, log, .. } = *self.inputs;
        let tried = self.try_all()?;
        let staying = tried.staying();
        let policy = start.best_policy(robot)?;
        let judging = match staying.last() {
            None => Compensation::nominal(robot),
            Some(&last) => {
                let compensation = &tried.candidates[last].compensation;
                self.judging(!compensation.shapes.is_empty())?
            }
        };
        let mut scored = ScoredWalks::new(self.inputs, &judging)?;
        let before = scored.score(&policy)?;
        let mut report = Report {
            robot: robot.name.clone(),
            seconds: log.seconds(),
            remarks: self.remarks.clone(),
            candidates: tried.candidates,
            calibrated: tried.calibrated,
            chosen: None,
            why: String::new(),
            before,
            after: before,
            control: None,
            paths: Vec::new(),
            settings: settings.clone(),
        };
        if staying.is_empty() {
            return self.calibrate_commands(policy, report, scored);
        }
        self.begin(5);
        let control = self.train("control", &CorrectedSimulator::nominal())?;
        let tuned = self.train_all(&staying, &mut report, &mut scored)?;
        report.before = scored.remarks(&policy)?;
        report.after = tuned.as_ref().map_or(Ok(report.before), |tuned| scored.remarks(tuned))?;
        report.control = Some(scored.remarks(&control)?);
        let chosen = choose(&policy, tuned, &mut report);
        report.paths = scored.pairs(&policy, &chosen)?;
        Ok(Outcome { policy: chosen, report })
    }

    /// Of a robot that is as simulated: its policy may still turn when it is to go straight.
    fn calibrate_commands(
        &self,
        policy: Policy,
        mut report: Report,
        mut scored: ScoredWalks,
    ) -> Result<Outcome, ResidualError> {
        let Inputs { robot, train_on: ground, start, settings, .. } = *self.inputs;
        let nothing = format!(
            "No correction brings the simulator nearer to these recordings by more than {} standard errors",
            settings.errors
        );
        report.why = format!("{nothing}: the policy is as it was.");
        let nominal = CorrectedSimulator::nominal();
        let calibrated = with_calibrated_commands(&policy, robot, ground, start, &nominal, &settings.tune)?;
        let Some(calibrated) = calibrated else { return Ok(Outcome { policy, report }) };
        report.before = scored.remarks(&policy)?;
        let after = scored.remarks(&calibrated)?;
        if !after.is_better(&report.before, settings.errors as f32) {
            report.after = report.before;
            return Ok(Outcome { policy, report });
        }
        (report.chosen, report.after) = (Some(0), after);
        report.why = format!(
            "{nothing}. The policy's commands were calibrated. Path-tracking error in the simulator (8 s): {:.3} -> {:.3} m.",
            report.before.position, after.position
        );
        report.paths = scored.pairs(&policy, &calibrated)?;
        Ok(Outcome { policy: calibrated, report })
    }

    pub fn fit_candidates(mut self) -> Result<Vec<Candidate>, ResidualError> {
        Ok(self.try_all()?.candidates)
    }

    /// Each kind of candidate against the last that stayed.
    fn try_all(&mut self) -> Result<CandidateSet, ResidualError> {
        let Inputs { robot, settings, given, .. } = *self.inputs;
        let for_fits = |k: usize| !is_held(settings, k);
        self.begin(0);
        let (nominal, best) = self.candidate(Compensation::nominal(robot), None)?;
        let mut tried = CandidateSet { candidates: vec![nominal], calibrated: 0, best };
        if let Some(given) = given {
            self.add(&mut tried, Compensation::given(robot, given))?;
        }
        self.begin(1);
        let parameters = self.fit("parameters", false, None, &for_fits)?;
        self.add(&mut tried, self.compensation("parameters", &parameters)?)?;
        let estimated = tried.candidates.len() - 1;
        let calibrated = tried.staying().last().copied();
        self.begin(2);
        // A coarse step delays and brakes by itself: the parameters that make up for that are not the robot's, and serve the training.
        let at_step = self.fit("parameters at step", false, Some(&parameters), &for_fits)?;
        self.add(&mut tried, self.compensation("parameters at the training's step", &at_step)?)?;
        self.begin(3);
        let torques = self.fit("torques", true, Some(&parameters), &for_fits)?;
        self.add(&mut tried, self.compensation("parameters and torques", &torques)?)?;
        tried.calibrated = calibrated.unwrap_or(if tried.staying().is_empty() { 0 } else { estimated });
        Ok(tried)
    }

    /// Policies trained on under the two richest candidates that stay: the best, if it is better than `report.before`.
    fn train_all(
        &mut self,
        staying: &[usize],
        report: &mut Report,
        scored: &mut ScoredWalks,
    ) -> Result<Option<Policy>, ResidualError> {
        let Inputs { robot, .. } = *self.inputs;
        let mut best = None;
        let richest = &staying[staying.len().saturating_sub(2)..];
        for (step, &k) in richest.iter().enumerate() {
            self.begin(6 + step);
            let corrected = report.candidates[k].compensation.corrected(robot);
            let tuned = self.train(&format!("policy {k}"), &corrected)?;
            let found = scored.score(&tuned)?;
            report.candidates[k].paths = Some(found);
            if found.is_better(&report.after, 0.0) {
                report.chosen = Some(k);
                report.after = found;
                best = Some(tuned);
            }
        }
        Ok(best)
    }

    /// A simulator fitted to the held-out stretches alone, with torques where the richest candidate that stays has more than parameters.
    fn judging(&mut self, with_torques: bool) -> Result<Compensation, ResidualError> {
        self.begin(4);
        let settings = self.inputs.settings;
        let held = |k: usize| is_held(settings, k);
        let parameters = self.fit("judge", false, None, &held)?;
        let fit = self.fit("judge at step", with_torques, Some(&parameters), &held)?;
        self.compensation("judge", &fit)
    }

    /// A candidate on held-out windows, with its error on each stretch.
    fn candidate(
        &self,
        compensation: Compensation,
        beat: Option<&[f64]>,
    ) -> Result<(Candidate, Vec<f64>), ResidualError> {
        let errors = compensation.replay(&self.replayer, &self.held, self.length)?;
        let own = by_stretch(&errors, &self.held);
        let [error, error_se] = mean_with_error(&own);
        let gains: Vec<f64> = beat.map_or_else(Vec::new, |beat| beat.iter().zip(&own).map(|(b, o)| b - o).collect());
        let gain = mean_with_error(&gains);
        let stays = beat.is_none() || gain[0] > self.inputs.settings.errors * gain[1];
        let held_out = HeldOut { error, error_se, joints: errors.by_joint(), gain, stays };
        Ok((Candidate { compensation, held_out, paths: None }, own))
    }

    /// Tries a candidate against the best so far.
    fn add(&self, tried: &mut CandidateSet, compensation: Compensation) -> Result<(), ResidualError> {
        let (candidate, own) = self.candidate(compensation, Some(&tried.best))?;
        if candidate.held_out.stays {
            tried.best = own;
        }
        tried.candidates.push(candidate);
        Ok(())
    }

    fn compensation(&self, kind: &str, fit: &Fit) -> Result<Compensation, ResidualError> {
        let spread = self.inputs.settings.tune.spread;
        Compensation::of_fit(kind, &self.replayer, &fit.coordinates, &fit.point, &fit.deviations, spread)
    }

    /// What was kept under a name, if it is sound, or what `make` makes, which is then kept.
    fn kept<T: Serialize + DeserializeOwned>(
        &mut self,
        name: &str,
        is_sound: impl FnOnce(&T) -> bool,
        make: impl FnOnce(&mut Self) -> Result<T, ResidualError>,
    ) -> Result<T, ResidualError> {
        let kept = self.keep.get(name).and_then(|text| serde_json::from_str(&text).ok());
        if let Some(kept) = kept.filter(|kept| is_sound(kept)) {
            return Ok(kept);
        }
        let made = make(self)?;
        self.keep.put(name, &serde_json::to_string(&made).unwrap_or_default())?;
        Ok(made)
    }

    fn fit(
        &mut self,
        name: &str,
        with_shapes: bool,
        from: Option<&Fit>,
        wanted: &dyn Fn(usize) -> bool,
    ) -> Result<Fit, ResidualError> {
        let settings = &self.inputs.settings.fit;
        let coordinates = coordinates(&self.replayer, &settings.prior, &self.tops, with_shapes)?;
        if let Some(kept) = self.keep.get(name).and_then(|text| kept_fit(&text, &coordinates)) {
            return Ok(kept);
        }
        let footing = self.footing.as_ref();
        let (windows, left_out) = windows_of(self.inputs, &self.replayer, footing, from.is_some(), wanted)?;
        let said =
            |name: String| format!("{name}: parameters are fitted without it: it has not the channels of the others");
        let new = left_out.into_iter().map(said).filter(|line| !self.remarks.contains(line));
        self.remarks.extend(new.collect::<Vec<_>>());
        let (notify, steps, mut done) = (&mut *self.notify, settings.steps as f64, 0.0);
        let mut notify = |step: usize, cost: f64| {
            done += 1.0;
            // How many parameters are chosen one after another is not known before.
            let share = if from.is_some() { (step as f64 + 1.0) / steps } else { done / (done + steps) };
            notify(Event::Progress(share, format!("cost {cost:.0}")));
        };
        let fit = match from {
            None => fit_shared_first(&*windows, coordinates, settings, &mut notify)?,
            Some(from) => {
                let start = from.at(&coordinates);
                fit(&*windows, coordinates, &start, settings.steps, &mut notify)?
            }
        };
        let text = serde_json::to_string(&(&fit.point, &fit.deviations, &fit.costs)).unwrap_or_default();
        self.keep.put(name, &text)?;
        Ok(fit)
    }

    fn train(&mut self, name: &str, corrected: &CorrectedSimulator) -> Result<Policy, ResidualError> {
        let Inputs { robot, train_on: ground, start, settings, .. } = *self.inputs;
        let mut policy = start.best_policy(robot)?;
        let count = policy.parameters.len();
        let is_sound = |kept: &Vec<f32>| kept.len() == count && kept.iter().all(|x| x.is_finite());
        policy.parameters = self.kept(name, is_sound, |this| {
            let (notify, all) = (&mut *this.notify, settings.tune.iterations as f64);
            let tuned = train_on(robot, ground, start, corrected, &settings.tune, |line, score| {
                if let Some(score) = score {
                    let share = (line.iteration.index as f64 + 1.0) / all;
                    notify(Event::Progress(share, format!("{:.3} m off the commanded path", score.position)));
                }
            })?;
            Ok(tuned.parameters)
        })?;
        Ok(policy)
    }
}

/// Windows of a fit in the stretches that are `wanted`: of rollouts, or in the simulator of the training; and recordings that were left out.
fn windows_of<'a>(
    inputs: &Inputs<'a>,
    replayer: &'a Replayer<'a>,
    footing: Option<&Footing>,
    in_training: bool,
    wanted: &dyn Fn(usize) -> bool,
) -> Result<(Box<dyn Windows + 'a>, Vec<String>), ResidualError> {
    let Inputs { robot, ground, log, settings, .. } = *inputs;
    let (most, length) = (settings.fit.windows, settings.fit.length);
    if in_training {
        let all = picked(inputs, footing, length, wanted);
        let count = all.len().min(most);
        let windows = (0..count).map(|k| all[k * all.len() / count]).collect();
        return Ok((Box::new(TrainingWindows { replayer, windows, length }), Vec::new()));
    }
    let is_known = |stretch: usize, [from, to]: [f64; 2]| {
        let decision = |time: f64| ((time - log.stretches[stretch].start) * f64::from(log.rate)) as usize;
        let window = Window { stretch, decision: decision(from) };
        let agrees = |f: &Footing| f.contradiction(window, decision(to) - window.decision) <= settings.footing;
        wanted(stretch) && footing.is_none_or(agrees)
    };
    // As many as a diagnosis has.
    let most = most.min(WindowOptions::default().most);
    let mut study = Study::new(log, robot, &ground.terrain, most, &is_known)?;
    let left_out = std::mem::take(&mut study.left_out);
    Ok((Box::new(study), left_out))
}

/// The policy that is handed out, and why: the one trained on, when it is better by more than chance.
fn choose(policy: &Policy, tuned: Option<Policy>, report: &mut Report) -> Policy {
    let after = report.after;
    let gains = |than: PathScore| after.is_better(&than, report.settings.errors as f32);
    let (than_before, than_control) = (gains(report.before), report.control.is_none_or(gains));
    match (tuned, report.chosen) {
        (Some(tuned), Some(k)) if than_before && than_control => {
            report.why = format!(
                "Best policy: fine-tuned with {}. Path-tracking error in a held-out simulator (8 s): {:.3} -> {:.3} m.",
                report.candidates[k].compensation.kind, report.before.position, report.after.position
            );
            tuned
        }
        _ => {
            report.why = match than_before {
                false => "No fine-tuned policy tracks its commands better than the given one, beyond chance: \
                          the policy is as it was.",
                true => "Trained on in the simulator as it was the policy becomes as good as under corrections: what it gains is none of \
                         theirs, and the policy is as it was. `qv walk train --resume` trains it further.",
            }
            .into();
            report.chosen = None;
            report.after = report.before;
            policy.clone()
        }
    }
}

/// A fit that was kept, if it is of these coordinates.
fn kept_fit(text: &str, coordinates: &[Coordinate]) -> Option<Fit> {
    let (point, deviations, costs): (Vec<f64>, Vec<f64>, Vec<f64>) = serde_json::from_str(text).ok()?;
    let within = |(c, x): (&Coordinate, &f64)| (c.least..=c.most).contains(x);
    let fits = point.len() == coordinates.len()
        && deviations.len() == point.len()
        && coordinates.iter().zip(&point).all(within)
        && deviations.iter().all(|d| d.is_finite());
    fits.then(|| Fit { coordinates: coordinates.to_vec(), point, deviations, costs })
}
