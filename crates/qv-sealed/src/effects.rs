//! The named effects: how large, on which part of the robot or floor, and through which parameters of the simulator.

use crate::scout::Scout;
use crate::sections::SETTLING;
use qv_core::random::SplitMix64;
use qv_go2::model::{self, JOINT_NAMES, LEGS};

/// Names of the effects that a diagnosis knows.
pub const EFFECTS: [&str; 26] = [
    "command_latency",
    "observation_latency",
    "actuator_lag",
    "joint_coulomb_friction",
    "joint_viscous_friction",
    "joint_armature",
    "motor_strength",
    "motor_gain_kp",
    "motor_gain_kd",
    "torque_limit",
    "torque_speed_limit",
    "backlash",
    "encoder_bias",
    "payload_mass",
    "com_offset",
    "link_inertia",
    "ground_friction",
    "contact_compliance",
    "contact_restitution",
    "terrain_slope",
    "terrain_height",
    "foot_radius",
    "external_force",
    "imu_tilt",
    "gyro_bias",
    "pose_delay",
];

/// Interface between robot and world at which an effect acts: `actuator`, `contact`, `inertial` or `sensing`; `None`
/// for a name that is not in [`EFFECTS`].
pub fn interface(effect: &str) -> Option<&'static str> {
    Some(match effect {
        "command_latency"
        | "actuator_lag"
        | "joint_coulomb_friction"
        | "joint_viscous_friction"
        | "joint_armature"
        | "motor_strength"
        | "motor_gain_kp"
        | "motor_gain_kd"
        | "torque_limit"
        | "torque_speed_limit"
        | "backlash" => "actuator",
        "observation_latency" | "encoder_bias" | "imu_tilt" | "gyro_bias" | "pose_delay" => "sensing",
        "payload_mass" | "com_offset" | "link_inertia" => "inertial",
        // What pulls at the robot touches it.
        "external_force"
        | "ground_friction"
        | "contact_compliance"
        | "contact_restitution"
        | "terrain_slope"
        | "terrain_height"
        | "foot_radius" => "contact",
        _ => return None,
    })
}

/// Groups of effects that are known to be confused; what is in no group is alone in its own.
const GROUPS: [&[&str]; 5] = [
    &["command_latency", "observation_latency", "actuator_lag", "joint_viscous_friction", "motor_gain_kd"],
    &["motor_strength", "motor_gain_kp", "link_inertia", "joint_armature", "payload_mass"],
    &["encoder_bias", "com_offset", "imu_tilt", "terrain_slope"],
    &["ground_friction", "contact_compliance", "foot_radius"],
    &["joint_coulomb_friction", "backlash"],
];

/// The effects that an effect is known to be confused with, itself among them.
pub fn confusable_group(effect: &str) -> Vec<&str> {
    GROUPS.into_iter().find(|group| group.contains(&effect)).map_or_else(|| vec![effect], <[&str]>::to_vec)
}

/// Whether the second engine hardly shows the effect: it solves contact velocities once more without any give, so that
/// soft contacts hardly act, and bounces a contact at once.
pub fn needs_our_engine(effect: &str) -> bool {
    matches!(effect, "contact_compliance" | "contact_restitution")
}

/// One size of an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Name: the last word of the simulator's parameter.
    pub name: &'static str,
    /// Value in SI units: the deviation from the nominal robot, but for limits, friction and time constants, which are
    /// the values themselves.
    pub value: f64,
    /// Unit.
    pub unit: &'static str,
    /// Range of its size, neutral neighbourhood included; of limits: what the motion uses.
    pub range: (f64, f64),
    /// Whether a diagnosis is asked for it; else it only goes along.
    pub asked: bool,
}

/// A rectangle of the floor \[m\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    /// Least and greatest x.
    pub x: [f64; 2],
    /// Least and greatest y.
    pub y: [f64; 2],
    /// Whether the motion comes to the edges of x, and of y: nobody can determine where the others are.
    pub met: [[bool; 2]; 2],
}

