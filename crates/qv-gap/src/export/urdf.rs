//! The corrections written into a robot's URDF: friction, damping and limits of joints, mass properties of links.

use super::advice::advice;
use super::corrected::{Body, CorrectionTarget, Entry, ModelCorrections};
use super::xml::{Edits, write_edits};
use crate::GapError;
use crate::report::Correction;
use glam::{DMat3, DVec3};
use qv_core::Pose;
use qv_sim::Model;
use qv_sim::urdf::{Inertial, Robot};

/// Limit that means none, for a `<limit>` that must state both.
const NO_LIMIT: f64 = 1e9;

/// `original_urdf` with the corrections in it, and what a URDF cannot say (rotor inertias that are known included), one line for each kind
/// with what to do with it elsewhere. Everything that no correction changes stays as it is, byte by byte. `model` is the one that was read from this
/// URDF.
///
/// A moving link may be several links of the URDF, fixed to each other: then the heaviest of them takes the change, or, where
/// no body could, the mass properties of all of them, which is said.
///
/// # Errors
/// When the text is no URDF, or has no joint or link of the model's names.
pub fn to_urdf(
    original_urdf: &str,
    model: &Model,
    corrections: &[Correction],
) -> Result<(String, Vec<String>), GapError> {
    let robot = Robot::parse(original_urdf).map_err(|e| wrong("a robot", &e.to_string()))?;
    let corrected = ModelCorrections::new(model, corrections);
    let mut edits = Edits::default();
    for j in 0..model.joints.len() {
        joint_edits(&corrected, &robot, j, &mut edits)?;
    }
    let mut notes = Vec::new();
    let mut moved = Vec::new();
    for l in (0..model.links.len()).filter(|&l| corrected.changes_link(l)) {
        if link_edits(&corrected, &robot, l, &mut edits, &mut notes)? {
            moved.push(l);
        }
    }
    let known = with_armature(model, corrections);
    notes.extend(advice(&ModelCorrections::new(model, &known), |e| is_said(&corrected, e, &moved)));
    let text = write_edits(original_urdf, &edits).map_err(|e| wrong("well-formed XML", &e))?;
    Ok((text, notes))
}

/// The corrections, and the rotor inertias of the model that none of them changes: no URDF states them, and without them its
/// reader has another robot.
fn with_armature(model: &Model, corrections: &[Correction]) -> Vec<Correction> {
    let known = model.joints.iter().filter(|j| j.armature != 0.0).map(|j| Correction {
        parameter: format!("joint.{}.armature", j.name),
        value: j.armature,
        nominal: j.armature,
        unit: "kg m²".into(),
    });
    // Of two of one parameter the later holds.
    known.chain(corrections.iter().cloned()).collect()
}

fn wrong(expected: &str, found: &str) -> GapError {
    GapError::run("URDF", expected, found)
}

fn joint_edits(corrected: &ModelCorrections, robot: &Robot, j: usize, edits: &mut Edits) -> Result<(), GapError> {
    let name = &corrected.model.joints[j].name;
    let of = |field: &str, attribute: &'static str| corrected.joint(j, field).map(|v| (attribute, v));
    let (stated, own) = (&corrected.model.joints[j], robot.joints.iter().find(|joint| joint.name == *name));
    let dynamics = own.and_then(|joint| joint.dynamics.as_ref());
    // What the recording states of a joint and the URDF does not is written, too.
    let friction = |field: &str, attribute: &'static str, stated: f64, own: Option<f64>| {
        of(field, attribute).or(Some((attribute, stated)).filter(|_| stated != own.unwrap_or(0.0)))
    };
    let dynamics: Vec<_> = [
        friction("viscous_friction", "damping", stated.viscous_friction, dynamics.map(|d| d.damping)),
        friction("coulomb_friction", "friction", stated.coulomb_friction, dynamics.map(|d| d.friction)),
    ]
    .into_iter()
    .flatten()
    .collect();
    let mut limit: Vec<_> =
        [of("torque_limit", "effort"), of("speed_knee", "velocity")].into_iter().flatten().collect();
    if dynamics.is_empty() && limit.is_empty() {
        return Ok(());
    }
    let joint = own.ok_or_else(|| wrong(&format!("joint `{name}` of the model"), "none of that name"))?;
    if !limit.is_empty() && joint.limit.effort == 0.0 && joint.limit.velocity == 0.0 {
        // Where the URDF states no limits, a reader asks for both as soon as there is one.
        for attribute in ["effort", "velocity"] {
            if limit.iter().all(|(a, _)| *a != attribute) {
                limit.push((attribute, NO_LIMIT));
            }
        }
    }
    edits.set_attributes(name, "dynamics", dynamics);
    edits.set_attributes(name, "limit", limit);
    Ok(())
}

