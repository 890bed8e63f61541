//! Sums over robots and steps.

use super::reward::TERMS;

/// Sums since figures were asked for.
#[derive(Debug, Clone)]
pub(super) struct Sums {
    pub steps: f64,
    pub terms: [f64; TERMS.len()],
    pub velocity_error: f64,
    pub turning_error: f64,
    /// Landings, time in the air, highest points.
    pub feet: [f64; 3],
}

impl Sums {
    pub fn new() -> Self {
        Self { steps: 0.0, terms: [0.0; TERMS.len()], velocity_error: 0.0, turning_error: 0.0, feet: [0.0; 3] }
    }
}
