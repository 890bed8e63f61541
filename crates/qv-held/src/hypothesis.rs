//! What may be wrong with a robot: typed columns, each a direction among the columns of the equations.

use crate::balance::{Balance, Column, Equation, Kind, Robot, Term};
use crate::gram::Layout;
use crate::regressor::{INERTIAL, modelled, point_mass, second_moments};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Causes that are distinguished by their physics; those of one group may be taken for each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Family {
    /// Friction of a joint.
    Friction,
    /// A mass, or its place.
    Load,
    /// Gains, strength and scale of torques.
    Drive,
    /// Inertia of rotors and links.
    Inertia,
    /// Constant torques.
    Offset,
    /// Delays.
    Latency,
    /// Springs.
    Spring,
}

/// A number of a hypothesis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Axis {
    /// Last word of the simulator's parameter, such as `coulomb_friction`.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// Full names of the simulator's parameters that it moves, each by its value.
    pub parameters: Vec<String>,
    /// Values of these as the robot is stated.
    pub nominal: Vec<f64>,
    /// Value of the parameters where the size is 1, read off the recording: of limits, which are there or not.
    pub at_one: Option<f64>,
    /// Value that is reported where the size is zero: nought but of limits that are a number.
    #[serde(default)]
    pub at_zero: f64,
    /// Values that are physical.
    pub range: [f64; 2],
}

/// A hypothesis: an effect of the library on some part of the robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Hypothesis {
    /// Name of the effect in the library.
    pub effect: String,
    /// `all`, a joint, or a link.
    pub scope: Vec<String>,
    /// What it may be taken for.
    pub family: Family,
    /// Its numbers.
    pub axes: Vec<Axis>,
    /// Link of a load whose place is a part of it.
    pub load_on: Option<usize>,
    /// Direction of each axis: place among the columns, and factor.
    #[serde(skip)]
    pub(crate) directions: Vec<Direction>,
}

/// Rotor inertia of a small geared servo, by which that of a joint may be off whatever is stated \[kg m²\].
const LEAST_ARMATURE: f64 = 0.005;
/// Error of an encoder's zero \[rad\].
const ENCODER: f64 = 0.005;

/// Places among the columns with factors.
pub(crate) type Direction = Vec<(usize, f64)>;

/// An effect of a joint: term, effect, parameter (kind and key), unit, family, and what is physical beside the stated value.
struct JointEffect {
    term: Term,
    effect: &'static str,
    parameter: (&'static str, &'static str),
    unit: &'static str,
    family: Family,
    range: [f64; 2],
    is_free_in_each: bool,
}

const MOST: f64 = f64::MAX;

/// Whether sizes of different joints are independent of each other (torques), or one number (factors and times).
fn joint_effects() -> Vec<JointEffect> {
    let all = [
        (
            Term::Coulomb,
            "joint_coulomb_friction",
            ("joint", "coulomb_friction"),
            "N m",
            Family::Friction,
            [0.0, MOST],
            true,
        ),
        (
            Term::Viscous,
            "joint_viscous_friction",
            ("joint", "viscous_friction"),
            "N m s/rad",
            Family::Friction,
            [0.0, MOST],
            true,
        ),
        (
            Term::Stribeck,
            "stribeck_friction",
            ("joint", "stribeck_friction"),
            "N m",
            Family::Friction,
            [0.0, MOST],
            false,
        ),
        (
            Term::Drag,
            "quadratic_drag",
            ("joint", "quadratic_drag"),
            "N m s²/rad²",
            Family::Friction,
            [0.0, MOST],
            false,
        ),
        (Term::Load, "load_friction", ("joint", "load_friction_motor"), "1", Family::Friction, [0.0, 0.8], false),
        (Term::Offset, "constant_torque", ("joint", "constant_torque"), "N m", Family::Offset, [-MOST, MOST], false),
        (Term::Armature, "joint_armature", ("joint", "armature"), "kg m²", Family::Inertia, [0.0, MOST], true),
        (Term::Spring, "joint_spring", ("joint", "spring_stiffness"), "N m/rad", Family::Spring, [0.0, MOST], false),
        (Term::TorqueScale, "torque_sensor_scale", ("sensor", "torque_scale"), "1", Family::Drive, [-0.9, 3.0], false),
        (
            Term::StateLatency,
            "observation_latency",
            ("sensor", "encoder_latency"),
            "s",
            Family::Latency,
            [0.0, 0.1],
            false,
        ),
        (Term::KpScale, "motor_gain_kp", ("actuator", "kp_scale"), "1", Family::Drive, [-0.95, 3.0], false),
        (Term::KdScale, "motor_gain_kd", ("actuator", "kd_scale"), "1", Family::Drive, [-0.95, 3.0], false),
        (Term::Strength, "motor_strength", ("actuator", "strength"), "1", Family::Drive, [-0.95, 3.0], false),
        (
            Term::CommandLatency,
            "command_latency",
            ("actuator", "command_latency"),
            "s",
            Family::Latency,
            [0.0, 0.1],
            false,
        ),
        (Term::Limit, "torque_limit", ("actuator", "torque_limit"), "N m", Family::Drive, [0.5, 1.5], false),
        (Term::Cap, "torque_limit", ("actuator", "torque_limit"), "N m", Family::Drive, [-MOST, 0.0], false),
        (Term::Lag, "actuator_lag", ("actuator", "lag"), "s", Family::Latency, [0.0, 0.1], false),
    ];
    all.into_iter()
        .map(|(term, effect, parameter, unit, family, range, is_free_in_each)| JointEffect {
            term,
            effect,
            parameter,
            unit,
            family,
            range,
            is_free_in_each,
        })
        .collect()
}