impl Region {
    /// Whether a place is inside.
    pub fn contains(&self, x: f64, y: f64) -> bool {
        (self.x[0]..self.x[1]).contains(&x) && (self.y[0]..self.y[1]).contains(&y)
    }
}

/// A named effect with its size and place.
#[derive(Debug, Clone, PartialEq)]
pub struct Cause {
    /// Name out of [`EFFECTS`].
    pub effect: &'static str,
    /// `all`, names of joints, kinds of joints, legs, or `floor`, `region`, `base`.
    pub scope: Vec<String>,
    /// The part of the floor that it is confined to.
    pub region: Option<Region>,
    /// Its sizes.
    pub figures: Vec<Figure>,
    /// Parameters of the simulator.
    pub settings: Vec<(String, f64)>,
}

/// Which joints, and how small a part of the robot that is.
struct Joints {
    which: Vec<usize>,
    scope: Vec<String>,
    few: bool,
}

/// All joints, a kind, a leg, or one joint.
fn some_joints(draws: &mut SplitMix64, whole: f64) -> Joints {
    let (which, kind, leg, joint) = (draws.uniform(), draws.index(3), draws.index(4), draws.index(12));
    if which <= whole {
        return Joints { which: (0..12).collect(), scope: vec!["all".into()], few: false };
    }
    let rest = (which - whole) / (1.0 - whole);
    let (scope, which) = if rest < 0.35 {
        (["hip", "thigh", "calf"][kind], (0..12).filter(|j| j % 3 == kind).collect())
    } else if rest < 0.7 {
        (LEGS[leg], (3 * leg..3 * leg + 3).collect())
    } else {
        (JOINT_NAMES[joint], vec![joint])
    };
    Joints { which, scope: vec![scope.into()], few: true }
}

/// A size between `least` and `most`; from the upper half where few joints have to show it.
fn size(draws: &mut SplitMix64, few: bool, least: f64, most: f64) -> f64 {
    draws.between(if few { 0.5 * (least + most) } else { least }, most)
}

fn asked(name: &'static str, value: f64, unit: &'static str, range: (f64, f64)) -> Figure {
    Figure { name, value, unit, range, asked: true }
}

fn beside(name: &'static str, value: f64, unit: &'static str, range: (f64, f64)) -> Figure {
    Figure { name, value, unit, range, asked: false }
}

impl Cause {
    /// Draws an effect; `None` for a name that is not in [`EFFECTS`], or when the motion does not bring it out.
    pub(crate) fn drawn(effect: &str, draws: &mut SplitMix64, scout: &Scout, walking: [f64; 2]) -> Option<Self> {
        let effect = EFFECTS.into_iter().find(|known| *known == effect)?;
        match effect {
            "torque_limit" => torque_limit(draws, scout),
            "torque_speed_limit" => torque_speed_limit(draws, scout),
            "ground_friction" => ground_friction(draws, scout),
            "external_force" => Some(external_force(draws, walking)),
            _ => Self::of_any_motion(effect, draws).or_else(|| sensing_effect(effect, draws)),
        }
    }

    /// The same of joints, bodies and contacts whose size does not depend on the motion.
    pub(crate) fn of_any_motion(effect: &'static str, draws: &mut SplitMix64) -> Option<Self> {
        joint_effect(effect, draws).or_else(|| body_effect(effect, draws)).or_else(|| contact_effect(effect, draws))
    }

