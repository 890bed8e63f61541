//! Bulk reads and writes say what the calls for one environment say; states of lanes carry on exactly.

use crate::robots::{biped_state, biped_urdf, bits, drive, model};
use qv_sim::{BaseKind, Batch, BatchCommand, JointCommand, LaneState, Precision, SimError, SimOptions, State, Terrain};

const COUNT: usize = 19;

fn batch<T: Precision>(options: &SimOptions) -> Batch<T> {
    let mut sim = Batch::new(&model(&biped_urdf(), BaseKind::Floating), &Terrain::plane(), options, COUNT).unwrap();
    for env in 0..COUNT {
        let mut state = biped_state();
        state.q[2] += 0.002 * env as f64;
        sim.set_state(env, &state).unwrap();
    }
    sim
}

fn keeping() -> SimOptions {
    SimOptions { keep_contacts: true, max_command_latency: 0.02, ..Default::default() }
}

#[test]
fn bulk_reads_are_the_single_ones() {
    let mut sim = batch::<f64>(&keeping());
    sim.set_parameter(3, "sensor.left_knee.encoder_bias", 0.05).unwrap();
    sim.set_parameter(3, "sensor.imu.gyro_bias_x", 0.02).unwrap();
    drive(&mut sim, 420, false);
    let (nq, nv, joints, geoms) = (11, 10, 4, sim.model().geoms.len());
    let read = |f: &dyn Fn(&mut [f32]), width: usize| {
        let mut out = vec![0.0; width * COUNT];
        f(&mut out);
        out
    };
    let q = read(&|out| sim.read_positions(out).unwrap(), nq);
    let v = read(&|out| sim.read_velocities(out).unwrap(), nv);
    let a = read(&|out| sim.read_accelerations(out).unwrap(), nv);
    let tau = read(&|out| sim.read_torques(out).unwrap(), joints);
    let push = read(&|out| sim.read_geom_forces(out).unwrap(), 3 * geoms);
    let (mut encoders, mut speeds) = (vec![0.0; joints * COUNT], vec![0.0; joints * COUNT]);
    sim.read_encoders(&mut encoders, &mut speeds).unwrap();
    let (mut gyro, mut acc, mut turn) = (vec![0.0; 3 * COUNT], vec![0.0; 3 * COUNT], vec![0.0; 4 * COUNT]);
    sim.read_imu(&mut gyro, &mut acc, &mut turn).unwrap();
    let mut touched = 0;
    for env in 0..COUNT {
        let state = sim.state(env).unwrap();
        let sensors = sim.sensors(env).unwrap();
        let same = |all: &[f32], one: &[f64]| {
            assert_eq!(all[env * one.len()..][..one.len()], *one.iter().map(|&x| x as f32).collect::<Vec<_>>());
        };
        same(&q, &state.q);
        same(&v, &state.v);
        same(&a, &sim.acceleration(env).unwrap());
        same(&tau, &sensors.tau);
        same(&encoders, &sensors.q);
        same(&speeds, &sensors.dq);
        same(&gyro, &sensors.gyro);
        same(&acc, &sensors.acc);
        same(&turn, &sensors.imu_orientation);
        // On a plane the normal force of a shape is the vertical part of its push, and contacts add up to it.
        let contacts = sim.contacts(env).unwrap();
        for (geom, normal) in sensors.foot_force.iter().enumerate() {
            let vertical = f64::from(push[(env * geoms + geom) * 3 + 2]);
            let listed: f64 = contacts.iter().filter(|c| c.geom == geom).map(|c| c.force[2]).sum();
            assert!((vertical - normal).abs() < 1e-4 * normal.max(1.0), "{vertical} for {normal}");
            assert!((listed - normal).abs() < 1e-9 * normal.max(1.0), "{listed} for {normal}");
        }
        touched += contacts.len();
        assert!(contacts.iter().all(|c| c.normal == [0.0, 0.0, 1.0] && c.distance < 0.0 && c.point[2] <= 0.0));
    }
    assert!(touched > 5, "some bipeds touch the ground: {touched} contacts");
}

#[test]
fn shapes_are_where_the_model_says() {
    let mut sim = batch::<f64>(&SimOptions::default());
    drive(&mut sim, 50, false);
    let feet: Vec<usize> = (0..sim.model().geoms.len()).rev().collect();
    let (mut at, mut moving) = (vec![0.0; 3 * feet.len() * COUNT], vec![0.0; 3 * feet.len() * COUNT]);
    sim.read_geoms(&feet, &mut at, &mut moving).unwrap();
    let robot = sim.model().clone();
    let place = |q: &[f64], geom: usize| {
        let links = robot.world_from_links(q);
        let g = &robot.geoms[geom];
        (links[g.link] * g.link_from_geom).position
    };
    let before: Vec<State> = (0..COUNT).map(|env| sim.state(env).unwrap()).collect();
    for env in 0..COUNT {
        for (k, &geom) in feet.iter().enumerate() {
            let expected = place(&before[env].q, geom);
            // The speed by a small motion along the velocities.
            let ahead = stepped(&before[env], 1e-6);
            let speed = (place(&ahead.q, geom) - expected) / 1e-6;
            for axis in 0..3 {
                let start = (env * feet.len() + k) * 3 + axis;
                assert!((f64::from(at[start]) - expected[axis]).abs() < 1e-6);
                assert!((f64::from(moving[start]) - speed[axis]).abs() < 1e-4, "{} {}", moving[start], speed[axis]);
            }
        }
    }
    assert!(matches!(sim.read_geoms(&[99], &mut [0.0; 57], &mut [0.0; 57]), Err(SimError::Value { .. })));
}