/// All hypotheses that the equations of a recording can show.
pub(crate) fn hypotheses(robot: &Robot, balance: &Balance, limits: &[f64], without: &[String]) -> Vec<Hypothesis> {
    let mut all = Vec::new();
    // The limit of a servo's position part is uncertain, and read off nothing.
    for effect in joint_effects().into_iter().filter(|e| e.term != Term::Limit || robot.servos.is_none()) {
        of_joints(robot, balance, (&effect, limits), &mut all);
    }
    (0..robot.model.links.len()).filter(|&l| is_carried(balance, l)).for_each(|l| of_link(robot, l, &mut all));
    all.retain(|h| !without.contains(&h.effect));
    all
}

/// Whether some equation sees the link.
fn is_carried(balance: &Balance, link: usize) -> bool {
    balance.equations.iter().any(|e| e.kind != Kind::Law && e.columns.contains(&Column::Link(link, 0)))
}

fn of_joints(robot: &Robot, balance: &Balance, (effect, limits): (&JointEffect, &[f64]), all: &mut Vec<Hypothesis>) {
    let has = |j: usize| balance.equations.iter().any(|e| e.columns.contains(&Column::Joint(j, effect.term)));
    let joints: Vec<usize> = (0..robot.joints()).filter(|&j| has(j)).collect();
    let names = robot.model.joint_names();
    // What is stated may be too much, too: the sum is what must be physical.
    let stated = |j: usize| match effect.term {
        Term::Coulomb => robot.coulomb[j],
        // It is apart from the motor's damping in its name alone.
        Term::Viscous if robot.servos.is_some() => MOST,
        Term::Viscous => robot.viscous[j],
        Term::Armature => robot.armature[j],
        _ => 0.0,
    };
    let cap = |j: usize| robot.servos.as_ref().map_or(f64::INFINITY, |s| s.cap[j]);
    let keys: &[&str] = if effect.term == Term::Load {
        &["load_friction_motor", "load_friction_external"]
    } else {
        &[effect.parameter.1]
    };
    let moved = |joints: &[usize]| -> Vec<String> {
        joints
            .iter()
            .flat_map(|&j| keys.iter().map(move |key| (j, key)))
            .map(|(j, key)| format!("{}.{}.{key}", effect.parameter.0, names[j]))
            .collect()
    };
    let axis = |joints: &[usize]| Axis {
        name: effect.parameter.1.into(),
        unit: effect.unit.into(),
        nominal: if effect.term == Term::Cap {
            joints.iter().map(|&j| cap(j)).collect()
        } else {
            moved(joints).iter().map(|name| robot.nominal(name)).collect()
        },
        parameters: moved(joints),
        at_zero: if effect.term == Term::Cap { joints.iter().map(|&j| cap(j)).fold(0.0, f64::max) } else { 0.0 },
        at_one: (effect.term == Term::Limit).then(|| joints.iter().map(|&j| limits[j]).fold(0.0, f64::max)),
        range: [joints.iter().map(|&j| effect.range[0] - stated(j)).fold(f64::NEG_INFINITY, f64::max), effect.range[1]],
    };
    // What pushes a joint along takes from the torque of its motor; motor and load both press on the gear.
    let factor = match effect.term {
        Term::Offset => -1.0,
        Term::Load => 2.0,
        _ => 1.0,
    };
    let direction = |joints: &[usize]| {
        joints.iter().map(|&j| (Layout::of(robot).place(Column::Joint(j, effect.term)), factor)).collect()
    };
    let mut push = |scope: Vec<String>, groups: &[Vec<usize>]| {
        all.push(Hypothesis {
            effect: effect.effect.into(),
            scope,
            family: effect.family,
            axes: groups.iter().map(|g| axis(g)).collect(),
            load_on: None,
            directions: groups.iter().map(|g| direction(g)).collect(),
        });
    };
    joints.iter().for_each(|&j| push(vec![names[j].clone()], &[vec![j]]));
    // Motors of different size have no limit in common.
    if joints.len() > 1 && effect.term != Term::Cap {
        push(vec!["all".into()], std::slice::from_ref(&joints));
        if effect.is_free_in_each {
            push(vec!["all".into()], &joints.iter().map(|&j| vec![j]).collect::<Vec<_>>());
        }
    }
}

