//! Good and bad URDFs.

use crate::robots::{biped_urdf, inertial};
use qv_sim::{BaseKind, JointKind, Model, ModelOptions, SimError};

fn read(urdf: &str) -> Result<Model, SimError> {
    Model::from_urdf(urdf, &ModelOptions::default())
}

fn chain(second: &str, joint: &str) -> String {
    format!(r#"<robot name="r"><link name="base">{}</link>{second}{joint}</robot>"#, inertial(1.0, 0.01))
}

const JOINT: &str = r#"<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 2"/><limit lower="-1" upper="1" effort="3" velocity="4"/></joint>"#;

fn arm(inertial: &str) -> String {
    format!(r#"<link name="arm">{inertial}</link>"#)
}

#[test]
fn fixed_joints_merge() {
    let robot = read(&biped_urdf()).unwrap();
    assert_eq!(robot.joint_names(), ["left_hip", "left_knee", "right_hip", "right_knee"]);
    assert_eq!((robot.nq(), robot.nv(), robot.links.len()), (11, 10, 5));
    assert!((robot.mass() - 7.4).abs() < 1e-12);
    let imu = robot.frame("imu").unwrap();
    assert_eq!(imu.link, Some(0));
    assert!((imu.link_from_frame.position - glam::DVec3::new(0.05, 0.0, 0.02)).length() < 1e-15);
}

#[test]
fn joints_keep_their_limits_and_axes() {
    let robot = read(&chain(&arm(&inertial(0.5, 0.001)), JOINT)).unwrap();
    let joint = &robot.joints[0];
    assert_eq!((joint.lower, joint.upper, joint.effort, joint.velocity), (-1.0, 1.0, 3.0, 4.0));
    assert_eq!((joint.axis, joint.kind), (glam::DVec3::Z, JointKind::Revolute));
    let slider = JOINT.replace("revolute", "prismatic");
    let robot = read(&chain(&arm(&inertial(0.5, 0.001)), &slider)).unwrap();
    assert_eq!(robot.joints[0].kind, JointKind::Prismatic);
    let wheel = JOINT.replace("revolute", "continuous");
    let robot = read(&chain(&arm(&inertial(0.5, 0.001)), &wheel)).unwrap();
    assert_eq!((robot.joints[0].lower, robot.joints[0].upper), (f64::NEG_INFINITY, f64::INFINITY));
}

#[test]
fn bad_files_name_the_link_or_joint() {
    let good = inertial(0.5, 0.001);
    let cases = [
        ("no inertia", chain(&arm(""), JOINT), "arm"),
        ("negative mass", chain(&arm(&inertial(-0.5, 0.001)), JOINT), "arm"),
        ("NaN mass", chain(&arm(&good.replace("0.5", "NaN")), JOINT), "arm"),
        ("infinite inertia", chain(&arm(&good.replace("izz=\"0.001\"", "izz=\"inf\"")), JOINT), "arm"),
        ("unknown parent", chain(&arm(&good), &JOINT.replace("link=\"base\"", "link=\"ghost\"")), "ghost"),
        ("unknown child", chain(&arm(&good), &JOINT.replace("link=\"arm\"", "link=\"ghost\"")), "ghost"),
        ("NaN axis", chain(&arm(&good), &JOINT.replace("0 0 2", "0 0 NaN")), "`j`"),
        ("zero axis", chain(&arm(&good), &JOINT.replace("0 0 2", "0 0 0")), "`j`"),
        ("planar joint", chain(&arm(&good), &JOINT.replace("revolute", "planar")), "`j`"),
        ("two links of a name", chain(&(arm(&good) + &arm(&good)), JOINT), "arm"),
        ("two roots", chain(&(arm(&good) + r#"<link name="alone"/>"#), JOINT), "alone"),
        ("two parents", chain(&arm(&good), &(JOINT.to_owned() + &JOINT.replace("\"j\"", "\"k\""))), "arm"),
        (
            "a loop beside the tree",
            chain(
                &(arm(&good) + r#"<link name="a"/><link name="b"/>"#),
                &(JOINT.to_owned()
                    + r#"<joint name="ab" type="fixed"><parent link="a"/><child link="b"/></joint>"#
                    + r#"<joint name="ba" type="fixed"><parent link="b"/><child link="a"/></joint>"#),
            ),
            "`a`",
        ),
        (
            "a loop alone",
            r#"<robot name="r"><link name="a"/><link name="b"/>
               <joint name="ab" type="fixed"><parent link="a"/><child link="b"/></joint>
               <joint name="ba" type="fixed"><parent link="b"/><child link="a"/></joint></robot>"#
                .to_owned(),
            "loop",
        ),
        ("not XML", "robot".to_owned(), "URDF"),
        ("empty", String::new(), "URDF"),
        ("no links", r#"<robot name="r"></robot>"#.to_owned(), "URDF"),
    ];
    for (what, urdf, named) in cases {
        let error = read(&urdf).map(|_| ()).expect_err(what).to_string();
        assert!(error.contains(named), "{what}: expected `{named}` in `{error}`");
        assert!(error.contains("expected"), "{what}: {error}");
    }
}

#[test]
fn a_fixed_base_is_the_world() {
    let urdf = chain(&arm(&inertial(0.5, 0.001)), JOINT);
    let robot = Model::from_urdf(&urdf, &ModelOptions { base: BaseKind::Fixed, ..Default::default() }).unwrap();
    assert_eq!((robot.nq(), robot.nv(), robot.links.len()), (1, 1, 1));
    assert!((robot.mass() - 0.5).abs() < 1e-12);
}

#[test]
fn a_long_chain_does_not_overflow_the_stack() {
    let mut urdf = format!(r#"<robot name="r"><link name="l0">{}</link>"#, inertial(1.0, 0.01));
    for i in 1..20_000 {
        urdf += &format!(
            r#"<link name="l{i}"/><joint name="j{i}" type="fixed"><parent link="l{}"/><child link="l{i}"/></joint>"#,
            i - 1
        );
    }
    assert_eq!(read(&(urdf + "</robot>")).unwrap().links.len(), 1);
}

/// Damaged copies of a good file either read or fail with a message; they never panic.
#[test]
fn damaged_files_do_not_panic() {
    let good = biped_urdf();
    let mut seed = 1u64;
    let mut random = move |below: usize| {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (seed >> 33) as usize % below
    };
    let mut failed = 0;
    for _ in 0..500 {
        let mut bytes = good.clone().into_bytes();
        for _ in 0..1 + random(4) {
            let at = random(bytes.len());
            match random(3) {
                0 => bytes[at] = b"0123456789-.<>\"/=exN "[random(21)],
                1 => drop(bytes.drain(at..(at + random(30)).min(bytes.len()))),
                _ => bytes.truncate(at.max(1)),
            }
        }
        failed += usize::from(read(&String::from_utf8_lossy(&bytes)).is_err());
    }
    assert!(failed > 100, "only {failed} of 500 damaged files were refused");
}
