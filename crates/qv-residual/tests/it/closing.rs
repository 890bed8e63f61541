//! Fits, the loop, and what is refused.

use crate::facts::States;
use qv_core::JointSeries;
use qv_policy::train::{Checkpoint, TrainSettings, Training};
use qv_policy::velocity::{Ground, TaskRobot, TaskSettings};
use qv_recording::Run;
use qv_residual::ResidualError;
use qv_residual::close::{Forget, Inputs, Keep, LoopSettings, close};
use qv_residual::compensation::Compensation;
use qv_residual::fitting::{Windows, fit_shared_first};
use qv_residual::hidden::{Engine, HiddenRobot, Order, Start};
use qv_residual::identify::{FitSettings, coordinates, tops};
use qv_residual::log::Log;
use qv_residual::study::Study;
use qv_residual::tune::TuneSettings;
use qv_residual::windows::{Replayer, windows};
use std::cell::RefCell;
use std::collections::BTreeMap;

#[test]
fn a_fit_finds_what_was_set_and_its_replay_is_better_by_far() {
    let robot = qv_go2::walk::robot().unwrap();
    let hidden =
        [("actuator.*.command_latency", 0.012), ("actuator.*.strength", 0.8), ("joint.*.coulomb_friction", 0.6)];
    let log = crate::squats::recordings(&robot, &hidden, 10, (500, 2e-4));
    let (ground, task) = (Ground::plane(), TaskSettings::default());
    let replayer = Replayer::new(&log, &robot, &ground.terrain, &task);
    let settings = FitSettings { windows: 48, ..Default::default() };
    let coordinates = coordinates(&replayer, &settings.prior, &tops(&replayer), false).unwrap();
    let study = Study::new(&log, &robot, &ground.terrain, settings.windows, &|k, _| k < 8).unwrap();
    let fitted = || fit_shared_first(&study, coordinates.clone(), &settings, &mut |_, _| {}).unwrap();
    let fit = fitted();
    let found = |name: &str| {
        let k = fit.coordinates.iter().position(|c| c.name == name).unwrap();
        (fit.point[k], fit.deviations[k])
    };
    let (latency, _) = found("actuator.*.command_latency");
    assert!((latency - 0.012).abs() < 0.002, "{latency}");
    let (strength, deviation) = found("actuator.FL_thigh_joint.strength");
    assert!((strength - 0.8).abs() < 0.05 && deviation < 0.05, "{strength} +- {deviation}");
    let (friction, _) = found("joint.RR_calf_joint.coulomb_friction");
    assert!((friction - 0.6).abs() < 0.25, "{friction}");
    let held = windows(&log, 50, |k| k >= 8);
    let corrected =
        Compensation::of_fit("parameters", &replayer, &fit.coordinates, &fit.point, &fit.deviations, 1.645).unwrap();
    let errors = |c: &Compensation| c.replay(&replayer, &held, 50).unwrap().joints();
    let (before, after) = (errors(&Compensation::nominal(&robot)), errors(&corrected));
    assert!(after < 0.2 * before, "{after} of {before} rad");
    // The same bits on another number of threads.
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let again = one.install(fitted);
    assert_eq!(fit.point, again.point);
}

#[test]
fn the_order_of_joints_changes_nothing_and_a_recording_without_a_channel_is_left_out() {
    let robot = qv_go2::walk::robot().unwrap();
    let log = crate::squats::recordings(&robot, &[], 3, (500, 2e-4));
    let ground = Ground::plane();
    let study = |log: &Log| Study::new(log, &robot, &ground.terrain, 12, &|_, _| true).unwrap();
    let mut turned = log.clone();
    let run = &mut turned.runs[1].1;
    run.joint_names.reverse();
    let (c, m) = (&mut run.commands, &mut run.measured);
    for series in [&mut c.position, &mut c.kp, &mut c.kd, &mut m.position, &mut m.velocity].into_iter().flatten() {
        series.values.chunks_exact_mut(12).for_each(<[f64]>::reverse);
    }
    let residuals = |log: &Log| study(log).residuals(&[], &[Vec::new()]).unwrap();
    assert_eq!(residuals(&log), residuals(&turned));
    let mut without = log.clone();
    without.runs[0].1.measured.gyro = None;
    assert_eq!(study(&without).left_out, ["squats 0"]);
    assert!(study(&log).left_out.is_empty());
}

/// Keeps stages in memory, and counts those that were asked for and there.
#[derive(Default)]
struct Memory(RefCell<(BTreeMap<String, String>, usize)>);

impl Keep for Memory {
    fn get(&self, name: &str) -> Option<String> {
        let mut inside = self.0.borrow_mut();
        let found = inside.0.get(name).cloned();
        inside.1 += usize::from(found.is_some());
        found
    }
    fn put(&self, name: &str, text: &str) -> Result<(), ResidualError> {
        self.0.borrow_mut().0.insert(name.into(), text.into());
        Ok(())
    }
}

