//! What stages hand on to each other and a report shows in the end: plain data, of which all stages may know.

use qv_rollout::Trace;
use serde::de::DeserializeOwned;
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
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Gap {
    /// Of the nominal simulator.
    #[serde(deserialize_with = "or_nan")]
    pub before: f64,
    /// With the causes.
    #[serde(deserialize_with = "or_nan")]
    pub after: f64,
    /// What noise, numerics and tolerated deviations give.
    #[serde(deserialize_with = "or_nan")]
    pub floor: f64,
    /// `(before - after) / (before - floor)`, 0 to 1.
    #[serde(deserialize_with = "or_nan")]
    pub closed: f64,
    /// Its interval by bootstrap over windows.
    #[serde(deserialize_with = "or_nan")]
    pub closed_ci95: [f64; 2],
    /// The same share in the windows of the fit, of which there are three times as many; `None` where the camera's gap is reported. Sizes are a
    /// few numbers fitted to thousands: nothing is made good there that is not closed elsewhere, too.
    pub closed_in_fit: Option<f64>,
    /// Unit of before, after, floor.
    pub unit: String,
    /// Whether these are windows that no fit has seen.
    pub heldout: bool,
    /// Root mean square error of joint positions before and after in the same windows \[rad\].
    #[serde(deserialize_with = "or_nan")]
    pub joint_rms: [f64; 2],
    /// The same of windows where paths part and of those that agree; `None` where none part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint_rms_apart: Option<JointRmsApart>,
}

/// Windows of two kinds: in most the corrected simulator stays near the recording, in some its path parts from it, as where a
/// foot slips in one and not in the other.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct JointRmsApart {
    /// Windows where paths part: their joints are off by more than [`PARTS`](Self::PARTS) times the median of all after correction.
    pub apart: usize,
    /// The other windows.
    pub agree: usize,
    /// Root mean square error of joint positions before and after in windows where paths part \[rad\].
    #[serde(deserialize_with = "or_nan")]
    pub rms_apart: [f64; 2],
    /// The same in the other windows \[rad\].
    #[serde(deserialize_with = "or_nan")]
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
    #[serde(deserialize_with = "or_nan")]
    pub value: f64,
    /// Interval.
    #[serde(deserialize_with = "or_nan")]
    pub ci95: [f64; 2],
    /// Unit.
    pub unit: String,
}

/// A place in the ranking.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RankedEffect {
    /// Name.
    pub effect: String,
    /// Orders candidates, from 0 to 1; it is no probability, see `Cause::score` of the report.
    #[serde(alias = "probability", deserialize_with = "or_nan")]
    pub score: f64,
}

/// A parameter of the simulator as it should be.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Correction {
    /// Full name, such as `actuator.FL_hip_joint.lag`.
    pub parameter: String,
    /// Value.
    #[serde(deserialize_with = "or_nan")]
    pub value: f64,
    /// Value before.
    #[serde(deserialize_with = "or_nan")]
    pub nominal: f64,
    /// Unit.
    pub unit: String,
}

/// A named share.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Share {
    /// Of what.
    pub name: String,
    /// 0 to 1.
    #[serde(deserialize_with = "or_nan")]
    pub share: f64,
}

/// A joint's share.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointShare {
    /// Joint.
    pub name: String,
    /// 0 to 1.
    #[serde(deserialize_with = "or_nan")]
    pub share: f64,
    /// Root mean square error of its position in the windows \[rad\].
    #[serde(deserialize_with = "or_nan")]
    pub pos_rms: f64,
}

/// A stretch of time's share.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TimeShare {
    /// \[s\]
    #[serde(deserialize_with = "or_nan")]
    pub start: f64,
    /// \[s\]
    #[serde(deserialize_with = "or_nan")]
    pub end: f64,
    /// 0 to 1.
    #[serde(deserialize_with = "or_nan")]
    pub share: f64,
}

/// A part of the floor's share.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RegionShare {
    /// Name.
    pub name: String,
    /// \[m\]
    #[serde(deserialize_with = "or_nan")]
    pub x: [f64; 2],
    /// \[m\]
    #[serde(deserialize_with = "or_nan")]
    pub y: [f64; 2],
    /// 0 to 1.
    #[serde(deserialize_with = "or_nan")]
    pub share: f64,
}

