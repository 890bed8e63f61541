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
    /// The same of windows where paths part and of those that agree; `None` where none part.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joint_rms_apart: Option<JointRmsApart>,
}

/// Windows of two kinds: in most the corrected simulator stays near the recording, in some its path parts from it, as where a
/// foot slips in one and not in the other.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct JointRmsApart {
    /// Windows where paths part: their joints are off by more than [`PARTS`](Self::PARTS) times the median of all after correction.
    pub apart: usize,
    /// The other windows.
    pub agree: usize,
    /// Root mean square error of joint positions before and after in windows where paths part \[rad\].
    pub rms_apart: [f64; 2],
    /// The same in the other windows \[rad\].
    pub rms_agree: [f64; 2],
}

impl JointRmsApart {
    /// From how many medians on a window's path has parted.
    pub const PARTS: f64 = 3.0;

    /// Windows with these root mean squares before and after \[rad\], sorted into the two kinds; `None` where no path parts.
    pub fn of(windows: &[[f64; 2]]) -> Option<Self> {
        let mut after: Vec<f64> = windows.iter().map(|w| w[1]).filter(|x| x.is_finite()).collect();
        let limit = Self::PARTS * qv_core::statistics::median(&mut after);
        let (apart, agree): (Vec<[f64; 2]>, Vec<[f64; 2]>) =
            windows.iter().filter(|w| w.iter().all(|x| x.is_finite())).partition(|w| w[1] > limit);
        let rms = |all: &[[f64; 2]], k: usize| {
            (all.iter().map(|w| w[k] * w[k]).sum::<f64>() / all.len().max(1) as f64).sqrt()
        };
        let both = |all: &[[f64; 2]]| [rms(all, 0), rms(all, 1)];
        let found = Self { apart: apart.len(), agree: agree.len(), rms_apart: both(&apart), rms_agree: both(&agree) };
        (found.apart > 0).then_some(found)
    }
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
