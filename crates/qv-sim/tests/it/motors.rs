//! Motors, sensors and outside forces against closed forms, on bodies simple enough to have them.

use crate::robots::{Order, command, inertial, model, near};
use qv_sim::{BaseKind, Batch, SimOptions, State, Terrain};

/// Inertia of the wheel about its axis: its own and the rotor's that `crate::robots::model` adds \[kg m²\].
const INERTIA: f64 = 0.05 + 0.01;

/// A wheel on a vertical axis: one joint, no gravity about it.
fn wheel(options: &SimOptions, limits: &str) -> Batch<f64> {
    let urdf = format!(
        r#"<robot name="wheel"><link name="bench"/><link name="wheel">{}</link>
        <joint name="axle" type="continuous"><parent link="bench"/><child link="wheel"/><axis xyz="0 0 1"/>{limits}</joint></robot>"#,
        inertial(1.0, 0.05)
    );
    Batch::new(&model(&urdf, BaseKind::Fixed), &Terrain::none(), options, 1).unwrap()
}

fn explicit() -> SimOptions {
    SimOptions {
        implicit_actuator_damping: false,
        max_command_latency: 0.02,
        max_sensor_latency: 0.02,
        ..Default::default()
    }
}

/// Torque of the first step for one command at rest \[N m\].
fn torque(set: &[(&str, f64)], order: Order) -> f64 {
    let mut sim = wheel(&explicit(), "");
    set.iter().for_each(|(name, value)| sim.set_parameter(0, name, *value).unwrap());
    command(&mut sim, order);
    sim.step();
    let found = sim.sensors(0).unwrap().tau[0];
    near(sim.state(0).unwrap().v[0], found / INERTIA * 0.001, 1e-12);
    found
}

#[test]
fn each_part_of_a_command_gives_its_torque() {
    let all = Order { q: 0.2, dq: 0.5, kp: 10.0, kd: 2.0, tau: 0.3 };
    near(torque(&[], Order { tau: 0.3, ..Default::default() }), 0.3, 1e-12);
    near(torque(&[], Order { q: 0.2, kp: 10.0, ..Default::default() }), 2.0, 1e-12);
    near(torque(&[], Order { dq: 0.5, kd: 2.0, ..Default::default() }), 1.0, 1e-12);
    near(torque(&[], all), 3.3, 1e-12);
    near(torque(&[("actuator.axle.strength", 0.5)], all), 1.65, 1e-12);
    near(torque(&[("actuator.axle.kp_scale", 0.5)], all), 2.3, 1e-12);
    near(torque(&[("actuator.axle.kd_scale", 0.5)], all), 2.8, 1e-12);
    near(torque(&[("actuator.axle.torque_limit", 1.5)], all), 1.5, 1e-12);
    near(torque(&[("actuator.axle.position_torque_limit", 0.7)], all), 0.7 + 1.0, 1e-12);
    // The controller sees the encoder, not the joint.
    near(torque(&[("sensor.axle.encoder_bias", 0.05)], all), 3.3 - 0.5, 1e-12);
}

#[test]
fn a_biased_encoder_moves_the_joint_to_the_wrong_place() {
    let mut sim = wheel(&explicit(), "");
    sim.set_parameter(0, "sensor.axle.encoder_bias", 0.1).unwrap();
    command(&mut sim, Order { q: 0.3, kp: 20.0, kd: 2.0, ..Default::default() });
    sim.step_many(5000);
    near(sim.state(0).unwrap().q[0], 0.2, 1e-6);
    near(sim.sensors(0).unwrap().q[0], 0.3, 1e-6);
}

#[test]
fn a_lag_answers_a_step_exponentially() {
    let mut sim = wheel(&explicit(), "");
    sim.set_parameter(0, "actuator.axle.lag", 0.01).unwrap();
    command(&mut sim, Order::default());
    sim.step();
    command(&mut sim, Order { tau: 1.0, ..Default::default() });
    sim.step_many(10);
    near(sim.sensors(0).unwrap().tau[0], 1.0 - (-1.0f64).exp(), 1e-9);
}

#[test]
fn a_lag_goes_on_from_where_it_was() {
    let mut sim = wheel(&explicit(), "");
    sim.set_parameter(0, "actuator.axle.lag", 0.01).unwrap();
    assert!(sim.set_lagged_torques(0, &[1.0, 2.0]).is_err() && sim.set_lagged_torques(0, &[f64::NAN]).is_err());
    sim.set_lagged_torques(0, &[1.0]).unwrap();
    command(&mut sim, Order::default());
    sim.step_many(10);
    near(sim.sensors(0).unwrap().tau[0], (-1.0f64).exp(), 1e-9);
    // A new state forgets it.
    let at_rest = State { q: vec![0.0], v: vec![0.0] };
    sim.set_state(0, &at_rest).unwrap();
    command(&mut sim, Order { tau: 1.0, ..Default::default() });
    sim.step();
    near(sim.sensors(0).unwrap().tau[0], 1.0, 1e-12);
}

