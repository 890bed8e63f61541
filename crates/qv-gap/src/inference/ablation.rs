//! A study without some of the library's effects: what a diagnosis would say that has never heard of the right one.

use crate::inference::gaussian_evidence::Normal;
use crate::inference::linearised::{EXTRA, LinearisedProblem};
use qv_fit::linear::add_scaled;

/// What a study knew before it forgot some effects.
pub struct StudyState {
    replicates: Vec<Vec<Option<Normal>>>,
    ghost_residuals: Vec<Vec<Option<Vec<f64>>>>,
    ghost_deviations: Vec<Vec<f64>>,
    tolerance: Vec<f64>,
    ablated: Vec<usize>,
}

impl LinearisedProblem<'_> {
    /// The same study of a library that has never heard of some effects: they are not suspected, no robot deviates in them, and
    /// the simulated ones do not, to first order. What is given back undoes it.
    pub fn ablate(&mut self, effects: &[usize]) -> StudyState {
        let kept = StudyState {
            replicates: self.replicates.clone(),
            ghost_residuals: self.ghost_residuals.clone(),
            ghost_deviations: self.ghost_deviations.clone(),
            tolerance: self.tolerance.clone(),
            ablated: self.ablated.clone(),
        };
        self.ablated.extend_from_slice(effects);
        let columns = &self.columns;
        let is_of = |c: &usize| effects.contains(&columns.units[columns.columns[*c].unit].effect);
        let ablated: Vec<usize> = (0..columns.tolerated).filter(is_of).collect();
        self.tolerance = self.tolerances();
        for ((residuals, normals), deviations) in
            self.ghost_residuals.iter_mut().zip(&mut self.replicates).zip(&mut self.ghost_deviations)
        {
            for ((residual, normal), seen) in residuals.iter_mut().zip(normals).zip(&self.seen) {
                let Some(residual) = residual else { continue };
                let column = |c: usize| seen.j.col_as_slice(EXTRA + c);
                ablated.iter().for_each(|&c| add_scaled(residual, -deviations[c], column(c)));
                *normal = Some(seen.normal_of(residual));
            }
            ablated.iter().for_each(|&c| deviations[c] = 0.0);
        }
        kept
    }

    /// Undoes what [`Self::ablate`] did.
    pub fn restore(&mut self, kept: StudyState) {
        self.replicates = kept.replicates;
        self.ghost_residuals = kept.ghost_residuals;
        self.ghost_deviations = kept.ghost_deviations;
        self.tolerance = kept.tolerance;
        self.ablated = kept.ablated;
    }
}
