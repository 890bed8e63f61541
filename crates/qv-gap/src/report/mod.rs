//! What a diagnosis found, as plain data: `report.json` is this, field by field.

pub(crate) mod attribution;
mod camera;
pub(crate) mod can_tell;
pub(crate) mod cannot_tell;
pub(crate) mod figures;
mod held;
pub(crate) mod leads;
pub(crate) mod narrative;
mod render;
pub(crate) mod residual_factors;
pub(crate) mod together;
pub(crate) mod traces;

use crate::decision::Policy;
pub use crate::findings::*;
pub use render::{render, report};
use serde::Serialize;

/// The format's name in `report.json`.
pub const FORMAT: &str = "qv-diagnosis/1";

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
pub struct Remainder {
    /// Share of the gap.
    pub share: f64,
    /// On what it depends.
    pub depends_on: Vec<Factor>,
}

/// Torque balance of a robot with a fixed base: `torque_balance` in `report.json`.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct TorqueBalance {
    /// Recordings without a cause that it was compared with, or pieces of one; 0 where the balance decided nothing.
    pub references: usize,
    /// Probability of a gap as large in a robot like its references.
    pub p_gap: Option<f64>,
    /// Effects that explain the recording as well as the best one by chance, best first.
    pub set: Vec<SetMember>,
    /// Torques from outside.
    pub events: Vec<qv_held::Event>,
    /// Friction and rotor of each joint: value, standard deviation, and what is stated.
    pub joints: Vec<qv_held::JointRow>,
    /// Torques over time: for the page, too much for `report.json`.
    #[serde(skip)]
    pub traces: Vec<qv_held::TorqueTrace>,
}

/// A hypothesis that explains the recording as well as the best one by chance.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SetMember {
    /// Name of the effect.
    pub effect: String,
    /// `all`, a joint or a link.
    pub scope: Vec<String>,
    /// Its size.
    pub parameters: Vec<ParameterEstimate>,
    /// What each test says of it.
    pub tests: qv_held::Judgement,
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
    pub ranking: Vec<RankedEffect>,
    /// Where to look when nothing is accused; no accusation.
    pub leads: Vec<Lead>,
    /// Several effects fitted at once, where nothing is accused of a robot that is held; no accusation.
    pub together: Option<Together>,
    /// How the causes were found, round by round.
    pub rounds: Vec<RoundSummary>,
    /// What the camera says, where images were compared.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub visual: Option<Sight>,
    /// Torque balance of a robot with a fixed base.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub torque_balance: Option<TorqueBalance>,
    /// What is left.
    pub unexplained: Remainder,
    /// What cannot be distinguished from this recording, and why.
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

impl Report {
    /// Whether it is decided by the torque balance of a fixed base: tests at an error rate, and no probabilities.
    pub fn is_balanced(&self) -> bool {
        self.torque_balance.as_ref().is_some_and(|balance| balance.p_gap.is_some())
    }
}

/// What is wrong with the camera: `visual` in `report.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sight {
    /// The outcome for this interface.
    pub verdict: Verdict,
    /// In a sentence.
    pub sentence: String,
    /// Photographs that were compared.
    pub photographs: usize,
    /// Their size \[px\].
    pub size: [usize; 2],
    /// How far they are apart.
    pub gap: VisualGap,
    /// See [`crate::decision::evidence::CameraEvidence::level`].
    pub level: [f64; 2],
    /// Accused, best first.
    pub causes: Vec<Cause>,
    /// All effects of a camera and `none`, likeliest first.
    pub ranking: Vec<RankedEffect>,
    /// Log evidence of each effect over that of none.
    pub evidence: Vec<(String, f64)>,
    /// What all photographs share, all effects free at once.
    pub shared: Vec<ParameterEstimate>,
    /// Scatter.
    pub noise: Noise,
    /// What cannot be reported.
    pub cannot_tell: Vec<String>,
}
