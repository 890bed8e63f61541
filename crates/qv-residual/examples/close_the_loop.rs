//! Hidden Go2s walk ten minutes each, the loop is closed on their recordings, and the hidden robots walk again:
//! `close_the_loop CHECKPOINT.bin inside|outside|nothing FIRST_SEED LAST_SEED`. One line of JSON for each.

use qv_policy::policy::Policy;
use qv_policy::train::Checkpoint;
use qv_policy::velocity::{Ground, TaskRobot};
use qv_residual::ResidualError;
use qv_residual::close::{Event, Forget, Inputs, LoopSettings, close};
use qv_residual::hidden::{Engine, Hidden, Order, wander};
use qv_residual::log::Log;
use serde_json::json;
use std::time::Instant;

/// Walks of a recording, and how long each lasts \[s\].
const WALKS: u64 = 30;
const SECONDS: f32 = 20.0;
/// Seconds and number of the walks that are scored.
const SCORED: [f32; 2] = [8.0, 24.0];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, file, kind, first, last] = &arguments[..] else {
        return Err("expected CHECKPOINT.bin, inside, outside or nothing, and two seeds".into());
    };
    let start = Checkpoint::from_bytes(&std::fs::read(file)?)?;
    let robot = qv_go2::walk::robot()?;
    let ground = Ground::plane();
    for seed in first.parse::<u64>()?..=last.parse()? {
        // Half of the robots in each engine, both kinds of effect in both.
        let engine = if seed / 2 % 2 == 0 { Engine::Ours } else { Engine::Second };
        let hidden = match kind.as_str() {
            "inside" => Hidden::inside(&robot, engine, seed),
            "outside" => Hidden::outside(&robot, engine, seed),
            _ => Hidden::nothing(engine),
        };
        let policy = start.best_policy(&robot)?;
        let log = record(&hidden, &robot, &ground, &policy, &start, seed)?;
        let clock = Instant::now();
        let settings = LoopSettings::default();
        let inputs = Inputs {
            robot: &robot,
            ground: &ground,
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
        let [before, after] =
            [&policy, &outcome.policy].map(|p| hidden.score(&robot, &ground, p, &start.settings.task, SCORED));
        let (before, after) = (before?, after?);
        let report = &outcome.report;
        let held: Vec<_> = report
            .candidates
            .iter()
            .map(|c| json!([c.compensation.kind, c.held_out.error, c.held_out.gain, c.held_out.stays, c.paths]))
            .collect();
        println!(
            "{}",
            json!({
                "robot": hidden.name, "engine": format!("{engine:?}"), "seconds": seconds, "candidates": held,
                "chosen": report.chosen, "before": before, "after": after, "ratio": after.position / before.position,
                "predicted": [report.before, report.after], "control_predicted": report.control,
            })
        );
    }
    Ok(())
}

fn record(
    hidden: &Hidden,
    robot: &TaskRobot,
    ground: &Ground,
    policy: &Policy,
    start: &Checkpoint,
    seed: u64,
) -> Result<Log, ResidualError> {
    let task = &start.settings.task;
    let drawn: Vec<_> = (0..WALKS).map(|k| wander(&task.commands, SECONDS, seed * 100 + k)).collect();
    let orders: Vec<Order> = drawn
        .iter()
        .zip(0..)
        .map(|(commands, k)| Order { commands, seconds: SECONDS, place: [0.0; 2], seed: seed * 1000 + k })
        .collect();
    let mut log = Log::new(robot, task);
    for (k, walk) in hidden.walks(robot, ground, policy, task.rate, &orders)?.iter().enumerate() {
        // A walk that ended in a fall at once has nothing to tell.
        if let Err(error) = log.add(&format!("walk {k}"), &walk.run, robot) {
            eprintln!("{error}");
        }
    }
    Ok(log)
}
