//! A diagnosis of opened recordings, and the files that it leaves: what the command line and Python share.

use crate::file_error;
use qv_core::statistics::median;
use qv_core::{JointSeries, Mismatch};
use qv_gap::decision::evidence::Evidence;
use qv_gap::inference::linearised::NullOptions;
use qv_gap::problem::library::{self, Effect};
use qv_gap::report::Report;
use qv_gap::{Diagnosis, GapError, Options, Progress, export};
use qv_recording::{RecordingError, Run};
use qv_rollout::RolloutError;
use qv_sim::names::unknown as unknown_name;
use qv_sim::{Model, Terrain};
use std::fs;
use std::path::Path;

/// How far off a mesh may be under a foot \[m\]: what flat ground in a mesh of good photographs has.
const GROUND_ERROR: f64 = 0.003;

/// What is to be diagnosed.
pub struct Request<'a> {
    /// Recordings of one robot, the first of which stands for all where it says more.
    pub runs: &'a [Run],
    /// Recordings of it without what is looked for.
    pub reference: Vec<Run>,
    /// The robot.
    pub model: &'a Model,
    /// The ground.
    pub terrain: &'a Terrain,
    /// Parameters that are known already, by name.
    pub given: Vec<(String, f64)>,
    /// See [`effects`].
    pub effects: Vec<Effect>,
    /// Effects that may not be accused.
    pub without: Vec<String>,
    /// See [`ground_error`] \[m\].
    pub ground_error: f64,
    /// Seed of the simulated recordings without an effect.
    pub seed: u64,
    /// So many of the most probable effects are left out in turn.
    pub leave_out: usize,
    /// Names the recordings on the page.
    pub title: String,
    /// What is said under the verdict of the page, a paragraph each.
    pub notes: Vec<String>,
    /// Program, arguments and inputs.
    pub provenance: Option<serde_json::Value>,
}

/// Diagnoses; `clock` gives seconds since some instant.
///
/// # Errors
/// As [`qv_gap::diagnose`].
pub fn diagnose(
    request: Request,
    clock: &(dyn Fn() -> f64 + Sync),
    progress: &(dyn Fn(&Progress) + Sync),
) -> Result<Diagnosis, RecordingError> {
    let Request { runs, model, terrain, leave_out, title, notes, provenance, .. } = request;
    let effort = NullOptions { seed: request.seed, ground_error: request.ground_error, ..Default::default() };
    let options = Options {
        library: request.effects,
        given: request.given,
        reference: request.reference,
        effort,
        without: request.without,
        clock: Some(clock),
        progress: Some(progress),
        ..Default::default()
    };
    let mut diagnosis = qv_gap::diagnose(runs, model, terrain, &options, leave_out).map_err(gap_error)?;
    let without = diagnosis.without.iter_mut().map(|(_, report, evidence)| (report, evidence));
    for (report, evidence) in without.chain([(&mut diagnosis.report, &mut diagnosis.evidence)]) {
        report.provenance.clone_from(&provenance);
        if let Some(data) = &mut evidence.report {
            (data.title, data.notes, data.provenance) = (title.clone(), notes.clone(), provenance.clone());
        }
    }
    Ok(diagnosis)
}

/// The effects that can be accused: those that are built in, and those of a file.
///
/// # Errors
/// The file cannot be read, or has an effect with the name of another one.
pub fn effects(own: Option<&Path>) -> Result<Vec<Effect>, RecordingError> {
    let mut all = library::built_in();
    let Some(path) = own else { return Ok(all) };
    let text = fs::read_to_string(path).map_err(|e| file_error(path, "a library of effects", &e.to_string()))?;
    let own = library::parse(&text, &path.display().to_string()).map_err(gap_error)?;
    if let Some(known) = own.iter().find(|own| all.iter().any(|e| e.name == own.name)) {
        let found = format!("`{}`, which is of the library", known.name);
        return Err(file_error(path, "effects with names of their own", &found));
    }
    all.extend(own);
    Ok(all)
}

