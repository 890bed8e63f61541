//! Settings of the second engine.

use crate::SimError;
use crate::error::finite;

/// Longest latency or delay that can be set \[s\].
pub const LONGEST_DELAY: f64 = 1.0;

/// Settings of the second engine.
#[derive(Debug, Clone, PartialEq)]
pub struct RapierOptions {
    /// Time step of commands and sensors \[s\].
    pub timestep: f64,
    /// Gravity in the world \[m/s²\].
    pub gravity: [f64; 3],
    /// Substeps of the dynamics and contacts within one time step.
    pub substeps: usize,
}

impl Default for RapierOptions {
    fn default() -> Self {
        Self { timestep: 0.001, gravity: [0.0, 0.0, -qv_core::GRAVITY], substeps: 4 }
    }
}

impl RapierOptions {
    pub(super) fn check(&self) -> Result<(), SimError> {
        let error = |what: &str, expected: &str, found| {
            Err(SimError::Value { what: what.into(), expected: expected.into(), found })
        };
        if !(1e-6..=0.1).contains(&self.timestep) {
            return error("timestep", "1e-6 to 0.1 s", self.timestep);
        }
        if !(1..=100).contains(&self.substeps) {
            return error("substeps", "1 to 100", self.substeps as f64);
        }
        finite("gravity", &self.gravity)
    }
}