/// Where the gap lies.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Where {
    /// actuator, contact, inertial, sensing, visual.
    pub interfaces: Vec<Share>,
    /// By joint.
    pub joints: Vec<JointShare>,
    /// By leg.
    pub legs: Vec<Share>,
    /// stance, swing, impact.
    pub phases: Vec<Share>,
    /// By window.
    pub times: Vec<TimeShare>,
    /// By place.
    pub regions: Vec<RegionShare>,
}

/// An effect that is accused.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cause {
    /// Name.
    pub effect: String,
    /// Orders causes and candidates, from 0 to 1: by the share of the gap that is closed, and by evidence among rivals. It is no probability. Of a robot that is decided by its torque balance it is 1 less the error rate of the tests that were
    /// passed.
    #[serde(alias = "probability", deserialize_with = "or_nan")]
    pub score: f64,
    /// `all`, or joints, legs, feet, a region.
    pub scope: Vec<String>,
    /// Its size.
    pub parameters: Vec<ParameterEstimate>,
    /// Share of the gap that it closes alone, in windows that no fit has seen; of a part of the floor where feet slip, share of what pieces of
    /// 0.1 s have more there than elsewhere.
    #[serde(deserialize_with = "or_nan")]
    pub closed_alone: f64,
    /// Effects that would look alike in this recording.
    pub confusable_with: Vec<String>,
    /// What would distinguish them.
    pub separating_experiment: String,
    /// Its first value by recording, where there are several, in the order of their dates.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub by_recording: Vec<OfRecording>,
}

impl Cause {
    /// Name of each parameter, and the part that it is of where each part of the scope has one.
    pub fn parameter_labels(&self) -> Vec<(&str, Option<&str>)> {
        let count = |name: &str| self.parameters.iter().filter(|p| p.name == name).count();
        let mut labels = Vec::new();
        for (k, p) in self.parameters.iter().enumerate() {
            let before = self.parameters[..k].iter().filter(|other| other.name == p.name).count();
            let is_of_parts = count(&p.name) == self.scope.len() && self.scope.len() > 1;
            labels.push((p.name.as_str(), is_of_parts.then(|| self.scope[before].as_str())));
        }
        labels
    }
}

/// What the remaining error goes along with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Factor {
    /// What.
    pub factor: String,
    /// Share of the remaining torque's variance that it foretells in windows that it was not fitted to.
    #[serde(deserialize_with = "or_nan")]
    pub r2_heldout: f64,
}

/// What a gap that nothing explains looks most like.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Lead {
    /// Effects that this recording cannot determine apart, the one that closes most first.
    pub effects: Vec<String>,
    /// `all`, or joints, legs, feet, for the first of them.
    pub scope: Vec<String>,
    /// Size of the first.
    pub parameters: Vec<ParameterEstimate>,
    /// Share of the gap that the first closes in windows that no fit has seen.
    #[serde(deserialize_with = "or_nan")]
    pub closed: f64,
    /// Its interval.
    #[serde(deserialize_with = "or_nan")]
    pub closed_ci95: [f64; 2],
    /// Root mean square error of joint positions in these windows before and with it \[rad\].
    #[serde(deserialize_with = "or_nan")]
    pub joint_rms: [f64; 2],
    /// What would distinguish them.
    pub separating_experiment: String,
    /// First value of the first by recording, where there are several, in the order of their dates; to first order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub by_recording: Vec<OfRecording>,
}

/// Joints by time: error of positions \[rad\] in each window.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct HeatMap {
    /// Joints.
    pub joints: Vec<String>,
    /// Start of each window \[s\].
    #[serde(deserialize_with = "or_nan")]
    pub times: Vec<f64>,
    /// Root mean square error before, shape `[joints][times]` \[rad\].
    #[serde(deserialize_with = "or_nan")]
    pub before: Vec<Vec<f64>>,
    /// After.
    #[serde(deserialize_with = "or_nan")]
    pub after: Vec<Vec<f64>>,
}

