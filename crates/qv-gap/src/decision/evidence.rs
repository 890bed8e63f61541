//! What a diagnosis measured: plain data, written beside `report.json` as `evidence.json`. All that is simulated is simulated before it.
//! [`decide`](super::decide) goes by it, and a report is rendered from it.

use crate::GapError;
use crate::checks::stationarity::Dependence;
pub use crate::findings::Level;
use crate::findings::{
    CanTell, Cause, Correction, Curve, Factor, FloorPoint, Gap, HeatMap, Lead, Noise, ParameterEstimate, RegionShare,
    Share, Stage, Timing, Together, Traces, VisualGap, Where, or_nan,
};
use crate::problem::columns::Extent;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The format's name in `evidence.json`.
pub const FORMAT: &str = "qv-evidence/2";
/// The format before, which lacks [`Evidence::report`]: it can be decided on, and not rendered.
const BEFORE: &str = "qv-evidence/1";

/// What an effect acts on, as far as decisions distinguish that.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ActsOn {
    /// Joints.
    Joints,
    /// Moving links.
    Links,
    /// Anything else.
    Other,
}

/// An effect that was looked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EffectFacts {
    /// Name.
    pub name: String,
    /// On what it acts.
    pub acts_on: ActsOn,
    /// Whether it could be accused; one that is withheld could not.
    pub is_known: bool,
    /// Interface that it belongs to.
    #[serde(default)]
    pub interface: String,
    /// What would distinguish it from the effects that look like it.
    #[serde(default)]
    pub experiment: String,
}

/// How a candidate does in windows that no fit has seen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeldOut {
    /// Closed share of the gap.
    pub closed: f64,
    /// How much lower the loss is, and the standard error of that over windows.
    pub fall: [f64; 2],
    /// The same of the logarithm of the loss.
    pub fall_of_logarithm: [f64; 2],
    /// The same of pieces of windows, where these reported the candidate.
    pub fall_of_pieces: Option<[f64; 2]>,
    /// What the law of those actuators leaves that it changes, in units of the null, before and after.
    pub actuator_residual: [f64; 2],
    /// Log of how much likelier it makes these windows, tolerated deviations integrated out over them; `None` for what is confined.
    pub log_evidence: Option<f64>,
    /// Relative fall of the loss in each window, of an event; empty for others.
    pub falls: Vec<f64>,
}

/// An effect at its best values, on something, perhaps for a while or somewhere.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// Name of the effect.
    pub effect: String,
    /// Names of what it acts on.
    pub scope: Vec<String>,
    /// Indices of these.
    pub members: Vec<usize>,
    /// What it is confined to.
    pub extent: Option<Extent>,
    /// Value of each axis.
    pub values: Vec<f64>,
    /// The same with names and intervals.
    pub parameters: Vec<ParameterEstimate>,
    /// Log evidence over that of nothing more, divided by the dispersion.
    #[serde(deserialize_with = "or_nan")]
    pub log_evidence: f64,
    /// Largest log evidence of the effect in recordings without one.
    pub by_chance: f64,
    /// Log evidence that the library states for it.
    pub least_evidence: Option<f64>,
    /// Deviation from absent, in tolerances; not finite for effects of which nothing is tolerated.
    #[serde(deserialize_with = "or_nan")]
    pub size: f64,
    /// Distance of the nearest value from the edge of its range, as a share of the range; of a limit, half the share of the edge.
    #[serde(deserialize_with = "or_nan")]
    pub from_edge: f64,
    /// Share of the excess over the null that it takes away.
    #[serde(deserialize_with = "or_nan")]
    pub share: f64,
    /// In windows that no fit has seen; `None` if it was not looked at there.
    pub held_out: Option<HeldOut>,
}

impl Candidate {
    /// Log evidence of the whole recording: of the windows of the fit, and of the others once these are known (the chain rule; MacKay,
    /// Information Theory, Inference and Learning Algorithms, 2003, chapter 28). Of what is confined, that of the windows of the fit.
    pub(crate) fn whole_evidence(&self) -> f64 {
        self.log_evidence + self.held_out.as_ref().and_then(|h| h.log_evidence).unwrap_or(0.0)
    }

    /// From and until, if it is confined to that \[s\].
    pub fn time(&self) -> Option<[f64; 2]> {
        match self.extent {
            Some(Extent::Time(time)) => Some(time),
            _ => None,
        }
    }
}

/// A round: one robot, as it is said to be so far, and what was found in it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// Level before the round's causes.
    pub level: Level,
    /// Loss beyond that of the null.
    pub excess: f64,
    /// Whether nothing was accused before.
    pub is_first: bool,
    /// All candidates, best first.
    pub candidates: Vec<Candidate>,
    /// Those that were accused when this was measured; what follows was measured of the robot with them.
    pub accused: Vec<usize>,
    /// What followed; `None` if nothing was accused.
    pub after: Option<After>,
}

