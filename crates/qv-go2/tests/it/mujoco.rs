//! The simulator against MuJoCo: recorded runs of the same bodies under the same commands
//! (`fixtures/mujoco/golden`, written by `fixtures/mujoco/generate.py`).

use qv_go2::gait::{Chirp, Trot};
use qv_go2::model;
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, SimOptions, State, Terrain};
use serde_json::Value;

fn golden(name: &str) -> Value {
    let path = format!("{}/../../fixtures/mujoco/golden/{name}.json", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}"));
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{path}: {e}"))
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("expected a number, found {value}"))
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap_or_else(|| panic!("expected an array, found {value}")).iter().map(number).collect()
}

fn rows(value: &Value) -> Vec<Vec<f64>> {
    value.as_array().unwrap_or_else(|| panic!("expected rows, found {value}")).iter().map(numbers).collect()
}

/// The model of a golden: its own URDF, or the Go2.
fn model_of(golden: &Value, joint: &Value) -> Model {
    let base = if golden["base"] == "fixed" { BaseKind::Fixed } else { BaseKind::Floating };
    let armature = joint["armature"].as_f64().unwrap_or(0.0);
    let urdf = golden["urdf"].as_str().map_or_else(model::urdf, str::to_owned);
    let mut robot = Model::from_urdf(&urdf, &ModelOptions { base, armature, ..Default::default() }).expect("URDF");
    for own in &mut robot.joints {
        own.viscous_friction = number(&joint["damping"]);
        own.coulomb_friction = number(&joint["frictionloss"]);
    }
    robot
}

fn options(golden: &Value) -> SimOptions {
    let gravity = numbers(&golden["options"]["gravity"]);
    SimOptions {
        timestep: number(&golden["options"]["timestep"]),
        gravity: [gravity[0], gravity[1], gravity[2]],
        impratio: number(&golden["options"]["impratio"]),
        // MuJoCo's height fields feel them.
        inner_edges: true,
        ..Default::default()
    }
}

fn simulation(golden: &Value, terrain: &Terrain) -> Batch<f64> {
    let model = model_of(golden, &golden["joint"]);
    let mut sim = Batch::new(&model, terrain, &options(golden), 1).expect("options of the golden");
    let state = State { q: numbers(&golden["initial_q"]), v: numbers(&golden["initial_v"]) };
    sim.set_state(0, &state).expect("state of the golden");
    sim
}

fn ground(golden: &Value) -> Terrain {
    match golden["friction"].as_f64() {
        Some(friction) => Terrain::plane().with_friction(friction).expect("friction of the golden"),
        None => Terrain::none(),
    }
}

/// Runs the golden's motion and gives the state at each of its samples. Without gains nothing is commanded.
fn run(golden: &Value, sim: &mut Batch<f64>, target: impl Fn(f64) -> [f64; 12]) -> Vec<State> {
    let joints = sim.model().joint_names().len();
    let gain = |name: &str| vec![golden["gains"][name].as_f64().unwrap_or(0.0); joints];
    let (kp, kd, zero) = (gain("kp"), gain("kd"), vec![0.0; joints]);
    let timestep = sim.options().timestep;
    let every = (number(&golden["sample_interval"]) / timestep).round() as usize;
    let steps = (number(&golden["duration"]) / timestep).round() as usize;
    let mut samples = vec![sim.state(0).unwrap()];
    for step in 0..steps {
        let q = target(step as f64 * timestep);
        sim.set_command(0, &JointCommand { q: &q[..joints], dq: &zero, kp: &kp, kd: &kd, tau: &zero }).unwrap();
        sim.step();
        if (step + 1) % every == 0 {
            samples.push(sim.state(0).unwrap());
        }
    }
    samples
}

fn still(_: f64) -> [f64; 12] {
    [0.0; 12]
}

fn stand(golden: &Value) -> impl Fn(f64) -> [f64; 12] + use<> {
    let stand = numbers(&golden["stand"]);
    move |_| std::array::from_fn(|j| stand[j])
}

fn trot(golden: &Value) -> Trot {
    let t = &golden["trot"];
    Trot {
        frequency: number(&t["frequency"]),
        ramp: number(&t["ramp"]),
        swing: number(&t["swing"]),
        lift: number(&t["lift"]),
        lift_delay: number(&t["lift_delay"]),
        phases: ["FL", "FR", "RL", "RR"].map(|leg| number(&t["phases"][leg])),
    }
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).take(3).map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt()
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(s, n), x| (s + x * x, n + 1.0));
    (sum / count).sqrt()
}

