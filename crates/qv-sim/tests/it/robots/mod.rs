//! Small robots for the tests.
#![allow(dead_code)]

use qv_core::TriangleMesh;
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, Precision, SimOptions, State, Terrain};

pub fn inertial(mass: f64, moment: f64) -> String {
    format!(
        r#"<inertial><mass value="{mass}"/><inertia ixx="{moment}" iyy="{moment}" izz="{moment}" ixy="0" ixz="0" iyz="0"/></inertial>"#
    )
}

/// A trunk with two legs of two joints, a sphere for each foot, an IMU, and one joint axis that is no coordinate axis.
pub fn biped_urdf() -> String {
    let mut legs = String::new();
    for (side, y) in [("left", 0.15), ("right", -0.15)] {
        legs += &format!(
            r#"<link name="{side}_thigh">{}</link>
            <joint name="{side}_hip" type="revolute"><parent link="trunk"/><child link="{side}_thigh"/><origin xyz="0 {y} -0.05"/>
              <axis xyz="0.1 1 0.05"/><limit lower="-1.2" upper="1.2" effort="40" velocity="20"/></joint>
            <link name="{side}_shank">{}<collision><origin xyz="0 0 -0.2"/><geometry><sphere radius="0.04"/></geometry></collision></link>
            <joint name="{side}_knee" type="revolute"><parent link="{side}_thigh"/><child link="{side}_shank"/>
              <origin xyz="0 0 -0.2" rpy="0 0.1 0"/><axis xyz="0 1 0"/><limit lower="-2" upper="0.1" effort="40" velocity="20"/></joint>"#,
            inertial(0.8, 0.004),
            inertial(0.4, 0.002)
        );
    }
    format!(
        r#"<robot name="biped"><link name="trunk">{}<collision><geometry><box size="0.2 0.3 0.1"/></geometry></collision></link>
        <link name="imu"/><joint name="imu_joint" type="fixed"><parent link="trunk"/><child link="imu"/><origin xyz="0.05 0 0.02"/></joint>
        {legs}</robot>"#,
        inertial(5.0, 0.05)
    )
}

pub fn model(urdf: &str, base: BaseKind) -> Model {
    Model::from_urdf(urdf, &ModelOptions { base, armature: 0.01, ..Default::default() }).unwrap()
}

/// A free body with one collision shape, 1 kg, given as the inside of `<geometry>`.
pub fn body(geometry: &str) -> Model {
    let urdf = format!(
        r#"<robot name="body"><link name="body">{}<collision><geometry>{geometry}</geometry></collision></link></robot>"#,
        inertial(1.0, 0.002)
    );
    model(&urdf, BaseKind::Floating)
}

/// The biped a little above the ground, knees bent, moving.
pub fn biped_state() -> State {
    State {
        q: vec![0.1, -0.2, 0.46, 0.98, 0.02, 0.05, 0.1, 0.1, -0.3, 0.05, -0.2],
        v: vec![0.3, 0.1, -0.2, 0.2, -0.1, 0.3, 0.5, -0.4, 0.2, 0.1],
    }
}

/// Commands the biped to a moving target and steps it.
pub fn drive<T: Precision>(sim: &mut Batch<T>, steps: usize, parallel: bool) {
    let (kp, kd, tau) = ([30.0; 4], [1.0; 4], [0.1; 4]);
    for k in 0..steps {
        let swing = 0.2 * (0.01 * k as f64).sin();
        let q = [0.1 + swing, -0.3 + 0.5 * swing, 0.05 - swing, -0.2 + 0.3 * swing];
        for env in 0..sim.len() {
            sim.set_command(env, &JointCommand { q: &q, dq: &[0.05; 4], kp: &kp, kd: &kd, tau: &tau }).unwrap();
        }
        if parallel { sim.step_parallel() } else { sim.step() }
    }
}

pub fn bits(state: &State) -> Vec<u64> {
    state.q.iter().chain(&state.v).map(|x| x.to_bits()).collect()
}

/// Steps a free body without joints.
pub fn settle(model: &Model, terrain: &Terrain, options: &SimOptions, state: &State, steps: usize) -> State {
    let mut sim = Batch::<f64>::new(model, terrain, options, 1).unwrap();
    sim.set_state(0, state).unwrap();
    sim.step_many(steps);
    assert!(!sim.is_faulty(0).unwrap());
    sim.state(0).unwrap()
}

/// A command of one joint.
#[derive(Clone, Copy, Default)]
pub struct Order {
    pub q: f64,
    pub dq: f64,
    pub kp: f64,
    pub kd: f64,
    pub tau: f64,
}

pub fn command<T: Precision>(sim: &mut Batch<T>, o: Order) {
    sim.set_command(0, &JointCommand { q: &[o.q], dq: &[o.dq], kp: &[o.kp], kd: &[o.kd], tau: &[o.tau] }).unwrap();
}

pub fn near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "found {found}, expected {expected} within {tolerance}");
}

/// The plane as two triangles.
pub fn tabletop() -> Terrain {
    let corner = |x: f64, y: f64| glam::DVec3::new(x, y, 0.0);
    let mesh = TriangleMesh {
        vertices: vec![corner(-5.0, -5.0), corner(5.0, -5.0), corner(5.0, 5.0), corner(-5.0, 5.0)],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Default::default()
    };
    Terrain::from_mesh(&mesh).unwrap()
}