fn of_link(robot: &Robot, l: usize, all: &mut Vec<Hypothesis>) {
    let (layout, link) = (Layout::of(robot), &robot.model.links[l]);
    let axis = |name: &str, unit: &str, range: [f64; 2]| Axis {
        name: name.into(),
        unit: unit.into(),
        nominal: vec![robot.nominal(&format!("link.{}.{name}", link.name))],
        parameters: vec![format!("link.{}.{name}", link.name)],
        at_one: None,
        at_zero: 0.0,
        range,
    };
    let mass = axis("payload_mass", "kg", [-0.9 * link.mass, MOST]);
    let moments = ["payload_moment_x", "payload_moment_y", "payload_moment_z"];
    let shifts = ["com_x", "com_y", "com_z"];
    let first = |k: usize, by: f64| vec![(layout.place(Column::Link(l, 1 + k)), by)];
    let mut push =
        |effect: &str, family: Family, axes: Vec<Axis>, directions: Vec<Direction>, load_on: Option<usize>| {
            all.push(Hypothesis {
                effect: effect.into(),
                scope: vec![link.name.clone()],
                family,
                axes,
                load_on,
                directions,
            });
        };
    push("payload_mass", Family::Load, vec![mass.clone()], vec![load_direction(layout, l, DVec3::ZERO)], None);
    let place = moments.iter().map(|name| axis(name, "kg m", [-MOST, MOST]));
    let mut directions = vec![load_direction(layout, l, DVec3::ZERO)];
    directions.extend((0..3).map(|k| first(k, 1.0)));
    push("payload_off_centre", Family::Load, std::iter::once(mass).chain(place).collect(), directions, Some(l));
    if link.mass > 0.0 {
        let axes = shifts.iter().map(|name| axis(name, "m", [-1.0, 1.0])).collect();
        push("com_offset", Family::Load, axes, (0..3).map(|k| first(k, link.mass)).collect(), None);
    }
    if link.inertia != glam::DMat3::ZERO {
        let scale = axis("inertia_scale", "1", [-0.95, MOST]);
        push(
            "link_inertia",
            Family::Inertia,
            vec![scale],
            vec![inertial(layout, l, &second_moments(&link.inertia))],
            None,
        );
    }
}

/// A kilogram on a link, at a place from its centre of mass \[m\], first moments apart.
pub(crate) fn load_direction(layout: Layout, link: usize, place: DVec3) -> Direction {
    let mut pi = point_mass(1.0, place);
    pi[1..4].fill(0.0);
    inertial(layout, link, &pi)
}

fn inertial(layout: Layout, link: usize, pi: &[f64; INERTIAL]) -> Direction {
    let place = |k: usize| layout.place(Column::Link(link, k));
    pi.iter().enumerate().filter(|(_, x)| **x != 0.0).map(|(k, x)| (place(k), *x)).collect()
}

/// What robots of one make differ in: directions, and how far each may be off.
#[derive(Default)]
pub(crate) struct Nuisance {
    pub directions: Vec<Direction>,
    pub tolerances: Vec<f64>,
}

impl Nuisance {
    /// What is uncertain in joints, and in links.
    pub fn split(self, layout: Layout) -> [Self; 2] {
        let mut all = [Self::default(), Self::default()];
        for (direction, tolerance) in self.directions.into_iter().zip(self.tolerances) {
            let is_of_link = direction.iter().any(|x| x.0 >= layout.place_of_links());
            all[usize::from(is_of_link)].directions.push(direction);
            all[usize::from(is_of_link)].tolerances.push(tolerance);
        }
        all
    }
}

/// By how much robots differ from their papers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Tolerances {
    /// Share of a link's mass.
    pub mass: f64,
    /// Place of a link's centre of mass \[m\], at most a tenth of the distance to its joint or the next.
    pub com: f64,
    /// Share of a link's rotational inertia.
    pub inertia: f64,
    /// Share of a rotor's inertia.
    pub armature: f64,
    /// Share of stated friction.
    pub friction: f64,
    /// Friction beyond what is stated, and offsets, as a share of the usual torque of a joint.
    pub torque: f64,
    /// Share of gains, strength and scale of torques.
    pub gain: f64,
    /// Delays, in samples of the recording.
    pub samples: f64,
}

