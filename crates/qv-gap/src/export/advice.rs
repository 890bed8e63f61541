//! What a robot's file cannot say, in words: which quantity, how much of it, and what to do with it elsewhere.

use super::corrected::{CorrectionTarget, Entry, ModelCorrections, short};

/// What to do with a parameter, by the last word of its name, or its full name where it belongs to the world.
const DEEDS: [(&str, &str); 72] = [
    ("armature", "add it as rotor inertia at the joint"),
    ("viscous_friction", "torque against the motion per speed at the joint"),
    ("coulomb_friction", "constant torque against the motion at the joint, which also holds it at rest"),
    ("strength", "multiply all that the motor law demands by it, feed-forward torque included"),
    ("kp_scale", "multiply the commanded position gain by it"),
    ("kd_scale", "multiply the commanded velocity gain by it"),
    ("torque_limit", "clip the motor's torque to it"),
    (
        "position_torque_limit",
        "clip position part plus feed-forward torque of the motor law to it, before the velocity part is added",
    ),
    ("speed_knee", "let the largest torque along the motion fall from this speed on"),
    ("speed_zero", "let the largest torque along the motion reach zero at this speed"),
    ("lag", "low-pass the motor's torque with this time constant (first order) before it is clipped"),
    ("command_latency", "hold commands back by this time before the motor law sees them"),
    (
        "backlash",
        "let the motor law see a motor angle that stays until the joint drags it along, at most half of this away from \
         the joint's",
    ),
    ("encoder_bias", "add it to the joint angle that the motor law and the log see"),
    ("encoder_latency", "report joint angle and speed late by this time"),
    ("torque_scale", "multiply the torque that is reported by it; the motion stays as it is"),
    ("external_torque", "apply it at the joint from external.start for external.duration"),
    (
        "stribeck_friction",
        "Coulomb friction at the joint beside the usual one, times exp(-(speed / stribeck_speed)^stribeck_exponent)",
    ),
    ("stribeck_speed", "speed in the exponential of stribeck_friction"),
    ("stribeck_exponent", "power in the exponential of stribeck_friction"),
    (
        "load_friction_motor",
        "Coulomb friction at the joint: |load_friction_motor times the motor's torque - load_friction_external times that from outside|",
    ),
    ("load_friction_external", "see load_friction_motor"),
    ("stribeck_load_friction_motor", "as load_friction_motor, times the exponential of stribeck_friction"),
    ("stribeck_load_friction_external", "see stribeck_load_friction_motor"),
    (
        "quadratic_load_friction_motor",
        "Coulomb friction at rest per squared motor torque, while a larger torque from outside drives the motor back",
    ),
    (
        "quadratic_load_friction_external",
        "Coulomb friction at rest per squared torque from outside, while the motor drives against it",
    ),
    ("quadratic_drag", "torque against the motion per squared speed at the joint"),
    ("constant_torque", "add it to the joint's torque at all times"),
    ("spring_stiffness", "spring at the joint that pulls it to within spring_slack of spring_rest"),
    ("spring_rest", "see spring_stiffness"),
    ("spring_slack", "see spring_stiffness"),
    ("strength_asymmetry", "add it times the size of what the motor law demands to the motor's torque"),
    (
        "series_compliance",
        "put a spring of this compliance between motor and joint: the motor law and the log see a motor angle that is ahead \
         of the joint's by this times the torque",
    ),
    (
        "strength_drift",
        "multiply all that the motor law demands by 1 plus this times the time since the run's start, 0 at least",
    ),
    ("mass_scale", "multiply mass and inertia of the link by it"),
    ("com_x", "shift the link's centre of mass by it along the link's axis"),
    ("com_y", "shift the link's centre of mass by it along the link's axis"),
    ("com_z", "shift the link's centre of mass by it along the link's axis"),
    ("inertia_scale", "multiply the link's rotational inertia by it"),
    (
        "length_scale",
        "multiply all distances from the link's own joint by it: of the joints and shapes on it, and of its centre of mass",
    ),
    ("payload_mass", "fix a point of this mass to the link, at its modelled centre of mass plus payload_x, y, z"),
    ("payload_x", "place of the payload from the link's modelled centre of mass"),
    ("payload_y", "place of the payload from the link's modelled centre of mass"),
    ("payload_z", "place of the payload from the link's modelled centre of mass"),
    ("payload_moment_x", "move the payload from its place by this over its mass"),
    ("payload_moment_y", "move the payload from its place by this over its mass"),
    ("payload_moment_z", "move the payload from its place by this over its mass"),
    ("friction_scale", "multiply the friction of the ground under this shape by it"),
    ("radius_offset", "make the shape's radius larger by it"),
    ("friction", "Coulomb friction of the ground of this material"),
    ("contact.friction", "Coulomb friction between feet and ground"),
    ("contact.time_constant", "time constant of the soft contact (first number of MuJoCo's solref)"),
    ("contact.damping_ratio", "damping ratio of the soft contact (second number of MuJoCo's solref)"),
    ("contact.restitution", "rebound speed over impact speed"),
    ("contact.friction_drop", "multiply the ground's friction by 1 - this (1 - exp(-slip / contact.friction_speed))"),
    ("contact.friction_speed", "see contact.friction_drop"),
    ("contact.yield_force", "let a foot sink in for good while it presses with more, by contact.sink_rate"),
    ("contact.sink_rate", "see contact.yield_force"),
    ("contact.torsional_friction", "torsional friction length"),
    ("contact.rolling_friction", "rolling friction length"),
    ("terrain.height", "raise the ground by it"),
    ("terrain.slope_x", "tilt the ground about the origin so that it rises along x"),
    ("terrain.slope_y", "tilt the ground about the origin so that it rises along y"),
    ("terrain.patch", "give this rectangle of the floor a friction of its own"),
    (
        "external",
        "apply the force at the base's centre of mass, world frame, and external torques at their joints, from start for \
         duration",
    ),
    ("sensor.imu.tilt_roll", "turn the IMU's frame by it about its x axis"),
    ("sensor.imu.tilt_pitch", "turn the IMU's frame by it about its y axis"),
    ("sensor.pose.delay", "report the base's pose late by this time"),
    ("sensor.foot_force.scale", "multiply reported foot forces by it"),
    (
        "supply.sag",
        "multiply all that motor laws demand by 1 - this times the mechanical power that they drew just before",
    ),
    ("run.start", "time of the run at which the simulation begins, from which strength_drift counts"),
    ("", "a parameter that this model does not have; nothing was done with it"),
];

