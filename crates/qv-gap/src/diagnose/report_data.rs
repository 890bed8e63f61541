//! What a report shows beyond what decides, of both outcomes: that nothing is accused, and that all is which was found.

use super::{Findings, ReportedCause, Session, merge, merged, setting};
use crate::GapError;
use crate::checks::held_out::{closed_in_fit, closure};
use crate::decision::evidence::{CauseData, Comparison, ReportData};
use crate::findings::{Correction, Factor, Gap, Timing, Traces};
use crate::inference::intervals::estimates_of;
use crate::inference::linearised::LinearisedProblem;
use crate::inference::regions::{EDGES, untested};
use crate::inference::short_windows::feet;
use crate::problem::columns::Extent;
use crate::problem::data_quality;
use crate::report::figures::{self, Figures};
use crate::report::{attribution, leads, residual_factors, together};
use qv_rollout::{Event, Overrides};

/// A robot that is simulated once more: the stated one, with corrections and events.
#[derive(Default)]
struct Robot {
    setting: Overrides,
    events: Vec<Event>,
}

impl Findings<'_> {
    pub(super) fn report_data(
        &mut self,
        session: &mut Session,
        nominal: &mut LinearisedProblem,
        fits_several: bool,
        begun: f64,
    ) -> Result<ReportData, GapError> {
        let seed = session.options.effort.seed;
        let robot = Robot { setting: setting(nominal, &self.corrections), events: std::mem::take(&mut self.events) };
        let gap = robot.gap(nominal, seed)?;
        session.end(nominal);
        let corrections = merged(&session.calibrated, &self.corrections_with_event());
        let later = self.later.as_ref().filter(|_| !self.accused.is_empty());
        let depends_on = residual_factors::factors(later.unwrap_or(nominal));
        let (mut stated, traces) = robot.comparison(nominal, gap, depends_on, corrections)?;
        let mut corrected = None;
        if !self.accused.is_empty() {
            let (robot, depends_on) = (Robot::default(), residual_factors::factors(nominal));
            let gap = robot.gap(nominal, seed)?;
            corrected = Some(stated);
            stated = robot.comparison(nominal, gap, depends_on, merged(&session.calibrated, &[]))?.0;
        }
        let dead: Vec<String> = data_quality::dead_positions(&session.runs).iter().map(|d| d.to_string()).collect();
        // Whatever is nearest may be due to a joint whose position is not known alone.
        let fits = self.rounds.first().map_or(&[][..], |r| &r.fits).iter().filter(|_| dead.is_empty());
        let fits: Vec<_> = fits.cloned().collect();
        let leads = leads::leads(nominal, &fits, seed, estimates_of)?;
        let together = if fits_several { together::together(nominal, &fits, seed)? } else { None };
        let mut place = std::mem::take(&mut self.opening.places);
        place.regions = attribution::cells(nominal);
        Ok(ReportData {
            title: String::new(),
            notes: Vec::new(),
            recordings: nominal.parts.len(),
            on_legs: nominal.rollout.on_legs,
            fall: None,
            dead,
            cannot_tell: std::mem::take(&mut self.cannot_tell),
            cannot_show: std::mem::take(&mut self.cannot_show),
            can_tell: Vec::new(),
            place,
            interfaces: attribution::interfaces(nominal)?,
            leads,
            together,
            stated,
            corrected,
            causes: self.causes(nominal),
            traces,
            joint_rows: Vec::new(),
            torque_traces: Vec::new(),
            stages: session.stages.clone(),
            timing: Timing { runtime_s: session.now() - begun, stages_s: session.stages_s.clone() },
            provenance: None,
        })
    }

    fn causes(&mut self, nominal: &LinearisedProblem) -> Vec<CauseData> {
        let later = self.later.as_ref();
        self.accused.iter_mut().for_each(|a| a.note_by_recording(later));
        self.accused.iter().map(|a| a.data(nominal)).collect()
    }

    /// Corrections of all that is accused. The simulator's parameters hold one event: the one that closes most.
    fn corrections_with_event(&self) -> Vec<Correction> {
        let events = self.accused.iter().filter(|a| a.time().is_some());
        let largest = events.max_by(|a, b| a.cause.closed_alone.total_cmp(&b.cause.closed_alone));
        let mut all = self.corrections.clone();
        merge(&mut all, largest.map_or(&[], |a| &a.corrections));
        all
    }
}

impl ReportedCause {
    fn data(&self, nominal: &LinearisedProblem) -> CauseData {
        let region = match self.fit.suspect.extent {
            Some(Extent::Region(region)) if self.cause.scope == ["region"] => Some(region),
            _ => None,
        };
        let edge = |name: &str| self.cause.parameters.iter().find(|p| p.name == name).map(|p| p.value);
        let edges = region.and_then(|_| Some(EDGES.map(edge)).filter(|e| e.iter().all(Option::is_some)));
        let untested = edges.map(|e| untested(&feet(nominal), e.map(Option::unwrap_or_default)));
        CauseData {
            cause: self.cause.clone(),
            region: region.map(|r| attribution::region(nominal, r)),
            untested: untested.unwrap_or_default().into_iter().map(String::from).collect(),
        }
    }
}

impl Robot {
    /// Does something with a study whose events are those of this robot.
    fn act<T>(&self, study: &mut LinearisedProblem, act: impl FnOnce(&mut LinearisedProblem) -> T) -> T {
        let before = std::mem::replace(&mut study.rollout.events, self.events.clone());
        let result = act(study);
        study.rollout.events = before;
        result
    }

    fn gap(&self, study: &mut LinearisedProblem, seed: u64) -> Result<Gap, GapError> {
        self.act(study, |study| {
            let (after, closed) = (closure(study, &self.setting)?, closed_in_fit(study, &self.setting)?);
            Ok(Gap { closed_in_fit: Some(closed), ..after.gap(study, seed) })
        })
    }

    fn comparison(
        &self,
        study: &mut LinearisedProblem,
        gap: Gap,
        depends_on: Vec<Factor>,
        corrections: Vec<Correction>,
    ) -> Result<(Comparison, Traces), GapError> {
        let Figures { heat_map, floor_plan, curves, traces } =
            self.act(study, |study| figures::all(study, &self.setting))?;
        Ok((Comparison { gap, depends_on, heat_map, floor_plan, curves, corrections }, traces))
    }
}