/// Positions a small time later at held velocities.
fn stepped(state: &State, h: f64) -> State {
    let mut out = state.clone();
    for k in 0..3 {
        out.q[k] += h * state.v[k];
    }
    let turn = glam::DVec3::new(state.v[3], state.v[4], state.v[5]) * h;
    let q = glam::DQuat::from_xyzw(state.q[4], state.q[5], state.q[6], state.q[3]).normalize();
    let q = q * glam::DQuat::from_scaled_axis(turn);
    out.q[3..7].copy_from_slice(&[q.w, q.x, q.y, q.z]);
    for j in 0..state.q.len() - 7 {
        out.q[7 + j] += h * state.v[6 + j];
    }
    out
}

#[test]
fn bulk_commands_are_single_ones() {
    let (mut one, mut all) = (batch::<f32>(&keeping()), batch::<f32>(&keeping()));
    for sim in [&mut one, &mut all] {
        sim.set_parameter(2, "actuator.left_knee.command_latency", 0.007).unwrap();
    }
    for step in 0..40 {
        let q: Vec<f32> = (0..4 * COUNT).map(|i| 0.01 * (i + step) as f32).collect();
        let (kp, kd) = ([30.0f32, 31.0, 32.0, 33.0], [1.0f32; 4]);
        let tau: Vec<f32> = (0..4 * COUNT).map(|i| 0.02 * i as f32).collect();
        all.set_commands(&BatchCommand { q: &q, dq: None, kp: &kp, kd: &kd, tau: Some(&tau) }).unwrap();
        for env in 0..COUNT {
            let wide = |x: &[f32]| x.iter().map(|&x| f64::from(x)).collect::<Vec<_>>();
            let (q, tau) = (wide(&q[4 * env..][..4]), wide(&tau[4 * env..][..4]));
            let command = JointCommand { q: &q, dq: &[0.0; 4], kp: &wide(&kp), kd: &wide(&kd), tau: &tau };
            one.set_command(env, &command).unwrap();
        }
        one.step();
        all.step();
    }
    for env in 0..COUNT {
        assert_eq!(bits(&one.state(env).unwrap()), bits(&all.state(env).unwrap()), "environment {env}");
    }
    let bad = BatchCommand { q: &[f32::NAN; 4 * COUNT], dq: None, kp: &[0.0; 4], kd: &[0.0; 4], tau: None };
    assert!(matches!(all.set_commands(&bad), Err(SimError::Value { .. })));
    let short = BatchCommand { q: &[0.0; 4 * COUNT], dq: None, kp: &[0.0; 3], kd: &[0.0; 4], tau: None };
    assert!(matches!(all.set_commands(&short), Err(SimError::Length { found: 3, .. })));
}

fn lanes_carry_on<T: Precision>() {
    let options = SimOptions { max_sensor_latency: 0.01, ..keeping() };
    let mut sim = batch::<T>(&options);
    for env in [2, 7, 18] {
        sim.set_parameter(env, "actuator.left_knee.command_latency", 0.013).unwrap();
        sim.set_parameter(env, "actuator.left_hip.lag", 0.01).unwrap();
        sim.set_parameter(env, "actuator.right_hip.backlash", 0.02).unwrap();
        sim.set_parameter(env, "sensor.left_hip.encoder_latency", 0.006).unwrap();
    }
    drive(&mut sim, 77, false);
    // Into a lane of another block, and into another batch, whose rings begin elsewhere.
    sim.copy_lane(2, 18).unwrap();
    let mut kept = LaneState::default();
    sim.read_lane(2, &mut kept).unwrap();
    let mut other = batch::<T>(&options);
    other.set_parameter(7, "actuator.left_knee.command_latency", 0.013).unwrap();
    other.set_parameter(7, "actuator.left_hip.lag", 0.01).unwrap();
    other.set_parameter(7, "actuator.right_hip.backlash", 0.02).unwrap();
    other.set_parameter(7, "sensor.left_hip.encoder_latency", 0.006).unwrap();
    drive(&mut other, 5, false);
    other.write_lane(7, &kept).unwrap();
    drive(&mut sim, 60, false);
    drive(&mut other, 60, false);
    let expected = bits(&sim.state(2).unwrap());
    assert_eq!(bits(&sim.state(18).unwrap()), expected);
    assert_eq!(bits(&other.state(7).unwrap()), expected);
    assert_eq!(other.sensors(7).unwrap(), sim.sensors(2).unwrap());
    assert_ne!(bits(&sim.state(3).unwrap()), expected);
    let mut without = batch::<T>(&SimOptions::default());
    assert!(matches!(without.write_lane(0, &kept), Err(SimError::Length { .. })), "no ring of commands");
}

