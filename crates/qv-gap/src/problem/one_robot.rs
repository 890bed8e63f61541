//! Whether several recordings are of one robot.

use crate::GapError;
use qv_recording::Run;

/// Looks whether all runs are of one robot: columns are given by their place.
///
/// # Errors
/// Names the first run that has other joints, or another base.
pub(crate) fn check<'r>(first: &Run, runs: impl Iterator<Item = &'r Run>) -> Result<(), GapError> {
    let remarks = |run: &Run| format!("{:?} base, joints {}", run.base, run.joint_names.join(", "));
    for (k, run) in runs.enumerate() {
        if (run.base, &run.joint_names) != (first.base, &first.joint_names) {
            let what = format!("recording {} of those given, references last", k + 1);
            return Err(GapError::run(what, format!("the robot of the first ({})", remarks(first)), remarks(run)));
        }
    }
    Ok(())
}
