//! Replay and diagnosis. What they find goes to Python as the text of the JSON that the command line writes, so that both have
//! the same fields.

use crate::errors::{opening, value};
use crate::recording::{Recording, table};
use crate::waiting::wait;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use qv_gap::Progress;
use qv_open::diagnosis::{self, Request, Robot};
use qv_open::{ground, model_of, remarks_of, urdf_of};
use qv_replay::{ReplayOptions, find_gains, to_html, to_json, verdict};

use qv_recording::{RecordingError, Run};
use qv_rollout::{Trace, expand};
use qv_sim::{Model, Terrain};
use std::path::PathBuf;
use std::time::Instant;

/// Parameters by name.
type Parameters = Vec<(String, f64)>;

/// The robot of a recording and its ground.
fn place(recording: &Recording, terrain: &str) -> Result<(Model, Terrain), RecordingError> {
    let model = model_of(&recording.run, &recording.path, recording.robot.as_deref())?;
    Ok((model, ground::terrain_of(terrain)?))
}

fn trace<'py>(py: Python<'py>, trace: &Trace) -> PyResult<Bound<'py, PyDict>> {
    let (columns, rows) = (PyDict::new(py), trace.time.len());
    columns.set_item("time", PyArray1::from_slice(py, &trace.time))?;
    let channels = [("position", &trace.position), ("velocity", &trace.velocity), ("torque", &trace.torque)];
    for (name, values) in channels.into_iter().chain([("foot_force", &trace.foot_force)]) {
        if !values.is_empty() {
            columns.set_item(name, table(py, values, rows)?)?;
        }
    }
    if !trace.base.is_empty() {
        let rows: Vec<Vec<f64>> = trace.base.iter().map(|pose| pose.to_vec()).collect();
        columns.set_item("base", PyArray2::from_vec2(py, &rows).map_err(value)?)?;
    }
    Ok(columns)
}

/// The recording's commands in the simulator: `{"report": JSON, "verdict", "html", "recorded", "simulated"}`.
#[pyfunction]
pub fn replay<'py>(
    py: Python<'py>,
    recording: &Recording,
    terrain: &str,
    parameters: Parameters,
    window: f64,
) -> PyResult<Bound<'py, PyDict>> {
    if !(0.01..=1000.0).contains(&window) {
        return Err(value(format!("window: expected 0.01 to 1000 s, found {window}")));
    }
    let (replay, factor) = py
        .detach(|| {
            let (model, terrain) = place(recording, terrain)?;
            ground::check_ground(&recording.run, &terrain)?;
            let parameters = expand(&model, &terrain, &parameters)?;
            let mut run = recording.run.clone();
            find_gains(std::slice::from_mut(&mut run), &model, &terrain, &parameters)?;
            let clock = Instant::now();
            let options = ReplayOptions { window, parameters, ..Default::default() };
            let replay = qv_replay::replay(&run, &model, &terrain, &options)?;
            let factor = replay.simulated / clock.elapsed().as_secs_f64();
            Ok((replay, factor))
        })
        .map_err(opening)?;
    let found = PyDict::new(py);
    found.set_item("report", to_json(&replay, factor).to_string())?;
    found.set_item("verdict", verdict(&replay))?;
    found.set_item("html", to_html(&replay, &recording.path.display().to_string(), &[]))?;
    found.set_item("joint_names", replay.joint_names.clone())?;
    found.set_item("recorded", trace(py, &replay.recorded)?)?;
    found.set_item("simulated", trace(py, &replay.whole)?)?;
    Ok(found)
}

/// The diagnosis of recordings of one robot: the names and bytes of its files, `report.json` among them. `progress` is called with each stage that
/// begins: its number, how many there are, its name, the share of all that is done.
#[pyfunction]
pub fn diagnose<'py>(
    py: Python<'py>,
    recordings: Vec<Py<Recording>>,
    reference: Vec<Py<Recording>>,
    terrain: &str,
    parameters: Parameters,
    without: Vec<String>,
    library_file: Option<PathBuf>,
    seed: u64,
    ground_error: f64,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let (recordings, reference): (Vec<&Recording>, Vec<&Recording>) =
        (recordings.iter().map(Py::get).collect(), reference.iter().map(Py::get).collect());
    let Some(first) = recordings.first() else {
        return Err(value("recordings: expected at least one, found none"));
    };
    let ground_error = diagnosis::ground_error(Some(ground_error), terrain).map_err(opening)?;
    let effects = diagnosis::effects(library_file.as_deref()).map_err(opening)?;
    diagnosis::check_without(&without, &effects, &[]).map_err(opening)?;
    let (model, terrain) = py.detach(|| place(first, terrain)).map_err(opening)?;
    let title: Vec<String> = recordings.iter().map(|r| r.path.display().to_string()).collect();
    let urdf = urdf_of(&first.run, &first.path, first.robot.as_deref());
    let count = recordings.len();
    let mut runs: Vec<Run> = recordings.iter().chain(&reference).map(|r| r.run.clone()).collect();
    let files = wait(py, progress.as_ref(), move |reporter| {
        runs[..count].iter().try_for_each(|run| ground::check_ground(run, &terrain).map(drop)).map_err(opening)?;
        let given = expand(&model, &terrain, &parameters).map_err(|e| opening(e.into()))?;
        find_gains(&mut runs, &model, &terrain, &given).map_err(|e| opening(e.into()))?;
        let reference = runs.split_off(count);
        let notes = remarks_of(&runs[0], &model);
        let clock = Instant::now();
        let seconds = || clock.elapsed().as_secs_f64();
        let remarks = |at: &Progress| reporter.begin((at.stage, at.stages, at.name.into(), at.done));
        let request = Request {
            runs: &runs,
            reference,
            model: &model,
            terrain: &terrain,
            given,
            effects,
            without,
            ground_error,
            seed,
            leave_out: 0,
            title: title.join(", "),
            notes,
            provenance: None,
        };
        let found = diagnosis::diagnose(request, &seconds, &remarks).map_err(opening)?;
        Ok(Robot::new(&runs[0], model.clone(), urdf).files(&found.report, &found.evidence, &[]))
    })?;
    let by_name = PyDict::new(py);
    for (name, bytes) in files {
        by_name.set_item(name, PyBytes::new(py, &bytes))?;
    }
    Ok(by_name)
}
