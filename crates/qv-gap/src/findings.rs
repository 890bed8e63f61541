//! What stages hand on to each other and a report tells in the end: plain data, of which all stages may know.

use serde::{Deserialize, Deserializer, Serialize};

/// Name of an effect that the library does not have.
pub const UNKNOWN: &str = "unknown";

/// The outcome in one word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Simulator and robot agree as well as noise and tolerances let them.
    NoGap,
    /// The causes close the gap.
    Explained,
    /// The causes close part of the gap; something else is there, too.
    PartlyExplained,
    /// There is a gap, and no effect of the library explains it.
    Unexplained,
}

/// How large the gap is and how far it closes. Mean squares of whitened residuals (1 = what a robot without an effect
/// shows).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Gap {
    /// Of the nominal simulator.
    pub before: f64,
    /// With the causes.
    pub after: f64,
    /// What noise, numerics and tolerated deviations give.
    pub floor: f64,
    /// `(before - after) / (before - floor)`, 0 to 1.
    pub closed: f64,
    /// Its interval by bootstrap over windows.
    pub closed_ci95: [f64; 2],
    /// The same share in the windows of the fit, of which there are three times as many; `None` where the camera's gap is told. Sizes are a
    /// few numbers fitted to thousands: nothing is made good there that is not closed elsewhere, too.
    pub closed_in_fit: Option<f64>,
    /// Unit of before, after, floor.
    pub unit: String,
    /// Whether these are windows that no fit has seen.
    pub heldout: bool,
    /// Root mean square error of joint positions before and after in the same windows \[rad\].
    pub joint_rms: [f64; 2],
}

/// A value that was found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ParameterEstimate {
    /// Last word of the simulator's parameter, such as `command_latency`.
    pub name: String,
    /// Value; a deviation from nominal unless the effect is stated as a value of its own.
    pub value: f64,
    /// Interval.
    pub ci95: [f64; 2],
    /// Unit.
    pub unit: String,
}

/// A place in the ranking.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Ranked {
    /// Name.
    pub effect: String,
    /// Probability that it is there; see `Cause::probability` of the report.
    pub probability: f64,
}

/// A parameter of the simulator as it should be.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Correction {
    /// Full name, such as `actuator.FL_hip_joint.lag`.
    pub parameter: String,
    /// Value.
    pub value: f64,
    /// Value before.
    pub nominal: f64,
    /// Unit.
    pub unit: String,
}

/// Losses per number in the windows of the fit, tolerated deviations at their best, over the mean of the null.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Level {
    /// Of the recording.
    #[serde(deserialize_with = "or_nan")]
    pub ratio: f64,
    /// The same in the quieter windows: feet that met the ground otherwise are in the others.
    #[serde(deserialize_with = "or_nan")]
    pub quiet: f64,
    /// Mean loss per number of the null.
    #[serde(deserialize_with = "or_nan")]
    pub null: f64,
    /// Numbers, weighted.
    pub count: f64,
}

/// JSON has no infinity: it was written as null.
pub(crate) fn or_nan<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::NAN))
}
