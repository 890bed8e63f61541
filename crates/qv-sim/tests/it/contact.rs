//! Shapes on ground: what a person would expect of a ball, a brick, a can and a die.

use crate::robots::{biped_urdf, body, inertial, model, settle, tabletop};
use qv_sim::{BaseKind, Batch, LineSearch, Model, ModelOptions, SimError, SimOptions, State, Terrain, WarmStart};

fn at(z: f64) -> State {
    State { q: vec![0.0, 0.0, z, 1.0, 0.0, 0.0, 0.0], v: vec![0.0; 6] }
}

const SHAPES: [(&str, f64); 4] = [
    (r#"<sphere radius="0.1"/>"#, 0.1),
    (r#"<box size="0.2 0.3 0.1"/>"#, 0.05),
    (r#"<cylinder radius="0.1" length="0.2"/>"#, 0.1),
    (r#"<capsule radius="0.05" length="0.2"/>"#, 0.15),
];

#[test]
fn each_shape_rests_at_its_height_on_plane_and_mesh() {
    // Contacts of 8 ms sink by millimetres under a body of little inertia.
    for terrain in [Terrain::plane(), tabletop()] {
        for (geometry, height) in SHAPES {
            let end = settle(&body(geometry), &terrain, &SimOptions::default(), &at(height + 0.02), 600);
            assert!((end.q[2] - height).abs() < 3e-3, "{geometry}: rests at {} m", end.q[2]);
            assert!(end.v.iter().all(|v| v.abs() < 2e-2), "{geometry}: still moves, {:?}", end.v);
        }
    }
}

#[test]
fn a_hull_rests_like_the_box_it_wraps() {
    let urdf = format!(
        r#"<robot name="rock"><link name="rock">{}<collision><geometry><mesh filename="rock.stl"/></geometry></collision></link></robot>"#,
        inertial(1.0, 0.002)
    );
    let corners = |_: &str| {
        let sign = |bit: i32| if bit == 0 { -1.0 } else { 1.0 };
        let corner = |c: i32| glam::DVec3::new(0.1 * sign(c & 1), 0.15 * sign(c & 2), 0.05 * sign(c & 4));
        Ok(qv_sim::MeshShape { vertices: (0..8).map(corner).collect(), triangles: Vec::new() })
    };
    let options = ModelOptions { base: BaseKind::Floating, mesh_reader: Some(&corners), ..Default::default() };
    let rock = Model::from_urdf(&urdf, &options).unwrap();
    for terrain in [Terrain::plane(), tabletop()] {
        let end = settle(&rock, &terrain, &SimOptions::default(), &at(0.07), 600);
        assert!((end.q[2] - 0.05).abs() < 3e-3, "rests at {} m", end.q[2]);
    }
    let unread = Model::from_urdf(&urdf, &ModelOptions { base: BaseKind::Floating, ..Default::default() }).unwrap();
    assert!(unread.geoms.is_empty() && unread.left_out[0].contains("rock.stl"), "{:?}", unread.left_out);
}

#[test]
fn restitution_returns_its_share_of_the_speed() {
    for wanted in [0.2, 0.5, 0.8] {
        let ball = body(r#"<sphere radius="0.1"/>"#);
        let options = SimOptions { timestep: 1e-4, ..Default::default() };
        let mut sim = Batch::<f64>::new(&ball, &Terrain::plane(), &options, 1).unwrap();
        sim.set_parameter(0, "contact.restitution", wanted).unwrap();
        let mut start = at(0.1001);
        start.v[2] = -3.0;
        sim.set_state(0, &start).unwrap();
        let fastest = (0..2000).map(|_| {
            sim.step();
            sim.state(0).unwrap().v[2]
        });
        let rebound = fastest.fold(0.0, f64::max) / 3.0;
        // Gravity and the impedance of the soft contact take a little.
        assert!((rebound - wanted).abs() < 0.08, "wanted {wanted}, found {rebound}");
    }
}

#[test]
fn torsion_stops_a_spinning_ball_and_rolling_friction_a_rolling_one() {
    let spin = |dimension: usize| {
        let options = SimOptions { contact_dimension: dimension, ..Default::default() };
        let ball = body(r#"<sphere radius="0.1"/>"#);
        let mut start = at(0.1);
        start.v[5] = 5.0;
        settle(&ball, &Terrain::plane(), &options, &start, 500).v[5]
    };
    assert!(spin(3) > 4.99 && spin(4) < 4.5, "{} {}", spin(3), spin(4));
    let roll = |dimension: usize| {
        let options = SimOptions { contact_dimension: dimension, ..Default::default() };
        let ball = body(r#"<sphere radius="0.1"/>"#);
        let mut start = at(0.1);
        (start.v[0], start.v[4]) = (0.5, 5.0);
        settle(&ball, &Terrain::plane(), &options, &start, 1000).v[0]
    };
    assert!(roll(3) > 0.49 && roll(6) < roll(3) - 0.005, "{} {}", roll(3), roll(6));
}

#[test]
fn a_box_slides_as_coulomb_says() {
    let slab = body(r#"<box size="0.2 0.2 0.1"/>"#);
    let mut sim = Batch::<f64>::new(&slab, &Terrain::plane(), &SimOptions::default(), 1).unwrap();
    sim.set_parameter(0, "contact.friction", 0.3).unwrap();
    let mut start = at(0.0499);
    start.v[0] = 2.0;
    sim.set_state(0, &start).unwrap();
    sim.step_many(300);
    // It chatters, so the normal impulse is taken from its vertical motion.
    let v = sim.state(0).unwrap().v;
    let normal_impulse = 9.81 * 0.3 + v[2];
    assert!(((2.0 - v[0]) / normal_impulse - 0.3).abs() < 1e-3, "friction {}", (2.0 - v[0]) / normal_impulse);
}

#[test]
fn a_patch_and_a_slope_act_where_they_are() {
    let mut sim =
        Batch::<f64>::new(&body(r#"<box size="0.2 0.2 0.1"/>"#), &Terrain::plane(), &SimOptions::default(), 2).unwrap();
    for env in 0..2 {
        sim.set_parameter(env, "terrain.slope_x", -0.3).unwrap();
        sim.set_parameter(env, "terrain.patch.x_min", 1.0).unwrap();
        sim.set_parameter(env, "terrain.patch.x_max", 3.0).unwrap();
        sim.set_parameter(env, "terrain.patch.y_min", -1.0).unwrap();
        sim.set_parameter(env, "terrain.patch.y_max", 1.0).unwrap();
        sim.set_parameter(env, "terrain.patch.friction", 0.05).unwrap();
        let x = env as f64 * 1.5;
        let tilt: f64 = 0.3;
        let mut start = at(-x * tilt.tan() + 0.05 / tilt.cos());
        start.q[0] = x;
        (start.q[3], start.q[5]) = ((0.5 * tilt).cos(), (0.5 * tilt).sin());
        sim.set_state(env, &start).unwrap();
    }
    sim.step_many(300);
    let speed = |env: usize| sim.state(env).unwrap().v[0];
    assert!(speed(0).abs() < 0.01, "holds on friction 0.8: {} m/s", speed(0));
    assert!(speed(1) > 0.5, "slides on the patch: {} m/s", speed(1));
}

#[test]
fn legs_pass_through_each_other_unless_asked_not_to() {
    let urdf = biped_urdf();
    let robot = model(&urdf, BaseKind::Fixed);
    let mut apart = Vec::new();
    for self_collision in [false, true] {
        let options = SimOptions { self_collision, ..Default::default() };
        // Both feet pulled to the same place by side forces is not possible with these joints: put them there.
        let near = model(&urdf.replace("0.15", "0.03"), BaseKind::Fixed);
        let mut sim = Batch::<f64>::new(&near, &Terrain::none(), &options, 1).unwrap();
        sim.set_state(0, &State { q: vec![0.3, -0.1, 0.3, -0.1], v: vec![0.0; 4] }).unwrap();
        sim.step_many(200);
        let state = sim.state(0).unwrap();
        assert!(!sim.is_faulty(0).unwrap());
        apart.push(state.q.iter().zip([0.3, -0.1, 0.3, -0.1]).map(|(a, b)| (a - b).abs()).sum::<f64>());
        let difference = (state.q[0] - state.q[2]).abs() + (state.q[1] - state.q[3]).abs();
        assert_eq!(self_collision, difference > 1e-3, "legs differ by {difference} rad");
    }
    assert_eq!(robot.joint_names().len(), 4);
}

#[test]
fn ways_to_the_solution_do_not_change_it() {
    let brick = body(SHAPES[1].0);
    let mut start = at(0.09);
    start.v = vec![1.5, -0.4, -0.5, 2.0, -3.0, 1.0];
    let exact = SimOptions { iterations: 100, tolerance: Some(1e-12), ..Default::default() };
    let end = settle(&brick, &Terrain::plane(), &exact, &start, 250);
    assert!(end.q[0] > 0.05 && end.v[0].abs() < 1.4, "it landed and slid: {end:?}");
    for (line_search, warm_start) in [(LineSearch::Apex, WarmStart::Last), (LineSearch::Halving, WarmStart::Cheaper)] {
        let options = SimOptions { line_search, warm_start, ..exact.clone() };
        let other = settle(&brick, &Terrain::plane(), &options, &start, 250);
        for (a, b) in end.q.iter().chain(&end.v).zip(other.q.iter().chain(&other.v)) {
            assert!((a - b).abs() < 1e-6, "{line_search:?} {warm_start:?}: {end:?} {other:?}");
        }
        assert_ne!(end, other, "{line_search:?} {warm_start:?} took the same way");
    }
    let none = SimOptions { line_search_iterations: 0, ..Default::default() };
    let refused = Batch::<f64>::new(&brick, &Terrain::plane(), &none, 1);
    assert!(matches!(refused.err(), Some(SimError::Value { .. })));
}
