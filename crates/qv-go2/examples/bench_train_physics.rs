//! Steps per second of CPU time of the physics that a walking policy is trained on: Go2 at 5 ms.
//!
//! `cargo run --release -p quadverse-go2 --example bench_train_physics -- [--scene stand|trot|noise] [--ground plane|field|mesh]
//! [--iterations N] [--shapes yes|no] [--warm last|cheaper] [--line-search halving|apex] [--line-steps N] [--tolerance X] [--timestep S] [--scalar f32|f64] [--count N] [--seconds S]
//! [--error yes]`
//! prints one line of JSON per case: without arguments the standing plane, the noisy plane at 30 and 6 iterations and the
//! noisy field at 6, each without and with shapes.
//!
//! `noise`: every 20 ms each joint gets a target from a normal distribution about the stand, as an untrained policy's
//! exploration would give it; who falls starts again. One thread. Only the steps are timed, not commands and restarts.
//! With `--error yes` every step is done again by a solve to the end in f64, from the same state: `base_error` \[m/s\] and
//! `joint_error` \[rad/s\] are the root mean squares of what one step's speeds are off, `worst_joint` the greatest.
//!
//! `bits` is a hash of all end states: equal in two programs that compute the same.

use qv_core::TriangleMesh;
use qv_core::random::SplitMix64;
use qv_go2::gait::Trot;
use qv_go2::model;
use qv_sim::{
    BaseKind, Batch, JointCommand, LineSearch, Model, ModelOptions, Precision, SimOptions, State, Terrain, WarmStart,
};
use std::hash::{DefaultHasher, Hasher};
use std::time::Instant;

/// Deviation of a target from the stand \[rad\]: actions of deviation 0.5, scaled by 0.25 rad.
const DEVIATION: f64 = 0.5 * 0.25;
/// Gains of the policy's position loop \[N m/rad, N m s/rad\].
const KP: f64 = 30.0;
const KD: f64 = 0.75;
/// Time for which a target holds \[s\].
const HELD: f64 = 0.02;
/// Simulated seconds before the clock starts, and between two looks at whether time is up.
const SETTLE: f64 = 1.0;
const ROUND: f64 = 1.0;
/// A base lower than this over its feet's ground, or tilted more than `acos` of this, starts again \[m\].
const LOWEST: f64 = 0.15;
const MOST_TILTED: f64 = 0.5;

#[derive(Clone)]
struct Case {
    scene: String,
    ground: String,
    iterations: usize,
    shapes: bool,
    warm: String,
    line_search: String,
    line_steps: usize,
    tolerance: Option<f64>,
    timestep: f64,
}

struct Arguments {
    cases: Vec<Case>,
    scalar: String,
    count: usize,
    seconds: f64,
    error: bool,
}

fn arguments() -> Result<Arguments, String> {
    let case = |scene: &str, ground: &str, iterations| Case {
        scene: scene.into(),
        ground: ground.into(),
        iterations,
        shapes: false,
        warm: "last".into(),
        line_search: "halving".into(),
        line_steps: SimOptions::default().line_search_iterations,
        tolerance: None,
        timestep: 0.005,
    };
    let mut single = case("stand", "plane", 6);
    let mut parsed = Arguments { cases: vec![], scalar: "f32".into(), count: 256, seconds: 3.0, error: false };
    let (mut named, mut rest) = (false, std::env::args().skip(1));
    while let Some(name) = rest.next() {
        let value = rest.next().ok_or(format!("{name}: expected a value"))?;
        let number = || value.parse::<f64>().map_err(|e| format!("{name} {value}: {e}"));
        named |= !matches!(name.as_str(), "--scalar" | "--count" | "--seconds" | "--error");
        match name.as_str() {
            "--scene" => single.scene = value,
            "--ground" => single.ground = value,
            "--iterations" => single.iterations = number()? as usize,
            "--shapes" => single.shapes = value == "yes",
            "--line-search" => single.line_search = value,
            "--line-steps" => single.line_steps = number()? as usize,
            "--tolerance" => single.tolerance = Some(number()?),
            "--warm" => single.warm = value,
            "--timestep" => single.timestep = number()?,
            "--scalar" => parsed.scalar = value,
            "--count" => parsed.count = number()? as usize,
            "--error" => parsed.error = value == "yes",
            "--seconds" => parsed.seconds = number()?,
            _ => return Err(format!("unknown argument {name}")),
        }
    }
    let all = [("stand", "plane", 6), ("noise", "plane", 30), ("noise", "plane", 6), ("noise", "field", 6)];
    for (scene, ground, iterations) in all {
        for shapes in [false, true] {
            parsed.cases.push(Case { shapes, ..case(scene, ground, iterations) });
        }
    }
    if named {
        parsed.cases = vec![single];
    }
    Ok(parsed)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments = arguments()?;
    for case in &arguments.cases {
        match arguments.scalar.as_str() {
            "f32" => bench::<f32>(case, &arguments)?,
            "f64" => bench::<f64>(case, &arguments)?,
            other => return Err(format!("expected --scalar f32 or f64, found {other}").into()),
        }
    }
    Ok(())
}

