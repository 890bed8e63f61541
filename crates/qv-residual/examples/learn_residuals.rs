//! Hidden Go2s walk, and each learned compensator is trained on what they recorded: held-out joint error over 1 s and CPU time.
//!
//! `learn_residuals CHECKPOINT.bin METHODS KIND:SEED ...`: METHODS are some of `position,torque,reinforce,both` (both: reinforced from the
//! supervised net), each with `/KEY=VALUE` for settings that differ; KIND is `inside` or `outside`.

use qv_policy::train::Checkpoint;
use qv_policy::velocity::{Ground, TaskRobot, TaskSettings};
use qv_residual::compensation::Compensation;
use qv_residual::fitting::{Fit, fit, fit_shared_first};
use qv_residual::hidden::{Engine, HiddenRobot, Order, wander};
use qv_residual::identify::{FitSettings, coordinates, lane_of, tops};
use qv_residual::log::Log;
use qv_residual::residual::reinforce::{self, ReinforceIteration, ReinforceSettings};
use qv_residual::residual::supervised::{train_position, train_torque};
use qv_residual::residual::{ResidualNet, SupervisedSettings};
use qv_residual::study::Study;
use qv_residual::training_windows::TrainingWindows;
use qv_residual::windows::{Lane, Replayer, Window, windows};

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, checkpoint, methods, robots @ ..] = &arguments[..] else {
        return Err("learn_residuals CHECKPOINT.bin METHODS KIND:SEED ...".into());
    };
    let file = Checkpoint::from_bytes(&std::fs::read(checkpoint)?)?;
    let robot = qv_go2::walk::robot()?;
    for name in robots {
        let (kind, seed) = name.split_once(':').ok_or("KIND:SEED, such as outside:3")?;
        let seed: u64 = seed.parse()?;
        let engine = if seed % 4 < 2 { Engine::Ours } else { Engine::Second };
        let hidden = match kind {
            "inside" => HiddenRobot::inside(&robot, engine, seed),
            _ => HiddenRobot::outside(&robot, engine, seed),
        };
        let log = record(&hidden, &robot, &file, seed)?;
        learn(&hidden.name, &log, &robot, &file.settings.task, methods)?;
    }
    Ok(())
}

/// Three minutes and twenty seconds under the policy.
fn record(hidden: &HiddenRobot, robot: &TaskRobot, file: &Checkpoint, seed: u64) -> Result<Log, Failure> {
    let task = &file.settings.task;
    let commands: Vec<_> = (0..10).map(|k| wander(&task.commands, 20.0, seed * 100 + k)).collect();
    let order =
        |(k, commands): (usize, _)| Order { commands, seconds: 20.0, place: [0.0; 2], seed: seed * 1000 + k as u64 };
    let orders: Vec<Order> = commands.iter().map(Vec::as_slice).enumerate().map(order).collect();
    let walks = hidden.walks(robot, &Ground::plane(), &file.best_policy(robot)?, task.rate, &orders)?;
    let mut log = Log::new(robot, task);
    for (k, walk) in walks.iter().enumerate() {
        if let Err(e) = log.add(&format!("walk {k}"), &walk.run, robot) {
            println!("{e}");
        }
    }
    Ok(log)
}

fn learn(name: &str, log: &Log, robot: &TaskRobot, task: &TaskSettings, methods: &str) -> Result<(), Failure> {
    let ground = Ground::plane();
    let replayer = Replayer::new(log, robot, &ground.terrain, task);
    let is_held = |k: usize| k % 5 == 4;
    let held = windows(log, 50, is_held);
    let judge = |lane: &Lane, net: Option<&ResidualNet>| -> Result<f64, Failure> {
        let lanes: Vec<Lane> = (0..held.len()).map(|window| Lane { window, ..lane.clone() }).collect();
        let compensator = net.map(|net| net.compensator(robot, log.substeps, lanes.len())).transpose()?;
        Ok(replayer.replay(&held, &lanes, 50, compensator)?.joints())
    };
    let nominal = judge(&Lane::default(), None)?;
    println!("{name}: {:.0} s, {} held-out windows, nominal {nominal:.4} rad", log.seconds(), held.len());
    let clock = cpu_seconds();
    let (identified, fitted) = identify(&replayer, is_held)?;
    let notify = |what: &str, error: f64, clock: f64| {
        println!("  {what:<34} {error:.4} rad {:.2} of nominal {:6.1} CPU s", error / nominal, cpu_seconds() - clock);
    };
    notify("identified", judge(&identified, None)?, clock);
    let clock = cpu_seconds();
    let shaped = fit_shapes(&replayer, &fitted, is_held)?;
    notify("identified + shapes", shaped.replay(&replayer, &held, 50)?.joints(), clock);
    let training = windows(log, 25, |k| !is_held(k));
    for (on, lane) in [("nominal", Lane::default()), ("identified", identified)] {
        for method in methods.split(',') {
            let clock = cpu_seconds();
            match train(method, &replayer, &training, &lane) {
                Ok(net) => notify(&format!("{on} + {method}"), judge(&lane, Some(&net))?, clock),
                Err(e) => println!("  {on} + {method}: {e}"),
            }
        }
    }
    Ok(())
}