impl Default for Tolerances {
    fn default() -> Self {
        Self {
            mass: 0.05,
            com: 0.01,
            inertia: 0.15,
            armature: 0.2,
            friction: 0.3,
            torque: 0.02,
            gain: 0.05,
            samples: 0.5,
        }
    }
}

/// Reach of a link that its centre of mass is measured by \[m\].
pub(crate) fn reach(robot: &Robot, link: usize) -> f64 {
    let children =
        robot.model.links.iter().filter(|l| l.parent == Some(link)).map(|l| l.parent_from_link.position.length());
    children.fold(robot.model.links[link].com.length(), f64::max)
}

/// How far a term of a servo may be off, whose columns are positions; `torque` is what lies beyond what is stated \[N m\].
fn of_servo(
    robot: &Robot,
    (j, term): (usize, Term),
    (torque, equation): (f64, &Equation),
    (tolerances, period): (&Tolerances, f64),
) -> f64 {
    match term {
        Term::Coulomb => torque + tolerances.friction * robot.coulomb[j],
        Term::Stribeck | Term::Offset => torque,
        // As much as Coulomb friction beyond what is stated moves it.
        Term::Viscous => {
            torque * rms_of(equation, Term::Coulomb) / rms_of(equation, Term::Viscous).max(1e-12)
                + tolerances.friction * robot.viscous[j].abs()
        }
        Term::Load => tolerances.torque,
        Term::Armature => tolerances.armature * robot.armature[j].max(LEAST_ARMATURE),
        Term::KpScale | Term::Limit => tolerances.gain,
        Term::CommandLatency | Term::Smoothing => tolerances.samples * period,
        Term::Slew => tolerances.gain / robot.servos.as_ref().map_or(f64::INFINITY, |s| s.top[j]),
        Term::LawOffset => ENCODER,
        _ => 0.0,
    }
}

/// Root mean square of a joint's column; 0 without it.
fn rms_of(equation: &Equation, term: Term) -> f64 {
    let at = equation.columns.iter().position(|c| *c == Column::Joint(equation.joint, term));
    at.map_or(0.0, |at| {
        let values = &equation.values[at];
        (qv_fit::linear::squared(values) / values.len().max(1) as f64).sqrt()
    })
}

/// What is uncertain in a robot of which the equations of `balance` were recorded; `period` is that of its log \[s\].
pub(crate) fn nuisance(robot: &Robot, balance: &Balance, tolerances: &Tolerances, period: f64) -> Nuisance {
    let layout = Layout::of(robot);
    let mut all = Nuisance::default();
    let mut push = |direction: Direction, tolerance: f64| {
        if tolerance > 0.0 {
            all.directions.push(direction);
            all.tolerances.push(tolerance);
        }
    };
    for equation in &balance.equations {
        let j = equation.joint;
        let rms = |values: &[f64]| (qv_fit::linear::squared(values) / values.len().max(1) as f64).sqrt();
        let torque = tolerances.torque * rms(&equation.modelled);
        for (column, values) in equation.columns.iter().zip(&equation.values) {
            let Column::Joint(_, term) = *column else { continue };
            let beyond = torque / rms(values).max(1e-12);
            let tolerance = match (equation.kind, term) {
                (Kind::Path, _) => of_servo(robot, (j, term), (torque, equation), (tolerances, period)),
                (Kind::Balance, Term::Coulomb) => beyond + tolerances.friction * robot.coulomb[j],
                (Kind::Balance, Term::Viscous) => beyond + tolerances.friction * robot.viscous[j],
                (Kind::Balance, Term::Armature) => 0.5 * beyond + tolerances.armature * robot.armature[j],
                (Kind::Balance, Term::TorqueScale) | (_, Term::KpScale | Term::KdScale) => tolerances.gain,
                (Kind::Balance, Term::StateLatency) | (_, Term::CommandLatency) => tolerances.samples * period,
                (Kind::Balance, Term::Spring)
                | (_, Term::Strength | Term::Lag | Term::Limit | Term::Smoothing | Term::Slew)
                | (Kind::Law, Term::TorqueScale | Term::StateLatency) => 0.0,
                // Zeros of encoders, which gains multiply, say nothing.
                (_, Term::LawOffset) => 10.0 * beyond,
                _ => beyond,
            };
            push(vec![(layout.place(*column), 1.0)], tolerance);
        }
    }
    for (l, link) in robot.model.links.iter().enumerate().filter(|(l, _)| is_carried(balance, *l)) {
        push(inertial(layout, l, &modelled(robot.model, l)), tolerances.mass);
        let com = tolerances.com.min(0.1 * reach(robot, l)) * link.mass;
        (0..3).for_each(|k| push(vec![(layout.place(Column::Link(l, 1 + k)), 1.0)], com));
        push(inertial(layout, l, &second_moments(&link.inertia)), tolerances.inertia);
    }
    all
}
