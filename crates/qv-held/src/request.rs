//! What is to be weighed.

use crate::decision::Policy;
use qv_recording::Run;
use qv_sim::Model;

/// What is weighed.
pub struct Request<'a> {
    /// Recordings of one robot.
    pub runs: &'a [Run],
    /// Recordings of it without what is looked for; without any a fleet is simulated.
    pub references: &'a [Run],
    /// The robot.
    pub model: &'a Model,
    /// Parameters that are known already, by name.
    pub given: &'a [(String, f64)],
    /// Effects that may not be a cause.
    pub without: &'a [String],
    /// Seed of the fleet.
    pub seed: u64,
    /// Rates and tolerances.
    pub policy: &'a Policy,
}
