//! What another reader of URDF makes of the robots that ours reads and writes: `urdf-rs`, which knows nothing of this one.

use glam::DVec3;
use qv_core::Pose;
use qv_gap::export::to_urdf;
use qv_gap::report::Correction;
use qv_sim::{BaseKind, JointKind, Model, ModelOptions};
use urdf_rs::{JointType, Robot};

use crate::two_links::ARM;

/// World from each link at zero, by the chain of joint origins; the root at the world's origin.
fn placed(robot: &Robot, link: &str) -> Pose {
    match robot.joints.iter().find(|j| j.child.link == link) {
        None => Pose::IDENTITY,
        Some(joint) => placed(robot, &joint.parent.link) * Pose::from_xyz_rpy(joint.origin.xyz.0, joint.origin.rpy.0),
    }
}

/// Compares a model with what the witness read from the same text.
fn agrees(text: &str, base: BaseKind) {
    let model = Model::from_urdf(text, &ModelOptions { base, ..Default::default() }).unwrap();
    let robot = urdf_rs::read_from_string(text).unwrap();
    let mass: f64 = robot.links.iter().map(|l| l.inertial.mass.value).sum();
    let ours: f64 = model.links.iter().map(|l| l.mass).sum();
    assert!((mass - ours).abs() < 1e-9 * mass.max(1.0), "{}: {ours} kg, witness {mass}", model.name);
    let mut zero = vec![0.0; model.nq()];
    if base == BaseKind::Floating {
        zero[3] = 1.0;
    }
    let poses = model.world_from_links(&zero);
    let moving: Vec<_> = robot.joints.iter().filter(|j| !matches!(j.joint_type, JointType::Fixed)).collect();
    assert_eq!(moving.len(), model.joints.len(), "{}", model.name);
    for joint in moving {
        let own = model.joints.iter().find(|j| j.name == joint.name).unwrap_or_else(|| panic!("no {}", joint.name));
        let axis = DVec3::from_array(joint.axis.xyz.0).normalize();
        assert!((own.axis - axis).length() < 1e-9, "{}: {} {axis}", joint.name, own.axis);
        assert_eq!(own.kind == JointKind::Prismatic, joint.joint_type == JointType::Prismatic, "{}", joint.name);
        let theirs = [joint.limit.lower, joint.limit.upper, joint.limit.effort, joint.limit.velocity];
        assert_eq!([own.lower, own.upper, own.effort, own.velocity], theirs, "{}", joint.name);
        let damping = joint.dynamics.as_ref().map_or([0.0; 2], |d| [d.damping, d.friction]);
        assert_eq!([own.viscous_friction, own.coulomb_friction], damping, "{}", joint.name);
        let at = placed(&robot, &joint.child.link);
        assert!((at.position - poses[own.link].position).length() < 1e-9, "{}", joint.child.link);
        assert!(at.rotation.dot(poses[own.link].rotation).abs() > 1.0 - 1e-12, "{}", joint.child.link);
    }
}

#[test]
fn another_reader_sees_the_robots_that_ours_reads_and_writes() {
    agrees(ARM, BaseKind::Fixed);
    let go2 = qv_go2::model::urdf();
    agrees(&go2, BaseKind::Floating);
    let model = Model::from_urdf(&go2, &ModelOptions { base: BaseKind::Floating, ..Default::default() }).unwrap();
    let correction =
        |parameter: &str, value: f64| Correction { parameter: parameter.into(), value, nominal: 0.0, unit: "1".into() };
    let found = [
        correction("link.base.payload_mass", 1.2),
        correction("link.base.com_x", 0.02),
        correction("joint.FL_calf_joint.coulomb_friction", 0.3),
        correction("joint.RR_hip_joint.viscous_friction", 0.1),
        correction("actuator.FR_thigh_joint.torque_limit", 12.0),
    ];
    let (text, unsaid) = to_urdf(&go2, &model, &found).unwrap();
    assert!(unsaid.is_empty() && text != go2, "{unsaid:?}");
    agrees(&text, BaseKind::Floating);
}