fn bench<T: Precision>(case: &Case, arguments: &Arguments) -> Result<(), Box<dyn std::error::Error>> {
    let mut walk = Walk::<T>::new(case, arguments.count)?;
    if arguments.error {
        let solved = Case { iterations: 200, line_steps: 50, tolerance: Some(1e-9), ..case.clone() };
        walk.exact = Some(Box::new(Walk::<f64>::new(&solved, arguments.count)?.sim));
    }
    let rounds = |seconds: f64| (seconds / HELD).round() as usize;
    walk.run(rounds(SETTLE))?;
    walk.seconds = 0.0;
    let mut periods = 0;
    while walk.seconds < arguments.seconds {
        walk.run(rounds(ROUND))?;
        periods += rounds(ROUND);
        // The same work in every program: a hash after one round, whatever the speed.
        if periods == rounds(ROUND) {
            walk.bits = hash(&walk.sim)?;
        }
    }
    let steps = periods * walk.held * arguments.count;
    let error = walk.error.text();
    println!(
        r#"{{"scene":"{}","ground":"{}","iterations":{},"line_search":"{}","line_steps":{},"shapes":{},"warm":"{}","scalar":"{}","lanes":{},"environments":{},"steps_per_cpu_second":{:.0},"restarts":{},"bits":"{:016x}"{error}}}"#,
        case.scene,
        case.ground,
        case.iterations,
        case.line_search,
        case.line_steps,
        case.shapes,
        case.warm,
        arguments.scalar,
        walk.sim.lanes(),
        arguments.count,
        steps as f64 / walk.seconds,
        walk.restarts,
        walk.bits,
    );
    Ok(())
}

/// Robots on their ground, each at a place of its own.
struct Walk<T: Precision> {
    sim: Batch<T>,
    scene: String,
    starts: Vec<State>,
    /// Steps for which a target holds, and the first of the next.
    held: usize,
    step: usize,
    timestep: f64,
    random: Random,
    restarts: usize,
    /// CPU time of the steps.
    seconds: f64,
    bits: u64,
    /// Does every step again to the end.
    exact: Option<Box<Batch<f64>>>,
    error: Errors,
}

/// Sums of squares of what speeds are off after one step, with their number, and the greatest.
#[derive(Default)]
struct Errors {
    base: f64,
    joints: f64,
    worst: f64,
    steps: usize,
}

impl Errors {
    fn add(&mut self, found: &State, exact: &State) {
        let off = |k: usize| (found.v[k] - exact.v[k]).powi(2);
        self.base += (0..3).map(off).sum::<f64>();
        self.joints += (6..18).map(off).sum::<f64>() / 12.0;
        self.worst = (6..18).map(|k| off(k).sqrt()).fold(self.worst, f64::max);
        self.steps += 1;
    }

