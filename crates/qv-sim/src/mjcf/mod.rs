//! MJCF, MuJoCo's own format: the part of it that models of robots use becomes a [`Model`].
//!
//! Read: bodies with any orientation, `<frame>`s, default classes, `<include>`, `<compiler>` (angle, eulerseq, autolimits, meshdir,
//! inertiafromgeom, inertiagrouprange), inertials or the masses of geoms, hinge, slide and free joints (any anchor, several on
//! one body), geoms for contact, sites as frames, position, velocity, motor and general actuators, the site of the IMU, the
//! keyframe of the stance. What is left out is named in [`Model::left_out`], what is read in a way of our own in
//! [`Model::remarks`]. Format: <https://mujoco.readthedocs.io/en/stable/XMLreference.html>.

mod actuators;
mod attributes;
mod bodies;
mod frames;
mod joints;
mod resistance;
mod schema;
mod sections;
mod shapes;
mod tree;

pub use sections::Stand;
pub use tree::Include;

use crate::{BaseKind, Model, ModelOptions, SimError};
use actuators::Actuator;
use attributes::Classes;
use bodies::Reader;
use frames::Compiler;
use resistance::apparent_inertias;
use shapes::Meshes;
use tree::Tree;

/// A robot with what its MJCF says beside the model.
#[derive(Debug, Clone)]
pub struct MjcfModel {
    /// The robot.
    pub model: Model,
    /// Gains of each joint of the model, in its order; `None` for a joint that no actuator drives.
    pub gains: Vec<Option<Gains>>,
    /// The stance of the keyframe `home`, else of the first one; `None` without any.
    pub stand: Option<Stand>,
    /// Time step of `<option>` \[s\].
    pub timestep: Option<f64>,
}

/// What the actuators of a joint do: torque `kp (q_des - q) - kd dq`. A motor has zeros.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gains {
    /// Position gain \[N m/rad\].
    pub kp: f64,
    /// Velocity gain \[N m s/rad\].
    pub kd: f64,
}

/// Whether a text is MJCF: its first element is `<mujoco>`.
pub fn is_mjcf(xml: &str) -> bool {
    let mut rest = xml.trim_start_matches('\u{feff}').trim_start();
    loop {
        let end = match rest {
            _ if rest.starts_with("<!--") => rest.find("-->").map(|at| at + 3),
            _ if rest.starts_with("<?") => rest.find("?>").map(|at| at + 2),
            _ if rest.starts_with("<!") => rest.find('>').map(|at| at + 1),
            _ => return rest.strip_prefix("<mujoco").is_some_and(|r| r.starts_with([' ', '>', '/', '\t', '\n', '\r'])),
        };
        let Some(end) = end else { return false };
        rest = rest[end..].trim_start();
    }
}

impl Model {
    /// Reads an MJCF, as [`MjcfModel::read`] does, for callers that need the model alone.
    ///
    /// # Errors
    /// As [`MjcfModel::read`].
    pub fn from_mjcf(xml: &str, options: &ModelOptions, include: &Include) -> Result<Self, SimError> {
        MjcfModel::read(xml, options, include).map(|read| read.model)
    }
}

impl MjcfModel {
    /// Reads the text of an MJCF. `options.mesh_reader` is asked for mesh files by their names with `meshdir` before them,
    /// `include` for the files of `<include>`. Rotor inertias are those of the file, not of `options`.
    ///
    /// The file says whether the base is free: [`BaseKind::Floating`] holds for a body with a free joint alone, and any other
    /// robot is fixed in the world. [`BaseKind::Fixed`] holds a free base where the file has it.
    ///
    /// # Errors
    /// [`SimError::Mjcf`] names element and line (and file, where that is an included one): no MJCF, attributes that are not what
    /// they must be, names and classes that are not there, ball joints, moving bodies without mass.
    pub fn read(xml: &str, options: &ModelOptions, include: &Include) -> Result<Self, SimError> {
        let tree = Tree::parse(xml, include)?;
        let classes = Classes::read(&tree)?;
        let compiler = Compiler::read(&tree)?;
        let meshes = Meshes::new(&tree, &classes, &compiler, options.mesh_reader)?;
        let mut reader = Reader::new(&tree, &classes, &compiler, &meshes);
        reader.world().map_err(|e| with_reasons(e, &reader))?;
        let actuators = actuators::read(&tree, &classes, &compiler, &mut reader.left_out)?;
        limit_efforts(&mut reader, &actuators);
        sections::sites(&tree, &mut reader);
        sections::left_out(&tree, &mut reader);
        reader.left_out.extend(schema::strange(&tree));
        let timestep = sections::option(&tree, &mut reader)?;
        let base = if reader.base_place.is_some() { options.base } else { BaseKind::Fixed };
        if base != options.base {
            reader.robot.remarks.push("no body has a free joint: the robot is fixed in the world".into());
        }
        let inner = ModelOptions { base, armature: 0.0, mesh_reader: options.mesh_reader, held: options.held };
        let mut model =
            Model::from_robot(&reader.robot, &inner).map_err(|e| with_reasons(in_words_of_mjcf(e), &reader))?;
        for frame in &reader.frames {
            let own = model.frames.iter_mut().find(|f| f.name == frame.name);
            if let Some(own) = own {
                own.link_from_frame.position += own.link_from_frame.rotation * frame.link_from_body;
            }
        }
        let stand = sections::stand(&tree, &reader, &model).map_err(|e| with_reasons(e, &reader))?;
        let gains = gains(&model, &reader, &actuators);
        model.left_out.splice(0..0, reader.left_out);
        say_gains(&mut model, &gains);
        Ok(Self { model, gains, stand, timestep })
    }
}

