//! What a diagnosis found, as plain data: `report.json` is this, field by field.

pub(crate) mod attribution;
pub(crate) mod can_tell;
pub(crate) mod figures;
pub(crate) mod leads;
pub(crate) mod narrative;
pub(crate) mod residual_factors;
pub(crate) mod together;
pub(crate) mod traces;

pub use crate::checks::by_recording::OfRecording;
use crate::decision::Policy;
pub use crate::findings::{Correction, Gap, JointRmsApart, ParameterEstimate, Ranked, UNKNOWN, Verdict};
pub use can_tell::CanTell;
use qv_rollout::Trace;
use serde::Serialize;
use serde_json::value::RawValue;
pub use together::{Together, TogetherEffect};

/// The format's name in `report.json`.
pub const FORMAT: &str = "qv-diagnosis/1";
/// A named share.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Share {
    /// Of what.
    pub name: String,
    /// 0 to 1.
    pub share: f64,
}

/// A joint's share.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JointShare {
    /// Joint.
    pub name: String,
    /// 0 to 1.
    pub share: f64,
    /// Root mean square error of its position in the windows \[rad\].
    pub pos_rms: f64,
}

/// A stretch of time's share.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TimeShare {
    /// \[s\]
    pub start: f64,
    /// \[s\]
    pub end: f64,
    /// 0 to 1.
    pub share: f64,
}

/// A part of the floor's share.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RegionShare {
    /// Name.
    pub name: String,
    /// \[m\]
    pub x: [f64; 2],
    /// \[m\]
    pub y: [f64; 2],
    /// 0 to 1.
    pub share: f64,
}

/// Where the gap lies.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
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
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Cause {
    /// Name.
    pub effect: String,
    /// Probability that it is there, by what is known of the effects of the library and `unknown`. Several can be there at once: where more
    /// than one is accused they do not sum to 1.
    pub probability: f64,
    /// `all`, or joints, legs, feet, a region.
    pub scope: Vec<String>,
    /// Its size.
    pub parameters: Vec<ParameterEstimate>,
    /// Share of the gap that it closes alone, in windows that no fit has seen; of a part of the floor where feet slip, share of what pieces of
    /// 0.1 s have more there than elsewhere.
    pub closed_alone: f64,
    /// Effects that would look alike in this recording.
    pub confusable_with: Vec<String>,
    /// What would tell them apart.
    pub separating_experiment: String,
    /// Its first value by recording, where there are several, in the order of their dates.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub by_recording: Vec<OfRecording>,
}

/// What the remaining error goes along with.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Factor {
    /// What.
    pub factor: String,
    /// Share of the remaining torque's variance that it foretells in windows that it was not fitted to.
    pub r2_heldout: f64,
}

/// What a gap that nothing explains looks most like.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Lead {
    /// Effects that this recording cannot tell apart, the one that closes most first.
    pub effects: Vec<String>,
    /// `all`, or joints, legs, feet, for the first of them.
    pub scope: Vec<String>,
    /// Size of the first.
    pub parameters: Vec<ParameterEstimate>,
    /// Share of the gap that the first closes in windows that no fit has seen.
    pub closed: f64,
    /// Its interval.
    pub closed_ci95: [f64; 2],
    /// Root mean square error of joint positions in these windows before and with it \[rad\].
    pub joint_rms: [f64; 2],
    /// What would tell them apart.
    pub separating_experiment: String,
    /// First value of the first by recording, where there are several, in the order of their dates; to first order.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub by_recording: Vec<OfRecording>,
}

/// A round of the search: what it began with, and what it made of each effect.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RoundSummary {
    /// Loss over that of the null before the round, tolerated deviations at their best.
    pub level: f64,
    /// The best of each effect, likeliest first.
    pub suspects: Vec<SuspectSummary>,
    /// Accused in this round.
    pub accused: Vec<String>,
    /// Why the best was not accused; empty if it was.
    pub reason: String,
}

/// An effect at its best in a round.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SuspectSummary {
    /// Name.
    pub effect: String,
    /// `all`, or joints, legs, feet, a region.
    pub scope: Vec<String>,
    /// Its size.
    pub parameters: Vec<ParameterEstimate>,
    /// Log evidence over that of nothing more, divided by the dispersion.
    pub log_evidence: f64,
    /// Share of the excess over the null that it takes away.
    pub share: f64,
}

/// What is left.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Unexplained {
    /// Share of the gap.
    pub share: f64,
    /// On what it depends.
    pub depends_on: Vec<Factor>,
}

/// Joints by time: error of positions \[rad\] in each window.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct HeatMap {
    /// Joints.
    pub joints: Vec<String>,
    /// Start of each window \[s\].
    pub times: Vec<f64>,
    /// Root mean square error before, shape `[joints][times]` \[rad\].
    pub before: Vec<Vec<f64>>,
    /// After.
    pub after: Vec<Vec<f64>>,
}

/// The robot's place in a window, and the gap there in units of the null.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FloorPoint {
    /// \[m\]
    pub x: f64,
    /// \[m\]
    pub y: f64,
    /// Before.
    pub before: f64,
    /// After.
    pub after: f64,
}