    /// More fields for the line of JSON; none where nothing was compared.
    fn text(&self) -> String {
        let root = |sum: f64| (sum / self.steps as f64).sqrt();
        if self.steps == 0 {
            return String::new();
        }
        let (base, joints) = (root(self.base), root(self.joints));
        format!(r#","base_error":{base:.2e},"joint_error":{joints:.2e},"worst_joint":{:.2e}"#, self.worst)
    }
}

impl<T: Precision> Walk<T> {
    fn new(case: &Case, count: usize) -> Result<Self, Box<dyn std::error::Error>> {
        let text = if case.shapes { model::urdf_with_shapes() } else { model::urdf() };
        let options = ModelOptions { base: BaseKind::Floating, armature: model::ARMATURE, ..Default::default() };
        let robot = Model::from_urdf(&text, &options)?;
        let terrain = match case.ground.as_str() {
            "plane" => Terrain::plane(),
            "field" => Terrain::height_field([-HALF; 2], [CELL; 2], POINTS, POINTS, bumps())?,
            "mesh" => Terrain::from_mesh(&mesh())?,
            other => return Err(format!("expected --ground plane, field or mesh, found {other}").into()),
        };
        let warm_start = match case.warm.as_str() {
            "last" => WarmStart::Last,
            "cheaper" => WarmStart::Cheaper,
            other => return Err(format!("expected --warm last or cheaper, found {other}").into()),
        };
        let line_search = match case.line_search.as_str() {
            "halving" => LineSearch::Halving,
            "apex" => LineSearch::Apex,
            other => return Err(format!("expected --line-search halving or apex, found {other}").into()),
        };
        let options = SimOptions {
            timestep: case.timestep,
            iterations: case.iterations,
            line_search,
            line_search_iterations: case.line_steps,
            warm_start,
            tolerance: case.tolerance,
            ..Default::default()
        };
        let mut sim = Batch::<T>::new(&robot, &terrain, &options, count)?;
        let side = (count as f64).sqrt().ceil() as usize;
        let mut starts = Vec::new();
        for env in 0..count {
            let place = |k: usize| (k as f64 + 0.5) / side as f64 * 1.6 * HALF - 0.8 * HALF;
            let (x, y) = (place(env % side), place(env / side));
            let corner = |k: usize| [[-0.3, -0.3], [0.3, -0.3], [-0.3, 0.3], [0.3, 0.3], [0.0, 0.0]][k];
            let heights = (0..5).map(|k| terrain.height_below(x + corner(k)[0], y + corner(k)[1], 1.0));
            let ground = heights.flatten().fold(0.0, f64::max);
            let mut q = vec![x, y, ground + model::touching_height(&model::STAND), 1.0, 0.0, 0.0, 0.0];
            q.extend(model::STAND);
            starts.push(State { q, v: vec![0.0; 18] });
            sim.set_state(env, &starts[env])?;
        }
        let held = (HELD / case.timestep).round() as usize;
        let (scene, random) = (case.scene.clone(), Random(SplitMix64::new(7)));
        Ok(Self {
            sim,
            scene,
            starts,
            held,
            step: 0,
            timestep: case.timestep,
            random,
            restarts: 0,
            seconds: 0.0,
            bits: 0,
            exact: None,
            error: Errors::default(),
        })
    }

