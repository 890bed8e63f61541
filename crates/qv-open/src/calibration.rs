//! Files of parameters (`--params`): what a diagnosis, a calibration of contact or a tuning found, for the robot and the ground at hand.

use crate::error::file_error;
use qv_recording::RecordingError;
use qv_rollout::{RolloutError, expand, feet_of_model, name_parts, parameters_from_toml};
use qv_sim::{Batch, Model, ParameterInfo, SimOptions, Terrain};
use std::fs;
use std::path::Path;

/// What a file says of a robot on its ground.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Calibration {
    /// Names that the simulator has for this robot on this ground, and values.
    pub parameters: Vec<(String, f64)>,
    /// What was given another name, and what was left out and why, a line each.
    pub notes: Vec<String>,
}

/// Reads a file of parameters for a robot on some ground; nothing without one. A shape that this robot lacks but that is named after one of
/// its feet is that foot. What belongs to a joint, link, shape or material that is not there is left out and noted.
///
/// # Errors
/// Names the file, and: a parameter that no robot has; that nothing of the file fits; or the first value that means nothing.
pub fn calibration_of(path: Option<&Path>, model: &Model, terrain: &Terrain) -> Result<Calibration, RecordingError> {
    let Some(path) = path else { return Ok(Calibration::default()) };
    let text = fs::read_to_string(path).map_err(|e| file_error(path, "a parameter file", &e.to_string()))?;
    let given = parameters_from_toml(&text).map_err(|e| of_file(path, e))?;
    let probe = Batch::<f32>::new(model, terrain, &SimOptions::default(), 1).map_err(|e| of_file(path, e.into()))?;
    let mut found = Calibration::default();
    for (name, value) in &given {
        match named_here(name, probe.catalogue(), model) {
            ParameterTarget::Here(name) => {
                found.parameters.extend(expand(model, terrain, &[(name, *value)]).map_err(|e| of_file(path, e))?);
            }
            ParameterTarget::Otherwise(new) => {
                found.notes.push(format!("{}: `{name}` is `{new}` in this robot", path.display()));
                found.parameters.push((new, *value));
            }
            ParameterTarget::Absent(why) => {
                found.notes.push(format!("{}: `{name}` is left out: {why}", path.display()))
            }
            ParameterTarget::Unknown => return Err(of_file(path, unknown(name, probe.catalogue()))),
        }
    }
    if let (true, Some((name, _))) = (found.parameters.is_empty(), given.first()) {
        return Err(of_file(path, unknown(name, probe.catalogue())));
    }
    check(path, &found.parameters, probe.catalogue())?;
    if terrain.materials().iter().any(|_| found.parameters.iter().any(|p| p.0 == "contact.friction")) {
        let note = "`contact.friction` is that of ground without a material; materials of this ground keep theirs";
        found.notes.push(format!("{}: {note}", path.display()));
    }
    Ok(found)
}

/// What a name means for a robot on its ground.
enum ParameterTarget {
    /// A parameter, or a pattern of such.
    Here(String),
    /// A parameter of another name.
    Otherwise(String),
    /// A parameter of something that is not there.
    Absent(String),
    /// No parameter at all.
    Unknown,
}

fn named_here(name: &str, catalogue: &[ParameterInfo], model: &Model) -> ParameterTarget {
    if name.contains('*') || catalogue.iter().any(|p| p.name == name) {
        return ParameterTarget::Here(name.to_string());
    }
    let [kind, member, field] = name_parts(name)[..] else { return ParameterTarget::Unknown };
    // The ground may have no material: nothing shows then whether the field exists.
    let is_field = |p: &ParameterInfo| matches!(name_parts(&p.name)[..], [k, _, f] if k == kind && f == field);
    if !catalogue.iter().any(is_field) && (kind, field) != ("material", "friction") {
        return ParameterTarget::Unknown;
    }
    if kind == "geom" {
        let feet = feet_of_model(model);
        let is_of = |foot: &&String| {
            member.strip_prefix(foot.as_str()).is_some_and(|rest| rest.starts_with('_') || rest.is_empty())
        };
        if let Some(foot) = feet.names.iter().position(|foot| is_of(&foot)) {
            return ParameterTarget::Otherwise(format!("geom.{}.{field}", model.geoms[feet.geoms[foot]].name));
        }
    }
    let what = match kind {
        "material" => "this ground has no material",
        "link" => "this robot has no link",
        "geom" => "this robot has no shape",
        _ => "this robot has no joint",
    };
    ParameterTarget::Absent(format!("{what} `{member}`"))
}

fn unknown(name: &str, catalogue: &[ParameterInfo]) -> RolloutError {
    let found = qv_sim::names::unknown("parameter", name, catalogue.iter().map(|p| p.name.as_str()));
    qv_core::Mismatch::new("parameters", "parameters of this robot", found).into()
}

fn check(path: &Path, parameters: &[(String, f64)], catalogue: &[ParameterInfo]) -> Result<(), RecordingError> {
    for (name, value) in parameters {
        let Some(info) = catalogue.iter().find(|p| p.name == *name) else { continue };
        let least = info.clamped(f64::NEG_INFINITY);
        if value.is_nan() || *value < least {
            return Err(file_error(path, &format!("`{name}` of at least {least}"), &value.to_string()));
        }
    }
    Ok(())
}

/// The error of a file of parameters.
fn of_file(path: &Path, error: RolloutError) -> RecordingError {
    match error {
        RolloutError::Run(error) => file_error(path, &error.expected, &error.found),
        RolloutError::Recording(error) => error,
        RolloutError::Sim(error) => file_error(path, "parameters of this robot", &error.to_string()),
    }
}
