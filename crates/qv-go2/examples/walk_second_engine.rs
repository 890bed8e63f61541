//! A policy of `qv walk train` on the Go2 in the second engine, steps of 1 ms on the plane of the goldens:
//! `walk_second_engine POLICY.onnx [--runs 64] [--seconds 8] [--seed 0] [--friction 0.8] [--both]`, with policy.toml beside POLICY.onnx.
//!
//! Prints JSON as `fixtures/mujoco/walk.py` does: how many runs fell, and the mean errors of velocity \[m/s\] and turning \[rad/s\] from one
//! second after the start on. Commands are even in the ranges of policy.toml. `--both` adds what our engine gives for the same commands, the
//! same steps and the same sensors.

use clap::Parser;
use qv_core::random::Xoshiro256PlusPlus;
use qv_go2::model::{FOOT_SHAPES, touching_height};
use qv_policy::onnx::OnnxPolicy;
use qv_policy::policy::PolicyFile;
use qv_policy::velocity::{TaskRobot, clock_input};
use qv_sim::rapier::{RapierEngine, RapierOptions};
use qv_sim::{Batch, JointCommand, Model, SimError, SimOptions, State, Terrain};
use serde_json::{Value, json};
use std::error::Error;
use std::path::PathBuf;

/// How to walk.
#[derive(Parser)]
struct Arguments {
    /// policy.onnx of `qv walk train`, with policy.toml beside it
    policy: PathBuf,
    /// Walks, each under a command of its own
    #[arg(long, default_value_t = 64)]
    runs: usize,
    /// How long each lasts [s]
    #[arg(long, default_value_t = 8.0)]
    seconds: f64,
    /// Seed of the commands
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Friction of the plane
    #[arg(long, default_value_t = 0.8)]
    friction: f64,
    /// Our engine, too
    #[arg(long)]
    both: bool,
}

/// Time step of physics, and the time from which errors count \[s\]: those of walk.py.
const TIMESTEP: f64 = 0.001;
const SETTLING: f64 = 1.0;
/// A robot that leans by more \[rad\], or whose base is lower \[m\], has fallen: as in walk.py.
const MOST_TILT: f64 = 1.0;
const LEAST_HEIGHT: f64 = 0.16;

/// An engine with one robot.
enum Engine {
    Second(Box<RapierEngine>),
    Ours(Box<Batch<f64>>),
}

impl Engine {
    fn begin(&mut self, state: &State) -> Result<(), SimError> {
        match self {
            Self::Second(engine) => engine.set_state(state),
            Self::Ours(batch) => batch.set_state(0, state),
        }
    }

    /// Steps under a command; none once the numbers ran away.
    fn advance(&mut self, command: &JointCommand, steps: usize) -> Result<Option<State>, SimError> {
        match self {
            Self::Second(engine) => {
                engine.set_command(command)?;
                (0..steps).try_for_each(|_| engine.step())?;
                Ok((!engine.is_faulty()).then(|| engine.state()))
            }
            Self::Ours(batch) => {
                batch.set_command(0, command)?;
                batch.step_many(steps);
                let state = batch.state(0)?;
                Ok((!batch.is_faulty(0)?).then_some(state))
            }
        }
    }
}

/// What all walks share.
struct Walks {
    robot: TaskRobot,
    file: PolicyFile,
    start: State,
    steps: usize,
    decisions: usize,
}

/// Sums over the decisions of a walk that count.
#[derive(Default)]
struct Errors {
    velocity: f64,
    turning: f64,
    count: f64,
    falls: usize,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    let mut policy = OnnxPolicy::from_bytes(&std::fs::read(&arguments.policy)?)?;
    let file = PolicyFile::parse(&std::fs::read_to_string(arguments.policy.with_file_name("policy.toml"))?)?;
    let robot = qv_go2::walk::robot()?;
    file.check(&robot)?;
    let period = 1.0 / (f64::from(file.rate) * TIMESTEP);
    if (period - period.round()).abs() > 1e-3 || period < 1.0 {
        return Err(
            format!("policy.toml, rate: expected a whole number of steps of 1 ms, found {} Hz", file.rate).into()
        );
    }
    if !(arguments.seconds > SETTLING && arguments.seconds <= 1e4) {
        return Err(
            format!("--seconds: expected more than {SETTLING}, at most 10000, found {}", arguments.seconds).into()
        );
    }
    let terrain = Terrain::plane().with_friction(arguments.friction)?;
    let commands = commands(&file, arguments.runs, arguments.seed);
    let model = feet_only(&robot);
    let decisions = (arguments.seconds * f64::from(file.rate)).round() as usize;
    let walks = Walks { start: standing(&file), steps: period.round() as usize, decisions, robot, file };
    let second = RapierEngine::new(&model, &terrain, &RapierOptions { timestep: TIMESTEP, ..Default::default() })?;
    let mut engines = vec![("rapier", Engine::Second(Box::new(second)))];
    if arguments.both {
        let options = SimOptions { timestep: TIMESTEP, tolerance: Some(1e-12), ..Default::default() };
        engines.push(("qv-sim", Engine::Ours(Box::new(Batch::new(&model, &terrain, &options, 1)?))));
    }
    for (name, mut engine) in engines {
        let mut errors = Errors::default();
        for &command in &commands {
            walks.walk(&mut engine, &mut policy, command, &mut errors)?;
        }
        println!("{}", errors.report(name, &arguments));
    }
    Ok(())
}

