//! What a training costs, as JSON on the last line, for `cargo xtask bench walk`. Times are CPU seconds of this process.
//!
//! - `bench_walk goal SEED MOST`: the Go2 on the plane until a score reaches the goal, at most MOST iterations, on all threads.
//! - `bench_walk loop plane|bumps WARM COUNT`: COUNT iterations after WARM others, on one thread, and which part takes what; `bumps` are
//!   4 cm high and robots differ as with `--robust`.

use cpu_time::{ProcessTime, ThreadTime};
use qv_policy::PolicyError;
use qv_policy::env::{End, VectorEnv};
use qv_policy::ppo::{Ppo, PpoSettings};
use qv_policy::symmetry::Symmetry;
use qv_policy::train::{TrainSettings, Training};
use qv_policy::velocity::{Commands, Ground, Randomise, TaskSettings, VelocityTask};
use serde_json::{Value, json};
use std::error::Error;
use std::time::{Duration, Instant};

/// The goal: errors below these \[m/s, rad/s\], and nobody falls.
const GOAL: [f32; 2] = [0.15, 0.2];
/// Robots at once.
const ROBOTS: usize = 256;
/// Height of the bumps \[m\].
const BUMPS: f32 = 0.04;
const SEED: u64 = 1;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let report = match words[..] {
        ["goal", seed, most] => goal(seed.parse()?, most.parse()?)?,
        ["loop", ground, warm, count] => on_one_thread(ground, warm.parse()?, count.parse()?)?,
        _ => return Err("expected `goal SEED MOST` or `loop plane|bumps WARM COUNT`".into()),
    };
    println!("{report}");
    Ok(())
}

fn goal(seed: u64, most: u64) -> Result<Value, PolicyError> {
    let mut settings = TrainSettings { seed, robots: ROBOTS, score_every: 10, ..Default::default() };
    settings.task.commands = Commands { vx: [0.0, 1.0], vy: [0.0; 2], wz: [-1.0, 1.0], ..Default::default() };
    let (clock, wall) = (ProcessTime::now(), Instant::now());
    let mut training = Training::new(&qv_go2::walk::robot()?, &Ground::plane(), &settings)?;
    let (mut reached, mut samples) = (false, 0);
    while !reached && training.ppo().iterations < most {
        let line = training.advance()?;
        samples = line.samples;
        reached = line
            .score
            .is_some_and(|score| score.fell == 0 && score.velocity_error < GOAL[0] && score.turning_error < GOAL[1]);
    }
    let best = training.best().map(|(score, _)| score);
    Ok(json!({
        "reached": reached,
        "cpu_seconds": clock.elapsed().as_secs_f64(),
        "wall_seconds": wall.elapsed().as_secs_f64(),
        "samples": samples,
        "velocity_error": best.map(|score| score.velocity_error),
        "turning_error": best.map(|score| score.turning_error),
    }))
}

fn on_one_thread(ground: &str, warm: u64, count: u64) -> Result<Value, Box<dyn Error>> {
    if count == 0 {
        return Err("COUNT: expected at least 1, found 0".into());
    }
    let robot = qv_go2::walk::robot()?;
    let mut settings = TaskSettings::default();
    let ground = match ground {
        "plane" => Ground::plane(),
        "bumps" => {
            settings.randomise = Randomise::robust(&robot.model.links[0].name);
            Ground::bumps(BUMPS, SEED)?
        }
        other => return Err(format!("ground: expected plane or bumps, found {other}").into()),
    };
    let mut task = VelocityTask::new(robot, ground, settings, ROBOTS)?;
    task.restart(SEED, 0)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    // Of a pool with one thread that thread does all, so its clock measures all.
    Ok(pool.install(|| measure(task, warm, count))?)
}

fn measure(task: VelocityTask, warm: u64, count: u64) -> Result<Value, PolicyError> {
    let settings = PpoSettings::default();
    let mut env = TimedTask { task, parts: Parts::default(), last: ThreadTime::now() };
    let mut ppo = Ppo::new(&settings, &env, SEED)?;
    ppo.reseed(SEED, 0, ROBOTS);
    for _ in 0..warm {
        ppo.iterate(&mut env)?;
    }
    env.parts = Parts::default();
    let (clock, mut update) = (ThreadTime::now(), Duration::ZERO);
    for _ in 0..count {
        ppo.iterate(&mut env)?;
        // The last that an iteration asks of the task is an observation: what follows is the update.
        update += env.last.elapsed();
    }
    let whole = clock.elapsed();
    let Parts { physics, task } = env.parts;
    let samples = count as f64 * (ROBOTS * settings.steps) as f64;
    let share = |part: Duration| part.as_secs_f64() / whole.as_secs_f64();
    Ok(json!({
        "steps_per_cpu_second": samples / whole.as_secs_f64(),
        "iteration_seconds": whole.as_secs_f64() / count as f64,
        "update_seconds": update.as_secs_f64() / count as f64,
        "rollout_networks_seconds": (whole - physics - task - update).as_secs_f64() / count as f64,
        "share": {
            "physics": share(physics),
            "observe_and_reward": share(task),
            "networks_forward": share(whole - physics - task - update),
            "update": share(update),
        },
        "critic_inputs": env.task.privileged(),
    }))
}

/// Time spent in the task.
#[derive(Default)]
struct Parts {
    physics: Duration,
    task: Duration,
}

/// The task with a clock.
struct TimedTask {
    task: VelocityTask,
    parts: Parts,
    /// When the task was last done with what it was asked.
    last: ThreadTime,
}

impl TimedTask {
    fn timed<T>(&mut self, what: impl FnOnce(&mut VelocityTask) -> T) -> T {
        let clock = ThreadTime::now();
        let answer = what(&mut self.task);
        self.parts.task += clock.elapsed();
        self.last = ThreadTime::now();
        answer
    }
}

impl VectorEnv for TimedTask {
    fn count(&self) -> usize {
        self.task.count()
    }
    fn observations(&self) -> usize {
        self.task.observations()
    }
    fn privileged(&self) -> usize {
        self.task.privileged()
    }
    fn actions(&self) -> usize {
        self.task.actions()
    }
    fn observation_scaling(&self) -> (Vec<f32>, Vec<f32>) {
        self.task.observation_scaling()
    }
    fn privileged_scaling(&self) -> (Vec<f32>, Vec<f32>) {
        self.task.privileged_scaling()
    }
    fn observe(&mut self, observations: &mut [f32], privileged: &mut [f32]) {
        self.timed(|task| task.observe(observations, privileged));
    }
    fn step(&mut self, actions: &[f32], rewards: &mut [f32], ends: &mut [End]) -> Result<(), PolicyError> {
        self.timed(|task| task.aim(actions))?;
        let clock = ThreadTime::now();
        self.task.simulate()?;
        self.parts.physics += clock.elapsed();
        self.timed(|task| task.judge(actions, rewards, ends))
    }
    fn reset(&mut self, mask: &[bool]) -> Result<(), PolicyError> {
        self.timed(|task| task.reset(mask))
    }
    fn restart(&mut self, seed: u64, epoch: u64) -> Result<(), PolicyError> {
        self.timed(|task| task.restart(seed, epoch))
    }
    fn symmetry(&self) -> Option<Symmetry> {
        self.task.symmetry()
    }
    fn figures(&mut self) -> Vec<(&'static str, f32)> {
        self.task.figures()
    }
    fn curriculum(&self) -> Vec<f32> {
        self.task.curriculum()
    }
    fn set_curriculum(&mut self, numbers: &[f32]) {
        self.task.set_curriculum(numbers);
    }
}
