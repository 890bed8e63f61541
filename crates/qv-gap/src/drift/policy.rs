//! Numbers that decide whether a robot changed.

/// Numbers that decide.
#[derive(Debug, Clone, PartialEq)]
pub struct DriftPolicy {
    /// Probability of any false alarm, over all parameters (Holm, Scandinavian Journal of Statistics 6, 1979).
    pub alarm: f64,
    /// How far a robot's parameters may move from one day to the next without a change, as a share of what robots of its kind differ by.
    pub session: f64,
    /// Changes that are named, at most.
    pub most: usize,
    /// Least part of the evidence of the first change that another one beside it has.
    pub beside: f64,
    /// So many times as large as the calibration could show: from there on a recording shows an effect no longer.
    pub blunter: f64,
}

impl Default for DriftPolicy {
    fn default() -> Self {
        Self { alarm: 0.01, session: 0.1, most: 6, beside: 0.1, blunter: 3.0 }
    }
}