    /// The same effect with so many times its size. Limits, frictions of the ground and the time constant of contacts are values, not
    /// deviations, and stay; so do places and times.
    pub(crate) fn scaled(mut self, factor: f64) -> Self {
        let is_deviation = |name: &str| {
            let end = name.rsplit('.').next().unwrap_or(name);
            let is_value = matches!(end, "torque_limit" | "speed_knee" | "speed_zero" | "friction" | "time_constant")
                || matches!(end, "x_min" | "x_max" | "y_min" | "y_max" | "start" | "duration")
                || end.starts_with("payload_") && end != "payload_mass";
            !is_value
        };
        self.figures.iter_mut().filter(|f| is_deviation(f.name)).for_each(|f| f.value *= factor);
        for (name, value) in self.settings.iter_mut().filter(|(name, _)| is_deviation(name)) {
            let neutral = match name.rsplit('.').next().unwrap_or(name) {
                "strength" | "kp_scale" | "kd_scale" | "inertia_scale" => 1.0,
                "armature" => model::ARMATURE,
                _ => 0.0,
            };
            *value = neutral + factor * (*value - neutral);
        }
        self
    }

    /// An effect whose figures are parameters of the same names with this prefix.
    fn whole(effect: &'static str, scope: &str, prefix: &str, figures: Vec<Figure>) -> Self {
        let settings = figures.iter().map(|f| (format!("{prefix}{}", f.name), f.value)).collect();
        Self { effect, scope: vec![scope.into()], region: None, figures, settings }
    }
}

/// One parameter of each joint in scope. What is drawn is the deviation from the nominal robot.
fn joint_effect(effect: &'static str, draws: &mut SplitMix64) -> Option<Cause> {
    let few_scopes = some_joints(draws, if effect == "encoder_bias" { 0.0 } else { 0.45 });
    let few = few_scopes.few;
    const RATIO: (f64, f64) = (-0.4, 0.25);
    let (prefix, name, value, unit, range) = match effect {
        "command_latency" => ("actuator", "command_latency", size(draws, few, 0.006, 0.025), "s", (0.0, 0.025)),
        "observation_latency" => ("sensor", "encoder_latency", size(draws, few, 0.006, 0.025), "s", (0.0, 0.025)),
        "actuator_lag" => ("actuator", "lag", size(draws, few, 0.006, 0.025), "s", (0.0, 0.025)),
        "joint_coulomb_friction" => ("joint", "coulomb_friction", size(draws, few, 0.25, 1.0), "N m", (0.0, 1.0)),
        "joint_viscous_friction" => ("joint", "viscous_friction", size(draws, few, 0.15, 0.6), "N m s/rad", (0.0, 0.6)),
        "joint_armature" => ("joint", "armature", size(draws, few, 0.0115, 0.04), "kg m²", (-0.005, 0.04)),
        "motor_strength" => ("actuator", "strength", ratio(draws, few, 0.1), "1", RATIO),
        "motor_gain_kp" => ("actuator", "kp_scale", ratio(draws, few, 0.1), "1", RATIO),
        // The velocity gain's part of the torque is small.
        "motor_gain_kd" => ("actuator", "kd_scale", ratio(draws, few, 0.16), "1", RATIO),
        "backlash" => ("actuator", "backlash", size(draws, few, 0.006, 0.02), "rad", (0.0, 0.02)),
        "encoder_bias" => ("sensor", "encoder_bias", draws.sign() * draws.between(0.025, 0.1), "rad", (-0.1, 0.1)),
        _ => return None,
    };
    let Joints { which, scope, .. } = few_scopes;
    let nominal = match name {
        "strength" | "kp_scale" | "kd_scale" => 1.0,
        "armature" => model::ARMATURE,
        _ => 0.0,
    };
    let setting = |&j: &usize| (format!("{prefix}.{}.{name}", JOINT_NAMES[j]), nominal + value);
    let (settings, figures) = (which.iter().map(setting).collect(), vec![asked(name, value, unit, range)]);
    Some(Cause { effect, scope, region: None, figures, settings })
}

/// How far a ratio of 0.6 to 1.25 is from 1, at least `away`.
fn ratio(draws: &mut SplitMix64, few: bool, away: f64) -> f64 {
    let away = if few { 0.2 } else { away };
    draws.among(&[(-0.4, -away), (away, 0.25)])
}

