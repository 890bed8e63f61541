//! Two causes at once: beside each of the best hypotheses, which other predicts best.

use crate::HeldError;
use crate::evidence::{Evidence, PairTest, best_first};
use crate::hypothesis::{Family, Hypothesis};
use crate::measure::{Target, places};
use crate::request::Request;
use crate::source::{Source, moved};
use rayon::prelude::*;

/// Best hypotheses, of an effect each, beside which a second is looked for; seconds of each that are followed.
const FIRST: usize = 3;
const SECOND: usize = 2;

impl Target<'_> {
    /// Pairs that predict best, each followed to its sizes.
    pub fn pairs(&self, evidence: &Evidence, request: &Request, source: &Source) -> Result<Vec<PairTest>, HeldError> {
        let order = best_first(&evidence.tested, |tested| &tested.losses);
        let firsts = best_of_each(&order, |&k| &evidence.tested[k].hypothesis.effect, FIRST);
        let all = firsts.into_par_iter().map(|first| self.pairs_of(evidence, *first, request, source));
        Ok(all.collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect())
    }

    fn pairs_of(
        &self,
        evidence: &Evidence,
        first: usize,
        request: &Request,
        source: &Source,
    ) -> Result<Vec<PairTest>, HeldError> {
        let own = &evidence.tested[first];
        let places = places(&own.hypothesis, &own.size);
        // The second is looked for about the robot with the first, where that can be computed anew.
        let robot = moved(self.robot, self.study.layout, &places);
        let balance = robot.as_ref().map(|robot| source.balance_about(robot, self.balance, &places)).transpose()?;
        let beside = robot.as_ref().zip(balance.as_ref()).map(|(robot, balance)| self.about(robot, balance));
        let (target, offset) = match &beside {
            Some(beside) => (beside, own.size.clone()),
            None => (self, vec![0.0; own.size.len()]),
        };
        let scales = self.gain_spread();
        let with = |k: usize| -> Option<PairTest> {
            let other = &evidence.tested[k].hypothesis;
            let mut test = target.test(joined(&own.hypothesis, other)?, scales)?;
            test.size.iter_mut().zip(&offset).for_each(|(size, from)| *size += from);
            let tolerances = [own.hypothesis.directions.first()?, other.directions.first()?];
            Some(PairTest { members: [first, k], test, tolerances: tolerances.map(|d| self.study.tolerance(d)) })
        };
        let all: Vec<PairTest> = (0..evidence.tested.len()).into_par_iter().filter_map(with).collect();
        let order = best_first(&all, |pair| &pair.test.losses);
        let effect = |k: &usize| &evidence.tested[all[*k].members[1]].hypothesis.effect;
        let best: Vec<PairTest> = best_of_each(&order, effect, SECOND).into_iter().map(|k| all[*k].clone()).collect();
        let follow = |mut pair: PairTest| -> Result<PairTest, HeldError> {
            let start = pair.test.size.clone();
            if !self.follow_drive(&mut pair.test, &start, request, source)? {
                target.note_left(&mut pair.test, request.policy.alpha);
            }
            Ok(pair)
        };
        best.into_par_iter().map(follow).collect()
    }
}

/// The first few of different effects.
fn best_of_each<'a, T>(sorted: &'a [T], effect: impl Fn(&'a T) -> &'a String, most: usize) -> Vec<&'a T> {
    let mut all: Vec<&T> = Vec::new();
    for one in sorted {
        if all.len() < most && all.iter().all(|other| effect(other) != effect(one)) {
            all.push(one);
        }
    }
    all
}

/// Two hypotheses as one: the first with all of its numbers, and another effect with one; none where the second has more, or both are one cause in
/// two parts: the masses of links, or a strength, which scales both gains, beside one of these.
fn joined(first: &Hypothesis, second: &Hypothesis) -> Option<Hypothesis> {
    let all = [first, second];
    let are_of_links = all.iter().all(|h| h.family == Family::Load || h.effect == "link_inertia");
    let are_gains = all.iter().all(|h| h.family == Family::Drive) && all.iter().any(|h| h.effect == "motor_strength");
    if first.effect == second.effect || second.axes.len() != 1 || are_of_links || are_gains {
        return None;
    }
    let mut all = first.clone();
    all.effect = format!("{} + {}", first.effect, second.effect);
    all.axes.extend(second.axes.iter().cloned());
    all.directions.extend(second.directions.iter().cloned());
    Some(all)
}
