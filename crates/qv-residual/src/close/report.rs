//! What comes out of the loop.

use super::settings::LoopSettings;
use crate::compensation::Compensation;
use crate::paths::{Path, PathScore};
use qv_policy::policy::Policy;
use serde::{Deserialize, Serialize};

/// Joint errors of a candidate on held-out windows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeldOut {
    /// Mean size of joint errors \[rad\].
    pub error: f64,
    /// Its standard error over stretches.
    pub error_se: f64,
    /// Mean size of each joint's error \[rad\].
    pub joints: Vec<f64>,
    /// How much less than the candidate that it must beat, and the standard error of the difference over stretches \[rad\].
    pub gain: [f64; 2],
    /// Whether it stays.
    pub stays: bool,
}

/// A candidate and what became of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// The corrections.
    pub compensation: Compensation,
    /// On held-out recordings.
    pub held_out: HeldOut,
    /// Paths of the policy that was trained on under it, in the simulator that no training has seen.
    pub paths: Option<PathScore>,
}

/// What comes out.
pub struct Outcome {
    /// The policy: trained on, or as it was.
    pub policy: Policy,
    /// What was found.
    pub report: Report,
}

/// Paths of one kind of command, before and after, in the simulator that no training has seen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PathPair {
    /// Command: forwards, to the left \[m/s\], turning \[rad/s\].
    pub command: [f32; 3],
    /// x, y \[m\] and heading \[rad\] of the policy as it was, at each decision.
    pub before: Path,
    /// Of the policy trained on.
    pub after: Path,
    /// What the simulator as it was promised of the policy as it was.
    pub promised: Path,
}

/// What was found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Robot.
    pub robot: String,
    /// Seconds of recordings that were used.
    pub seconds: f64,
    /// What was left out of them.
    pub remarks: Vec<String>,
    /// Candidates in the order in which they were tried.
    pub candidates: Vec<Candidate>,
    /// Index of the candidate whose parameters are the robot's, estimated in rollouts at 1 ms or given; 0 = nothing was found.
    pub calibrated: usize,
    /// Index of the candidate whose policy was chosen; `None` = the policy is as it was.
    pub chosen: Option<usize>,
    /// Why.
    pub why: String,
    /// Paths of the policy as it was, in the simulator that no training has seen; walks that chose no policy, as those of `after` and `control`.
    pub before: PathScore,
    /// Paths of the policy that was chosen, there.
    pub after: PathScore,
    /// Paths of the policy trained on as long in the simulator as it was.
    pub control: Option<PathScore>,
    /// Some paths.
    pub paths: Vec<PathPair>,
    /// Settings in force.
    pub settings: LoopSettings,
}