fn rms_of_all(samples: &[State], theirs: &[Vec<f64>]) -> f64 {
    assert_eq!(samples.len(), theirs.len());
    let pairs = samples.iter().zip(theirs).flat_map(|(a, b)| a.q.iter().zip(b));
    rms(pairs.map(|(a, b)| a - b))
}

#[test]
fn one_step_from_random_states() {
    let golden = golden("single_step");
    for (index, state) in golden["states"].as_array().unwrap().iter().enumerate() {
        let model = model_of(&golden, &state["joint"]);
        let mut sim = Batch::<f64>::new(&model, &ground(&golden), &options(&golden), 1).unwrap();
        sim.set_state(0, &State { q: numbers(&state["q"]), v: numbers(&state["v"]) }).unwrap();
        let (kp, kd) = ([number(&golden["gains"]["kp"]); 12], [number(&golden["gains"]["kd"]); 12]);
        let q = numbers(&state["ctrl"]);
        sim.set_command(0, &JointCommand { q: &q, dq: &[0.0; 12], kp: &kp, kd: &kd, tau: &[0.0; 12] }).unwrap();
        sim.step();
        let found = sim.state(0).unwrap();
        let scale = rms(numbers(&state["v_next"]).into_iter());
        for (i, (ours, theirs)) in found.v.iter().zip(numbers(&state["v_next"])).enumerate() {
            assert!((ours - theirs).abs() < 1e-6 * scale, "state {index}, velocity {i}: {ours} against {theirs}");
        }
        for (i, (ours, theirs)) in found.q.iter().zip(numbers(&state["q_next"])).enumerate() {
            assert!((ours - theirs).abs() < 1e-8, "state {index}, position {i}: {ours} against {theirs}");
        }
    }
}

#[test]
fn drop_of_the_standing_robot() {
    let golden = golden("drop");
    let mut sim = simulation(&golden, &ground(&golden));
    let samples = run(&golden, &mut sim, stand(&golden));
    let error = rms(samples.iter().zip(rows(&golden["q"])).map(|(ours, theirs)| ours.q[2] - theirs[2]));
    println!("drop: {:.6} mm rms in z", error * 1e3);
    assert!(error <= number(&golden["tolerance"]["z_rms_m"]), "{error} m");
}

#[test]
fn chirp_of_the_held_robot() {
    for name in ["chirp", "chirp_friction"] {
        let golden = golden(name);
        let chirp = &golden["chirp"];
        let chirp = Chirp {
            start: number(&chirp["start"]),
            end: number(&chirp["end"]),
            duration: number(&chirp["duration"]),
            ramp: number(&chirp["ramp"]),
            amplitude: number(&chirp["amplitude"]),
            phase_step: number(&chirp["phase_step"]),
        };
        let mut sim = simulation(&golden, &ground(&golden));
        let samples = run(&golden, &mut sim, |t| chirp.target(t));
        let error = rms_of_all(&samples, &rows(&golden["q"]));
        println!("{name}: {:.6} mrad rms", error * 1e3);
        assert!(error <= number(&golden["tolerance"]["rms_rad"]), "{name}: {error} rad");
    }
}

#[test]
fn trot_on_the_flat() {
    for name in ["trot_mu08", "trot_mu02", "trot_friction_mu08", "trot_friction_mu02"] {
        let golden = golden(name);
        let trot = trot(&golden);
        let mut sim = simulation(&golden, &ground(&golden));
        let samples = run(&golden, &mut sim, |t| trot.target(t));
        end_position(name, &golden, &samples);
    }
}

fn end_position(name: &str, golden: &Value, samples: &[State]) {
    let theirs = rows(&golden["q"]).pop().expect("samples");
    let error = distance(&samples[samples.len() - 1].q, &theirs);
    println!("{name}: end position off by {:.6} mm", error * 1e3);
    assert!(error <= number(&golden["tolerance"]["end_position_m"]), "{name}: {error} m");
}

/// The golden's bumps as a height field, and as a mesh of the same triangles.
fn bumps(golden: &Value) -> [Terrain; 2] {
    let t = &golden["terrain"];
    let size = |name: &str| t[name].as_u64().unwrap_or_else(|| panic!("expected terrain.{name}")) as usize;
    let (columns, cell) = (size("columns"), number(&t["cell"]));
    let (x0, y0) = (number(&t["x0"]), number(&t["y0"]));
    let heights: Vec<f64> = rows(&golden["heights"]).concat();
    let count = size("rows");
    let vertices = heights
        .iter()
        .enumerate()
        .map(|(i, &z)| glam::DVec3::new(x0 + (i % columns) as f64 * cell, y0 + (i / columns) as f64 * cell, z));
    let mut mesh = qv_core::TriangleMesh { vertices: vertices.collect(), ..Default::default() };
    for j in 0..count - 1 {
        for i in 0..columns - 1 {
            let a = (j * columns + i) as u32;
            let above = a + columns as u32;
            mesh.triangles.push([a, a + 1, above + 1]);
            mesh.triangles.push([a, above + 1, above]);
        }
    }
    let friction = number(&golden["friction"]);
    [
        Terrain::height_field([x0, y0], [cell, cell], columns, count, heights).expect("heights of the golden"),
        Terrain::from_mesh(&mesh).expect("triangles of the golden"),
    ]
    .map(|terrain| terrain.with_friction(friction).expect("friction of the golden"))
}

