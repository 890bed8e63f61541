//! One environment has the same bits in any batch, lane, precision path and thread count, and its own parameters.

use crate::robots::{biped_state, biped_urdf, bits, drive, model};
use qv_core::TriangleMesh;
use qv_sim::{BaseKind, Batch, JointCommand, Precision, SimError, SimOptions, State, Terrain};

fn start(env: usize) -> State {
    let mut state = biped_state();
    state.q[2] += 0.003 * env as f64;
    state.v[0] -= 0.05 * env as f64;
    state
}

fn wavy() -> Terrain {
    let heights = (0..400).map(|i| 0.01 * ((i % 20) as f64 * 1.3).sin() * ((i / 20) as f64 * 0.7).cos()).collect();
    Terrain::height_field([-1.0, -1.0], [0.1, 0.1], 20, 20, heights).unwrap()
}

fn batch<T: Precision>(terrain: &Terrain, lanes: Option<usize>, environments: &[usize]) -> Batch<T> {
    let robot = model(&biped_urdf(), BaseKind::Floating);
    let options = SimOptions { lanes, max_command_latency: 0.05, ..Default::default() };
    let mut sim = Batch::<T>::new(&robot, terrain, &options, environments.len()).unwrap();
    for (i, &env) in environments.iter().enumerate() {
        sim.set_state(i, &start(env)).unwrap();
        sim.set_parameter(i, "contact.friction", 0.3 + 0.05 * env as f64).unwrap();
        if env % 3 == 0 {
            sim.set_parameter(i, "joint.left_knee.coulomb_friction", 0.3).unwrap();
            sim.set_parameter(i, "actuator.right_hip.command_latency", 0.0013 * env as f64).unwrap();
        }
        if env % 4 == 1 {
            sim.set_parameter(i, "joint.left_hip.viscous_friction", 0.1).unwrap();
        }
    }
    sim
}

fn same_bits_anywhere<T: Precision>() {
    for terrain in [Terrain::plane(), wavy()] {
        let everyone: Vec<usize> = (0..37).collect();
        let mut together = batch::<T>(&terrain, None, &everyone);
        drive(&mut together, 300, false);
        let mut threads = batch::<T>(&terrain, None, &everyone);
        drive(&mut threads, 300, true);
        for lanes in [1, 4, 8, 16] {
            let mut other = batch::<T>(&terrain, Some(lanes), &[5, 36, 9, 12]);
            drive(&mut other, 300, false);
            for (i, env) in [5, 36, 9, 12].into_iter().enumerate() {
                let expected = bits(&together.state(env).unwrap());
                assert_eq!(bits(&other.state(i).unwrap()), expected, "environment {env} with {lanes} lanes");
                assert_eq!(bits(&threads.state(env).unwrap()), expected, "environment {env} on threads");
            }
        }
        let mut alone = batch::<T>(&terrain, None, &[12]);
        drive(&mut alone, 300, false);
        assert_eq!(bits(&alone.state(0).unwrap()), bits(&together.state(12).unwrap()));
        assert_ne!(bits(&together.state(12).unwrap()), bits(&together.state(13).unwrap()));
    }
}

#[test]
fn same_bits_in_double_precision() {
    same_bits_anywhere::<f64>();
}

#[test]
fn same_bits_in_single_precision() {
    same_bits_anywhere::<f32>();
}