/// What is said in one line: the parts of a rectangle or of a push mean nothing alone.
fn kind<'a>(entry: &Entry<'a>) -> &'a str {
    let whole = ["terrain.patch", "external"].into_iter().find(|whole| entry.field.starts_with(whole));
    whole.filter(|_| entry.part == CorrectionTarget::World).unwrap_or(entry.field)
}

fn deed(entry: &Entry) -> &'static str {
    if entry.field.starts_with("sensor.imu.") && entry.field.contains("_bias_") {
        return "add it to what this axis of the IMU reports";
    }
    let of = |field: &str| DEEDS.iter().find(|(name, _)| *name == field).map(|(_, deed)| *deed);
    let known = if entry.part == CorrectionTarget::Nothing { None } else { of(kind(entry)) };
    known.unwrap_or(DEEDS[DEEDS.len() - 1].1)
}

/// One line for each kind of correction that `said` does not claim: the quantity, its values, and what to do with it.
pub(super) fn advice(corrected: &ModelCorrections, said: impl Fn(&Entry) -> bool) -> Vec<String> {
    let left: Vec<&Entry> = corrected.entries.iter().filter(|e| !said(e)).collect();
    let mut kinds: Vec<&str> = Vec::new();
    for entry in &left {
        if !kinds.contains(&kind(entry)) {
            kinds.push(kind(entry));
        }
    }
    let line = |wanted: &str| {
        let alike: Vec<&Entry> = left.iter().copied().filter(|e| kind(e) == wanted).collect();
        format!("{wanted}: {}. {}.", values(corrected, &alike), capitalised(deed(alike[0])))
    };
    kinds.into_iter().map(line).collect()
}

/// `a, b 0.3 N m; c 0.2 N m`, joints and links of one value together; the bare value where it belongs to no part.
fn values(corrected: &ModelCorrections, alike: &[&Entry]) -> String {
    let mut groups: Vec<(String, Vec<&str>)> = Vec::new();
    for entry in alike {
        let value = with_unit(short(entry.correction.value), &entry.correction.unit);
        let name = name(corrected, entry);
        match groups.iter_mut().find(|(v, _)| *v == value) {
            Some((_, names)) => names.push(name),
            None => groups.push((value, vec![name])),
        }
    }
    let all_joints = alike.len() > 1 && alike.len() == corrected.model.joints.len();
    let one = |(value, names): &(String, Vec<&str>)| match names[..] {
        [""] => value.clone(),
        _ if all_joints && groups.len() == 1 => format!("all joints {value}"),
        _ => format!("{} {value}", names.join(", ")),
    };
    groups.iter().map(one).collect::<Vec<_>>().join("; ")
}

