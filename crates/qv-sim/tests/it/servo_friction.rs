//! Friction of geared servos and springs beside motors against closed forms and against an integrator of its own.

use crate::robots::{inertial, model, near};
use qv_sim::{BaseKind, Batch, JointCommand, SimOptions, State, Terrain};

/// Inertia of the wheel about its axis: its own and the rotor's that `crate::robots::model` adds \[kg m²\].
const INERTIA: f64 = 0.05 + 0.01;
const STEP: f64 = 0.0005;

fn options() -> SimOptions {
    SimOptions { timestep: STEP, implicit_actuator_damping: false, ..Default::default() }
}

/// A wheel on a vertical axis: one joint, no gravity about it.
fn wheel(set: &[(&str, f64)]) -> Batch<f64> {
    let urdf = format!(
        r#"<robot name="wheel"><link name="bench"/><link name="wheel">{}</link>
        <joint name="axle" type="continuous"><parent link="bench"/><child link="wheel"/><axis xyz="0 0 1"/></joint></robot>"#,
        inertial(1.0, 0.05)
    );
    let mut sim = Batch::new(&model(&urdf, BaseKind::Fixed), &Terrain::none(), &options(), 1).unwrap();
    set.iter().for_each(|(name, value)| sim.set_parameter(0, name, *value).unwrap());
    sim
}

fn push(sim: &mut Batch<f64>, tau: f64) {
    sim.set_command(0, &JointCommand { q: &[0.0], dq: &[0.0], kp: &[0.0], kd: &[0.0], tau: &[tau] }).unwrap();
}

fn speed(sim: &Batch<f64>) -> f64 {
    sim.state(0).unwrap().v[0]
}

fn spin(sim: &mut Batch<f64>, speed: f64) {
    sim.set_state(0, &State { q: vec![0.0], v: vec![speed] }).unwrap();
}

/// Torque against motion at a speed, from the loss of speed over a step; `tau` is the motor's.
fn friction(set: &[(&str, f64)], at: f64, tau: f64) -> f64 {
    let mut sim = wheel(set);
    spin(&mut sim, at);
    push(&mut sim, tau);
    sim.step();
    tau - (speed(&sim) - at) / STEP * INERTIA
}

#[test]
fn friction_falls_with_speed_as_stribeck_says() {
    let set = [
        ("joint.axle.coulomb_friction", 0.1),
        ("joint.axle.stribeck_friction", 0.2),
        ("joint.axle.stribeck_speed", 0.5),
        ("joint.axle.stribeck_exponent", 1.5),
    ];
    for at in [0.25, 0.5, 1.0, 4.0] {
        near(friction(&set, at, 0.0), 0.1 + 0.2 * (-(at / 0.5f64).powf(1.5)).exp(), 1e-6);
    }
    // At rest all of it holds, and no more.
    let mut sim = wheel(&set);
    push(&mut sim, 0.29);
    sim.step_many(2000);
    // The solver holds softly, as MuJoCo's does: it creeps.
    near(speed(&sim), 0.0, 1e-2);
    push(&mut sim, 0.4);
    sim.step_many(400);
    assert!(speed(&sim) > 0.5, "{}", speed(&sim));
}

#[test]
fn friction_grows_with_the_torque_of_the_motor() {
    let set = [("joint.axle.coulomb_friction", 0.05), ("joint.axle.load_friction_motor", 0.3)];
    near(friction(&set, 2.0, 1.0), 0.05 + 0.3, 1e-6);
    near(friction(&set, 2.0, -1.0), 0.05 + 0.3, 1e-6);
    near(friction(&set, 2.0, 0.0), 0.05, 1e-6);
    let at_rest = [("joint.axle.stribeck_load_friction_motor", 0.3), ("joint.axle.stribeck_speed", 1.0)];
    near(friction(&at_rest, 1.0, 2.0), 0.3 * 2.0 * (-1.0f64).exp(), 1e-6);
}