/// The robot's place in a window, and the gap there in units of the null.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FloorPoint {
    /// \[m\]
    #[serde(deserialize_with = "or_nan")]
    pub x: f64,
    /// \[m\]
    #[serde(deserialize_with = "or_nan")]
    pub y: f64,
    /// Before.
    #[serde(deserialize_with = "or_nan")]
    pub before: f64,
    /// After.
    #[serde(deserialize_with = "or_nan")]
    pub after: f64,
}

/// A joint in a window that no fit has seen: measured, and simulated before and after.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Curve {
    /// Joint.
    pub joint: String,
    /// \[s\]
    #[serde(deserialize_with = "or_nan")]
    pub time: Vec<f64>,
    /// \[rad\]
    #[serde(deserialize_with = "or_nan")]
    pub measured: Vec<f64>,
    /// \[rad\]
    #[serde(deserialize_with = "or_nan")]
    pub before: Vec<f64>,
    /// \[rad\]
    #[serde(deserialize_with = "or_nan")]
    pub after: Vec<f64>,
}

/// All joints in a window that no fit has seen, at the recorded instants; channels that were not recorded are empty.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct TracedWindow {
    /// Which recording it is of, from 0.
    pub run: usize,
    /// Measured.
    #[serde(with = "StoredTrace")]
    pub measured: Trace,
    /// Simulated before, at the same times; empty channels where the simulation ran away.
    #[serde(with = "StoredTrace")]
    pub before: Trace,
    /// Simulated after, likewise.
    #[serde(with = "StoredTrace")]
    pub after: Trace,
}

/// All joints in all windows that no fit has seen.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Traces {
    /// Joints, in the order of the traces' columns.
    pub joints: Vec<String>,
    /// The windows, run after run, in the order of time.
    pub windows: Vec<TracedWindow>,
}

/// A stage and what was simulated in it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Stage {
    /// Name.
    pub name: String,
    /// Simulated steps.
    pub steps: usize,
}

/// How long it took, by the clock that the caller gave: another time in every run, so that it stands in a field of its own.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Timing {
    /// Seconds in all.
    #[serde(deserialize_with = "or_nan")]
    pub runtime_s: f64,
    /// Of each stage \[s\]; 0 without a clock.
    #[serde(deserialize_with = "or_nan")]
    pub stages_s: Vec<f64>,
}

/// Several effects at their best beside each other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Together {
    /// Each of them, the one that is missed most first.
    pub effects: Vec<TogetherEffect>,
    /// Share of the gap that all of them close in windows that no fit has seen.
    #[serde(deserialize_with = "or_nan")]
    pub closed: f64,
    /// Its interval.
    #[serde(deserialize_with = "or_nan")]
    pub closed_ci95: [f64; 2],
    /// Root mean square error of joint positions in these windows before and with them \[rad\].
    #[serde(deserialize_with = "or_nan")]
    pub joint_rms: [f64; 2],
    /// What is left in the windows of the fit over what the null leaves.
    #[serde(deserialize_with = "or_nan")]
    pub level: f64,
}

/// An effect beside others.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TogetherEffect {
    /// Name.
    pub effect: String,
    /// `all`, or joints or links.
    pub scope: Vec<String>,
    /// Its size, with what the others leave open of it.
    pub parameters: Vec<ParameterEstimate>,
    /// Log likelihood ratio of having it, the others at their best without it, in units of what is left.
    #[serde(deserialize_with = "or_nan")]
    pub log_likelihood_ratio: f64,
    /// Effects that this recording does not show from it beside the others (correlation above 0.95).
    pub alike: Vec<String>,
}

impl TogetherEffect {
    /// Its name, then those that are not distinguished from it.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        std::iter::once(&self.effect).chain(&self.alike).map(String::as_str)
    }
}

/// The least size of an effect on a part of the robot that this recording would show with 90 % power (80 % where it is decided by its torque
/// balance), if nothing else were wrong.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CanTell {
    /// Effect of the library.
    pub effect: String,
    /// On what it acts: `all`, or names of joints, legs, feet.
    pub scope: Vec<String>,
    /// The size that is meant, of those that the effect has.
    pub parameter: String,
    /// Its unit.
    pub unit: String,
    /// Deviation from absent; `None` where it is beyond the effect's range, or the recording does not show it at all.
    pub least_size: Option<f64>,
    /// What any robot may deviate by.
    #[serde(deserialize_with = "or_nan")]
    pub tolerance: f64,
    /// Sizes that are looked for.
    #[serde(deserialize_with = "or_nan")]
    pub range: [f64; 2],
    /// Effects that look much the same in this recording.
    pub confusable_with: Vec<String>,
}

