//! How probable each effect is, and which interfaces the gap lies at.

use super::{Accused, Findings};
use crate::GapError;
use crate::decide::{NO_GAP, UNEXPLAINED};
use crate::library;
use crate::report::{Ranked, RoundTold, Share, UNKNOWN, Verdict};
use crate::search::Search;
use crate::shares;
use crate::study::Study;
use std::collections::BTreeMap;

impl Findings<'_> {
    /// Probability of `unknown` by what is left.
    fn by_level(&self) -> f64 {
        1.0 / (1.0 + (-(self.level_after.ratio - UNEXPLAINED) / 0.1).exp())
    }

    /// Probabilities of the effects and of `unknown`; `beside` is what the corrected robot asks for.
    pub(super) fn ranking(&self, verdict: Verdict, beside: BTreeMap<String, f64>) -> Vec<Ranked> {
        let best = self.rivals(verdict, beside);
        // An odds ratio beyond any doubt about the model itself means nothing: evidence counts in steps of ten nats.
        let most = best.values().copied().fold(0.0, f64::max);
        let weight = |evidence: f64| ((evidence - most) / 10.0).exp();
        let total: f64 = best.values().map(|e| weight(*e)).sum::<f64>().max(1e-300);
        let unknown = match verdict {
            // What is there may be too small to be seen.
            Verdict::NoGap => 0.5 / (1.0 + (-(self.level_after.ratio - NO_GAP) / 0.15).exp()),
            Verdict::Unexplained if self.doubt.is_some() => 0.8,
            // What is nearest was not good enough to be accused.
            Verdict::Unexplained => self.by_level().max(0.5),
            _ => self.by_level(),
        };
        // Something is accused beside what is unknown.
        let unknown = if verdict == Verdict::PartlyExplained { unknown.min(0.4) } else { unknown };
        let known = if verdict == Verdict::NoGap { 0.05 } else { 1.0 - unknown };
        let accused: Vec<&str> = self.accused.iter().map(|a| a.cause.effect.as_str()).collect();
        let mut ranking: Vec<Ranked> = best
            .iter()
            .map(|(effect, evidence)| {
                let share = known * weight(*evidence) / total;
                // One that was found in a later round has no rival left in the first; what is asked for beside it and was not
                // accused is no more than even.
                let probability = match accused.contains(&effect.as_str()) {
                    true => share.max(0.9 * known),
                    false if !accused.is_empty() => share.min(0.5 * known),
                    false => share,
                };
                Ranked { effect: effect.clone(), probability }
            })
            .collect();
        ranking.push(Ranked { effect: UNKNOWN.into(), probability: unknown });
        // Thousands of nats below the best all probabilities are 0, and evidence still tells.
        let evidence = |r: &Ranked| best.get(&r.effect).copied().unwrap_or(f64::NEG_INFINITY);
        ranking.sort_by(|a, b| b.probability.total_cmp(&a.probability).then(evidence(b).total_cmp(&evidence(a))));
        ranking
    }

    /// Log evidence of the effects by name. Beside causes that explain the recording counts what the corrected robot asks for: a
    /// rival that imitates them had much evidence before, and a second effect has some now. Where they do not, their rivals count.
    fn rivals(&self, verdict: Verdict, beside: BTreeMap<String, f64>) -> BTreeMap<String, f64> {
        let told = |round: Option<&RoundTold>| -> BTreeMap<String, f64> {
            round.iter().flat_map(|r| &r.suspects).map(|s| (s.effect.clone(), s.log_evidence)).collect()
        };
        if self.accused.is_empty() {
            return told(self.told.first());
        }
        let explains = matches!(verdict, Verdict::Explained | Verdict::PartlyExplained);
        let mut best = if explains { beside } else { told(self.told.first()) };
        best.extend(told(self.told.last().filter(|r| r.accused.is_empty())));
        for Accused { cause, fit, .. } in &self.accused {
            let evidence = best.entry(cause.effect.clone()).or_insert(fit.evidence);
            *evidence = evidence.max(fit.evidence);
        }
        best
    }

    /// Log evidence by one linear step of each effect that is not accused, in the corrected robot.
    pub(super) fn asked_beside(&mut self) -> Result<BTreeMap<String, f64>, GapError> {
        let accused = self.effects();
        let level = self.level_after.ratio.max(1.0);
        let mut best = BTreeMap::new();
        let Some(study) = self.later.as_mut().filter(|_| !accused.is_empty()) else { return Ok(best) };
        let mut search = Search::new(study, 1.0)?;
        let base = search.base(&[])?;
        for (evidence, suspect) in search.linear(&base.sums) {
            let columns = &search.study.columns;
            let effect = &columns.effects[columns.groups[suspect.group].effect].name;
            if evidence.is_finite() && !accused.contains(effect) {
                let most = best.entry(effect.clone()).or_insert(f64::NEG_INFINITY);
                *most = most.max(evidence / level);
            }
        }
        Ok(best)
    }

    /// Shares of the interfaces: those of the causes by what they close, the rest by what speaks for each interface.
    pub(super) fn interfaces(&self, study: &mut Study, closed: f64) -> Result<Vec<Share>, GapError> {
        let shares = shares::interfaces(study)?;
        let total: f64 = self.accused.iter().map(|a| a.cause.closed_alone.max(0.01)).sum();
        let share = |(interface, share): &(library::Interface, f64)| {
            let of_causes: f64 = self
                .accused
                .iter()
                .filter(|a| study.columns.effects.iter().any(|e| e.name == a.cause.effect && e.interface == *interface))
                .map(|a| a.cause.closed_alone.max(0.01) / total)
                .sum();
            let explained = if self.accused.is_empty() { 0.0 } else { closed.max(0.6) };
            Share { name: interface.name().into(), share: explained * of_causes + (1.0 - explained) * share }
        };
        let mut all: Vec<Share> = shares.iter().map(share).collect();
        all.push(Share { name: "visual".into(), share: 0.0 });
        Ok(all)
    }
}