#[test]
fn torques_from_outside_load_a_gear_too_and_may_be_held_by_it() {
    let held = |share: f64| {
        let set = [("joint.axle.load_friction_external", share), ("joint.axle.external_torque", 3.0)];
        let mut sim = wheel(&set);
        push(&mut sim, 0.0);
        sim.step_many(400);
        speed(&sim)
    };
    // A worm gear does not turn back; a spur gear does, with what friction leaves.
    let free = 3.0 / INERTIA * 400.0 * STEP;
    near(held(1.2), 0.0, 0.01 * free);
    near(held(0.4), 0.6 * free, 1e-3 * free);
    // Motor and outside work against each other: both load the teeth.
    let both = [
        ("joint.axle.load_friction_external", 0.1),
        ("joint.axle.load_friction_motor", 0.2),
        ("joint.axle.external_torque", -1.0),
    ];
    let mut sim = wheel(&both);
    spin(&mut sim, 5.0);
    push(&mut sim, 2.0);
    sim.step();
    near((speed(&sim) - 5.0) / STEP * INERTIA, 2.0 - 1.0 - (0.2 * 2.0 + 0.1), 1e-6);
}

#[test]
fn the_quadratic_part_depends_on_which_side_drives() {
    let of = |motor: f64, external: f64| {
        let set = [
            ("joint.axle.quadratic_load_friction_motor", 0.01),
            ("joint.axle.quadratic_load_friction_external", 0.02),
            ("joint.axle.stribeck_speed", 1e9),
            ("joint.axle.external_torque", external),
        ];
        let mut sim = wheel(&set);
        spin(&mut sim, 1.0);
        push(&mut sim, motor);
        sim.step();
        motor + external - (speed(&sim) - 1.0) / STEP * INERTIA
    };
    near(of(3.0, -1.0), 0.02, 1e-6);
    near(of(1.0, -3.0), 0.01, 1e-6);
    near(of(3.0, 1.0), 0.0, 1e-6);
}

#[test]
fn drag_ends_in_the_speed_at_which_it_takes_all_torque() {
    let mut sim = wheel(&[("joint.axle.quadratic_drag", 0.02)]);
    push(&mut sim, 0.5);
    sim.step_many(8000);
    near(speed(&sim), (0.5f64 / 0.02).sqrt(), 1e-3);
}

#[test]
fn springs_have_slack_and_constant_torques_do_not_end() {
    let set = [
        ("joint.axle.spring_stiffness", 2.0),
        ("joint.axle.spring_rest", 0.5),
        ("joint.axle.spring_slack", 0.1),
        ("joint.axle.viscous_friction", 0.5),
    ];
    let rests_at = |more: &[(&str, f64)], tau: f64| {
        let mut sim = wheel(&[&set, more].concat());
        push(&mut sim, tau);
        sim.step_many(20_000);
        sim.state(0).unwrap().q[0]
    };
    near(rests_at(&[], 0.4), 0.5 + 0.1 + 0.2, 1e-4);
    near(rests_at(&[], -0.4), 0.5 - 0.1 - 0.2, 1e-4);
    near(rests_at(&[("joint.axle.constant_torque", -0.2)], 0.4), 0.5 + 0.1 + 0.1, 1e-4);
}

#[test]
fn a_motor_may_be_stronger_one_way() {
    let of = |tau: f64| {
        let mut sim = wheel(&[("actuator.axle.strength", 0.9), ("actuator.axle.strength_asymmetry", 0.1)]);
        push(&mut sim, tau);
        sim.step();
        sim.sensors(0).unwrap().tau[0]
    };
    near(of(2.0), 2.0, 1e-12);
    near(of(-2.0), -1.6, 1e-12);
}