/// A limit that clips 4 to 15 % of what the joints in scope give in this motion.
fn torque_limit(draws: &mut SplitMix64, scout: &Scout) -> Option<Cause> {
    let Joints { which, scope, .. } = some_joints(draws, 0.3);
    let limit = scout.quantile(&scout.torque, &which, 1.0 - draws.between(0.04, 0.15));
    let most = scout.quantile(&scout.torque, &which, 0.998);
    // Clipped by less than that nobody would see it.
    if most < limit + 2.0 {
        return None;
    }
    let settings = which.iter().map(|&j| (format!("actuator.{}.torque_limit", JOINT_NAMES[j]), limit)).collect();
    let figures = vec![asked("torque_limit", limit, "N m", (0.0, most))];
    Some(Cause { effect: "torque_limit", scope, region: None, figures, settings })
}

/// A fall of torque with speed, as steep as the Go2's own (13.5 to 30.1 rad/s), that 1.5 to 8 % of what the joints in scope do in this motion run into.
fn torque_speed_limit(draws: &mut SplitMix64, scout: &Scout) -> Option<Cause> {
    let Joints { which, scope, .. } = some_joints(draws, 0.4);
    let fast = scout.quantile(&scout.speed, &which, 0.998);
    // Joints that hardly move have no speed to be limited by.
    if fast < 3.0 {
        return None;
    }
    let effort = model::effort_limits();
    let bites = (0..40).find_map(|_| {
        let knee = draws.between(0.15, 0.9) * fast;
        let zero = knee * draws.between(1.9, 2.5);
        (0.015..0.08).contains(&scout.over_speed_limit(&which, &effort, knee, zero)).then_some((knee, zero))
    });
    let (knee, zero) = bites?;
    let both = |j: usize| {
        let name = |end: &str| format!("actuator.{}.{end}", JOINT_NAMES[j]);
        [(name("speed_knee"), knee), (name("speed_zero"), zero)]
    };
    let settings = which.iter().flat_map(|&j| both(j)).collect();
    let range = (0.0, 1.2 * fast);
    let figures =
        vec![asked("speed_knee", knee, "rad/s", range), beside("speed_zero", zero, "rad/s", (0.0, 2.5 * range.1))];
    Some(Cause { effect: "torque_speed_limit", scope, region: None, figures, settings })
}

/// Low friction everywhere, or in a stripe or rectangle ahead of the feet.
fn ground_friction(draws: &mut SplitMix64, scout: &Scout) -> Option<Cause> {
    const RANGE: (f64, f64) = (0.1, 1.2);
    if draws.chance(0.4) {
        let figures = vec![asked("friction", draws.between(0.15, 0.45), "1", RANGE)];
        return Some(Cause::whole("ground_friction", "floor", "contact.", figures));
    }
    let (from, to) = (*scout.path.first()?, *scout.path.last()?);
    let along = usize::from((to[1] - from[1]).abs() > (to[0] - from[0]).abs());
    let (way, across) = (to[along] - from[along], 1 - along);
    // Front feet stand 0.2 m ahead of the base; what lies beyond the end of the walk would never be met.
    if way.abs() < 0.5 {
        return None;
    }
    let near = from[along] + way.signum() * (0.25 + draws.between(0.0, 0.3) * way.abs());
    let far = near + way.signum() * draws.between(0.3, 0.7);
    let mut sides = [[-3.0, 3.0]; 2];
    sides[along] = [near.min(far), near.max(far)];
    if draws.chance(0.5) {
        // Half of the path's width: the feet of one side may stay off it.
        let edge = from[across] + 0.5 * (to[across] - from[across]) + draws.between(-0.1, 0.1);
        sides[across] = if draws.chance(0.5) { [edge, edge + 0.8] } else { [edge - 0.8, edge] };
    }
    // Feet stand up to 0.2 m beside the base.
    let met = |axis: usize, edge: f64| {
        let near = |sign: f64| scout.path.iter().any(|place| sign * (place[axis] - edge) > -0.2);
        near(1.0) && near(-1.0)
    };
    let met = [0, 1].map(|axis| sides[axis].map(|edge| met(axis, edge)));
    let region = Region { x: sides[0], y: sides[1], met };
    let friction = draws.between(0.1, 0.35);
    let side = |name, value| beside(name, value, "m", (-3.0, 3.0));
    let figures = vec![
        asked("friction", friction, "1", RANGE),
        side("x_min", region.x[0]),
        side("x_max", region.x[1]),
        side("y_min", region.y[0]),
        side("y_max", region.y[1]),
    ];
    let region_scope = Some(region);
    Some(Cause { region: region_scope, ..Cause::whole("ground_friction", "region", "terrain.patch.", figures) })
}

