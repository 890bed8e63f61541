//! Joints of bodies.
//!
//! <https://mujoco.readthedocs.io/en/stable/XMLreference.html#body-joint>

use super::attributes::Attributes;
use super::frames::Compiler;
use super::tree::Tree;
use crate::SimError;
use crate::urdf::{Dynamics, JointElement, JointType, Limit, Origin};
use glam::DVec3;
use qv_core::Pose;

/// A hinge or slide.
pub(super) struct Joint {
    /// Without its origin and links.
    pub element: JointElement,
    /// In the body's frame \[m\].
    pub anchor: DVec3,
    /// The position at which the file draws it \[rad or m\].
    pub reference: f64,
    pub left_out: Vec<String>,
}

/// Whether an element is a free joint.
pub(super) fn is_free(tree: &Tree, element: usize) -> bool {
    match tree.element(element).tag.as_str() {
        "freejoint" => true,
        "joint" => tree.attribute(element, "type") == Some("free"),
        _ => false,
    }
}

/// A link that does not move in its parent.
pub(super) fn fixed(name: &str, line: usize, at: Pose) -> JointElement {
    JointElement {
        name: name.to_owned(),
        line,
        kind: JointType::Fixed,
        origin: Origin::from(at),
        parent: String::new(),
        child: String::new(),
        axis: [0.0, 0.0, 1.0],
        limit: Limit::default(),
        dynamics: None,
        armature: None,
        mimics: false,
    }
}

/// The joint of the free base, and what is left out of it.
pub(super) fn free(joint: &Attributes, name: &str, at: Pose) -> Result<(JointElement, Option<String>), SimError> {
    let tree = joint.tree;
    let line = tree.element(joint.element()).line;
    let element = JointElement { kind: JointType::Floating, ..fixed(name, line, at) };
    let mut lost = Vec::new();
    // A <freejoint> has none of these.
    for setting in
        ["damping", "armature", "frictionloss"].into_iter().filter(|_| tree.element(joint.element()).tag == "joint")
    {
        if joint.numbers(setting, 1, 8)?.is_some_and(|v| v.iter().any(|x| *x != 0.0)) {
            lost.push(setting);
        }
    }
    let words = format!("{} of the free joint `{name}` {}", lost.join(", "), tree.place(joint.element()));
    Ok((element, (!lost.is_empty()).then_some(words)))
}

/// A hinge or slide; `frame` is that around it in the body.
pub(super) fn read(joint: &Attributes, compiler: &Compiler, name: &str, frame: &Pose) -> Result<Joint, SimError> {
    let kind = match joint.text("type") {
        None | Some("hinge") => JointType::Revolute,
        Some("slide") => JointType::Prismatic,
        Some(other) => return Err(joint.error("hinge, slide or free as `type`", format!("`{other}`"))),
    };
    let turns = kind == JointType::Revolute;
    let angle = |x: f64| if turns { compiler.radians(x) } else { x };
    let axis = frame.transform_vector(DVec3::from_array(joint.vector("axis")?.unwrap_or([0.0, 0.0, 1.0])));
    let anchor = frame.transform_point(DVec3::from_array(joint.vector("pos")?.unwrap_or_default()));
    if axis.length() < 1e-6 {
        return Err(joint.error("an `axis` that is not zero", axis));
    }
    let range = joint.range("range", "limited", compiler.autolimits)?;
    let [lower, upper] = range.map_or([f64::NEG_INFINITY, f64::INFINITY], |r| r.map(angle));
    let force = joint.range("actuatorfrcrange", "actuatorfrclimited", compiler.autolimits)?;
    let least = |name: &str| {
        let value = joint.numbers(name, 1, 8)?.map_or(0.0, |v| v[0]);
        if value < 0.0 { Err(joint.error(format!("a `{name}` of at least 0"), value)) } else { Ok(value) }
    };
    let element = JointElement {
        kind,
        axis: axis.to_array(),
        limit: Limit { lower, upper, effort: force.map_or(0.0, largest), velocity: 0.0 },
        dynamics: Some(Dynamics { damping: least("damping")?, friction: least("frictionloss")? }),
        armature: Some(least("armature")?),
        ..fixed(name, joint.tree.element(joint.element()).line, Pose::IDENTITY)
    };
    let mut left_out = Vec::new();
    let place = joint.tree.place(joint.element());
    let mut lose = |what: String| left_out.push(format!("{what} of joint `{name}` {place}"));
    if least("stiffness")? > 0.0 {
        lose(format!("the spring (stiffness {})", least("stiffness")?));
    }
    if joint.numbers("damping", 1, 8)?.is_some_and(|v| v[1..].iter().any(|x| *x != 0.0)) {
        lose("damping that is no line".into());
    }
    if joint.text("springdamper").is_some() {
        lose("its springdamper".into());
    }
    Ok(Joint { element, anchor, reference: angle(joint.number_or("ref", 0.0)?), left_out })
}

/// The greater magnitude of a range.
pub(super) fn largest([low, high]: [f64; 2]) -> f64 {
    low.abs().max(high.abs())
}
