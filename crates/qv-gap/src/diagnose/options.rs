//! What a diagnosis is asked, and what it gives back.

use super::progress::Progress;
use crate::decision::Policy;
use crate::decision::evidence::Evidence;
use crate::inference::linearised::NullOptions;
use crate::problem::library::{self, Effect};
use crate::report::Report;
use qv_recording::Run;
use qv_rollout::WindowOptions;

/// How to diagnose.
pub struct Options<'a> {
    /// Effects that may be accused.
    pub library: Vec<Effect>,
    /// Parameters that are known already, by name; `*` stands for all that fit.
    pub given: Vec<(String, f64)>,
    /// Recordings of the same robot without what is looked for; may be none.
    pub reference: Vec<Run>,
    /// How windows are cut.
    pub cut: WindowOptions,
    /// How much is done.
    pub effort: NullOptions,
    /// What decides.
    pub policy: Policy,
    /// Effects of the library that may not be accused.
    pub without: Vec<String>,
    /// Seconds since some instant, for the report; libraries read no clock.
    pub clock: Option<&'a (dyn Fn() -> f64 + Sync)>,
    /// Reported of each stage as it begins.
    pub progress: Option<&'a (dyn Fn(&Progress) + Sync)>,
}

impl Default for Options<'_> {
    fn default() -> Self {
        Self {
            library: library::built_in(),
            given: Vec::new(),
            reference: Vec::new(),
            cut: WindowOptions::default(),
            effort: NullOptions::default(),
            policy: Policy::default(),
            without: Vec::new(),
            clock: None,
            progress: None,
        }
    }
}

/// A diagnosis, and what it would have been had the library lacked one of the effects it ranks first.
pub struct Diagnosis {
    /// The diagnosis.
    pub report: Report,
    /// What it was decided by.
    pub evidence: Evidence,
    /// Effect left out, and the diagnosis without it.
    pub without: Vec<(String, Report, Evidence)>,
}

/// Recordings as they are judged.
pub(super) struct PreparedRuns {
    pub usable: Vec<Run>,
    /// The reference recordings, likewise.
    pub reference: Vec<Run>,
    /// What was broken in them, and what was done about it.
    pub cannot_tell: Vec<String>,
    /// Those of a robot that fell.
    pub fallen: Vec<String>,
}