/// A force on the trunk, all the time or for a while of the walk.
fn external_force(draws: &mut SplitMix64, walking: [f64; 2]) -> Cause {
    let push = draws.chance(0.6);
    let strength = if push { draws.between(12.0, 30.0) } else { draws.between(7.5, 22.0) };
    let heading = draws.between(0.0, std::f64::consts::TAU);
    let rise = draws.between(-0.4, 0.4);
    let parts = [heading.cos() * f64::cos(rise), heading.sin() * f64::cos(rise), f64::sin(rise)];
    let names = ["force_x", "force_y", "force_z"];
    let mut figures: Vec<Figure> = (0..3).map(|i| asked(names[i], strength * parts[i], "N", (-30.0, 30.0))).collect();
    if push {
        let lasting = draws.between(0.3, 1.5);
        let start = draws.between(walking[0] + 0.5, walking[1] - lasting - 0.5);
        figures.push(beside("start", start, "s", (0.0, 20.0)));
        figures.push(beside("duration", lasting, "s", (0.0, 20.0)));
    }
    let mut cause = Cause::whole("external_force", "base", "external.", figures);
    // The simulator's clock starts before the recording's.
    cause.settings.iter_mut().filter(|(name, _)| name == "external.start").for_each(|(_, t)| *t += SETTLING);
    cause
}

/// Masses and where they are.
fn body_effect(effect: &'static str, draws: &mut SplitMix64) -> Option<Cause> {
    let place = (-0.1, 0.1);
    match effect {
        "payload_mass" => {
            let mass = draws.among(&[(-1.0, -0.6), (0.9, 4.0)]);
            let at = |name, value| beside(name, value, "m", place);
            let figures = vec![
                asked("payload_mass", mass, "kg", (-1.0, 4.0)),
                at("payload_x", draws.between(-0.08, 0.08)),
                at("payload_y", draws.between(-0.04, 0.04)),
                at("payload_z", draws.between(0.0, 0.1)),
            ];
            Some(Cause::whole(effect, "base", "link.base.", figures))
        }
        "com_offset" => {
            let heading = draws.between(0.0, std::f64::consts::TAU);
            let distance = draws.between(0.03, 0.1);
            let figures = vec![
                asked("com_x", distance * heading.cos(), "m", place),
                asked("com_y", distance * heading.sin(), "m", place),
                beside("com_z", draws.between(-0.02, 0.02), "m", place),
            ];
            Some(Cause::whole(effect, "base", "link.base.", figures))
        }
        "link_inertia" => {
            // Of the trunk alone little shows.
            let alone = draws.chance(0.5);
            let least = if alone { 0.22 } else { 0.15 };
            let more = draws.among(&[(-0.3, -least), (least, 0.3)]);
            let figures = vec![asked("inertia_scale", more, "1", (-0.3, 0.3))];
            if alone {
                let settings = vec![("link.base.inertia_scale".into(), 1.0 + more)];
                return Some(Cause { effect, scope: vec!["base".into()], region: None, figures, settings });
            }
            let legs = LEGS.iter().flat_map(|leg| ["hip", "thigh", "calf"].map(|part| format!("{leg}_{part}")));
            let links = legs.chain(["base".to_string()]);
            let settings = links.map(|link| (format!("link.{link}.inertia_scale"), 1.0 + more)).collect();
            Some(Cause { effect, scope: vec!["all".into()], region: None, figures, settings })
        }
        _ => None,
    }
}