#[test]
fn one_command_for_all_is_each_one_commanded() {
    let everyone: Vec<usize> = (0..11).collect();
    let mut each = batch::<f64>(&Terrain::plane(), None, &everyone);
    let mut all = batch::<f64>(&Terrain::plane(), None, &everyone);
    let mut parts = batch::<f64>(&Terrain::plane(), None, &everyone);
    for step in 0..60 {
        if step == 30 {
            [&mut each, &mut all, &mut parts].into_iter().for_each(|sim| sim.set_state(4, &start(9)).unwrap());
        }
        let q = [0.1, -0.3, 0.004 * f64::from(step), -0.2];
        let command = JointCommand { q: &q, dq: &[0.0; 4], kp: &[30.0; 4], kd: &[1.0; 4], tau: &[0.1; 4] };
        (0..11).for_each(|env| each.set_command(env, &command).unwrap());
        all.set_command_for_all(&command).unwrap();
        parts.set_command_in(0..3, &command).unwrap();
        parts.set_command_in(3..11, &command).unwrap();
        each.step();
        parts.step();
        if step % 2 == 0 { all.step() } else { all.follow(&[command], step % 3 == 0).unwrap() }
    }
    for env in 0..11 {
        assert_eq!(bits(&each.state(env).unwrap()), bits(&all.state(env).unwrap()), "environment {env}");
        assert_eq!(bits(&each.state(env).unwrap()), bits(&parts.state(env).unwrap()), "environment {env}");
    }
    let command = JointCommand { q: &[0.0; 4], dq: &[0.0; 4], kp: &[0.0; 4], kd: &[0.0; 4], tau: &[0.0; 4] };
    assert!(matches!(parts.set_command_in(9..12, &command), Err(SimError::Environment { index: 11, count: 11 })));
    assert!(parts.set_command_in(3..3, &command).is_ok(), "nobody is commanded");
}

#[test]
fn single_precision_follows_double() {
    let mut double = batch::<f64>(&Terrain::plane(), None, &[2]);
    let mut single = batch::<f32>(&Terrain::plane(), None, &[2]);
    drive(&mut double, 200, false);
    drive(&mut single, 200, false);
    for (a, b) in double.state(0).unwrap().q.iter().zip(single.state(0).unwrap().q) {
        assert!((a - b).abs() < 1e-3, "{a} against {b}");
    }
}

#[test]
fn snapshot_and_restore_repeat_the_same_bits() {
    let mut sim = batch::<f64>(&wavy(), None, &[0, 1, 2, 3, 4]);
    drive(&mut sim, 100, false);
    let snapshot = sim.snapshot();
    drive(&mut sim, 100, false);
    let first: Vec<_> = (0..5).map(|env| bits(&sim.state(env).unwrap())).collect();
    sim.set_parameter(2, "contact.friction", 1.1).unwrap();
    sim.restore(&snapshot).unwrap();
    assert_eq!(sim.parameter(2, "contact.friction").unwrap(), 0.4);
    drive(&mut sim, 100, false);
    let second: Vec<_> = (0..5).map(|env| bits(&sim.state(env).unwrap())).collect();
    assert_eq!(first, second);
    let mut other = batch::<f64>(&wavy(), None, &[0]);
    assert_eq!(other.restore(&snapshot), Err(SimError::Snapshot));
}

#[test]
fn an_environment_that_runs_away_is_named_and_harms_no_other() {
    let mut sim = batch::<f64>(&Terrain::plane(), None, &[0, 1, 2]);
    let mut calm = batch::<f64>(&Terrain::plane(), None, &[0, 1, 2]);
    let mut wild = start(1);
    wild.v[7] = 1e200;
    sim.set_state(1, &wild).unwrap();
    drive(&mut sim, 50, false);
    drive(&mut calm, 50, false);
    assert!(sim.is_faulty(1).unwrap() && !sim.is_faulty(0).unwrap());
    assert!(sim.state(1).unwrap().q.iter().all(|x| x.is_finite()));
    for env in [0, 2] {
        assert_eq!(bits(&sim.state(env).unwrap()), bits(&calm.state(env).unwrap()));
    }
    sim.set_state(1, &start(1)).unwrap();
    assert!(!sim.is_faulty(1).unwrap());
    drive(&mut sim, 10, false);
    assert!(!sim.is_faulty(1).unwrap());
}

