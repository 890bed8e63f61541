//! Follows hypotheses to where their columns are those of their sizes.

use crate::HeldError;
use crate::balance::Term;
use crate::evidence::{Evidence, HypothesisTest, best_first};
use crate::hypothesis::Hypothesis;
use crate::measure::{Target, places as places_of};
use crate::request::Request;
use crate::source::{Source, moved};
use crate::traces::torques_left;
use rayon::prelude::*;

/// Lags \[s\] and quantiles of torques from which lags and limits are followed, whose columns at zero say little of large sizes.
const LAGS: [f64; 4] = [0.004, 0.008, 0.016, 0.032];
const CAPS: [f64; 6] = [0.99, 0.95, 0.9, 0.8, 0.6, 0.4];
/// Best hypotheses beside which events are looked for.
const FOLLOWED: usize = 10;

impl Target<'_> {
    /// Follows the best hypotheses: to where their columns are those of their sizes, and to the events that are left beside them.
    pub fn follow(&self, evidence: &mut Evidence, request: &Request, source: &Source) -> Result<(), HeldError> {
        let order = best_first(&evidence.tested, |tested| &tested.losses);
        let starts = (evidence.tested.par_iter().map(|t| self.start(&t.hypothesis, source)))
            .collect::<Result<Vec<Option<Vec<f64>>>, HeldError>>()?;
        let rank = order.iter().enumerate().filter(|(rank, k)| *rank < FOLLOWED || starts[**k].is_some());
        let order: Vec<usize> = rank.map(|(_, k)| *k).collect();
        let one = |&k: &usize| -> Result<(usize, HypothesisTest), HeldError> {
            let mut tested = evidence.tested[k].clone();
            let is_there = match &starts[k] {
                // Its columns at zero promise what its sizes do not keep.
                Some(start) => {
                    let linear = std::mem::replace(&mut tested.loss, evidence.loss);
                    let is_better = self.follow_drive(&mut tested, start, request, source)?;
                    tested.loss = if is_better { tested.loss } else { linear };
                    is_better
                }
                None => false,
            };
            let start = tested.size.clone();
            if !is_there && !self.follow_drive(&mut tested, &start, request, source)? {
                self.note_left(&mut tested, request.policy.alpha);
            }
            Ok((k, tested))
        };
        let followed = order.par_iter().map(one).collect::<Result<Vec<_>, _>>()?;
        followed.into_iter().for_each(|(k, tested)| evidence.tested[k] = tested);
        Ok(())
    }

    /// The best of some sizes of a lag or a limit where that is better than none: columns about zero say little of large ones.
    fn start(&self, hypothesis: &Hypothesis, source: &Source) -> Result<Option<Vec<f64>>, HeldError> {
        let ([direction], Some(servos)) = (&hypothesis.directions[..], &self.robot.servos) else { return Ok(None) };
        let terms: Vec<(usize, Term)> = direction.iter().filter_map(|d| self.study.layout.term(d.0)).collect();
        let sizes: Vec<f64> = match terms.first() {
            Some((_, Term::Lag)) => LAGS.to_vec(),
            Some(&(joint, Term::Cap)) => {
                let limits = source.torques(self.robot, joint, &CAPS).unwrap_or_default();
                limits.into_iter().map(|limit| limit - servos.cap[joint]).collect()
            }
            _ => return Ok(None),
        };
        let joints: Vec<usize> = terms.iter().map(|t| t.0).collect();
        let mut best = (source.loss(self.robot, &joints)?, None);
        for size in sizes {
            let Some(robot) = moved(self.robot, self.study.layout, &places_of(hypothesis, &[size])) else { continue };
            let loss = source.loss(&robot, &joints)?;
            if loss < best.0 {
                best = (loss, Some(vec![size]));
            }
        }
        Ok(best.1)
    }

    /// Notes what a hypothesis leaves of torques, and the events in that.
    pub fn note_left(&self, tested: &mut HypothesisTest, alpha: f64) {
        let Some(fit) = self.profiles.bands[0].fit(&tested.hypothesis.directions) else { return };
        tested.events = Some(self.events(&fit, tested.loss, alpha));
        tested.left = torques_left(self.balance, self.study.layout, &fit.values);
    }

    /// Gauss and Newton's steps of a hypothesis of motors, friction or rotors: the equations are computed anew with its size, and with them what delays and
    /// scales that are pinned make of it. Whether its fit is better there.
    pub fn follow_drive(
        &self,
        tested: &mut HypothesisTest,
        start: &[f64],
        request: &Request,
        source: &Source,
    ) -> Result<bool, HeldError> {
        const STEPS: usize = 8;
        // A step that lowers the loss by less is the last.
        const LEAST_FALL: f64 = 0.01;
        const SHARES: [f64; 4] = [1.0, 0.5, 0.2, 0.05];
        let mut size = start.to_vec();
        let mut best: Option<HypothesisTest> = None;
        for _ in 0..STEPS {
            let places = places_of(&tested.hypothesis, &size);
            let Some(robot) = moved(self.robot, self.study.layout, &places) else { break };
            let balance = source.balance_about(&robot, self.balance, &places)?;
            let target = self.about(&robot, &balance);
            let Some(mut found) = target.test(tested.hypothesis.clone(), 0.0) else { break };
            let before = best.as_ref().unwrap_or(tested).loss;
            if found.loss >= before {
                break;
            }
            // A step to what no robot can be is shortened, and what it would leave is not believed.
            let ahead = |share: f64| size.iter().zip(&found.size).map(|(all, more)| all + share * more).collect();
            let is_possible =
                |next: &Vec<f64>| moved(self.robot, self.study.layout, &places_of(&tested.hypothesis, next)).is_some();
            let Some((share, next)) =
                SHARES.iter().map(|share| (*share, ahead(*share))).find(|(_, next)| is_possible(next))
            else {
                break;
            };
            if share < 1.0 {
                size = next;
                continue;
            }
            let is_last = found.loss > (1.0 - LEAST_FALL) * before;
            target.note_left(&mut found, request.policy.alpha);
            size = next;
            found.size.clone_from(&size);
            found.acted[0].clone_from(&tested.acted[0]);
            best = Some(found);
            if is_last {
                break;
            }
        }
        let Some(found) = best else { return Ok(false) };
        *tested = found;
        Ok(true)
    }
}