fn train(method: &str, replayer: &Replayer, training: &[Window], lane: &Lane) -> Result<ResidualNet, Failure> {
    let say = |round: &_| {
        if std::env::var("TALK").is_ok() {
            println!("    {round:?}");
        }
    };
    let mut words = method.split('/');
    let name = words.next().unwrap_or_default();
    let mut settings = if name == "torque" { SupervisedSettings::torque() } else { SupervisedSettings::default() };
    let mut reinforced = ReinforceSettings::default();
    let hear = |r: &ReinforceIteration| {
        if std::env::var("TALK").is_ok() && r.iteration.index % 20 == 19 {
            let i = &r.iteration;
            println!(
                "    {} {:.4} {:?} std {:.3} rate {:.5} {:?}",
                i.index, i.reward, r.figures, i.std, i.rate, i.ends
            );
        }
    };
    for word in words {
        let (key, value) = word.split_once('=').ok_or("KEY=VALUE after a method")?;
        match key {
            "rounds" => settings.rounds = value.parse()?,
            "length" => settings.length = value.parse()?,
            "windows" => settings.windows = value.parse()?,
            "passes" => settings.passes = value.parse()?,
            "error" => settings.error = value.parse()?,
            "iterations" => reinforced.iterations = value.parse()?,
            "std" => reinforced.std = value.parse()?,
            "rate" => reinforced.ppo.rate = value.parse()?,
            "ahead" => settings.ahead = value.parse()?,
            "spread" => settings.spread = value.parse()?,
            "pull" => settings.pull = value.parse()?,
            other => return Err(format!("no setting `{other}`").into()),
        }
    }
    Ok(match name {
        "position" => train_position(replayer, training, lane, &settings, say)?,
        "torque" => train_torque(replayer, training, lane, &settings, say)?,
        "reinforce" => reinforce::train(replayer, training, lane, None, &reinforced, hear)?,
        "both" => {
            let start = train_position(replayer, training, lane, &settings, say)?;
            reinforce::train(replayer, training, lane, Some(&start), &reinforced, hear)?
        }
        other => return Err(format!("no method `{other}`").into()),
    })
}

/// Parameters in rollouts: fewer windows than tuning has, for there are ten robots to fit.
fn identify(replayer: &Replayer, is_held: impl Fn(usize) -> bool) -> Result<(Lane, Fit), Failure> {
    let settings = FitSettings { windows: 48, steps: 6, ..Default::default() };
    let coordinates = coordinates(replayer, &settings.prior, &tops(replayer), false)?;
    let study = Study::new(replayer.log, replayer.robot, replayer.terrain, settings.windows, &|k, _| !is_held(k))?;
    let fit = fit_shared_first(&study, coordinates, &settings, &mut |_, _| {})?;
    Ok((lane_of(&fit.coordinates, &fit.point, 0, replayer.log.joints), fit))
}

/// Torques of known shapes beside the parameters, in the simulator of the training.
fn fit_shapes(replayer: &Replayer, from: &Fit, is_held: impl Fn(usize) -> bool) -> Result<Compensation, Failure> {
    let settings = FitSettings { windows: 80, steps: 5, ..Default::default() };
    let coordinates = coordinates(replayer, &settings.prior, &tops(replayer), true)?;
    let all = windows(replayer.log, settings.length, |k| !is_held(k));
    let count = all.len().min(settings.windows);
    let windows = (0..count).map(|k| all[k * all.len() / count]).collect();
    let windows = TrainingWindows { replayer, windows, length: settings.length };
    let start = from.at(&coordinates);
    let fit = fit(&windows, coordinates, &start, settings.steps, &mut |_, _| {})?;
    Ok(Compensation::of_fit("shapes", replayer, &fit.coordinates, &fit.point, &fit.deviations, 0.0)?)
}

/// CPU time of this process \[s\]; 0 where the system does not show it.
fn cpu_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = text.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
    // utime and stime in ticks, of which Linux shows 100 a second.
    let ticks = |k: usize| fields.get(k).and_then(|x| x.parse::<f64>().ok()).unwrap_or(0.0);
    (ticks(11) + ticks(12)) / 100.0
}
