//! Sizes once more, in the corrected robot. A size is found with the sensitivities of the robot without the effect: what is tolerated there
//! imitates a part of a large effect at little cost, and the size stops short of it. Those of the corrected robot ask for the rest.

use super::{Findings, ReportedCause, estimates, merge};
use crate::GapError;
use crate::inference::linearised::LinearisedProblem;
use crate::inference::search::{Fit, Search};
use crate::report::Correction;

/// Log evidence from which on a size is moved.
const LEAST_GAIN: f64 = 8.0;

impl Findings<'_> {
    /// Moves the accused size that the corrected robot of `study` asks most to be moved, of those that were not yet: two that imitate each
    /// other would go on along what neither is given by. Returns whether there is one.
    pub(super) fn refine(&mut self, study: &mut LinearisedProblem) -> Result<bool, GapError> {
        let steady = self.accused.iter().enumerate().filter(|(_, a)| a.fit.suspect.extent.is_none() && !a.is_refined);
        let groups: Vec<(usize, usize)> = steady.filter_map(|(k, a)| Some((k, a.group_in(study)?))).collect();
        let mut search = Search::new(study, 1.0)?;
        let base = search.base(&[])?;
        let dispersion = (base.loss / base.sums.count.max(1.0)).max(1.0);
        let mut best: Option<(f64, usize, Fit)> = None;
        for (k, group) in groups {
            let Some(fit) = search.refined(&base, group)? else { continue };
            let gain = 0.5 * (base.loss - fit.loss) / dispersion;
            if gain > LEAST_GAIN && best.as_ref().is_none_or(|b| gain > b.0) {
                best = Some((gain, k, fit));
            }
        }
        let Some((_, k, fit)) = best else { return Ok(false) };
        self.accused[k].follow(study, &fit);
        merge(&mut self.corrections, &self.accused[k].corrections);
        Ok(true)
    }
}

impl ReportedCause {
    /// The same group in another study.
    fn group_in(&self, study: &LinearisedProblem) -> Option<usize> {
        let columns = &study.columns;
        columns.groups.iter().position(|g| {
            let effect = &columns.effects[g.effect];
            effect.levels_of.is_none() && effect.name == self.cause.effect && g.members == self.group.members
        })
    }

    /// Takes over what a fit found in the study of the robot that is corrected by this.
    fn follow(&mut self, study: &LinearisedProblem, fit: &Fit) {
        self.is_refined = true;
        let effect = study.columns.effects[study.columns.groups[fit.suspect.group].effect].clone();
        for (value, found) in self.fit.suspect.values.iter_mut().zip(&fit.suspect.values) {
            // A deviation is counted from the corrected robot there.
            *value = if effect.absolute { *found } else { *value + found };
        }
        self.fit.deviations.clone_from(&fit.deviations);
        let setting = study.columns.setting_of(&study.rollout, std::slice::from_ref(&fit.suspect));
        for (id, value) in setting {
            let name = &study.rollout.catalogue[id].name;
            match self.corrections.iter_mut().find(|c| c.parameter == *name) {
                Some(correction) => correction.value = value,
                None => self.corrections.push(Correction {
                    parameter: name.clone(),
                    value,
                    nominal: study.rollout.nominal[id],
                    unit: study.rollout.catalogue[id].unit.into(),
                }),
            }
        }
        self.cause.parameters = estimates(&effect, &self.fit, None);
    }
}