/// The robot after a round's accusations.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct After {
    /// Level outside of the accused regions.
    pub level: Level,
    /// Mean loss in windows that no fit has seen, and what noise alone gives.
    pub held_out: [f64; 2],
}

/// What was accused in the end, with the sizes that it has in the corrected robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct IdentifiedCause {
    /// Round that it was accused in.
    pub round: usize,
    /// Which of its candidates.
    pub candidate: usize,
    /// Values in the corrected robot.
    pub values: Vec<f64>,
    /// The same with names and intervals.
    pub parameters: Vec<ParameterEstimate>,
    /// How it changes while it lasts, of an event.
    pub fading: Option<Dependence>,
    /// What the value depends on, of a steady effect of joints.
    pub depends_on: Vec<Dependence>,
}

/// An effect that the corrected robot asks for by one linear step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LinearCandidate {
    /// Name.
    pub effect: String,
    /// Indices of what it acts on.
    pub members: Vec<usize>,
    /// Log evidence over the level of the corrected robot.
    pub log_evidence: f64,
    /// Size in tolerances; see [`Candidate::size`].
    #[serde(deserialize_with = "or_nan")]
    pub size: f64,
}

/// All that is accused, in windows that no fit has seen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Closure {
    /// Mean loss before and after.
    pub loss: [f64; 2],
    /// What noise alone gives.
    pub floor: f64,
    /// Closed share of the gap, by what acts all the time.
    pub share: f64,
    /// The same, by events, too.
    pub share_with_events: f64,
    /// How much lower the loss is, and the standard error of that over windows.
    pub fall: [f64; 2],
    /// See [`HeldOut::actuator_residual`].
    pub actuator_residual: [f64; 2],
    /// See [`HeldOut::log_evidence`].
    pub log_evidence: f64,
}

/// What was measured of the robot with all that was accused.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CorrectedRobot {
    /// What was accused.
    pub accused: Vec<IdentifiedCause>,
    /// Other effects of the accused joints that are asked for, best first.
    pub same_joints: Vec<LinearCandidate>,
    /// Log evidence of every effect that is not accused, by one linear step.
    pub beside: BTreeMap<String, f64>,
    /// How far the gap shrinks.
    pub closed: Closure,
}

/// Simulator and recording beside each other, the robot as it is stated or corrected.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// How far apart they are, and how much nearer than as it is stated.
    pub gap: Gap,
    /// What the remaining error goes along with.
    pub depends_on: Vec<Factor>,
    /// Errors by joint and time.
    pub heat_map: HeatMap,
    /// The gap by place.
    pub floor_plan: Vec<FloorPoint>,
    /// Examples.
    pub curves: Vec<Curve>,
    /// Parameters that are corrected, those of a reference among them.
    pub corrections: Vec<Correction>,
}

/// What a report says of one that was accused, in the order of [`CorrectedRobot::accused`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CauseData {
    /// The cause; its probability is decided later.
    pub cause: Cause,
    /// Share of the gap in a slippery region.
    pub region: Option<RegionShare>,
    /// Edges of that beyond which no foot stood.
    pub untested: Vec<String>,
}

/// What a report shows beyond what decides.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReportData {
    /// Names the recordings, where the caller does.
    pub title: String,
    /// What is said under the verdict of the page, a paragraph each.
    pub notes: Vec<String>,
    /// Recordings that were diagnosed together.
    pub recordings: usize,
    /// Whether legs and IMU stand in for poses of the base.
    pub on_legs: bool,
    /// That the robot fell, if it did.
    pub fall: Option<String>,
    /// Joints whose positions are not known.
    pub dead: Vec<String>,
    /// See `Report::cannot_tell`.
    pub cannot_tell: Vec<String>,
    /// See `Report::cannot_show`.
    pub cannot_show: Vec<String>,
    /// See `Report::can_tell`.
    pub can_tell: Vec<CanTell>,
    /// Where the gap of the stated robot lies, but for interfaces; regions are cells of the floor.
    pub place: Where,
    /// What speaks for each interface.
    pub interfaces: Vec<Share>,
    /// What the gap looks most like, should nothing be accused,
    pub leads: Vec<Lead>,
    /// and what several effects at once would close of it, where the policy of the diagnosis accuses nothing of a robot that is held.
    pub together: Option<Together>,
    /// The robot as it is stated.
    pub stated: Comparison,
    /// The robot with all that was accused.
    pub corrected: Option<Comparison>,
    /// What was accused.
    pub causes: Vec<CauseData>,
    /// Every joint at the recorded rate; `after` is with all that was accused.
    pub traces: Traces,
    /// Friction and rotor of each joint, of a robot with a fixed base.
    #[serde(default)]
    pub joint_rows: Vec<qv_held::JointRow>,
    /// Torques over time of a robot that is decided by its torque balance, with what is named.
    #[serde(default)]
    pub torque_traces: Vec<qv_held::TorqueTrace>,
    /// What was done.
    pub stages: Vec<Stage>,
    /// How long it took; it is not stored, since it differs from run to run.
    #[serde(skip)]
    pub timing: Timing,
    /// Program, arguments and inputs, where the caller says them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub provenance: Option<serde_json::Value>,
}