/// A pendulum of 0.5 kg on 0.15 m whose servo follows a sine, its friction that of a published servo (M6), against a plain integrator
/// at a hundredth of the step: sticking, sliding, back-driving.
#[test]
fn a_servo_on_a_pendulum_moves_as_an_integrator_of_its_own_says() {
    let (mass, arm, kp, kd) = (0.5, 0.15, 10.0, 0.2);
    let [coulomb, stribeck, motor, external, motor0, external0, quad_motor, quad_external, vs, alpha, viscous] =
        [0.02, 0.03, 0.05, 0.24, 0.02, 0.14, 0.0076, 0.0034, 0.37, 1.5, 0.028];
    let urdf = format!(
        r#"<robot name="p"><link name="bench"/><link name="arm"><inertial><origin xyz="0 0 -{arm}"/><mass value="{mass}"/>
        <inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="axle" type="continuous"><parent link="bench"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>"#
    );
    let mut sim = Batch::<f64>::new(&model(&urdf, BaseKind::Fixed), &Terrain::none(), &options(), 1).unwrap();
    let set = [
        ("coulomb_friction", coulomb),
        ("stribeck_friction", stribeck),
        ("load_friction_motor", motor),
        ("load_friction_external", external),
        ("stribeck_load_friction_motor", motor0),
        ("stribeck_load_friction_external", external0),
        ("quadratic_load_friction_motor", quad_motor),
        ("quadratic_load_friction_external", quad_external),
        ("stribeck_speed", vs),
        ("stribeck_exponent", alpha),
        ("viscous_friction", viscous),
    ];
    set.iter().for_each(|(name, value)| sim.set_parameter(0, &format!("joint.axle.{name}"), *value).unwrap());
    let inertia = mass * arm * arm + 1e-5 + 0.01;
    let (mut q, mut v) = (0.0f64, 0.0f64);
    let fine = 100;
    let h = STEP / f64::from(fine);
    let mut worst = 0.0f64;
    let mut farthest = 0.0f64;
    for k in 0..8000 {
        let target = 1.2 * (2.0 * f64::from(k) * STEP).sin();
        sim.set_command(0, &JointCommand { q: &[target], dq: &[0.0], kp: &[kp], kd: &[kd], tau: &[0.0] }).unwrap();
        sim.step();
        for _ in 0..fine {
            let m = kp * (target - q) - kd * v;
            let e = -mass * 9.81 * arm * q.sin();
            let at_rest = (-(v.abs() / vs).powf(alpha)).exp();
            let squared = if e.abs() < m.abs() { quad_external * e * e } else { quad_motor * m * m };
            let rest = stribeck + (motor0 * m - external0 * e).abs() + if m * e < 0.0 { squared } else { 0.0 };
            let dry = coulomb + (motor * m - external * e).abs() + at_rest * rest;
            let free = v + h * (m + e - viscous * v) / inertia;
            v = free.signum() * (free.abs() - h * dry / inertia).max(0.0);
            q += h * v;
        }
        worst = worst.max((sim.state(0).unwrap().q[0] - q).abs());
        farthest = farthest.max(q);
    }
    // The solver's friction is soft (MuJoCo's), and it creeps where the other sticks.
    assert!(farthest > 0.9 && worst < 0.012, "swings to {farthest}, off by {worst}");
}

#[test]
fn a_rotor_that_is_stated_beside_the_model_holds_as_one_within_it() {
    // MuJoCo's dry friction creeps at `0.001 w F` (w the joint's inverse inertia): 1 - 0.9 over 0.9 of it, by a damping of 2 / (0.95 x 0.02 s).
    let creep = |set: &[(&str, f64)]| {
        let mut sim = wheel(set);
        push(&mut sim, 0.06);
        sim.step_many(2000);
        speed(&sim)
    };
    for armature in [0.01, 0.4, 2.0] {
        let found = creep(&[("joint.axle.armature", armature), ("joint.axle.coulomb_friction", 0.09)]);
        let expected = 0.06 / (0.05 + armature) * (0.1 / 0.9) / (2.0 / (0.95 * 0.02));
        near(found / expected, 1.0, 0.02);
    }
}
