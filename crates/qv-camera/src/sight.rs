//! What a look at the photographs leaves: evidence for the decision, pictures for the page, the camera as it should be.

use crate::footage::Rig;
use qv_gap::decision::evidence::CameraEvidence;

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

/// What was seen.
#[derive(Debug, Clone, PartialEq)]
pub struct Look {
    /// What is decided by.
    pub evidence: CameraEvidence,
    /// The camera with the causes; that which is stated when there are none.
    pub corrected: Rig,
    /// Pictures.
    pub pictures: Vec<Looks>,
}