fn name<'a>(corrected: &ModelCorrections<'a>, entry: &Entry<'a>) -> &'a str {
    match entry.part {
        CorrectionTarget::Joint(j) => &corrected.model.joints[j].name,
        CorrectionTarget::Link(l) => &corrected.model.links[l].name,
        CorrectionTarget::Geom(g) => &corrected.model.geoms[g].name,
        CorrectionTarget::Material(name) => name,
        CorrectionTarget::World => entry.field.strip_prefix(kind(entry)).unwrap_or_default().trim_start_matches('.'),
        CorrectionTarget::Nothing => "",
    }
}

fn with_unit(value: f64, unit: &str) -> String {
    if unit == "1" || unit.is_empty() { value.to_string() } else { format!("{value} {unit}") }
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map(|first| first.to_uppercase().chain(letters).collect()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::Correction;
    use qv_sim::{Batch, Model, ModelOptions, SimOptions, Terrain};

    fn go2() -> Model {
        Model::from_urdf(&qv_go2::model::urdf(), &ModelOptions::default()).unwrap()
    }

    #[test]
    fn every_parameter_of_the_simulator_has_a_deed() {
        let model = go2();
        let batch = Batch::<f64>::new(&model, &Terrain::plane(), &SimOptions::default(), 1).unwrap();
        let all: Vec<Correction> = batch
            .catalogue()
            .iter()
            .map(|p| Correction { parameter: p.name.clone(), value: 1.0, nominal: 0.0, unit: p.unit.into() })
            .collect();
        let corrected = ModelCorrections::new(&model, &all);
        assert_eq!(corrected.entries.len(), all.len());
        for entry in &corrected.entries {
            assert!(entry.part != CorrectionTarget::Nothing, "{}", entry.correction.parameter);
            assert!(!deed(entry).contains("does not have"), "{}", entry.correction.parameter);
        }
        for (name, _) in &DEEDS[..DEEDS.len() - 1] {
            let used = corrected.entries.iter().any(|e| kind(e) == *name);
            assert!(used || *name == "friction", "{name} is no parameter (friction is one of terrains with materials)");
        }
    }

    #[test]
    fn joints_of_one_value_share_a_line() {
        let model = go2();
        let c = |joint: &str, value| Correction {
            parameter: format!("actuator.{joint}.lag"),
            value,
            nominal: 0.0,
            unit: "s".into(),
        };
        let all = [c("FL_hip_joint", 0.01), c("FR_hip_joint", 0.02), c("RL_hip_joint", 0.01)];
        let lines = advice(&ModelCorrections::new(&model, &all), |_| false);
        assert_eq!(lines.len(), 1);
        assert!(
            lines[0].starts_with("lag: FL_hip_joint, RL_hip_joint 0.01 s; FR_hip_joint 0.02 s. Low-pass"),
            "{lines:?}"
        );
        let every: Vec<Correction> = model.joint_names().iter().map(|j| c(j, 0.01)).collect();
        assert!(advice(&ModelCorrections::new(&model, &every), |_| false)[0].starts_with("lag: all joints 0.01 s."));
        assert!(advice(&ModelCorrections::new(&model, &every), |e| e.field == "lag").is_empty());
        let patch = |name: &str, value, unit: &str| Correction {
            parameter: format!("terrain.patch.{name}"),
            value,
            nominal: 0.0,
            unit: unit.into(),
        };
        let rectangle = [patch("x_min", 1.5, "m"), patch("x_max", 2.0, "m"), patch("friction", 0.2, "1")];
        assert_eq!(
            advice(&ModelCorrections::new(&model, &rectangle), |_| false),
            [
                "terrain.patch: x_min 1.5 m; x_max 2 m; friction 0.2. Give this rectangle of the floor a friction of its own."
            ]
        );
        let odd = [Correction { parameter: "joint.tail.lag".into(), value: 1.0, nominal: 0.0, unit: "1".into() }];
        assert_eq!(
            advice(&ModelCorrections::new(&model, &odd), |_| false),
            ["joint.tail.lag: 1. A parameter that this model does not have; nothing was done with it."]
        );
    }
}