/// Checks the names of effects that may not be accused; `others` are names beside those of `effects`.
///
/// # Errors
/// There is no such effect.
pub fn check_without(without: &[String], effects: &[Effect], others: &[&str]) -> Result<(), RecordingError> {
    let known = effects.iter().map(|e| e.name.as_str()).chain(others.iter().copied());
    let Some(name) = without.iter().find(|name| known.clone().all(|k| k != **name)) else { return Ok(()) };
    let (expected, found) = ("an effect of `qv effects`", unknown_name("effect", name, known));
    Err(Mismatch::new("--without", expected, found).into())
}

/// How far off the ground may be under a foot \[m\], standard deviation: as stated, else what a mesh of photographs has, 0 for a plane.
///
/// # Errors
/// It is none.
pub fn ground_error(stated: Option<f64>, terrain: &str) -> Result<f64, RecordingError> {
    let error = stated.unwrap_or(if terrain == "plane" { 0.0 } else { GROUND_ERROR });
    if (0.0..=0.05).contains(&error) {
        return Ok(error);
    }
    Err(Mismatch::new("--ground-error", "0 to 0.05 m", error).into())
}

/// An error of the diagnosis as one of what was opened.
pub fn gap_error(error: GapError) -> RecordingError {
    match error {
        GapError::Recording(error) => error,
        GapError::Library { file, expected, found } => RecordingError::File { file, expected, found },
        GapError::Run(error) => error.into(),
        GapError::Sim(error) => RolloutError::Sim(error).into(),
    }
}

/// What files for other programs need to know of the robot.
pub struct Robot {
    model: Model,
    urdf: Option<String>,
    kp: Vec<f64>,
    kd: Vec<f64>,
}

impl Robot {
    /// The robot of a recording, and the URDF that its model was read from.
    pub fn new(run: &Run, mut model: Model, urdf: Option<String>) -> Self {
        for joint in &mut model.joints {
            let Some(column) = run.joint_names.iter().position(|n| *n == joint.name) else { continue };
            let stated = &run.joint_parameters[column];
            joint.armature = stated.armature.unwrap_or(joint.armature);
            joint.viscous_friction = stated.viscous_friction.unwrap_or(joint.viscous_friction);
            joint.coulomb_friction = stated.coulomb_friction.unwrap_or(joint.coulomb_friction);
        }
        let kp = gains(run, &model, &run.commands.kp, run.actuator.kp);
        let kd = gains(run, &model, &run.commands.kd, run.actuator.kd);
        Self { model, urdf, kp, kd }
    }

    /// All files of a diagnosis by name, `evidence.json` among them; `sections` are HTML for the page.
    pub fn files(&self, report: &Report, evidence: &Evidence, sections: &[String]) -> Vec<(String, Vec<u8>)> {
        let said = evidence.report.as_ref().map(|data| (data.title.as_str(), &data.notes[..]));
        let ((title, notes), urdf) = (said.unwrap_or_default(), self.urdf.as_deref());
        let gains = export::Gains { kp: &self.kp, kd: &self.kd };
        let mut files = export::files(report, &self.model, urdf, title, notes, sections, gains);
        files.push(("evidence.json".into(), evidence.to_json()));
        files
    }
}

/// Gains in the order of the model's joints: the median of what was commanded, else what is stated, else none.
fn gains(run: &Run, model: &Model, series: &Option<JointSeries>, fixed: Option<f64>) -> Vec<f64> {
    let of = |name: &String| {
        let column = run.joint_names.iter().position(|n| n == name);
        let typical = series.as_ref().zip(column).map(|(s, c)| {
            let mut finite: Vec<f64> = s.column(c).filter(|x| x.is_finite()).collect();
            median(&mut finite)
        });
        typical.filter(|x| x.is_finite()).or(fixed).unwrap_or(0.0)
    };
    model.joint_names().iter().map(of).collect()
}
