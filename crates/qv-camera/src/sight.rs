//! What was seen, as plain data: `visual` in `report.json`.

use crate::Rig;
use qv_gap::report::{Cause, ParameterEstimate, Ranked, Verdict};
use serde::Serialize;

/// Scatter from photograph to photograph about what all share.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Noise {
    /// Of the rotation \[rad\].
    pub rotation: f64,
    /// Of the translation \[m\].
    pub translation: f64,
    /// Of the logarithm of the gain.
    pub gain: f64,
    /// Of the logarithm of the focal length.
    pub focal: f64,
}

/// How far photographs and scene are apart: root mean square difference of displayed brightness, differences above 0.2 limited.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct VisualGap {
    /// As the camera is stated.
    pub before: f64,
    /// With the causes, fitted to other photographs.
    pub after: f64,
    /// Each photograph moved to where it agrees best.
    pub floor: f64,
    /// Share of the squares above the floor that the causes take away, 0 to 1.
    pub closed: f64,
    /// Its interval by bootstrap over photographs.
    pub closed_ci95: [f64; 2],
    /// Unit of before, after, floor.
    pub unit: String,
    /// Whether no fit has seen the photographs that it is judged in.
    pub heldout: bool,
}

/// A photograph beside what the scene shows, shape `[height, width, 3]` each.
#[derive(Debug, Clone, PartialEq)]
pub struct Looks {
    /// Stamp \[s\].
    pub time: f64,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The photograph.
    pub photograph: Vec<u8>,
    /// The scene at the measured pose.
    pub measured: Vec<u8>,
    /// The scene with the causes.
    pub corrected: Vec<u8>,
    /// Photograph minus scene as measured, grey where they agree.
    pub difference_before: Vec<u8>,
    /// Photograph minus scene with the causes.
    pub difference_after: Vec<u8>,
}

/// What is wrong with the camera.
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
    /// Mean square of what photographs are off by, in units of their scatter and of tolerances together: without a cause, and with.
    pub level: [f64; 2],
    /// Accused, best first.
    pub causes: Vec<Cause>,
    /// All effects of a camera and `none`, likeliest first.
    pub ranking: Vec<Ranked>,
    /// Log evidence of each effect over that of none.
    pub evidence: Vec<(String, f64)>,
    /// What all photographs share, all effects free at once.
    pub shared: Vec<ParameterEstimate>,
    /// Scatter.
    pub noise: Noise,
    /// What cannot be told.
    pub cannot_tell: Vec<String>,
    /// The camera with the causes; that which is stated when there are none.
    #[serde(skip)]
    pub corrected: Option<Rig>,
    /// Pictures.
    #[serde(skip)]
    pub looks: Vec<Looks>,
}
