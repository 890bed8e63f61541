//! The effects that a diagnosis knows: data, read from TOML. No effect has code of its own.

use crate::GapError;
use serde::Deserialize;
use std::collections::BTreeMap;

const BUILT_IN: &str = include_str!("effects.toml");

/// Parameters, by the beginning of their names, that mean something for a free base only.
pub(crate) const OF_BASE: [&str; 4] = ["external.", "sensor.imu", "sensor.pose", "sensor.foot"];
/// Those of what a robot touches.
pub(crate) const OF_GROUND: [&str; 4] = ["contact.", "terrain.", "geom.", "material."];

/// A part of the simulator that a gap can lie in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Interface {
    /// Motors and transmissions.
    Actuator,
    /// Feet, ground and whatever else touches the robot.
    Contact,
    /// Masses and inertias.
    Inertial,
    /// What sensors report.
    Sensing,
}

impl Interface {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Actuator, Self::Contact, Self::Inertial, Self::Sensing];

    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Actuator => "actuator",
            Self::Contact => "contact",
            Self::Inertial => "inertial",
            Self::Sensing => "sensing",
        }
    }
}

/// What an effect acts on: it has one member for each of these.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Scope {
    /// Every joint.
    Joints,
    /// Every moving link.
    Links,
    /// The floating base; every moving link of a robot that is held.
    Base,
    /// Every foot.
    Feet,
    /// Every material of the ground, or the ground as a whole when it has none.
    Ground,
    /// One for all.
    World,
}

/// The measured quantity that levels are shares of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LevelsOf {
    /// Largest torque of the joint \[N m\].
    Torque,
    /// Largest speed of the joint \[rad/s\].
    Speed,
    /// What the robot weighs \[N\].
    Weight,
}

/// A direction of an effect.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axis {
    /// Name in reports.
    pub name: String,
    /// Unit of its parameter where that is not the effect's: values are searched in the effect's unit, and reported as those of the parameter.
    pub unit: Option<String>,
    /// Parameters that it moves, with the factor from the axis' value to each.
    pub moves: BTreeMap<String, f64>,
}

/// An effect: a name, a prior, and the parameters that it moves.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Effect {
    /// Name in reports.
    pub name: String,
    /// What it is, in a few words.
    #[serde(default)]
    pub about: String,
    /// Where it belongs.
    pub interface: Interface,
    /// What it acts on.
    pub scope: Scope,
    /// Whether it acts with speed alone: nothing shows it at joints that are at rest.
    #[serde(default)]
    pub needs_motion: bool,
    /// Unit of its values.
    pub unit: String,
    /// Whether values are those of the parameters; else deviations from nominal.
    #[serde(default)]
    pub absolute: bool,
    /// Values worth searching.
    pub range: [f64; 2],
    /// The same for a robot that is held: its motors may be of any make, and nothing but they hides an effect.
    pub held_range: Option<[f64; 2]>,
    /// Spread of the deviations that any robot has.
    pub tolerance: f64,
    /// Values at which the simulator is asked.
    pub levels: Vec<f64>,
    /// What levels are shares of.
    pub levels_of: Option<LevelsOf>,
    /// Log evidence that it needs as a first cause if it acts steadily, where it is known that other engines do not reach that without
    /// it; it need not take a share of the excess then.
    pub least_evidence: Option<f64>,
    /// Added to its log evidence \[nats\]: below 0 for causes that are rarer than others.
    #[serde(default)]
    pub log_prior: f64,
    /// Whether it is looked for in robots that are held alone.
    #[serde(default)]
    pub held_only: bool,
    /// Whether it may act for a part of the time only.
    #[serde(default)]
    pub local: bool,
    /// Share of a value by which other engines put it off (one standard deviation); part of its interval.
    #[serde(default = "engine_error")]
    pub engine_error: f64,
    /// What would distinguish it from its likes.
    #[serde(default)]
    pub experiment: String,
    /// Directions that belong together.
    #[serde(rename = "axis")]
    pub axes: Vec<Axis>,
    /// Length of `range` in the sizes of the robot at hand, whatever its `held_range`: what is usual lies within a share of it. Set once a
    /// robot is known.
    #[serde(skip)]
    pub usual_span: f64,
    /// Of a gain that nobody states: it is fitted, and no cause. Set once a robot is known.
    #[serde(skip)]
    pub nuisance: bool,
    /// File that it was read from, for errors.
    #[serde(skip)]
    pub file: String,
}

impl Effect {
    /// Whether a robot whose base is held in the air can show it: what only moves a free base or what feet touch has no meaning there.
    pub fn shows_on_held(&self) -> bool {
        let mut moved = self.axes.iter().flat_map(|axis| axis.moves.keys());
        let touches = matches!(self.scope, Scope::Ground | Scope::Feet);
        !touches && !moved.any(|name| OF_BASE.iter().chain(&OF_GROUND).any(|prefix| name.starts_with(prefix)))
    }

    /// Length of the range.
    pub fn span(&self) -> f64 {
        self.range[1] - self.range[0]
    }
}

/// That of most effects.
fn engine_error() -> f64 {
    qv_rollout::ENGINE_ERROR
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    effect: Vec<Effect>,
}

/// The effects that come with the program.
///
/// # Panics
/// Never: a test reads them.
pub fn built_in() -> Vec<Effect> {
    parse(BUILT_IN, "effects.toml").expect("tested")
}