    fn run(&mut self, periods: usize) -> Result<(), Box<dyn std::error::Error>> {
        let (kp, kd, zero) = ([KP; 12], [KD; 12], [0.0; 12]);
        let mut now = self.starts[0].clone();
        let mut commands = vec![[0.0; 12]; self.sim.len()];
        for _ in 0..periods {
            for env in 0..self.sim.len() {
                self.sim.read_state(env, &mut now)?;
                let (tilt, height) = (1.0 - 2.0 * (now.q[4].powi(2) + now.q[5].powi(2)), now.q[2]);
                if tilt < MOST_TILTED || height < LOWEST || self.sim.is_faulty(env)? {
                    self.sim.set_state(env, &self.starts[env])?;
                    self.restarts += 1;
                }
                let q = self.target()?;
                let command = JointCommand { q: &q, dq: &zero, kp: &kp, kd: &kd, tau: &zero };
                self.sim.set_command(env, &command)?;
                commands[env] = q;
            }
            if let Some(mut exact) = self.exact.take() {
                for _ in 0..self.held {
                    for (env, q) in commands.iter().enumerate() {
                        exact.set_state(env, &self.sim.state(env)?)?;
                        exact.set_command(env, &JointCommand { q, dq: &zero, kp: &kp, kd: &kd, tau: &zero })?;
                    }
                    exact.step();
                    self.sim.step();
                    for env in 0..commands.len() {
                        self.error.add(&self.sim.state(env)?, &exact.state(env)?);
                    }
                }
                // What such a run takes shows nothing.
                (self.exact, self.seconds) = (Some(exact), f64::INFINITY);
                self.step += self.held;
                continue;
            }
            let clock = Clock::start();
            self.sim.step_many(self.held);
            self.seconds += clock.seconds();
            self.step += self.held;
        }
        Ok(())
    }

    fn target(&mut self) -> Result<[f64; 12], String> {
        let mut target = match self.scene.as_str() {
            "stand" | "noise" => model::STAND,
            "trot" => Trot::default().target(self.step as f64 * self.timestep),
            other => return Err(format!("expected --scene stand, trot or noise, found {other}")),
        };
        if self.scene == "noise" {
            target.iter_mut().for_each(|angle| *angle += DEVIATION * self.random.normal());
        }
        Ok(target)
    }
}

fn hash<T: Precision>(sim: &Batch<T>) -> Result<u64, qv_sim::SimError> {
    let mut hasher = DefaultHasher::new();
    for env in 0..sim.len() {
        let State { q, v } = sim.state(env)?;
        q.iter().chain(&v).for_each(|x| hasher.write_u64(x.to_bits()));
    }
    Ok(hasher.finish())
}

/// Half the field's edge \[m\], a cell's edge \[m\], points along an edge, and the bumps' height \[m\].
const HALF: f64 = 10.0;
const CELL: f64 = 0.1;
const POINTS: usize = 201;
const BUMP: f64 = 0.04;

fn bumps() -> Vec<f64> {
    let mut random = Random(SplitMix64::new(11));
    (0..POINTS * POINTS).map(|_| BUMP * random.uniform()).collect()
}

/// The same ground as a mesh.
fn mesh() -> TriangleMesh {
    let heights = bumps();
    let mut mesh = TriangleMesh::default();
    for j in 0..POINTS {
        for i in 0..POINTS {
            let place = |k: usize| k as f64 * CELL - HALF;
            mesh.vertices.push(glam::DVec3::new(place(i), place(j), heights[j * POINTS + i]));
            if i + 1 < POINTS && j + 1 < POINTS {
                let [a, b] = [(j * POINTS + i) as u32, ((j + 1) * POINTS + i) as u32];
                mesh.triangles.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
            }
        }
    }
    mesh
}

/// Numbers in 0..1, and normal ones.
struct Random(SplitMix64);

impl Random {
    /// In 0..1.
    fn uniform(&mut self) -> f64 {
        (self.0.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Of deviation 1, by Box and Muller.
    fn normal(&mut self) -> f64 {
        let (u, v) = (1.0 - self.uniform(), self.uniform());
        (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    }
}

/// CPU time of this thread where the system shows it, else the time of day.
struct Clock {
    wall: Instant,
    thread: Option<u64>,
}

impl Clock {
    fn start() -> Self {
        Self { wall: Instant::now(), thread: thread_nanoseconds() }
    }

    fn seconds(&self) -> f64 {
        match (self.thread, thread_nanoseconds()) {
            (Some(start), Some(end)) => (end - start) as f64 * 1e-9,
            _ => self.wall.elapsed().as_secs_f64(),
        }
    }
}

/// Linux: time on a processor, the first number of `schedstat`.
fn thread_nanoseconds() -> Option<u64> {
    std::fs::read_to_string("/proc/thread-self/schedstat").ok()?.split(' ').next()?.parse().ok()
}