/// Whether the change of the moving link `l` could be written.
fn link_edits(
    corrected: &ModelCorrections,
    robot: &Robot,
    l: usize,
    edits: &mut Edits,
    notes: &mut Vec<String>,
) -> Result<bool, GapError> {
    let name = &corrected.model.links[l].name;
    let Some(whole) = corrected.body(l) else {
        notes.push(format!("link {name}: the corrections leave it no mass; its mass properties stay as they are."));
        return Ok(false);
    };
    let members = members(corrected.model, robot, l)?;
    let heaviest = (0..members.len()).max_by(|&a, &b| members[a].body.mass.total_cmp(&members[b].body.mass));
    let heaviest = heaviest.ok_or_else(|| wrong(&format!("link `{name}` of the model"), "none of that name"))?;
    let rest = members.iter().enumerate().filter(|(m, _)| *m != heaviest).map(|(_, member)| &member.body);
    let own = rest.into_iter().try_fold(
        whole,
        |sum, other| {
            if other.mass > 0.0 { sum.welded(&other.negated()) } else { Some(sum) }
        },
    );
    let target = &members[heaviest];
    if let Some(body) = own.map(|b| without_dust(&b)).filter(is_possible) {
        edits.set_inertial(&target.name, Some(inertial(&body, &target.carrier_from_link)));
        return Ok(true);
    }
    if !is_possible(&whole) {
        notes.push(format!(
            "link {name}: no body has the mass properties that the corrections give it; they stay as they are."
        ));
        return Ok(false);
    }
    let others: Vec<&str> = members.iter().map(|m| m.name.as_str()).filter(|n| *n != target.name).collect();
    others.iter().for_each(|other| edits.set_inertial(other, None));
    edits.set_inertial(&target.name, Some(inertial(&whole, &target.carrier_from_link)));
    notes.push(format!("link {}: it now has the mass properties of {} as well.", target.name, others.join(", ")));
    Ok(true)
}

/// A link of the URDF that a moving link consists of.
struct Member {
    name: String,
    carrier_from_link: Pose,
    /// In the carrier's frame.
    body: Body,
}

fn members(model: &Model, robot: &Robot, l: usize) -> Result<Vec<Member>, GapError> {
    let frames = model.frames.iter().filter(|f| f.link == Some(l));
    let member = |frame: &qv_sim::Frame| {
        let link = robot.links.iter().find(|link| link.name == frame.name);
        let link = link.ok_or_else(|| wrong(&format!("link `{}` of the model", frame.name), "none of that name"))?;
        let none = Inertial { line: link.line, origin: Default::default(), mass: 0.0, inertia: [0.0; 6] };
        let own = link.inertial.unwrap_or(none);
        let origin = Pose::from_xyz_rpy(own.origin.xyz, own.origin.rpy);
        let [xx, xy, xz, yy, yz, zz] = own.inertia;
        let columns = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
        let [x, y, z] = columns.map(DVec3::from_array);
        let body = Body { mass: own.mass, com: DVec3::ZERO, inertia: DMat3::from_cols(x, y, z) };
        let body = body.transformed(&origin).transformed(&frame.link_from_frame);
        Ok(Member { name: link.name.clone(), carrier_from_link: frame.link_from_frame, body })
    };
    frames.map(member).collect()
}

/// What rounding leaves of an inertia that is zero (a point mass) is no body's; a URDF may say zero.
fn without_dust(body: &Body) -> Body {
    let dust = 1e-13 * body.mass;
    let none = body.moments().iter().all(|x| x.abs() < dust);
    Body { inertia: if none { DMat3::ZERO } else { body.inertia }, ..*body }
}

fn is_possible(body: &Body) -> bool {
    body.is_physical() || (body.mass > 0.0 && body.inertia == DMat3::ZERO)
}

/// The element, for a body in the carrier's frame, in the frame of one of its links.
fn inertial(body: &Body, carrier_from_link: &Pose) -> String {
    let own = body.transformed(&carrier_from_link.inverse());
    // Adding zero makes a negative zero positive.
    let [x, y, z] = (own.com + DVec3::ZERO).to_array();
    let [ixx, iyy, izz, ixy, ixz, iyz] = own.moments().map(|m| m + 0.0);
    format!(
        "<inertial><origin xyz=\"{x} {y} {z}\" rpy=\"0 0 0\"/><mass value=\"{}\"/>\
         <inertia ixx=\"{ixx}\" ixy=\"{ixy}\" ixz=\"{ixz}\" iyy=\"{iyy}\" iyz=\"{iyz}\" izz=\"{izz}\"/></inertial>",
        own.mass
    )
}

fn is_said(corrected: &ModelCorrections, entry: &Entry, moved: &[usize]) -> bool {
    match entry.part {
        CorrectionTarget::Joint(j) => match entry.field {
            "viscous_friction" | "coulomb_friction" | "torque_limit" | "speed_knee" => true,
            "speed_zero" => {
                // A velocity limit means that torque along the motion is gone a tenth above it.
                let knee = corrected.joint(j, "speed_knee").unwrap_or(corrected.model.joints[j].velocity);
                (entry.correction.value / knee - 1.1).abs() < 0.005
            }
            _ => false,
        },
        CorrectionTarget::Link(l) => moved.contains(&l) && entry.field != "length_scale",
        _ => false,
    }
}