/// Feet and floor.
fn contact_effect(effect: &'static str, draws: &mut SplitMix64) -> Option<Cause> {
    match effect {
        "contact_compliance" => {
            let figures = vec![asked("time_constant", draws.between(0.02, 0.05), "s", (0.002, 0.05))];
            Some(Cause::whole(effect, "floor", "contact.", figures))
        }
        "contact_restitution" => {
            let figures = vec![asked("restitution", draws.between(0.3, 0.8), "1", (0.0, 0.8))];
            Some(Cause::whole(effect, "floor", "contact.", figures))
        }
        "terrain_slope" => {
            const MOST: f64 = 0.07;
            let (heading, slope) = (draws.between(0.0, std::f64::consts::TAU), draws.between(0.02, MOST));
            let figures = vec![
                asked("slope_x", slope * heading.cos(), "rad", (-MOST, MOST)),
                asked("slope_y", slope * heading.sin(), "rad", (-MOST, MOST)),
            ];
            Some(Cause::whole(effect, "floor", "terrain.", figures))
        }
        "terrain_height" => {
            let figures = vec![asked("height", draws.sign() * draws.between(0.025, 0.1), "m", (-0.1, 0.1))];
            Some(Cause::whole(effect, "floor", "terrain.", figures))
        }
        "foot_radius" => {
            let offset = draws.sign() * draws.between(0.0015, 0.004);
            let (one, leg) = (draws.chance(0.4), draws.index(4));
            let feet = (0..4).filter(|&l| !one || l == leg);
            let settings = feet.map(|l| (format!("geom.{}.radius_offset", model::FOOT_LINKS[l]), offset)).collect();
            let scope = if one { LEGS[leg] } else { "all" };
            let figures = vec![asked("radius_offset", offset, "m", (-0.004, 0.004))];
            Some(Cause { effect, scope: vec![scope.into()], region: None, figures, settings })
        }
        _ => None,
    }
}

/// What sensors report.
fn sensing_effect(effect: &'static str, draws: &mut SplitMix64) -> Option<Cause> {
    match effect {
        "imu_tilt" => {
            const MOST: f64 = 0.0524;
            let (heading, tilt) = (draws.between(0.0, std::f64::consts::TAU), draws.between(0.015, MOST));
            let figures = vec![
                asked("tilt_roll", tilt * heading.cos(), "rad", (-MOST, MOST)),
                asked("tilt_pitch", tilt * heading.sin(), "rad", (-MOST, MOST)),
            ];
            Some(Cause::whole(effect, "base", "sensor.imu.", figures))
        }
        "gyro_bias" => {
            let axis = draws.index(3);
            let main = draws.sign() * draws.between(0.025, 0.1);
            let mut part = |own: usize| if own == axis { main } else { draws.between(-0.02, 0.02) };
            let values = [part(0), part(1), part(2)];
            let names = ["gyro_bias_x", "gyro_bias_y", "gyro_bias_z"];
            let figures = (0..3).map(|i| asked(names[i], values[i], "rad/s", (-0.1, 0.1))).collect();
            Some(Cause::whole(effect, "base", "sensor.imu.", figures))
        }
        "pose_delay" => {
            let figures = vec![asked("delay", draws.between(0.025, 0.1), "s", (0.0, 0.1))];
            Some(Cause::whole(effect, "base", "sensor.pose.", figures))
        }
        _ => None,
    }
}
