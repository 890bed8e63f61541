//! What is broken in recordings, and what of them is used.

use qv_recording::Run;
use qv_recording::run::FaultKind;
use qv_rollout::channels::snippet;
use qv_rollout::features::rotation_at;

/// A trunk tilted by more than this lies on the ground \[rad\].
const FALLEN: f64 = 1.0;
/// Samples on end whose lack is reported.
const MANY: usize = 50;

/// What is broken in the recordings; `mended` are the same without what stood still for a part of the time.
pub fn faults(runs: &[Run], mended: &[Run]) -> Vec<String> {
    let lost = runs.iter().flat_map(|r| &r.lost).map(|loss| format!("lost of {}: {}", loss.file, loss.what));
    let mut remarks: Vec<String> = lost.collect();
    let both = runs.iter().zip(mended).flat_map(|(run, mended)| run.faults.iter().map(move |fault| (fault, mended)));
    for (fault, mended) in both {
        let line = match fault.kind {
            FaultKind::Frozen if !mended.faults.contains(fault) => {
                format!("{} {}: what was recorded then is left out", fault.channel, fault.detail)
            }
            FaultKind::Frozen => {
                format!("{} stood still: nothing is identified on it ({})", fault.channel, fault.detail)
            }
            // What is left out costs no windows.
            FaultKind::Gap
                if mended.faults.iter().any(|f| f.kind == FaultKind::Convention && f.channel == fault.channel) =>
            {
                continue;
            }
            FaultKind::Gap if fault.count > MANY => {
                format!("{}: {}; windows there are left out", fault.channel, fault.detail)
            }
            // What stands as it was logged until it is asked for.
            FaultKind::Convention if stays(&fault.channel) => format!("{}: {}", fault.channel, fault.detail),
            FaultKind::Convention if mended.faults.contains(fault) => {
                format!("{}: {}; it is left out", fault.channel, fault.detail)
            }
            FaultKind::Convention => format!("{}: {}", fault.channel, fault.detail),
            FaultKind::Missing => format!("{} was not recorded", fault.channel),
            kind if kind.is_partial() => {
                format!("{kind} in {} at {:.2} s: {}", fault.channel, fault.time, fault.detail)
            }
            _ => continue,
        };
        if !remarks.contains(&line) {
            remarks.push(line);
        }
    }
    remarks
}

/// Whether a channel of another convention is used as it was logged: those of the commands and of whole joints are.
fn stays(channel: &str) -> bool {
    ["commands", "joint", "torques"].iter().any(|kind| channel.split(' ').next() == Some(kind))
}

/// The runs up to a fall, and what is said about falls.
pub fn upright(runs: &[Run]) -> (Vec<Run>, Vec<String>) {
    let mut remarks = Vec::new();
    let cut = |run: &Run| match fall(run) {
        Some(time) => {
            remarks.push(format!("the robot fell at {time:.1} s: what comes after is left out"));
            let whole = snippet(run, run.span()[0], time - 0.3);
            Run { faults: run.faults.clone(), robot: run.robot.clone(), ..whole }
        }
        None => run.clone(),
    };
    (runs.iter().map(cut).collect(), remarks)
}

fn fall(run: &Run) -> Option<f64> {
    let (series, first) = match (&run.measured.orientation, &run.measured.base_pose) {
        (Some(imu), _) => (imu, 0),
        (None, Some(pose)) => (pose, 3),
        _ => return None,
    };
    let tilted = |i: &usize| {
        let rotation = rotation_at(series, first, series.time[*i]);
        rotation.is_some_and(|q| (q * glam::DVec3::Z).z < FALLEN.cos())
    };
    (0..series.len()).step_by(5).find(tilted).map(|i| series.time[i])
}

/// Positions of joints that stood still all the time: `position NAME`.
pub(crate) fn dead_positions(runs: &[Run]) -> Vec<&str> {
    let faults = runs.iter().flat_map(|run| &run.faults);
    let mut names: Vec<&str> = faults
        .filter(|f| f.kind == FaultKind::Frozen && f.channel.starts_with("position "))
        .map(|f| f.channel.as_str())
        .collect();
    names.dedup();
    names
}