#[test]
fn environments_with_parameters_of_their_own_are_as_alone() {
    let latencies = [0.0, 0.0005, 0.0005, 0.0023, 0.01, 0.0023];
    let set = |sim: &mut Batch<f32>, env: usize, latency: f64| {
        for joint in ["left_hip", "right_knee"] {
            sim.set_parameter(env, &format!("actuator.{joint}.command_latency"), latency).unwrap();
        }
        sim.set_parameter(env, "link.trunk.payload_mass", 300.0 * latency).unwrap();
    };
    let mut all = batch::<f32>(&wavy(), None, &[1; 6]);
    latencies.iter().enumerate().for_each(|(env, &latency)| set(&mut all, env, latency));
    drive(&mut all, 100, false);
    for (env, &latency) in latencies.iter().enumerate() {
        let mut alone = batch::<f32>(&wavy(), None, &[1]);
        set(&mut alone, 0, latency);
        drive(&mut alone, 100, false);
        assert_eq!(bits(&all.state(env).unwrap()), bits(&alone.state(0).unwrap()), "latency {latency}");
    }
    assert_ne!(bits(&all.state(1).unwrap()), bits(&all.state(3).unwrap()));
}

#[test]
fn a_million_triangles() {
    let side = 708;
    let mut mesh = TriangleMesh::default();
    for j in 0..side as u32 {
        for i in 0..side as u32 {
            mesh.vertices.push(glam::DVec3::new(0.05 * f64::from(i) - 17.0, 0.05 * f64::from(j) - 17.0, 0.0));
            if i + 1 < side as u32 && j + 1 < side as u32 {
                let (a, row) = (j * side as u32 + i, side as u32);
                mesh.triangles.extend([[a, a + 1, a + row + 1], [a, a + row + 1, a + row]]);
            }
        }
    }
    let terrain = Terrain::from_mesh(&mesh).unwrap();
    assert!(terrain.triangle_count() > 999_000);
    let mut on_mesh = batch::<f64>(&terrain, None, &[0]);
    let mut on_plane = batch::<f64>(&Terrain::plane(), None, &[0]);
    drive(&mut on_mesh, 400, false);
    drive(&mut on_plane, 400, false);
    // A flat mesh is a plane: its inner edges are not felt.
    for (a, b) in on_mesh.state(0).unwrap().q.iter().zip(on_plane.state(0).unwrap().q) {
        assert!((a - b).abs() < 1e-7, "{a} against {b}");
    }
}

#[test]
fn bad_requests_are_named() {
    let mut sim = batch::<f64>(&Terrain::plane(), None, &[0]);
    let mut state = start(0);
    state.q[3] = f64::NAN;
    assert!(matches!(sim.set_state(0, &state), Err(SimError::Value { .. })));
    state.q.pop();
    assert!(matches!(sim.set_state(0, &state), Err(SimError::Length { expected: 11, found: 10, .. })));
    assert!(matches!(sim.state(7), Err(SimError::Environment { index: 7, count: 1 })));
    let error = sim.set_parameter(0, "contact.frictio", 0.5).unwrap_err().to_string();
    assert!(error.contains("contact.friction"), "{error}");
    assert!(matches!(sim.set_parameter(0, "contact.friction", -1.0), Err(SimError::Value { .. })));
    assert!(matches!(sim.set_parameter(0, "link.trunk.payload_mass", -6.0), Err(SimError::Value { .. })));
    assert_eq!(sim.parameter(0, "link.trunk.payload_mass").unwrap(), 0.0);
    let late = sim.set_parameter(0, "actuator.left_hip.command_latency", 0.5).unwrap_err().to_string();
    assert!(late.contains("max_command_latency"), "{late}");
    let command = JointCommand { q: &[0.0; 3], dq: &[0.0; 4], kp: &[0.0; 4], kd: &[0.0; 4], tau: &[0.0; 4] };
    assert!(matches!(sim.set_command(0, &command), Err(SimError::Length { expected: 4, found: 3, .. })));
    let robot = model(&biped_urdf(), BaseKind::Floating);
    let bad = SimOptions { timestep: 0.0, ..Default::default() };
    assert!(matches!(Batch::<f64>::new(&robot, &Terrain::plane(), &bad, 1), Err(SimError::Value { .. })));
    assert!(Batch::<f64>::new(&robot, &Terrain::plane(), &SimOptions::default(), 0).is_err());
}
