//! Recordings on disk become runs, with a bar for who waits.

use crate::RunArguments;
use crate::progress::{progress, remark, spinner};
use indicatif::ProgressBar;
use qv_open::Reading;
pub use qv_open::{
    bag_files, beyond_range, file_error, lost_from, lost_from_model, model_named, model_of, read_model, read_urdf,
    remarks_of, urdf_of, write_error,
};
use qv_recording::run::{Fault, FaultKind, GainSource};
use qv_recording::{RecordingError, Run};
use qv_sim::{Model, Terrain};
use std::path::Path;

/// Opens whatever `arguments.run` names.
///
/// # Errors
/// When there is no such file, or nothing usable in it.
pub fn open_run(arguments: &RunArguments) -> Result<Run, RecordingError> {
    let asked = arguments.reading.clone();
    let reading =
        Reading { pose_topic: asked.pose_topic, robot: asked.robot, namespace: asked.namespace, fix: asked.fix };
    let bar = progress(0, "reading");
    let seen = |done, total| {
        bar.set_length(total);
        bar.set_position(done);
    };
    let run = qv_open::open_run(&arguments.run, &reading, &seen);
    bar.finish_and_clear();
    run
}

/// Looks for a joint that is turned round or exchanged with another in all channels: a fault of `run`, or with `--fix` read without it.
pub fn check_joints(run: &mut Run, model: &Model, terrain: &Terrain, fix: bool) -> Result<(), RecordingError> {
    let options = qv_replay::ReplayOptions::default();
    // What cannot be replayed is said where it is replayed.
    let Ok(Some(found)) = qv_replay::mistaken_joints(run, model, terrain, &options) else { return Ok(()) };
    let (what, line) = (found.mistake.words(&run.joint_names), found.mistake.lines(&run.joint_names));
    let errors =
        format!("windows are {:.1} mrad off as recorded, {:.1} mrad so", 1e3 * found.before, 1e3 * found.after);
    if fix {
        found.mistake.undo(run);
        run.remarks.push(format!("{what} ({errors}); read so (--fix): {line}"));
        return Ok(());
    }
    let detail = format!("{what} ({errors}); run.toml: {line} (or --fix)");
    run.faults.push(Fault {
        kind: FaultKind::Convention,
        channel: "joint".into(),
        time: run.span()[0],
        count: 1,
        detail,
    });
    Ok(())
}

/// Finds gains that are stated as unknown (see [`qv_replay::find_gains`]), with a sign of life.
pub fn find_gains(
    runs: &mut [Run],
    model: &Model,
    terrain: &Terrain,
    parameters: &[(String, f64)],
) -> Result<(), RecordingError> {
    let is_unknown = |run: &Run| run.actuator.gains.contains(&GainSource::Unknown);
    let bar = runs.iter().any(is_unknown).then(|| spinner("finding the gains"));
    qv_replay::find_gains(runs, model, terrain, parameters)?;
    bar.iter().for_each(ProgressBar::finish_and_clear);
    Ok(())
}

/// The parameters of a `--params` file for a robot on some ground; none without one. What does not fit is remarked.
///
/// # Errors
/// See [`qv_open::calibration_of`].
pub fn parameters_of(
    path: Option<&Path>,
    model: &Model,
    terrain: &Terrain,
) -> Result<Vec<(String, f64)>, RecordingError> {
    let found = qv_open::calibration_of(path, model, terrain)?;
    found.notes.iter().for_each(|note| remark(note));
    Ok(found.parameters)
}
