//! The Go2 with shapes on all its links: they carry it where it lies, and leave it alone where it stands.

use qv_go2::model::{self, DEFAULT_KD, DEFAULT_KP, FOOT_SHAPES, STAND};
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, SimOptions, State, Terrain};

const OPTIONS: ModelOptions =
    ModelOptions { base: BaseKind::Floating, armature: model::ARMATURE, mesh_reader: None, held: &[] };

fn shaped() -> Model {
    Model::from_urdf(&model::urdf_with_shapes(), &OPTIONS).unwrap()
}

/// Commands the stand, and lets the robot move from `start` for a number of steps of 2 ms.
fn stand(robot: &Model, start: &State, steps: usize) -> Batch<f64> {
    let options = SimOptions { timestep: 0.002, ..Default::default() };
    let mut sim = Batch::<f64>::new(robot, &Terrain::plane(), &options, 1).unwrap();
    let (zero, kp, kd) = ([0.0; 12], [DEFAULT_KP; 12], [DEFAULT_KD; 12]);
    sim.set_state(0, start).unwrap();
    sim.set_command(0, &JointCommand { q: &STAND, dq: &zero, kp: &kp, kd: &kd, tau: &zero }).unwrap();
    sim.step_many(steps);
    sim
}

fn at(height: f64, wxyz: [f64; 4]) -> State {
    let mut q = vec![0.0, 0.0, height];
    q.extend(wxyz);
    q.extend(STAND);
    State { q, v: vec![0.0; 18] }
}

#[test]
fn the_shapes_are_named_after_their_links_and_weigh_nothing() {
    let (robot, plain) = (shaped(), Model::from_urdf(&model::urdf(), &OPTIONS).unwrap());
    let names: Vec<&str> = robot.geoms.iter().map(|g| g.name.as_str()).collect();
    let mut expected = vec!["base".to_owned()];
    for leg in model::LEGS {
        expected.extend(["hip", "thigh", "calf", "foot"].map(|part| format!("{leg}_{part}")));
    }
    assert_eq!(names, expected);
    let feet: Vec<_> = robot.geoms.iter().filter(|g| FOOT_SHAPES.contains(&g.name.as_str())).collect();
    assert_eq!((feet.len(), plain.geoms.len()), (4, 4));
    for (foot, other) in feet.iter().zip(&plain.geoms) {
        assert_eq!((foot.link, foot.link_from_geom, &foot.shape), (other.link, other.link_from_geom, &other.shape));
    }
    assert_eq!((robot.links.len(), robot.joint_names()), (plain.links.len(), plain.joint_names()));
    for (link, other) in robot.links.iter().zip(&plain.links) {
        assert_eq!((link.mass, link.com, link.inertia), (other.mass, other.com, other.inertia), "{}", link.name);
    }
}

#[test]
fn standing_only_the_feet_touch() {
    let (robot, plain) = (shaped(), Model::from_urdf(&model::urdf(), &OPTIONS).unwrap());
    let start = at(model::touching_height(&STAND) + 0.02, [1.0, 0.0, 0.0, 0.0]);
    let sim = stand(&robot, &start, 1500);
    let forces = sim.sensors(0).unwrap().foot_force;
    for (geom, force) in robot.geoms.iter().zip(&forces) {
        let foot = FOOT_SHAPES.contains(&geom.name.as_str());
        assert!(if foot { *force > 10.0 } else { *force == 0.0 }, "{}: {force} N", geom.name);
    }
    assert!((forces.iter().sum::<f64>() - robot.mass() * 9.81).abs() < 1.0, "{forces:?}");
    assert_eq!(
        sim.state(0).unwrap(),
        stand(&plain, &start, 1500).state(0).unwrap(),
        "shapes in the air change nothing"
    );
}

#[test]
fn on_its_back_trunk_and_thighs_carry_it() {
    let robot = shaped();
    let sim = stand(&robot, &at(0.3, [0.0, 1.0, 0.0, 0.0]), 2000);
    let State { q, v } = sim.state(0).unwrap();
    let forces = sim.sensors(0).unwrap().foot_force;
    let carried: f64 = robot
        .geoms
        .iter()
        .zip(&forces)
        .filter(|(geom, _)| !FOOT_SHAPES.contains(&geom.name.as_str()))
        .map(|(_, force)| force)
        .sum();
    assert!((carried - robot.mass() * 9.81).abs() < 2.0, "{forces:?}");
    assert!(v.iter().all(|v| v.abs() < 0.02), "it still moves: {v:?}");
    assert!(q[2] > 0.03, "the base lies at {} m", q[2]);
}

#[test]
fn on_bumps_shapes_in_the_air_change_no_bit() {
    let heights: Vec<f64> = (0..41 * 41).map(|k| 0.03 * f64::from(k * 7919 % 101) / 100.0).collect();
    let field = Terrain::height_field([-2.0; 2], [0.1; 2], 41, 41, heights).unwrap();
    let mut start = at(model::touching_height(&STAND) + 0.03, [1.0, 0.0, 0.0, 0.0]);
    let mut ends = Vec::new();
    for text in [model::urdf(), model::urdf_with_shapes()] {
        let robot = Model::from_urdf(&text, &OPTIONS).unwrap();
        let options = SimOptions { timestep: 0.005, ..Default::default() };
        let mut sim = Batch::<f32>::new(&robot, &field, &options, 20).unwrap();
        let (zero, kp, kd) = ([0.0; 12], [DEFAULT_KP; 12], [DEFAULT_KD; 12]);
        for env in 0..20 {
            (start.q[0], start.q[1]) = (0.07 * env as f64 - 0.7, 0.5 - 0.05 * env as f64);
            sim.set_state(env, &start).unwrap();
            sim.set_command(env, &JointCommand { q: &STAND, dq: &zero, kp: &kp, kd: &kd, tau: &zero }).unwrap();
        }
        sim.step_many(200);
        let forces = sim.sensors(0).unwrap().foot_force;
        assert!(forces.iter().sum::<f64>() > 100.0, "it stands: {forces:?}");
        ends.push((0..20).map(|env| sim.state(env).unwrap()).collect::<Vec<_>>());
    }
    assert_eq!(ends[0], ends[1]);
}
