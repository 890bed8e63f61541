//! Tuning and diagnosis of the same simulated Go2s, each with one hidden effect: command latency, motor strength, Coulomb friction or mass.
//! Prints what each estimates, with intervals, and how often the two agree:
//! `cargo run --release -p quadverse --example tune_and_diagnose -- CHECKPOINT.bin robots=10 seed=1`, with `effect=NAME` for one effect alone.
//! The robots walk under the policy of CHECKPOINT, half of them in our engine at 1 ms, half in Rapier where the build has it.

use qv_core::random::SplitMix64;
use qv_gap::{Options, diagnose};
use qv_policy::train::Checkpoint;
use qv_policy::velocity::{Ground, TaskRobot};
use qv_recording::Run;
use qv_residual::close::LoopSettings;
use qv_residual::fitting::fit_shared_first;
use qv_residual::hidden::{Engine, HiddenRobot, Order, wander};
use qv_residual::identify::{coordinates, tops};
use qv_residual::log::Log;
use qv_residual::study::Study;
use qv_residual::windows::Replayer;
use serde::Serialize;
use std::error::Error;

/// Walks that tuning is given, each of so many seconds; the diagnosis is given the first.
const WALKS: u64 = 30;
const SECONDS: f32 = 20.0;
/// Standard deviations of a 95 % interval.
const DEVIATIONS: f64 = 1.96;

/// How the diagnosis states a size.
#[derive(Clone, Copy, PartialEq)]
enum SizeConvention {
    /// As the simulator does.
    AsItIs,
    /// As a difference from 1.
    Change,
    /// As a mass on the base \[kg\].
    Payload,
}

/// One hidden effect.
struct Effect {
    /// Name in the library of the diagnosis.
    name: &'static str,
    /// Parameters of the simulator: what stands before and after a joint's or a link's name.
    parameter: [&'static str; 2],
    /// Range of sizes that are drawn.
    range: [f64; 2],
    stated: SizeConvention,
}

const EFFECTS: [Effect; 4] = [
    Effect {
        name: "command_latency",
        parameter: ["actuator", "command_latency"],
        range: [0.004, 0.04],
        stated: SizeConvention::AsItIs,
    },
    Effect {
        name: "motor_strength",
        parameter: ["actuator", "strength"],
        range: [0.7, 0.92],
        stated: SizeConvention::Change,
    },
    Effect {
        name: "joint_coulomb_friction",
        parameter: ["joint", "coulomb_friction"],
        range: [0.2, 0.8],
        stated: SizeConvention::AsItIs,
    },
    Effect {
        name: "payload_mass",
        parameter: ["link", "mass_scale"],
        range: [1.1, 1.5],
        stated: SizeConvention::Payload,
    },
];

/// An estimate with its standard error.
#[derive(Clone, Copy, Serialize)]
struct Estimate {
    value: f64,
    error: f64,
}

impl Estimate {
    fn holds(&self, truth: f64) -> bool {
        (self.value - truth).abs() <= DEVIATIONS * self.error
    }

