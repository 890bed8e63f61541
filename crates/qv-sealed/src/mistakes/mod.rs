//! Recordings of three robots whose command channel is right, or holds one of twelve mistakes that people make: for judging what is reported
//! of conventions.

mod makes;
mod robots;

pub use makes::{MISTAKES, Mistake, MistakenRun, SIZES, plant};
pub use robots::{Firmware, Motors, ROBOTS, RobotKind, record};

use qv_recording::Run;
use qv_recording::faults::examine;
use qv_recording::run::FaultKind;

/// What is reported of a run's conventions, first to last: channel and detail.
pub fn reported(run: &mut Run) -> Vec<(String, String)> {
    run.faults.clear();
    examine(run, None);
    let all = run.faults.iter().filter(|f| f.kind == FaultKind::Convention);
    all.map(|f| (f.channel.clone(), f.detail.clone())).collect()
}