/// Puts the limits of actuators on their joints, where they are below the joints' own.
fn limit_efforts(reader: &mut Reader, actuators: &[Actuator]) {
    for joint in &mut reader.robot.joints {
        let own: Vec<f64> = actuators.iter().filter(|a| a.joint == joint.name).map(|a| a.effort).collect();
        // Those of several on one joint add up.
        let all: f64 = own.iter().sum();
        if !own.is_empty() && all.is_finite() {
            let stated = if joint.limit.effort > 0.0 { joint.limit.effort } else { f64::INFINITY };
            joint.limit.effort = stated.min(all);
        }
    }
    for actuator in actuators {
        if !reader.robot.joints.iter().any(|j| j.name == actuator.joint) {
            let joint = &actuator.joint;
            reader.left_out.push(format!("an actuator of joint `{joint}`, which no body of the robot has"));
        }
    }
}

/// The gains of the model's joints. Those of several actuators on one joint add up.
fn gains(model: &Model, reader: &Reader, actuators: &[Actuator]) -> Vec<Option<Gains>> {
    let drawn = |name: &String| reader.joints.iter().find(|(_, n, _)| n == name).map_or(0.0, |(_, _, at)| *at);
    let drawn: Vec<f64> = model.joint_names().iter().map(drawn).collect();
    let needs_inertias = actuators.iter().any(|a| a.damping_ratio.is_some());
    let inertias = if needs_inertias { apparent_inertias(model, &drawn) } else { vec![0.0; drawn.len()] };
    let of = |(j, name): (usize, &String)| {
        let own = actuators.iter().filter(|a| a.joint == *name);
        own.fold(None, |all: Option<Gains>, actuator| {
            let all = all.unwrap_or(Gains { kp: 0.0, kd: 0.0 });
            // Critical for the joint's inertia at the positions that the file draws.
            let critical = 2.0 * (actuator.kp * inertias[j]).sqrt();
            let kd = actuator.kd + actuator.damping_ratio.map_or(0.0, |ratio| ratio * critical);
            Some(Gains { kp: all.kp + actuator.kp, kd: all.kd + kd })
        })
    };
    model.joint_names().iter().enumerate().map(of).collect()
}

/// What the file says that a recording may not.
fn say_gains(model: &mut Model, gains: &[Option<Gains>]) {
    let mut kinds: Vec<(Gains, Vec<&str>)> = Vec::new();
    for (gains, name) in gains.iter().zip(model.joint_names()) {
        let Some(gains) = gains.filter(|g| g.kp > 0.0 || g.kd > 0.0) else { continue };
        match kinds.iter_mut().find(|(known, _)| *known == gains) {
            Some((_, names)) => names.push(name),
            None => kinds.push((gains, vec![name])),
        }
    }
    let one = |(g, names): &(Gains, Vec<&str>)| format!("kp {} kd {} of {}", g.kp, g.kd, names.join(" "));
    let all: Vec<String> = kinds.iter().map(one).collect();
    if !all.is_empty() {
        model.remarks.push(format!("the file's gains: {}", all.join("; ")));
    }
}

/// Adds what is not followed of the file, where its lack may be the reason: bodies that an element would have made, joints with
/// misspelt names, geoms whose shape is not known.
fn with_reasons(error: SimError, reader: &Reader) -> SimError {
    let SimError::Mjcf { element, expected, mut found } = error else { return error };
    // Other faults name their own line.
    if found.starts_with("none") || found.starts_with("no link") || element.starts_with("<key>") {
        let body = element.strip_prefix("body `").and_then(|rest| rest.strip_suffix('`'));
        let own = body.map_or_else(Vec::new, |body| reader.reasons_without_mass(body));
        let makers = schema::makers(reader.tree).into_iter().map(|what| format!("{what} is not followed"));
        for reason in own.into_iter().chain(makers).chain(schema::strange(reader.tree)) {
            found += &format!("; {reason}");
        }
    }
    SimError::Mjcf { element, expected, found }
}

/// What is wrong with the links and joints of a robot, said of bodies.
fn in_words_of_mjcf(error: SimError) -> SimError {
    match error {
        SimError::Link { link, expected, found } => {
            SimError::Mjcf { element: format!("body `{link}`"), expected, found }
        }
        SimError::Joint { joint, expected, found } => {
            SimError::Mjcf { element: format!("joint `{joint}`"), expected, found }
        }
        SimError::UrdfSyntax(found) => {
            SimError::Mjcf { element: "<worldbody>".into(), expected: "bodies that move".into(), found }
        }
        other => other,
    }
}