/// A joint in a window that no fit has seen: measured, and simulated before and after.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Curve {
    /// Joint.
    pub joint: String,
    /// \[s\]
    pub time: Vec<f64>,
    /// \[rad\]
    pub measured: Vec<f64>,
    /// \[rad\]
    pub before: Vec<f64>,
    /// \[rad\]
    pub after: Vec<f64>,
}

/// All joints in a window that no fit has seen, at the recorded instants; channels that were not recorded are empty.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TracedWindow {
    /// Which recording it is of, from 0.
    pub run: usize,
    /// Measured.
    pub measured: Trace,
    /// Simulated before, at the same times; empty channels where the simulation ran away.
    pub before: Trace,
    /// Simulated after, likewise.
    pub after: Trace,
}

/// All joints in all windows that no fit has seen.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Traces {
    /// Joints, in the order of the traces' columns.
    pub joints: Vec<String>,
    /// The windows, run after run, in the order of time.
    pub windows: Vec<TracedWindow>,
}

/// A stage and what was simulated in it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stage {
    /// Name.
    pub name: String,
    /// Simulated steps.
    pub steps: usize,
}

/// How long it took, by the clock that the caller gave: another time in every run, so that it stands in a field of its own.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Timing {
    /// Seconds in all.
    pub runtime_s: f64,
    /// Of each stage \[s\]; 0 without a clock.
    pub stages_s: Vec<f64>,
}

/// What another crate adds to a report: its JSON, with keys in the order of its own fields.
#[derive(Debug, Clone, Serialize)]
#[serde(transparent)]
pub struct Part(Box<RawValue>);

impl Part {
    /// Of plain data.
    pub fn new(of: &impl Serialize) -> Self {
        // Indented as the fields of a report are.
        let text = serde_json::to_string_pretty(of).expect("plain data").replace('\n', "\n  ");
        Self(RawValue::from_string(text).expect("it was written as JSON"))
    }
}

impl PartialEq for Part {
    fn eq(&self, other: &Self) -> bool {
        self.0.get() == other.0.get()
    }
}

/// A diagnosis.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// [`FORMAT`].
    pub format: String,
    /// The outcome.
    pub verdict: Verdict,
    /// The outcome in a sentence.
    pub sentence: String,
    /// How large.
    pub gap: Gap,
    /// Where.
    #[serde(rename = "where")]
    pub place: Where,
    /// What is accused, best first.
    pub causes: Vec<Cause>,
    /// All that was considered, best first, `unknown` among them.
    pub ranking: Vec<Ranked>,
    /// Where to look when nothing is accused; no accusation.
    pub leads: Vec<Lead>,
    /// Several effects fitted at once, where nothing is accused of a robot that is held; no accusation.
    pub together: Option<Together>,
    /// How the causes were found, round by round.
    pub rounds: Vec<RoundSummary>,
    /// What the camera says, where another crate looked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub visual: Option<Part>,
    /// What is left.
    pub unexplained: Unexplained,
    /// What cannot be told from this recording, and why.
    pub cannot_tell: Vec<String>,
    /// What to do next.
    pub next: Vec<String>,
    /// The parameters with the causes.
    pub corrections: Vec<Correction>,
    /// Whether they are for use: with them the loss in windows that no fit has seen is not higher than without. Else they are a finding, and no
    /// file applies them.
    pub corrections_apply: bool,
    /// Effects that this recording could not show: a channel, a part of the robot or excitation is lacking.
    pub cannot_show: Vec<String>,
    /// The least sizes that this recording shows, by effect and part of the robot.
    pub can_tell: Vec<CanTell>,
    /// Error by joint and time.
    pub heat_map: HeatMap,
    /// Gap by place.
    pub floor_plan: Vec<FloorPoint>,
    /// Examples.
    pub curves: Vec<Curve>,
    /// Every joint at the recorded rate: for the page, too much for `report.json`.
    #[serde(skip)]
    pub traces: Traces,
    /// What was done.
    pub stages: Vec<Stage>,
    /// How long it took.
    pub timing: Timing,
    /// The numbers that decided.
    pub policy: Policy,
    /// Program, arguments, and inputs with their hashes, where the caller says them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub provenance: Option<serde_json::Value>,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Keys that are not in the order of the alphabet, and numbers that JSON lacks.
    #[derive(Serialize)]
    struct Own {
        size: f64,
        parts: Vec<Share>,
        after: f64,
    }

    #[derive(Serialize)]
    struct Whole<T> {
        first: u8,
        visual: T,
        last: u8,
    }

    #[test]
    fn a_part_reads_as_if_it_were_a_field() {
        let own = Own { size: 0.1, parts: vec![Share { name: "a\nb".into(), share: 1.0 }], after: f64::NAN };
        let part = Part::new(&own);
        let as_part = serde_json::to_string_pretty(&Whole { first: 1, visual: part.clone(), last: 2 }).unwrap();
        let value = serde_json::to_value(&part).unwrap();
        assert_eq!((value["size"].as_f64(), value["after"].is_null()), (Some(0.1), true), "{value}");
        assert_eq!(as_part, serde_json::to_string_pretty(&Whole { first: 1, visual: own, last: 2 }).unwrap());
    }
}