fn small() -> LoopSettings {
    let fit = FitSettings { windows: 30, steps: 3, ..Default::default() };
    let tune = TuneSettings { iterations: 2, robots: 32, walks: 6, calibration: 12, ..Default::default() };
    LoopSettings { walks: 6, fit, tune, ..Default::default() }
}

/// Walks and trainings on one ground, and nothing known beforehand.
fn plain<'a>(
    robot: &'a TaskRobot,
    ground: &'a Ground,
    log: &'a Log,
    start: &'a Checkpoint,
    settings: &'a LoopSettings,
) -> Inputs<'a> {
    Inputs { robot, ground, train_on: ground, log, start, given: None, settings }
}

#[test]
fn nothing_wrong_leaves_the_policy_as_it_was() {
    let robot = qv_go2::walk::robot().unwrap();
    let log = crate::squats::recordings(&robot, &[], 15, (200, 2e-4));
    let ground = Ground::plane();
    let training = Training::new(&robot, &ground, &TrainSettings { robots: 16, ..Default::default() }).unwrap();
    let (start, settings) = (training.checkpoint().clone(), small());
    let inputs = plain(&robot, &ground, &log, &start, &settings);
    let outcome = close(&inputs, &Forget, &mut |_| {}).unwrap();
    assert_eq!(outcome.report.chosen, None);
    assert_eq!(outcome.policy.parameters, start.best_policy(&robot).unwrap().parameters);
    assert!(outcome.report.candidates[1..].iter().all(|c| !c.held_out.stays), "{:?}", outcome.report.candidates);
}

#[test]
fn a_robot_that_differs_is_trained_for_and_stages_that_are_kept_are_not_done_again() {
    let robot = qv_go2::walk::robot().unwrap();
    let log = crate::squats::recordings(
        &robot,
        &[("actuator.*.command_latency", 0.015), ("actuator.*.strength", 0.75)],
        15,
        (200, 2e-4),
    );
    let ground = Ground::plane();
    let mut training =
        Training::new(&robot, &ground, &TrainSettings { robots: 16, epoch: 1, ..Default::default() }).unwrap();
    training.advance().unwrap();
    let (start, settings) = (training.checkpoint().clone(), small());
    let given = [("actuator.FL_hip_joint.strength".to_owned(), 0.75)];
    let inputs = Inputs { given: Some(&given), ..plain(&robot, &ground, &log, &start, &settings) };
    let memory = Memory::default();
    let first = close(&inputs, &memory, &mut |_| {}).unwrap();
    let kinds: Vec<&str> = first.report.candidates.iter().map(|c| c.compensation.kind.as_str()).collect();
    let at_step = "parameters at the training's step";
    assert_eq!(kinds, ["nominal", "calibrated", "parameters", at_step, "parameters and torques"]);
    assert_eq!(first.report.calibrated, 2, "the robot's parameters are those of rollouts");
    let parameters = &first.report.candidates[2];
    assert!(parameters.held_out.stays && parameters.held_out.error < 0.3 * first.report.candidates[0].held_out.error);
    assert!(first.report.control.is_some() && parameters.paths.is_some());
    let kept = memory.0.borrow().0.len();
    let again = close(&inputs, &memory, &mut |_| {}).unwrap();
    assert_eq!(memory.0.borrow().1, kept, "each stage was found");
    assert_eq!(again.policy.parameters, first.policy.parameters);
    assert!(again.report == first.report, "the same bits");
    let text = serde_json::to_string(&parameters.compensation).unwrap();
    assert_eq!(Compensation::parse(&text).unwrap(), parameters.compensation);
}

fn standing(seconds: f32) -> Run {
    let robot = qv_go2::walk::robot().unwrap();
    let training =
        Training::new(&robot, &Ground::plane(), &TrainSettings { robots: 16, ..Default::default() }).unwrap();
    let order = Order { commands: &[(0.0, [0.0; 3])], seconds, place: [0.0; 2], seed: 1 };
    let hidden = HiddenRobot::nothing(Engine::Ours);
    hidden
        .walks(&robot, &Ground::plane(), &training.policy(), &TaskSettings::default(), &[order])
        .unwrap()
        .remove(0)
        .run
}

#[test]
fn recordings_that_do_not_serve_are_named() {
    let robot = qv_go2::walk::robot().unwrap();
    let task = TaskSettings::default();
    let run = standing(3.0);
    let said = |run: &Run| {
        let mut log = Log::new(&robot, &task);
        log.add("the walk", run, &robot).unwrap_err().to_string()
    };
    let mut good = Log::new(&robot, &task);
    good.add("the walk", &run, &robot).unwrap();
    assert!(good.seconds() > 2.0);
    let mut other = run.clone();
    other.joint_names[3] = "elbow".into();
    assert!(said(&other).contains("FR_hip_joint"), "{}", said(&other));
    let mut silent = run.clone();
    silent.commands = Default::default();
    assert!(said(&silent).contains("commands"), "{}", said(&silent));
    let mut stiff = run.clone();
    stiff.commands.kp = Some(JointSeries { time: vec![0.0], values: vec![60.0; 12], joints: 12 });
    assert!(said(&stiff).contains("kp") && said(&stiff).contains("60"), "{}", said(&stiff));
    let mut lying = run.clone();
    for series in [&mut lying.measured.base_pose, &mut lying.measured.orientation] {
        let series = series.as_mut().unwrap();
        let width = series.joints;
        for row in series.values.chunks_exact_mut(width) {
            row[width - 4..].copy_from_slice(&[0.0, 1.0, 0.0, 0.0]);
        }
    }
    assert!(said(&lying).contains("lies"), "{}", said(&lying));
    assert!(said(&standing(1.0)).states("2 2"), "{}", said(&standing(1.0)));
}

