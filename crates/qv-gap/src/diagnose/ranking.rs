//! How probable each effect is, and which interfaces the gap lies at.

use super::Findings;
use crate::decide::{NO_GAP, UNEXPLAINED};
use crate::library;
use crate::report::{Ranked, Share, UNKNOWN, Verdict};
use crate::shares;
use crate::study::Study;
use std::collections::BTreeMap;

impl Findings<'_> {
    /// Probability of `unknown` by what is left.
    fn by_level(&self) -> f64 {
        1.0 / (1.0 + (-(self.level_after.ratio - UNEXPLAINED) / 0.1).exp())
    }

    /// Probabilities of the effects and of `unknown`.
    pub(super) fn ranking(&self, verdict: Verdict) -> Vec<Ranked> {
        // Where something is accused, the others are judged beside it.
        let judged = if self.accused.is_empty() { self.told.first() } else { self.told.last() };
        let mut best: BTreeMap<String, f64> = BTreeMap::new();
        for told in self.told.first().into_iter().chain(judged) {
            best.extend(told.suspects.iter().map(|s| (s.effect.clone(), s.log_evidence)));
        }
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
                // One that was found in a later round has no rival left in the first.
                let probability = if accused.contains(&effect.as_str()) { share.max(0.9 * known) } else { share };
                Ranked { effect: effect.clone(), probability }
            })
            .collect();
        for accused in &self.accused {
            if !ranking.iter().any(|r| r.effect == accused.cause.effect) {
                ranking.push(Ranked { effect: accused.cause.effect.clone(), probability: 0.9 * known });
            }
        }
        ranking.push(Ranked { effect: UNKNOWN.into(), probability: unknown });
        ranking.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        ranking
    }

    /// Shares of the interfaces: those of the causes by what they close, the rest by what freeing each interface takes away.
    pub(super) fn interfaces(&self, study: &Study, closed: f64) -> Vec<Share> {
        let freed = shares::interfaces(study);
        let total: f64 = self.accused.iter().map(|a| a.cause.closed_alone.max(0.01)).sum();
        let share = |(interface, free): &(library::Interface, f64)| {
            let of_causes: f64 = self
                .accused
                .iter()
                .filter(|a| study.columns.effects.iter().any(|e| e.name == a.cause.effect && e.interface == *interface))
                .map(|a| a.cause.closed_alone.max(0.01) / total)
                .sum();
            let explained = if self.accused.is_empty() { 0.0 } else { closed.max(0.6) };
            Share { name: interface.name().into(), share: explained * of_causes + (1.0 - explained) * free }
        };
        let mut all: Vec<Share> = freed.iter().map(share).collect();
        all.push(Share { name: "visual".into(), share: 0.0 });
        all
    }
}
