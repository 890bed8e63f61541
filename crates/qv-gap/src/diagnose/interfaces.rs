//! Which interfaces the gap lies at.

use super::Findings;
use crate::GapError;
use crate::inference::linearised::LinearisedProblem;
use crate::problem::library;
use crate::report::Share;
use crate::report::attribution;

impl Findings<'_> {
    /// Shares of the interfaces: those of the causes by what they close, the rest by what speaks for each interface.
    pub(super) fn interfaces(&self, study: &mut LinearisedProblem, closed: f64) -> Result<Vec<Share>, GapError> {
        let shares = attribution::interfaces(study)?;
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