/// Reads effects from the text of a TOML file; `name` is reported in errors.
///
/// # Errors
/// When the text is not of this form, or an effect cannot be used.
pub fn parse(text: &str, name: &str) -> Result<Vec<Effect>, GapError> {
    let wrong = |found: String| GapError::Library { file: name.into(), expected: "[[effect]] tables".into(), found };
    let mut file: File = toml::from_str(text).map_err(|e| wrong(e.to_string()))?;
    file.effect.iter_mut().for_each(|effect| effect.file = name.into());
    for (index, effect) in file.effect.iter().enumerate() {
        check(effect, name)?;
        if file.effect[..index].iter().any(|other| other.name == effect.name) {
            return Err(wrong(format!("two of the name `{}`", effect.name)));
        }
    }
    Ok(file.effect)
}

fn check(effect: &Effect, file: &str) -> Result<(), GapError> {
    let wrong = |expected: &str, found: String| {
        let expected = format!("{expected} in effect `{}`", effect.name);
        Err(GapError::Library { file: file.into(), expected, found })
    };
    if effect.name.is_empty() || effect.name == "unknown" {
        return wrong("a name other than `unknown`", format!("`{}`", effect.name));
    }
    for range in [Some(effect.range), effect.held_range].into_iter().flatten() {
        if !(range[0] < range[1] && range.iter().all(|x| x.is_finite())) {
            return wrong("a rising, finite range", format!("{range:?}"));
        }
    }
    if !(effect.tolerance.is_finite() && effect.tolerance >= 0.0) {
        return wrong("a tolerance of at least 0", effect.tolerance.to_string());
    }
    if effect.levels.is_empty() || effect.levels.iter().any(|x| !x.is_finite() || (*x == 0.0 && !effect.absolute)) {
        return wrong("levels that are finite and not 0", format!("{:?}", effect.levels));
    }
    if effect.least_evidence.is_some_and(|e| !(e.is_finite() && e > 0.0)) {
        return wrong("a least evidence above 0", format!("{:?}", effect.least_evidence));
    }
    if !(effect.log_prior.is_finite() && effect.log_prior <= 0.0) {
        return wrong("a log prior of at most 0", effect.log_prior.to_string());
    }
    if !(effect.engine_error.is_finite() && effect.engine_error >= 0.0) {
        return wrong("an engine error of at least 0", effect.engine_error.to_string());
    }
    let moves = || effect.axes.iter().flat_map(|a| a.moves.values());
    if effect.axes.is_empty() || moves().count() == 0 || moves().any(|x| !x.is_finite() || *x == 0.0) {
        return wrong("at least one axis that moves a parameter by a finite factor", format!("{:?}", effect.axes));
    }
    if let Some(axis) = effect.axes.iter().find(|a| a.unit.is_some() && a.moves.len() != 1) {
        return wrong("one parameter of an axis with a unit of its own", format!("{:?}", axis.moves));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_library_has_every_name_of_the_report() {
        let names: Vec<String> = built_in().into_iter().map(|e| e.name).collect();
        for name in "command_latency observation_latency actuator_lag joint_coulomb_friction joint_viscous_friction \
            joint_armature stribeck_friction load_friction quadratic_drag joint_spring constant_torque series_compliance strength_drift supply_sag motor_strength motor_gain_kp motor_gain_kd torque_limit torque_speed_limit backlash \
            encoder_bias payload_mass com_offset link_inertia ground_friction friction_drop ground_sinkage contact_compliance contact_restitution \
            terrain_slope terrain_height foot_radius external_force imu_tilt gyro_bias pose_delay"
            .split_whitespace()
        {
            assert_eq!(names.iter().filter(|n| *n == name).count(), 1, "{name}");
        }
    }

    #[test]
    fn each_effect_says_what_it_is_and_who_can_show_it() {
        let all = built_in();
        assert!(all.iter().all(|effect| !effect.about.is_empty()));
        let held: Vec<&str> = all.iter().filter(|e| e.shows_on_held()).map(|e| e.name.as_str()).collect();
        assert!(held.contains(&"backlash") && held.contains(&"payload_mass"), "{held:?}");
        assert!(!held.contains(&"ground_friction") && !held.contains(&"imu_tilt"), "{held:?}");
    }

    #[test]
    fn faults_in_a_library_are_named() {
        let good = "[[effect]]\nname = 'wind'\ninterface = 'contact'\nscope = 'world'\nunit = 'N'\nrange = [0, 9]\n\
            tolerance = 0.1\nlevels = [1]\n[[effect.axis]]\nname = 'x'\nmoves = { 'external.force_x' = 1.0 }\n";
        assert_eq!(parse(good, "mine.toml").unwrap()[0].name, "wind");
        for (from, to, remarks) in [
            ("[0, 9]", "[9, 0]", "rising"),
            ("unit = 'N'\n", "unit = 'N'\nheld_range = [1, 1]\n", "rising"),
            ("levels = [1]", "levels = [0]", "not 0"),
            ("= 1.0 }", "= 0.0 }", "factor"),
            ("'wind'", "'unknown'", "other than"),
            ("unit = 'N'\n", "", "unit"),
            ("unit = 'N'\n", "unit = 'N'\nleast_evidence = -1\n", "above 0"),
            ("unit = 'N'\n", "unit = 'N'\nengine_error = nan\n", "at least 0"),
            ("unit = 'N'\n", "unit = 'N'\nlog_prior = 1\n", "at most 0"),
        ] {
            let error = parse(&good.replace(from, to), "mine.toml").unwrap_err().to_string();
            assert!(error.contains(remarks) && error.contains("mine.toml"), "{error}");
        }
    }
}