/// What images of the robot's camera show against a scene of Gaussians.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraEvidence {
    /// Photographs that were compared.
    pub photographs: usize,
    /// Their size \[px\].
    pub size: [usize; 2],
    /// How far photographs and scene are apart.
    pub gap: VisualGap,
    /// Mean square of what photographs are off by, in units of their scatter and of tolerances together: without a cause, and with.
    #[serde(deserialize_with = "or_nan")]
    pub level: [f64; 2],
    /// What was accused, best first; probabilities are decided later.
    pub causes: Vec<Cause>,
    /// Log evidence of each effect over that of none, best first.
    pub evidence: Vec<(String, f64)>,
    /// What all photographs share, all effects free at once.
    pub shared: Vec<ParameterEstimate>,
    /// Scatter.
    pub noise: Noise,
    /// Whether the scene is of another place, or lies off the frame of the poses.
    pub is_scene_off: bool,
    /// What cannot be reported.
    pub cannot_tell: Vec<String>,
}

/// All of a diagnosis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// [`FORMAT`].
    pub format: String,
    /// Whether the base is free.
    pub is_free: bool,
    /// Names of the joints.
    pub joints: Vec<String>,
    /// Effects that were looked for.
    pub effects: Vec<EffectFacts>,
    /// Level before anything is accused.
    pub level: Level,
    /// Mean loss in windows that no fit has seen, and what noise alone gives.
    pub held_out: [f64; 2],
    /// What was found, round by round.
    pub rounds: Vec<Round>,
    /// What was measured in the end; `None` if nothing was accused.
    pub corrected: Option<CorrectedRobot>,
    /// What a report shows beyond that; `None` in evidence of the format before.
    pub report: Option<ReportData>,
    /// What the camera shows, where images were compared.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraEvidence>,
    /// Torque balances beside those of references, by which alone it is decided then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub held: Option<qv_held::Evidence>,
}

/// What any format of evidence begins with.
#[derive(Deserialize)]
struct Head {
    format: String,
}

impl Evidence {
    /// Reads `evidence.json`, which `name` names in errors. The format before is read as far as it goes.
    ///
    /// # Errors
    /// It is something else, or of a format that this program does not know.
    pub fn read(text: &str, name: &str) -> Result<Self, GapError> {
        let wrong = |found: String| {
            let expected = format!("{FORMAT}, as `qv diagnose` writes it");
            GapError::Library { file: name.into(), expected, found }
        };
        let Head { format } = serde_json::from_str(text).map_err(|e| wrong(e.to_string()))?;
        match format.as_str() {
            FORMAT | BEFORE => {
                let evidence: Self = serde_json::from_str(text).map_err(|e| wrong(e.to_string()))?;
                match evidence.corrected.iter().flat_map(|c| &c.accused).find(|a| !has(&evidence.rounds, a)) {
                    Some(a) => {
                        Err(wrong(format!("candidate {} of round {}, which is not there", a.candidate, a.round)))
                    }
                    None => Ok(evidence),
                }
            }
            other => Err(wrong(format!("`{other}`: run `qv diagnose` again"))),
        }
    }

    /// `evidence.json`. Numbers that are not finite are null.
    pub fn to_json(&self) -> Vec<u8> {
        serde_json::to_vec(self).expect("plain data")
    }

    /// What is known of an effect.
    pub fn effect(&self, name: &str) -> Option<&EffectFacts> {
        self.effects.iter().find(|e| e.name == name)
    }

    /// What was accused, as it was found.
    pub fn accused(&self) -> impl Iterator<Item = (&IdentifiedCause, &Candidate)> {
        let all = self.corrected.iter().flat_map(|c| &c.accused);
        all.map(|a| (a, &self.rounds[a.round].candidates[a.candidate]))
    }
}

/// Whether rounds have what was accused in them.
fn has(rounds: &[Round], accused: &IdentifiedCause) -> bool {
    rounds.get(accused.round).is_some_and(|round| accused.candidate < round.candidates.len())
}