#[test]
fn trot_on_bumps() {
    for name in ["trot_bumps_mu08", "trot_bumps_mu02"] {
        let golden = golden(name);
        let trot = trot(&golden);
        let ends = bumps(&golden).map(|terrain| {
            let mut sim = simulation(&golden, &terrain);
            let samples = run(&golden, &mut sim, |t| trot.target(t));
            end_position(name, &golden, &samples);
            samples[samples.len() - 1].clone()
        });
        assert!(distance(&ends[0].q, &ends[1].q) < 1e-6, "{name}: height field and mesh differ");
    }
}

#[test]
fn robot_on_an_incline_holds_then_slides() {
    for name in ["incline_hold", "incline_slide"] {
        let golden = golden(name);
        let mut sim = simulation(&golden, &ground(&golden));
        let samples = run(&golden, &mut sim, stand(&golden));
        let theirs = rows(&golden["q_and_velocity"]).pop().expect("samples");
        let (ours, theirs) = (&samples[samples.len() - 1].v[..3], &theirs[theirs.len() - 3..]);
        let speed = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        println!("{name}: {:.6} m/s against {:.6}", speed(ours), speed(theirs));
        if name == "incline_hold" {
            let most = number(&golden["tolerance"]["holding_speed_m_per_s"]);
            assert!(speed(ours) < most && speed(theirs) < most, "{name} slides");
        } else {
            let error = (speed(ours) / speed(theirs) - 1.0).abs();
            assert!(error <= number(&golden["tolerance"]["speed_relative"]), "{name}: speed off by {error}");
            assert!(speed(ours) > 0.1, "{name} does not slide");
        }
    }
}

#[test]
fn free_flight_keeps_energy_and_momentum() {
    let golden = golden("free_flight");
    let mut sim = simulation(&golden, &ground(&golden));
    let samples = run(&golden, &mut sim, still);
    let robot = sim.model().clone();
    let start = robot.mechanics(&samples[0].q, &samples[0].v);
    let (mut energy, mut momentum) = (0.0f64, 0.0f64);
    for sample in &samples {
        let now = robot.mechanics(&sample.q, &sample.v);
        energy = energy.max((now.kinetic_energy - start.kinetic_energy).abs());
        momentum = momentum.max((now.angular_momentum - start.angular_momentum).length());
    }
    let (their_energy, their_momentum) =
        (number(&golden["tolerance"]["energy_drift_J"]), number(&golden["tolerance"]["angular_momentum_drift"]));
    println!(
        "free flight: energy drifts {energy:.6} J (MuJoCo {their_energy:.6}), momentum {momentum:.7} ({their_momentum:.7})"
    );
    assert!((start.kinetic_energy - rows(&golden["rows"])[0][2]).abs() < 1e-9, "not the same motion");
    // The tolerances are MuJoCo's own drifts; the last digits of equal arithmetic in another order are allowed for.
    assert!(energy <= their_energy * 1.001 && momentum <= their_momentum * 1.001);
}

#[test]
fn pendulums_with_friction() {
    for name in ["pendulum", "double_pendulum"] {
        let golden = golden(name);
        let mut sim = simulation(&golden, &ground(&golden));
        let samples = run(&golden, &mut sim, still);
        let error = rms_of_all(&samples, &rows(&golden["q"]));
        println!("{name}: {:.6} mrad rms", error * 1e3);
        assert!(error <= number(&golden["tolerance"]["rms_rad"]), "{name}: {error} rad");
    }
}

#[test]
fn boxes_dropped_and_thrown() {
    for name in ["box_drop", "box_throw"] {
        let golden = golden(name);
        let mut sim = simulation(&golden, &ground(&golden));
        let samples = run(&golden, &mut sim, still);
        let theirs = rows(&golden["q"]);
        let error = rms(samples.iter().zip(&theirs).map(|(a, b)| distance(&a.q, b)));
        println!("{name}: path off by {:.6} mm rms", error * 1e3);
        assert!(error <= number(&golden["tolerance"]["path_rms_m"]), "{name}: {error} m");
    }
}
