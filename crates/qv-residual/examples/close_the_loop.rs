//! A hidden Go2 walks, its motors are fitted, the policy is trained on, and the hidden robot walks again:
//! `close_the_loop CHECKPOINT.bin [inside|outside] [seed]`.

use qv_policy::train::Checkpoint;
use qv_policy::velocity::Ground;
use qv_residual::hidden::{Engine, Hidden, Order, wander};
use qv_residual::identify::{FitSettings, Fitter, basis, coordinates, lane_of, parameters_of, shapes_of, tops};
use qv_residual::log::Log;
use qv_residual::paths::{PathScore, commands, error};
use qv_residual::tune::{Corrected, TuneSettings, train_on};
use qv_residual::windows::{Lane, Replayer, windows};
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let file = Checkpoint::from_bytes(&std::fs::read(&arguments[1])?)?;
    let robot = qv_go2::walk::robot()?;
    let ground = Ground::plane();
    let seed: u64 = arguments.get(3).map_or(Ok(0), |s| s.parse())?;
    let engine = if seed % 4 < 2 { Engine::Ours } else { Engine::Second };
    let hidden = match arguments.get(2).map(String::as_str) {
        Some("outside") => Hidden::outside(&robot, engine, seed),
        _ => Hidden::inside(&robot, engine, seed),
    };
    for (n, x) in hidden.parameters.iter().filter(|(n, _)| n.contains("FL")) {
        println!("  {n} {x:.4}");
    }
    let policy = file.best_policy(&robot)?;
    let task = file.settings.task.clone();
    let clock = Instant::now();
    let orders: Vec<_> = (0..30).map(|k| (wander(&task.commands, 20.0, seed * 100 + k), k)).collect();
    let orders: Vec<Order> = orders
        .iter()
        .map(|(c, k)| Order { commands: c, seconds: 20.0, place: [0.0, 0.0], seed: seed * 1000 + k })
        .collect();
    let walks = hidden.walks(&robot, &ground, &policy, task.rate, &orders)?;
    println!("recorded {:.1} s", clock.elapsed().as_secs_f64());
    let clock = Instant::now();
    let mut log = Log::new(&robot, &task);
    for (k, walk) in walks.iter().enumerate() {
        if let Err(e) = log.add(&format!("walk {k}"), &walk.run, &robot) {
            println!("{e}");
        }
    }
    println!(
        "log {:.1} s of {} stretches in {:.1} s; {:?}",
        log.seconds(),
        log.stretches.len(),
        clock.elapsed().as_secs_f64(),
        log.told
    );
    let replayer = Replayer::new(&log, &robot, &ground.terrain, &task);
    let is_held = |k: usize| k % 5 == 4;
    let mut training = windows(&log, 20, |k| !is_held(k));
    let held = windows(&log, 50, is_held);
    let settings = FitSettings::default();
    let every = training.len() / settings.windows;
    training = training.into_iter().step_by(every.max(1)).take(settings.windows).collect();
    let neutral: Vec<Lane> = (0..held.len()).map(|window| Lane { window, ..Default::default() }).collect();
    let nominal = replayer.replay(&held, &neutral, 50, None)?;
    println!("held-out {} windows, nominal {:.4} rad", held.len(), nominal.joints());
    let tops = tops(&replayer);
    let mut corrected = Vec::new();
    for with_shapes in [false] {
        let clock = Instant::now();
        let coordinates = coordinates(&replayer, &settings.prior, &tops, with_shapes)?;
        let start: Vec<f64> = coordinates.iter().map(|c| c.neutral).collect();
        let fitter = Fitter { replayer: &replayer, coordinates, windows: training.clone(), settings: &settings };
        let fit = fitter
            .fit(&start, |k, cost| println!("  step {k}: {cost:.2} at {:.1} s", clock.elapsed().as_secs_f64()))?;
        for ((c, x), d) in fit.coordinates.iter().zip(&fit.point).zip(&fit.deviations) {
            if (x - c.neutral).abs() > 3.0 * d && !c.name.contains("RL") && !c.name.contains("RR") {
                println!("    {:<50} {x:.4} +- {d:.4}", c.name);
            }
        }
        let lanes: Vec<Lane> = (0..held.len()).map(|w| lane_of(&fit.coordinates, &fit.point, w, 12)).collect();
        let numbers = shapes_of(&fit.coordinates, &fit.point, 12);
        let compensator = (!numbers.is_empty()).then(|| basis(&robot, numbers));
        let found = replayer.replay(&held, &lanes, 50, compensator.as_ref().map(|c| c.for_count(held.len())))?;
        println!(
            "shapes {with_shapes}: held-out {:.4} rad ({:.2} of nominal) in {:.1} s",
            found.joints(),
            found.joints() / nominal.joints(),
            clock.elapsed().as_secs_f64()
        );
        let batch = replayer.batch(1)?;
        let parameters = parameters_of(&fit.coordinates, &fit.point, batch.catalogue()).into_iter().collect();
        corrected.push((
            if with_shapes { "shapes" } else { "parameters" },
            Corrected { parameters, ranges: Default::default(), compensator },
        ));
    }
    corrected.insert(0, ("control", Corrected::nominal()));
    let fixed = commands(&task.commands, 24, 7);
    let timed: Vec<Vec<(f32, [f32; 3])>> = fixed.iter().map(|c| vec![(0.0, *c)]).collect();
    let orders: Vec<Order> = timed
        .iter()
        .enumerate()
        .map(|(k, c)| Order { commands: c, seconds: 8.0, place: [0.0; 2], seed: 5000 + k as u64 })
        .collect();
    let score = |policy: &qv_policy::policy::Policy| -> Result<PathScore, Box<dyn std::error::Error>> {
        let walks = hidden.walks(&robot, &ground, policy, task.rate, &orders)?;
        let errors: Vec<_> = walks.iter().zip(&fixed).map(|(w, c)| error(&w.path, *c, 400, task.rate)).collect();
        for (k, (name, _)) in qv_residual::paths::KINDS.iter().enumerate() {
            let of = |f: &dyn Fn(&qv_residual::paths::PathError) -> f32| {
                errors.iter().skip(k).step_by(6).map(f).sum::<f32>() / 4.0
            };
            let ends: Vec<_> = walks
                .iter()
                .zip(&fixed)
                .skip(k)
                .step_by(6)
                .take(2)
                .map(|(w, c)| (w.path[49], *w.path.last().unwrap(), qv_residual::paths::place(*c, 8.0), c))
                .collect();
            println!("      {name}: {:.3} m {:.3} rad {:.2?}", of(&|e| e.position), of(&|e| e.heading), ends);
        }
        Ok(PathScore::of(&errors))
    };
    println!("nominal: {:?}", score(&policy)?);
    let inside = |policy: &qv_policy::policy::Policy,
                  corrected: &Corrected|
     -> Result<PathScore, Box<dyn std::error::Error>> {
        let mut judge =
            qv_policy::velocity::VelocityTask::new(robot.clone(), ground.clone(), corrected.task(&task), fixed.len())?;
        judge.set_compensator(corrected.compensator.as_ref().map(|c| c.for_count(fixed.len())));
        let walks = qv_residual::paths::walk(policy, &mut judge, &fixed, 8.0, 3)?;
        Ok(PathScore::of(&walks.iter().map(|w| w.1).collect::<Vec<_>>()))
    };
    for (name, corrected) in &corrected {
        println!("nominal policy in simulator {name}: {:?}", inside(&policy, corrected)?);
    }
    let tuning = TuneSettings {
        iterations: arguments.get(4).map_or(Ok(100), |s| s.parse())?,
        steady: arguments.get(5).map_or(Ok(2.0), |s| s.parse())?,
        std: arguments.get(6).map_or(Ok(0.25), |s| s.parse())?,
        robots: arguments.get(7).map_or(Ok(512), |s| s.parse())?,
        ..Default::default()
    };
    for (name, corrected) in &corrected {
        let clock = Instant::now();
        let tuned = train_on(&robot, &ground, &file, corrected, &tuning, |line, score| {
            if let Some(score) = score {
                println!(
                    "   {} {:.3} {:.3} {} | v {:.3} w {:.3} rate {:.5}",
                    line.iteration.index,
                    score.position,
                    score.heading,
                    score.fell,
                    line.figures.iter().find(|f| f.0 == "velocity_error").unwrap().1,
                    line.figures.iter().find(|f| f.0 == "turning_error").unwrap().1,
                    line.iteration.rate
                );
            }
        })?;
        println!(
            "{name}: {:?} inside {:?} in {:.1} s",
            score(&tuned)?,
            inside(&tuned, corrected)?,
            clock.elapsed().as_secs_f64()
        );
    }
    Ok(())
}