#[test]
fn states_of_lanes_carry_on_in_both_precisions() {
    lanes_carry_on::<f32>();
    lanes_carry_on::<f64>();
}

#[test]
fn a_push_changes_velocities_and_nothing_else() {
    let mut sim = batch::<f64>(&keeping());
    drive(&mut sim, 20, false);
    let before = sim.state(4).unwrap();
    let mut push = vec![0.0; 10];
    push[1] = 0.5;
    sim.add_velocity(4, &push).unwrap();
    let after = sim.state(4).unwrap();
    assert_eq!(before.q, after.q);
    assert_eq!(after.v[1], before.v[1] + 0.5);
    assert_eq!(before.v[2..], after.v[2..]);
}

#[test]
fn an_added_torque_acts_behind_latency_and_limits_and_is_not_reported() {
    let robot = model(&biped_urdf(), BaseKind::Fixed);
    let options = SimOptions { max_command_latency: 0.02, gravity: [0.0; 3], ..Default::default() };
    let mut sim = Batch::<f64>::new(&robot, &Terrain::none(), &options, 2).unwrap();
    sim.set_added_torques(&[0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]).unwrap();
    sim.step();
    assert!(sim.acceleration(0).unwrap()[1].abs() > 10.0, "at once: {:?}", sim.acceleration(0).unwrap());
    assert_eq!(sim.sensors(0).unwrap().tau, vec![0.0; 4]);
    assert!(sim.acceleration(1).unwrap().iter().all(|&a| a == 0.0));
    // The same as an outside torque of the catalogue.
    let mut outside = Batch::<f64>::new(&robot, &Terrain::none(), &options, 1).unwrap();
    outside.set_parameter(0, "joint.left_knee.external_torque", 2.0).unwrap();
    outside.step();
    assert_eq!(sim.acceleration(0).unwrap(), outside.acceleration(0).unwrap());
    sim.set_state(0, &State { q: vec![0.0; 4], v: vec![0.0; 4] }).unwrap();
    sim.step();
    assert!(sim.acceleration(0).unwrap().iter().all(|&a| a == 0.0), "a new state takes it away");
}

#[test]
fn wrenches_accelerate_as_newton_and_euler_say() {
    let ball = crate::robots::body(r#"<sphere radius="0.05"/>"#);
    let options = SimOptions { gravity: [0.0; 3], ..Default::default() };
    let mut sim = Batch::<f64>::new(&ball, &Terrain::none(), &options, 1).unwrap();
    sim.set_wrench(0, 0, [1.0, 2.0, 3.0], [0.02, 0.0, -0.04]).unwrap();
    sim.step();
    // 1 kg and 0.002 kg m² about every axis.
    let expected = [1.0, 2.0, 3.0, 10.0, 0.0, -20.0];
    for (found, expected) in sim.acceleration(0).unwrap().iter().zip(expected) {
        assert!((found - expected).abs() < 1e-9, "{found} for {expected}");
    }
    // On a leg of a free robot in space, the whole gains force over mass.
    let robot = model(&biped_urdf(), BaseKind::Floating);
    let mut sim = Batch::<f64>::new(&robot, &Terrain::none(), &options, 1).unwrap();
    let shank = robot.links.iter().position(|l| l.name == "left_shank").unwrap();
    sim.set_wrench(0, shank, [0.0, 3.0, 0.0], [0.0; 3]).unwrap();
    let h = 1000;
    sim.step_many(h);
    let momentum: f64 = momentum_y(&sim.state(0).unwrap(), &robot);
    assert!((momentum - 3.0).abs() < 1e-2, "{momentum} N s after 1 s of 3 N");
    assert!(matches!(sim.set_wrench(0, 99, [0.0; 3], [0.0; 3]), Err(SimError::Value { .. })));
}

/// Momentum along y \[kg m/s\], by differences of the centre of mass.
fn momentum_y(state: &State, robot: &qv_sim::Model) -> f64 {
    let first = |q: &[f64]| -> f64 {
        let links = robot.world_from_links(q);
        robot.links.iter().zip(links).map(|(link, pose)| link.mass * pose.transform_point(link.com).y).sum()
    };
    (first(&stepped(state, 1e-6).q) - first(&state.q)) / 1e-6
}

#[test]
fn reset_by_mask() {
    let mut sim = batch::<f64>(&keeping());
    drive(&mut sim, 30, false);
    let mask: Vec<bool> = (0..COUNT).map(|env| env % 5 == 0).collect();
    let kept = sim.state(1).unwrap();
    sim.reset(&mask, |env| State {
        q: {
            let mut s = biped_state();
            s.q[0] = env as f64;
            s.q
        },
        v: vec![0.0; 10],
    })
    .unwrap();
    assert_eq!(sim.state(10).unwrap().q[0], 10.0);
    assert_eq!(sim.state(1).unwrap(), kept);
    assert!(matches!(sim.reset(&mask[1..], |_| biped_state()), Err(SimError::Length { .. })));
}
