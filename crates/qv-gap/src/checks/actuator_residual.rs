//! What the laws of the actuators leave, tolerated deviations at their best, one joint at a time.
//!
//! The level of all features together hardly shows what one actuator does wrong among hundreds of numbers that are right, and
//! holds what engines differ in at contacts. The law of an actuator knows no contacts.

use crate::findings::or_nan;
use crate::inference::gaussian_evidence::Marginal;
use crate::inference::linearised::LinearisedProblem;
use crate::inference::search::fitted;
use qv_rollout::law;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// What the law of a joint's actuator leaves in the windows of the fit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ActuatorResidual {
    /// The joint.
    pub joint: usize,
    /// Mean square over that of simulated recordings without an effect.
    #[serde(deserialize_with = "or_nan")]
    pub ratio: f64,
    /// The same of the simulated recording in which it is largest.
    #[serde(deserialize_with = "or_nan")]
    pub by_chance: f64,
}

/// Of all actuators whose torque was measured; none where the normal equations are no good.
pub fn actuator_residuals(study: &LinearisedProblem) -> Vec<ActuatorResidual> {
    let Ok(marginal) = study.marginal(fitted) else { return Vec::new() };
    let here = squares(study, &marginal, &study.residuals());
    let replicates: Vec<_> = study.residuals_of_replicates().collect();
    let replicates: Vec<Vec<f64>> = replicates.par_iter().map(|g| squares(study, &marginal, g)).collect();
    let left = |(k, &joint): (usize, &usize)| {
        let finite: Vec<f64> = replicates.iter().map(|g| g[k]).filter(|x| x.is_finite()).collect();
        let mean = finite.iter().sum::<f64>() / finite.len().max(1) as f64;
        let most = finite.iter().copied().fold(0.0, f64::max);
        ActuatorResidual { joint, ratio: here[k] / mean, by_chance: most / mean }
    };
    study.rollout.law_joints.iter().enumerate().map(left).collect()
}

/// Mean squares of the laws' residuals of a recording by joint, with its own best deviations.
fn squares(study: &LinearisedProblem, marginal: &Marginal, residuals: &[Option<&Vec<f64>>]) -> Vec<f64> {
    let bins = law::bins(&study.rollout);
    let joints = study.rollout.law_joints.len();
    let (mut sums, mut count) = (vec![0.0; joints], 0.0);
    for left in study.without_deviations(marginal, residuals, fitted).iter().flatten() {
        // The features of the laws are the last ones, but for one of each joint that corrects their squares.
        let first = left.len() - joints * (bins + 1);
        left[first..first + joints * bins].iter().enumerate().for_each(|(i, x)| sums[i / bins] += x * x);
        count += bins as f64;
    }
    sums.iter().map(|sum| sum / f64::max(count, 1.0)).collect()
}