    /// Distance from another estimate in standard errors of the difference.
    fn distance(&self, other: &Self) -> f64 {
        (self.value - other.value).abs() / self.error.hypot(other.error)
    }
}

#[derive(Serialize)]
struct Row {
    effect: &'static str,
    engine: String,
    truth: f64,
    /// What tuning estimates of each joint, or of the base.
    tuned: Vec<Estimate>,
    /// What the diagnosis estimates, where it names the effect.
    diagnosed: Option<Estimate>,
    causes: Vec<String>,
}

fn names(effect: &Effect, robot: &TaskRobot) -> Vec<String> {
    let [before, after] = effect.parameter;
    let of = match before {
        "link" => vec![robot.model.links[0].name.clone()],
        _ => robot.model.joint_names().iter().map(|name| (*name).to_string()).collect(),
    };
    of.iter().map(|name| format!("{before}.{name}.{after}")).collect()
}

fn hidden(effect: &Effect, robot: &TaskRobot, engine: Engine, truth: f64) -> HiddenRobot {
    let parameters = names(effect, robot).into_iter().map(|name| (name, truth)).collect();
    HiddenRobot { name: effect.name.into(), parameters, outside: Vec::new(), engine }
}

fn walks(hidden: &HiddenRobot, robot: &TaskRobot, start: &Checkpoint, seed: u64) -> Result<Vec<Run>, Box<dyn Error>> {
    let task = &start.settings.task;
    let policy = start.best_policy(robot)?;
    let drawn: Vec<_> = (0..WALKS).map(|k| wander(&task.commands, SECONDS, seed * 100 + k)).collect();
    let orders: Vec<Order> = drawn
        .iter()
        .zip(0u64..)
        .map(|(commands, k)| Order { commands, seconds: SECONDS, place: [0.0; 2], seed: seed * 1000 + k })
        .collect();
    let walked = hidden.walks(robot, &Ground::plane(), &policy, task, &orders)?;
    Ok(walked.into_iter().map(|walk| walk.run).collect())
}

/// Estimates of the parameters of `names` by tuning's fit.
fn tune(
    runs: &[Run],
    robot: &TaskRobot,
    start: &Checkpoint,
    names: &[String],
) -> Result<Vec<Estimate>, Box<dyn Error>> {
    let (task, settings, ground) = (&start.settings.task, LoopSettings::default().fit, Ground::plane());
    let mut log = Log::new(robot, task);
    for (k, run) in runs.iter().enumerate() {
        if let Err(error) = log.add(&format!("walk {k}"), run, robot) {
            eprintln!("{error}");
        }
    }
    let replayer = Replayer::new(&log, robot, &ground.terrain, task);
    let coordinates = coordinates(&replayer, &settings.prior, &tops(&replayer), false)?;
    let terrain = ground.terrain;
    let study = Study::new(&log, robot, &terrain, settings.windows, &|_, _| true)?;
    let fit = fit_shared_first(&study, coordinates, &settings, &mut |_, _| {})?;
    let is_of = |coordinate: &str| {
        let [before, after] = coordinate.split_once('*').map_or(["", ""], |(a, b)| [a, b]);
        let shared = coordinate.contains('*') && names[0].starts_with(before) && names[0].ends_with(after);
        shared || names.iter().any(|name| name == coordinate)
    };
    let rows = fit.coordinates.iter().zip(fit.point.iter().zip(&fit.deviations));
    Ok(rows.filter(|(c, _)| is_of(&c.name)).map(|(_, (&value, &error))| Estimate { value, error }).collect())
}

fn diagnosed(run: &Run, robot: &TaskRobot, effect: &Effect) -> Result<(Option<Estimate>, Vec<String>), Box<dyn Error>> {
    let terrain = Ground::plane().terrain;
    let report = diagnose(std::slice::from_ref(run), &robot.model, &terrain, &Options::default(), 0)?.report;
    let causes = report.causes.iter().map(|c| {
        let p = &c.parameters[0];
        format!(
            "{} of {}: {} {:.4} ({:.4} to {:.4})",
            c.effect,
            c.scope.join(", "),
            p.name,
            p.value,
            p.ci95[0],
            p.ci95[1]
        )
    });
    let scale = if effect.stated == SizeConvention::Payload { robot.model.links[0].mass } else { 1.0 };
    let absent = if effect.stated == SizeConvention::AsItIs { 0.0 } else { 1.0 };
    let found = report.causes.iter().find(|c| c.effect == effect.name).map(|c| {
        let p = &c.parameters[0];
        Estimate { value: absent + p.value / scale, error: (p.ci95[1] - p.ci95[0]) / (2.0 * DEVIATIONS * scale) }
    });
    Ok((found, causes.collect()))
}

/// How often each holds the truth and both agree.
#[derive(Default)]
struct Counts {
    robots: usize,
    named: usize,
    diagnosed: usize,
    tuned: [usize; 2],
    agree: [usize; 2],
}

impl Counts {
    fn add(&mut self, row: &Row) {
        self.robots += 1;
        self.tuned[0] += row.tuned.iter().filter(|t| t.holds(row.truth)).count();
        self.tuned[1] += row.tuned.len();
        let Some(found) = &row.diagnosed else { return };
        self.named += 1;
        self.diagnosed += usize::from(found.holds(row.truth));
        self.agree[0] += row.tuned.iter().filter(|t| t.distance(found) <= 2.0).count();
        self.agree[1] += row.tuned.len();
    }

    fn print(&self, effect: &str) {
        let Self { robots, named, diagnosed, tuned, agree } = self;
        println!(
            "{effect}: {robots} robots; the diagnosis names it in {named}, holds the truth in {diagnosed}; tuning holds it in {} of {}; within \
             two standard errors of each other: {} of {}",
            tuned[0], tuned[1], agree[0], agree[1]
        );
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let named = |name: &str| arguments.iter().find_map(|a| a.strip_prefix(name)?.strip_prefix('='));
    let number = |name: &str, otherwise: u64| named(name).map_or(Ok(otherwise), str::parse);
    let (robots, seed, first) = (number("robots", 10)?, number("seed", 1)?, number("first", 0)?);
    let file = arguments.iter().find(|a| !a.contains('=')).ok_or("expected CHECKPOINT.bin, found none")?;
    let start = Checkpoint::from_bytes(&std::fs::read(file)?)?;
    let robot = qv_go2::walk::robot()?;
    for (e, effect) in EFFECTS.iter().enumerate().filter(|(_, e)| named("effect").is_none_or(|name| name == e.name)) {
        let mut draws = SplitMix64::new(seed.wrapping_mul(1000).wrapping_add(e as u64));
        let mut counts = Counts::default();
        for k in 0..robots {
            let truth = effect.range[0] + (effect.range[1] - effect.range[0]) * draws.uniform();
            if k < first {
                continue;
            }
            let engine = if k % 2 == 0 { Engine::Ours } else { Engine::Second };
            let names = names(effect, &robot);
            let runs = walks(&hidden(effect, &robot, engine, truth), &robot, &start, seed * 31 + k)?;
            let tuned = tune(&runs, &robot, &start, &names)?;
            let (diagnosed, causes) = diagnosed(&runs[0], &robot, effect)?;
            let row = Row { effect: effect.name, engine: format!("{engine:?}"), truth, tuned, diagnosed, causes };
            println!("{}", serde_json::to_string(&row)?);
            counts.add(&row);
        }
        counts.print(effect.name);
    }
    Ok(())
}