/// What a recording asks for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OfRecording {
    /// Index among the recordings that were given, from 0.
    pub recording: usize,
    /// First value of the effect, in its unit.
    #[serde(deserialize_with = "or_nan")]
    pub value: f64,
    /// Its interval.
    #[serde(deserialize_with = "or_nan")]
    pub ci95: [f64; 2],
}

/// Scatter from photograph to photograph about what all share.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Noise {
    /// Of the rotation \[rad\].
    #[serde(deserialize_with = "or_nan")]
    pub rotation: f64,
    /// Of the translation \[m\].
    #[serde(deserialize_with = "or_nan")]
    pub translation: f64,
    /// Of the logarithm of the gain.
    #[serde(deserialize_with = "or_nan")]
    pub gain: f64,
    /// Of the logarithm of the focal length.
    #[serde(deserialize_with = "or_nan")]
    pub focal: f64,
}

/// How far photographs and scene are apart: root mean square difference of displayed brightness, differences above 0.2 limited.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct VisualGap {
    /// As the camera is stated.
    #[serde(deserialize_with = "or_nan")]
    pub before: f64,
    /// With the causes, fitted to other photographs.
    #[serde(deserialize_with = "or_nan")]
    pub after: f64,
    /// Each photograph moved to where it agrees best.
    #[serde(deserialize_with = "or_nan")]
    pub floor: f64,
    /// Share of the squares above the floor that the causes take away, 0 to 1.
    #[serde(deserialize_with = "or_nan")]
    pub closed: f64,
    /// Its interval by bootstrap over photographs.
    #[serde(deserialize_with = "or_nan")]
    pub closed_ci95: [f64; 2],
    /// Unit of before, after, floor.
    pub unit: String,
    /// Whether no fit has seen the photographs that it is judged in.
    pub heldout: bool,
}

/// Losses per number in the windows of the fit, tolerated deviations at their best, over the mean of the null.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Level {
    /// Of the recording.
    #[serde(deserialize_with = "or_nan")]
    pub ratio: f64,
    /// Mean loss per number of the null.
    #[serde(deserialize_with = "or_nan")]
    pub null: f64,
    /// Numbers, weighted.
    #[serde(deserialize_with = "or_nan")]
    pub count: f64,
}

/// Channels of joints of a trace, as they are stored.
#[derive(Serialize, Deserialize)]
#[serde(remote = "Trace")]
struct StoredTrace {
    time: Vec<f64>,
    #[serde(deserialize_with = "or_nan")]
    position: Vec<f64>,
    #[serde(deserialize_with = "or_nan")]
    velocity: Vec<f64>,
    #[serde(deserialize_with = "or_nan")]
    torque: Vec<f64>,
    #[serde(skip)]
    foot_force: Vec<f64>,
    #[serde(skip)]
    base: Vec<[f64; 7]>,
    joints: usize,
}

/// Numbers of some shape, and what JSON holds of them: it has neither infinity nor NaN, both were written as null.
pub(crate) trait Numbers {
    /// As they are read.
    type JsonForm: DeserializeOwned;
    /// Null as NaN.
    fn read(stored: Self::JsonForm) -> Self;
}

impl Numbers for f64 {
    type JsonForm = Option<f64>;
    fn read(stored: Option<f64>) -> Self {
        stored.unwrap_or(f64::NAN)
    }
}

impl Numbers for [f64; 2] {
    type JsonForm = [Option<f64>; 2];
    fn read(stored: Self::JsonForm) -> Self {
        stored.map(f64::read)
    }
}

impl<T: Numbers> Numbers for Vec<T> {
    type JsonForm = Vec<T::JsonForm>;
    fn read(stored: Self::JsonForm) -> Self {
        stored.into_iter().map(T::read).collect()
    }
}

/// Reads numbers of which some may be null.
pub(crate) fn or_nan<'de, D: Deserializer<'de>, T: Numbers>(deserializer: D) -> Result<T, D::Error> {
    T::JsonForm::deserialize(deserializer).map(T::read)
}