/// The robot as MuJoCo's reference has it: only feet touch.
fn feet_only(robot: &TaskRobot) -> Model {
    let mut model = robot.model.clone();
    model.geoms.retain(|geom| FOOT_SHAPES.contains(&geom.name.as_str()));
    model
}

/// Even in the ranges of policy.toml: forwards, to the left \[m/s\], turning \[rad/s\].
fn commands(file: &PolicyFile, runs: usize, seed: u64) -> Vec<[f32; 3]> {
    let mut random = Xoshiro256PlusPlus::of(seed, 31, 0);
    let ranges = [file.commands.vx, file.commands.vy, file.commands.wz];
    (0..runs).map(|_| ranges.map(|[low, high]| random.between(low, high))).collect()
}

/// At rest in the policy's stand, the feet on the ground.
fn standing(file: &PolicyFile) -> State {
    let stand: Vec<f64> = file.stand.iter().map(|&x| f64::from(x)).collect();
    let angles: [f64; 12] = std::array::from_fn(|j| stand.get(j).copied().unwrap_or(0.0));
    let mut q = vec![0.0, 0.0, touching_height(&angles), 1.0, 0.0, 0.0, 0.0];
    q.extend(angles);
    State { q, v: vec![0.0; 18] }
}

impl Walks {
    fn walk(
        &self,
        engine: &mut Engine,
        policy: &mut OnnxPolicy,
        command: [f32; 3],
        errors: &mut Errors,
    ) -> Result<(), Box<dyn Error>> {
        let wide = |list: &[f32]| list.iter().map(|&x| f64::from(x)).collect::<Vec<_>>();
        let (kp, kd, zero) = (wide(&self.file.kp), wide(&self.file.kd), vec![0.0; 12]);
        let settled = (SETTLING * f64::from(self.file.rate)) as usize;
        let mut targets = self.file.stand.clone();
        let mut state = self.start.clone();
        engine.begin(&state)?;
        for decision in 0..self.decisions {
            let (gravity, heading) = attitude(&state);
            if -gravity[2] < MOST_TILT.cos() || state.q[2] < LEAST_HEIGHT {
                errors.falls += 1;
                return Ok(());
            }
            if decision >= settled {
                errors.add(&state, heading, gravity, command);
            }
            let mut seen = observation(&state, gravity, command, &targets);
            seen.extend(clock_input(self.file.clock, self.file.rate, decision, command));
            policy.run(&seen, &mut targets)?;
            if targets.len() != self.robot.joints() {
                return Err(format!("policy: expected {} targets, found {}", self.robot.joints(), targets.len()).into());
            }
            let q = wide(&targets);
            let held = JointCommand { q: &q, dq: &zero, kp: &kp, kd: &kd, tau: &zero };
            match engine.advance(&held, self.steps)? {
                Some(next) => state = next,
                None => {
                    errors.falls += 1;
                    return Ok(());
                }
            }
        }
        Ok(())
    }
}

/// Direction of gravity in the base, and cosine and sine of the heading.
fn attitude(state: &State) -> ([f64; 3], [f64; 2]) {
    let [w, x, y, z] = std::array::from_fn(|k| state.q[3 + k]);
    let gravity = [2.0 * (w * y - x * z), -2.0 * (w * x + y * z), 2.0 * (x * x + y * y) - 1.0];
    let (c, s) = (1.0 - 2.0 * (y * y + z * z), 2.0 * (w * z + x * y));
    let length = c.hypot(s).max(1e-12);
    (gravity, [c / length, s / length])
}

/// What the policy sees but the clock, from the true state: the contract of policy.onnx.
fn observation(state: &State, gravity: [f64; 3], command: [f32; 3], targets: &[f32]) -> Vec<f32> {
    let narrow = |list: &[f64]| list.iter().map(|&x| x as f32).collect::<Vec<_>>();
    [
        narrow(&state.v[3..6]),
        narrow(&gravity),
        command.to_vec(),
        narrow(&state.q[7..]),
        narrow(&state.v[6..]),
        targets.to_vec(),
    ]
    .concat()
}

impl Errors {
    fn add(&mut self, state: &State, [c, s]: [f64; 2], gravity: [f64; 3], command: [f32; 3]) {
        let [vx, vy, wz] = command.map(f64::from);
        let (ahead, aside) = (c * state.v[0] + s * state.v[1], c * state.v[1] - s * state.v[0]);
        // About the vertical: gravity's direction is the vertical, downwards, in the axes of the base.
        let turning: f64 = -(0..3).map(|k| gravity[k] * state.v[3 + k]).sum::<f64>();
        self.velocity += (ahead - vx).hypot(aside - vy);
        self.turning += (turning - wz).abs();
        self.count += 1.0;
    }

    fn report(&self, engine: &str, arguments: &Arguments) -> Value {
        let mean = |sum: f64| if self.count > 0.0 { json!(sum / self.count) } else { Value::Null };
        json!({
            "engine": engine,
            "runs": arguments.runs,
            "seconds": arguments.seconds,
            "seed": arguments.seed,
            "falls": self.falls,
            "mean_velocity_error": mean(self.velocity),
            "mean_turning_error": mean(self.turning),
        })
    }
}