#[test]
fn a_hole_costs_what_is_missing_and_a_recording_counts_once() {
    let robot = qv_go2::walk::robot().unwrap();
    let task = TaskSettings::default();
    let whole = standing(9.0);
    let mut holed = whole.clone();
    for series in [&mut holed.measured.position, &mut holed.measured.velocity] {
        let series = series.as_mut().unwrap();
        let is_kept: Vec<bool> = series.time.iter().map(|t| !(4.5..4.7).contains(t)).collect();
        let rows = series.values.chunks_exact(series.joints).zip(&is_kept).filter(|(_, kept)| **kept);
        series.values = rows.flat_map(|(row, _)| row.to_vec()).collect();
        let mut kept = is_kept.iter();
        series.time.retain(|_| *kept.next().unwrap());
    }
    let mut log = Log::new(&robot, &task);
    log.add("holed", &holed, &robot).unwrap();
    assert_eq!(log.stretches.len(), 2, "before and after the hole");
    assert!(log.seconds() > 8.0 && log.seconds() < 8.9, "{} s", log.seconds());
    assert!(log.remarks[0].states("missing"), "{:?}", log.remarks);
    let mut log = Log::new(&robot, &task);
    log.add("one", &whole, &robot).unwrap();
    let again = log.add("two", &whole, &robot).unwrap_err().to_string();
    assert!(again.contains("two") && again.states("recording"), "{again}");
    let mut far = whole.clone();
    far.measured.base_pose.as_mut().unwrap().values[0] = 1e300;
    let mut log = Log::new(&robot, &task);
    let far = log.add("far", &far, &robot).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(log.stretches.iter().all(|s| s.states.iter().all(|x| x.is_finite())), "{far}");
}

#[test]
fn settings_and_files_that_mean_nothing_are_named() {
    let said = |settings: LoopSettings| settings.check().unwrap_err().to_string();
    assert!(said(LoopSettings { held_every: 1, ..Default::default() }).contains("held_every"));
    let mut soft = LoopSettings::default();
    soft.fit.prior.contact[1] = f64::NAN;
    assert!(said(soft).contains("fit.prior"));
    assert!(said(LoopSettings { window: f32::NAN, ..Default::default() }).contains("window"));
    let tune = TuneSettings { std: 0.0, ..Default::default() };
    assert!(said(LoopSettings { tune, ..Default::default() }).contains("tune.std"));
    LoopSettings::default().check().unwrap();
    let robot = qv_go2::walk::robot().unwrap();
    let mut other = Compensation::nominal(&robot);
    other.robot = "cat".into();
    assert!(other.check(&robot).unwrap_err().to_string().contains("cat"));
    let mut odd = Compensation::nominal(&robot);
    odd.shapes = vec![0.0; 3];
    assert!(odd.check(&robot).unwrap_err().to_string().states("72 `shapes`"));
    assert!(Compensation::parse("{}").unwrap_err().to_string().states("tune"));
}

#[test]
fn a_hidden_robot_steps_from_where_it_starts_with_the_same_bits() {
    let robot = qv_go2::walk::robot().unwrap();
    let settings = TrainSettings { robots: 16, ..Default::default() };
    let policy = Training::new(&robot, &Ground::plane(), &settings).unwrap().policy();
    let (hidden, plane, task) =
        (HiddenRobot::inside(&robot, Engine::Ours, 1), Ground::plane(), TaskSettings::default());
    let walk = |seed: u64, steps: usize| {
        let start = Start { place: [0.5, -0.25], yaw: 0.8, seed };
        let mut walker = hidden.start(&robot, &plane, &policy, &task, start).unwrap();
        (0..steps).for_each(|_| walker.step([0.4, 0.0, 0.2]).unwrap());
        (walker.state().unwrap(), walker.fell())
    };
    let (start, fell) = walk(3, 0);
    assert!(!fell && start.q[0] == 0.5 && start.q[1] == -0.25);
    assert!((2.0 * start.q[6].atan2(start.q[3]) - 0.8).abs() < 1e-12, "{:?}", &start.q[..7]);
    let (end, _) = walk(3, 10);
    assert!(end != start && end.q.iter().chain(&end.v).all(|x| x.is_finite()));
    assert_eq!(walk(3, 10).0, end, "the same seed gives the same bits");
    assert_ne!(walk(4, 10).0, end, "another one has other noise");
}
