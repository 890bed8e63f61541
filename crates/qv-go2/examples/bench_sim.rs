//! Steps per second of the simulator on the Go2's trot: the other side of `fixtures/mujoco/bench.py`.
//!
//! `cargo run --release -p quadverse-go2 --example bench_sim -- --case flat|friction|mesh --mode single|batch`; prints one line
//! of JSON. `cargo xtask bench sim` runs both in turn.

use qv_core::TriangleMesh;
use qv_go2::gait::Trot;
use qv_go2::model;
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, Precision, SimOptions, State, Terrain};
use std::time::Instant;

/// Steps of one trot, as in the reference.
const STEPS: usize = 4000;

struct Arguments {
    case: String,
    mode: String,
    scalar: String,
    seconds: f64,
    threads: usize,
    count: usize,
}

fn arguments() -> Result<Arguments, String> {
    let mut parsed = Arguments {
        case: "flat".into(),
        mode: "single".into(),
        scalar: "f64".into(),
        seconds: 2.0,
        threads: 1,
        count: 0,
    };
    let mut rest = std::env::args().skip(1);
    while let Some(name) = rest.next() {
        let value = rest.next().ok_or(format!("{name}: expected a value"))?;
        let number = || value.parse::<f64>().map_err(|e| format!("{name} {value}: {e}"));
        match name.as_str() {
            "--case" => parsed.case = value,
            "--mode" => parsed.mode = value,
            "--scalar" => parsed.scalar = value,
            "--seconds" => parsed.seconds = number()?,
            "--threads" => parsed.threads = number()? as usize,
            "--count" => parsed.count = number()? as usize,
            _ => return Err(format!("unknown argument {name}")),
        }
    }
    if parsed.count == 0 {
        parsed.count = if parsed.mode == "batch" { 256 } else { 1 };
    }
    Ok(parsed)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments = arguments()?;
    // Inside the pool: a call from outside would wake sleeping threads at every step.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads).build()?;
    let rate = pool.install(|| match arguments.scalar.as_str() {
        "f32" => bench::<f32>(&arguments).map_err(|e| e.to_string()),
        "f64" => bench::<f64>(&arguments).map_err(|e| e.to_string()),
        other => Err(format!("expected --scalar f32 or f64, found {other}")),
    });
    Ok(rate?)
}

fn bench<T: Precision>(arguments: &Arguments) -> Result<(), Box<dyn std::error::Error>> {
    let options = ModelOptions { base: BaseKind::Floating, armature: model::ARMATURE, ..Default::default() };
    let mut robot = Model::from_urdf(&model::urdf(), &options)?;
    if arguments.case == "friction" {
        for joint in &mut robot.joints {
            (joint.viscous_friction, joint.coulomb_friction) = (0.2, 0.2);
        }
    }
    let terrain = if arguments.case == "mesh" { Terrain::from_mesh(&bumps())? } else { Terrain::plane() };
    let mut sim = Batch::<T>::new(&robot, &terrain, &SimOptions::default(), arguments.count)?;
    let targets: Vec<[f64; 12]> = (0..STEPS).map(|k| Trot::default().target(k as f64 * 0.001)).collect();
    let mut q = vec![0.0, 0.0, model::touching_height(&model::STAND), 1.0, 0.0, 0.0, 0.0];
    q.extend(model::STAND);
    let start = State { q, v: vec![0.0; 18] };
    trot(&mut sim, &start, &targets[..200], arguments.threads)?;
    let (clock, mut steps) = (Instant::now(), 0);
    while clock.elapsed().as_secs_f64() < arguments.seconds {
        trot(&mut sim, &start, &targets, arguments.threads)?;
        steps += targets.len() * arguments.count;
    }
    let rate = steps as f64 / clock.elapsed().as_secs_f64();
    let end = sim.state(arguments.count - 1)?.q;
    if end[2] < 0.15 || sim.is_faulty(0)? {
        return Err(format!("expected the robot on its feet after 4 s, found its base at {:?}", &end[..3]).into());
    }
    println!(
        r#"{{"engine":"qv-sim","case":"{}","mode":"{}","threads":{},"scalar":"{}","lanes":{},"environments":{},"steps_per_second":{rate:.0},"bytes_per_environment":{},"end_position":{:?}}}"#,
        arguments.case,
        arguments.mode,
        arguments.threads,
        arguments.scalar,
        sim.lanes(),
        arguments.count,
        sim.bytes_per_environment(),
        &end[..3]
    );
    Ok(())
}

/// All environments trot from the stand, with a new command every step as in the reference.
fn trot<T: Precision>(
    sim: &mut Batch<T>,
    start: &State,
    targets: &[[f64; 12]],
    threads: usize,
) -> Result<(), qv_sim::SimError> {
    for env in 0..sim.len() {
        sim.set_state(env, start)?;
    }
    let (kp, kd, zero) = ([model::DEFAULT_KP; 12], [model::DEFAULT_KD; 12], [0.0; 12]);
    let commands: Vec<JointCommand> =
        targets.iter().map(|q| JointCommand { q, dq: &zero, kp: &kp, kd: &kd, tau: &zero }).collect();
    // As many steps at once as in the reference, which is given its controls beforehand, too.
    sim.follow(&commands, threads > 1)?;
    Ok(())
}

/// The reference's height field as a mesh of 20 000 triangles.
fn bumps() -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for j in 0..101u32 {
        for i in 0..101u32 {
            let (x, y) = (0.1 * f64::from(i) - 5.0, 0.1 * f64::from(j) - 5.0);
            let noise = 43758.5453 * (12.9898 * f64::from(i) + 78.233 * f64::from(j)).sin();
            let flat = x.abs() < 0.4 + 1e-9 && y.abs() < 0.4 + 1e-9;
            let z = if flat { 0.0 } else { 0.03 * (noise - noise.floor()) };
            mesh.vertices.push(glam::DVec3::new(x, y, z));
            if i < 100 && j < 100 {
                let a = j * 101 + i;
                mesh.triangles.push([a, a + 1, a + 102]);
                mesh.triangles.push([a, a + 102, a + 101]);
            }
        }
    }
    mesh
}