#[test]
fn all_of_a_command_is_late() {
    for late in [
        Order { tau: 1.0, ..Default::default() },
        Order { q: 1.0, kp: 1.0, ..Default::default() },
        Order { dq: 1.0, kd: 1.0, ..Default::default() },
    ] {
        let mut sim = wheel(&explicit(), "");
        sim.set_parameter(0, "actuator.axle.command_latency", 0.0025).unwrap();
        command(&mut sim, Order::default());
        sim.step();
        command(&mut sim, late);
        let torques: Vec<f64> = (0..4)
            .map(|_| {
                sim.step();
                sim.sensors(0).unwrap().tau[0]
            })
            .collect();
        assert_eq!(&torques[..2], [0.0, 0.0]);
        // Half a step is half of the new command, gains and targets alike; then all of it.
        let half = if late.tau > 0.0 { 0.5 } else { 0.25 };
        near(torques[2], half, 1e-12);
        near(torques[3], 1.0, 1e-2);
    }
}

#[test]
fn a_motor_stops_driving_at_its_speed_limit_and_still_brakes() {
    let mut sim = wheel(&explicit(), r#"<limit lower="0" upper="0" effort="5" velocity="10"/>"#);
    command(&mut sim, Order { tau: 5.0, ..Default::default() });
    sim.step_many(3000);
    let speed = sim.state(0).unwrap().v[0];
    assert!(speed > 10.0 && speed < 11.001, "{speed} rad/s");
    command(&mut sim, Order { tau: -5.0, ..Default::default() });
    sim.step();
    near(sim.sensors(0).unwrap().tau[0], -5.0, 1e-12);
}

#[test]
fn a_new_state_forgets_the_command() {
    let mut sim = wheel(&explicit(), "");
    command(&mut sim, Order { tau: 5.0, ..Default::default() });
    sim.step_many(10);
    sim.set_state(0, &State { q: vec![0.0], v: vec![0.0] }).unwrap();
    sim.step_many(10);
    assert_eq!(sim.state(0).unwrap().v[0], 0.0);
}

#[test]
fn sensor_latency_beyond_what_is_kept_is_refused_at_once() {
    let mut sim = wheel(&explicit(), "");
    let error = sim.set_parameter(0, "sensor.axle.encoder_latency", 0.5).unwrap_err().to_string();
    assert!(error.contains("max_sensor_latency"), "{error}");
}

/// A free body with an IMU off its centre.
fn satellite(gravity: [f64; 3]) -> Batch<f64> {
    let urdf = format!(
        r#"<robot name="satellite"><link name="hull">{}</link><link name="imu"/><joint name="mount" type="fixed">
        <parent link="hull"/><child link="imu"/><origin xyz="0.1 0.2 0"/></joint></robot>"#,
        inertial(2.0, 0.05)
    );
    let options = SimOptions { gravity, ..Default::default() };
    Batch::new(&model(&urdf, BaseKind::Floating), &Terrain::plane(), &options, 1).unwrap()
}

fn floating(sim: &mut Batch<f64>, turning: [f64; 3]) {
    let v = [0.0; 3].into_iter().chain(turning).collect();
    sim.set_state(0, &State { q: vec![0.0, 0.0, 5.0, 1.0, 0.0, 0.0, 0.0], v }).unwrap();
}

#[test]
fn an_imu_off_centre_feels_the_turn() {
    let mut sim = satellite([0.0; 3]);
    floating(&mut sim, [0.0, 0.0, 3.0]);
    sim.step();
    let reading = sim.sensors(0).unwrap();
    // Towards the axis: -w² r.
    near(reading.acc[0], -0.9, 1e-9);
    near(reading.acc[1], -1.8, 1e-9);
    near(reading.gyro[2], 3.0, 1e-9);
}

#[test]
fn an_outside_force_acts_at_the_centre_of_mass() {
    let mut sim = satellite([0.0; 3]);
    sim.set_parameter(0, "link.hull.com_y", 0.1).unwrap();
    sim.set_parameter(0, "external.force_x", 4.0).unwrap();
    floating(&mut sim, [0.0; 3]);
    sim.step();
    // Pushed through its centre the body does not turn, and its origin follows without the lever.
    let v = sim.state(0).unwrap().v;
    near(v[0], 4.0 / 2.0 * 0.001, 1e-12);
    near(v[5], 0.0, 1e-12);
    // In the IMU's place a force through the centre is all there is; turned by a torque it feels the rate of turn, too.
    near(sim.sensors(0).unwrap().acc[0], 2.0, 1e-9);
}

/// A payload's place may be said by its first moment, too; of no mass that is a shift of the centre of mass.
#[test]
fn the_moment_of_a_payload_is_its_place() {
    let turned = |parameters: &[(&str, f64)]| {
        let mut sim = satellite([0.0; 3]);
        floating(&mut sim, [2.0, 1.0, 3.0]);
        for (name, value) in parameters {
            sim.set_parameter(0, &format!("link.hull.{name}"), *value).unwrap();
        }
        sim.set_parameter(0, "external.force_x", 4.0).unwrap();
        sim.step_many(100);
        sim.state(0).unwrap().v
    };
    let apart = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
    let by_place = turned(&[("payload_mass", 1.5), ("payload_x", 0.3), ("payload_y", -0.1)]);
    let by_moment = turned(&[("payload_mass", 1.5), ("payload_moment_x", 0.45), ("payload_moment_y", -0.15)]);
    assert!(apart(&by_place, &by_moment) < 1e-9, "{by_place:?} {by_moment:?}");
    assert!(apart(&by_place, &turned(&[("payload_mass", 1.5)])) > 0.1);
    // The hull weighs 2 kg. What the moment adds to its inertia, as of 2 g at a metre, is a trifle.
    let (shifted, moment) = (turned(&[("com_y", 0.001)]), turned(&[("payload_moment_y", 0.002)]));
    assert!(apart(&shifted[..3], &moment[..3]) < 1e-4, "{shifted:?} {moment:?}");
    assert!(apart(&shifted[3..], &moment[3..]) < 0.02, "{shifted:?} {moment:?}");
}

#[test]
fn an_imu_on_a_body_that_begins_to_turn_feels_it() {
    let mut sim = satellite([0.0; 3]);
    floating(&mut sim, [2.0, 1.0, 3.0]);
    sim.set_parameter(0, "link.hull.payload_mass", 1.0).unwrap();
    sim.set_parameter(0, "link.hull.payload_x", 0.3).unwrap();
    let before = sim.state(0).unwrap();
    sim.step();
    let after = sim.state(0).unwrap();
    let reading = sim.sensors(0).unwrap();
    // The velocity of the IMU's place over the step, by differences, in axes that hardly turn within it.
    let place = |s: &State| {
        let rotation = glam::DQuat::from_xyzw(s.q[4], s.q[5], s.q[6], s.q[3]);
        let turning = glam::DVec3::new(s.v[3], s.v[4], s.v[5]);
        glam::DVec3::new(s.v[0], s.v[1], s.v[2]) + rotation * turning.cross(glam::DVec3::new(0.1, 0.2, 0.0))
    };
    let rotation = glam::DQuat::from_xyzw(after.q[4], after.q[5], after.q[6], after.q[3]);
    let expected = rotation.conjugate() * ((place(&after) - place(&before)) / 0.001);
    let rate = (after.v[3] - before.v[3]).hypot(after.v[4] - before.v[4]) / 0.001;
    assert!(rate > 0.5, "the body must change its turn to test this: {rate} rad/s²");
    near((glam::DVec3::from_array(reading.acc) - expected).length(), 0.0, 0.03);
}

#[test]
fn a_tilted_imu_sees_gravity_from_the_side() {
    let mut sim = satellite([0.0, 0.0, -9.81]);
    floating(&mut sim, [0.0; 3]);
    sim.set_parameter(0, "sensor.imu.tilt_roll", 0.1).unwrap();
    // Before the first step nothing accelerates: the IMU feels what holds it against gravity.
    let reading = sim.sensors(0).unwrap();
    near(reading.acc[1], 9.81 * 0.1f64.sin(), 1e-9);
    near(reading.acc[2], 9.81 * 0.1f64.cos(), 1e-9);
    near(reading.imu_orientation[1], 0.05f64.sin(), 1e-12);
    sim.set_parameter(0, "sensor.imu.tilt_roll", 0.0).unwrap();
    sim.set_parameter(0, "sensor.imu.tilt_pitch", 0.1).unwrap();
    near(sim.sensors(0).unwrap().acc[0], -9.81 * 0.1f64.sin(), 1e-9);
}
