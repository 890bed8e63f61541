//! Parameters of the simulator: which a run states, which a file or a command line gives, and what each means to what is measured.

use crate::RolloutError;
use qv_recording::run::{Base, FaultKind, Run};
use qv_sim::{BaseKind, Batch, Model, SimOptions, Terrain};

/// Values of parameters that are not nominal: index in the catalogue, value; sorted by index.
pub type Overrides = Vec<(usize, f64)>;

/// Parameters from the text of a TOML file: numbers under their dotted names, below an optional table `parameters`.
///
/// # Errors
/// When the text is no TOML, or holds something that is no number.
pub fn parameters_from_toml(text: &str) -> Result<Vec<(String, f64)>, RolloutError> {
    let wrong = |found: String| RolloutError::run("parameters", "numbers under parameter names", found);
    let table: toml::Table = text.parse().map_err(|e: toml::de::Error| wrong(e.to_string()))?;
    let inner = table.get("parameters").and_then(toml::Value::as_table).unwrap_or(&table);
    let mut found = Vec::new();
    flatten(inner, "", &mut found).map_err(wrong)?;
    Ok(found)
}

fn flatten(table: &toml::Table, prefix: &str, found: &mut Vec<(String, f64)>) -> Result<(), String> {
    for (key, value) in table {
        let name = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
        match value {
            toml::Value::Float(x) => found.push((name, *x)),
            toml::Value::Integer(x) => found.push((name, *x as f64)),
            toml::Value::Table(inner) => flatten(inner, &name, found)?,
            other => return Err(format!("`{name}` is a {}", other.type_str())),
        }
    }
    Ok(())
}

/// Column of `run` for each joint of `model`, shape `[n]`, and whether the base is free.
///
/// # Errors
/// When the positions look like degrees, a joint of the model is not in the run, or only one of them has a free base.
pub fn joint_columns(run: &Run, model: &Model) -> Result<(Vec<usize>, bool), RolloutError> {
    if let Some(fault) = run.faults.iter().find(|f| f.kind == FaultKind::DegreesSuspected) {
        // A table can say so; a bag's messages are in radians by their definitions.
        let found = format!(
            "{}: {} (position_unit = \"deg\" in run.toml, where they are degrees; of a LeRobot dataset they may be \
             -100..100 of a calibration: scale and offset of [dataset.joint.NAME] are its own)",
            fault.channel, fault.detail
        );
        return Err(RolloutError::run("positions", "radians", found));
    }
    let mut columns = Vec::new();
    for name in model.joint_names() {
        let found = || {
            let known = run.joint_names.iter().map(String::as_str);
            let nearest = qv_sim::names::nearest(name, known).unwrap_or("none");
            format!("{} (nearest: {nearest})", run.joint_names.join(", "))
        };
        let column = run.joint_names.iter().position(|n| n == name);
        columns.push(column.ok_or_else(|| RolloutError::run("joints", format!("joint {name} of the model"), found()))?);
    }
    if columns.is_empty() {
        return Err(RolloutError::run("model", "at least one joint", "none"));
    }
    let free = model.base == BaseKind::Floating;
    if free != (run.base == Base::Free) {
        let word = |free: bool| if free { "free" } else { "fixed" };
        let expected = format!("a model with a {} base, as in the run", word(!free));
        return Err(RolloutError::run("base", expected, word(free)));
    }
    Ok((columns, free))
}

/// Gives the joints of a model the rotor inertias that the run states: the model is then that of the robot, and constraints are as soft as its
/// inertias make them.
pub fn with_stated_rotors(run: &Run, model: &mut Model) {
    for joint in &mut model.joints {
        let column = run.joint_names.iter().position(|name| *name == joint.name);
        let stated = column.and_then(|column| run.joint_parameters[column].armature);
        joint.armature = stated.unwrap_or(joint.armature);
    }
}

/// What the run states about its joints, as parameters of the simulator.
pub fn stated_parameters(run: &Run, model: &Model) -> Vec<(String, f64)> {
    let mut all = Vec::new();
    for name in model.joint_names() {
        let Some(column) = run.joint_names.iter().position(|n| n == name) else { continue };
        let stated = &run.joint_parameters[column];
        let mut push = |name: String, value: Option<f64>| all.extend(value.map(|v| (name, v)));
        push(format!("joint.{name}.armature"), stated.armature);
        push(format!("joint.{name}.coulomb_friction"), stated.coulomb_friction);
        push(format!("joint.{name}.viscous_friction"), stated.viscous_friction);
        push(format!("sensor.{name}.encoder_bias"), stated.position_offset);
        stated.servo.iter().for_each(|(key, value)| push(format!("joint.{name}.{key}"), Some(*value)));
        push(format!("actuator.{name}.position_torque_limit"), stated.tau_max.or(run.actuator.tau_max));
    }
    all
}

/// Parameters with each `*` in a name spelt out.
///
/// # Errors
/// When no parameter fits a name with `*`.
pub fn expand(model: &Model, terrain: &Terrain, given: &[(String, f64)]) -> Result<Vec<(String, f64)>, RolloutError> {
    let mut all = Vec::new();
    if given.iter().any(|(name, _)| name.contains('*')) {
        let probe = Batch::<f64>::new(model, terrain, &SimOptions::default(), 1)?;
        for (name, value) in given {
            let fits: Vec<String> =
                probe.catalogue().iter().map(|p| p.name.clone()).filter(|n| matches(name, n)).collect();
            if fits.is_empty() {
                // As names with a star are written: the member, between two dots, stands for all.
                let mut known: Vec<String> = probe.catalogue().iter().filter_map(|p| with_star(&p.name)).collect();
                known.dedup();
                let found = qv_sim::names::unknown("parameter", name, known.iter().map(String::as_str));
                return Err(RolloutError::run("parameters", "parameters of this robot", found));
            }
            all.extend(fits.into_iter().map(|n| (n, *value)));
        }
    } else {
        all.extend(given.iter().cloned());
    }
    Ok(all)
}

/// Kind, member and field of a name such as `joint.FL_calf_joint.armature`, or kind and field. Names of members may have dots.
pub fn name_parts(name: &str) -> Vec<&str> {
    let Some((kind, rest)) = name.split_once('.') else { return vec![name] };
    match rest.rsplit_once('.') {
        Some((member, field)) => vec![kind, member, field],
        None => vec![kind, rest],
    }
}

/// `joint.*.armature` for `joint.FL_calf_joint.armature`; none for a name without a member.
fn with_star(name: &str) -> Option<String> {
    match name_parts(name)[..] {
        [kind, _, field] => Some(format!("{kind}.*.{field}")),
        _ => None,
    }
}

/// Whether `name` is `pattern` with any text for its `*`, within one part of the name.
fn matches(pattern: &str, name: &str) -> bool {
    let (pattern, name) = (name_parts(pattern), name_parts(name));
    let fits = |pattern: &str, part: &str| match pattern.split_once('*') {
        None => pattern == part,
        Some((head, tail)) => part.strip_prefix(head).is_some_and(|rest| rest.ends_with(tail)),
    };
    pattern.len() == name.len() && pattern.iter().zip(&name).all(|(pattern, part)| fits(pattern, part))
}
