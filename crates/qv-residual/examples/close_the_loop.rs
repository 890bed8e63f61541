//! Hidden robots walk ten minutes each, the loop is closed on their recordings, and the hidden robots walk again. One line of JSON for each:
//! `close_the_loop CHECKPOINT.bin inside|outside|nothing FIRST_SEED LAST_SEED [--robot FILE.toml] [--bumps METRES] [--flat] [--seed N]`.
//! With `--bumps` they walk on bumps up to so high; with `--flat` replays are then on a plane nevertheless. `--seed` is that of the training.

use qv_policy::policy::Policy;
use qv_policy::train::Checkpoint;
use qv_policy::velocity::{Ground, RobotFile, TaskRobot};
use qv_residual::close::{Event, Forget, Inputs, LoopSettings, close};
use qv_residual::hidden::{Engine, HiddenRobot, SCORED};
use qv_residual::paths;
use serde_json::json;
use std::path::Path;
use std::time::Instant;

/// Walks of a recording, and how long each lasts \[s\].
const WALKS: u64 = 30;
const SECONDS: f32 = 20.0;
/// Number of the walks that are scored under commands of the promise, and as many under uniform ones.
const SCORED_WALKS: usize = 48;

type Failure = Box<dyn std::error::Error>;

struct Arguments {
    plain: Vec<String>,
    robot: Option<String>,
    bumps: Option<f32>,
    is_flat: bool,
    seed: u64,
}

fn arguments() -> Result<Arguments, Failure> {
    let mut found = Arguments { plain: Vec::new(), robot: None, bumps: None, is_flat: false, seed: 0 };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or(format!("expected a value after {word}"));
        match word.as_str() {
            "--robot" => found.robot = Some(value()?),
            "--bumps" => found.bumps = Some(value()?.parse()?),
            "--seed" => found.seed = value()?.parse()?,
            "--flat" => found.is_flat = true,
            _ => found.plain.push(word),
        }
    }
    Ok(found)
}

fn robot(file: Option<&String>) -> Result<TaskRobot, Failure> {
    let Some(file) = file else { return Ok(qv_go2::walk::robot()?) };
    let described = RobotFile::parse(&std::fs::read_to_string(file)?)?;
    Ok(described.robot(&std::fs::read_to_string(Path::new(file).with_file_name(&described.urdf))?)?)
}

fn main() -> Result<(), Failure> {
    let given = arguments()?;
    let [file, kind, first, last] = &given.plain[..] else {
        return Err("expected CHECKPOINT.bin, inside, outside or nothing, and two seeds".into());
    };
    let start = Checkpoint::from_bytes(&std::fs::read(file)?)?;
    let robot = robot(given.robot.as_ref())?;
    let mut settings = LoopSettings::default();
    settings.tune.seed = given.seed;
    for seed in first.parse::<u64>()?..=last.parse()? {
        let ground = given.bumps.map_or_else(|| Ok(Ground::plane()), |height| Ground::bumps(height, seed))?;
        let plane = Ground::plane();
        // Half of the robots in each engine, both kinds of effect in both.
        let engine = if seed / 2 % 2 == 0 { Engine::Ours } else { Engine::Second };
        let hidden = match kind.as_str() {
            "inside" => HiddenRobot::inside(&robot, engine, seed),
            "outside" => HiddenRobot::outside(&robot, engine, seed),
            _ => HiddenRobot::nothing(engine),
        };
        let policy = start.best_policy(&robot)?;
        let log = hidden.record(&robot, &ground, &policy, &start.settings.task, (WALKS, SECONDS), seed)?;
        let clock = Instant::now();
        let inputs = Inputs {
            robot: &robot,
            ground: if given.is_flat { &plane } else { &ground },
            train_on: &ground,
            log: &log,
            start: &start,
            given: None,
            settings: &settings,
        };
        let outcome = close(&inputs, &Forget, &mut |event| match event {
            Event::Stage(name, number, count) => {
                eprintln!("{:6.1} s {number}/{count} {name}", clock.elapsed().as_secs_f64())
            }
            Event::Progress(share, figure) => eprintln!("         {:3.0} % {figure}", 100.0 * share),
        })?;
        let seconds = clock.elapsed().as_secs_f64();
        let task = &start.settings.task;
        let score = |policy: &Policy, wanted: &[[f32; 3]]| {
            hidden.score(&robot, &ground, policy, task, wanted, paths::SECONDS, seed)
        };
        let wanted = [paths::commands, paths::uniform].map(|of| of(&task.commands, SCORED_WALKS, SCORED + seed));
        let [before, before_uniform] = [score(&policy, &wanted[0])?, score(&policy, &wanted[1])?];
        let [after, after_uniform] = [score(&outcome.policy, &wanted[0])?, score(&outcome.policy, &wanted[1])?];
        let report = &outcome.report;
        let candidates = report.candidates.iter();
        let held: Vec<_> = candidates
            .map(|c| json!({"kind": c.compensation.kind, "error": c.held_out.error, "stays": c.held_out.stays}))
            .collect();
        println!(
            "{}",
            json!({
                "robot": hidden.name, "engine": format!("{engine:?}"), "seed": given.seed, "seconds": seconds,
                "candidates": held, "chosen": report.chosen, "before": before, "after": after,
                "uniform": [before_uniform, after_uniform], "why": report.why,
                "foretold": [report.before, report.after], "control": report.control, "remarks": report.remarks,
            })
        );
    }
    Ok(())
}
