//! Functions that compute, against values that are worked out here.

use crate::squats;
use qv_policy::shape_torques::{SHAPES, shapes};
use qv_policy::velocity::{Commands, Randomise, TaskSettings};
use qv_residual::compensation::Compensation;
use qv_residual::hidden::wander;
use qv_residual::identify::{Prior, coordinates, expanded, lane_of, shapes_of, shared, tops, values, values_of};
use qv_residual::paths::{KINDS, PathError, PathScore, commands, from_start, measured};
use qv_residual::tune::CorrectedSimulator;
use qv_residual::windows::{BASE_CHANNELS, Errors, Replayer, WARM, Window, windows};
use qv_sim::Terrain;

#[test]
fn shapes_are_their_formulas() {
    let (off, speed, torque): (f32, f32, f32) = (0.2, -0.6, 5.0);
    let sign = (speed / 0.3) / (1.0 + (speed / 0.3).powi(2)).sqrt();
    let near = 1.0 / (1.0 + (speed / 1.5).powi(2));
    let expected = [-sign * near, -sign * 5.0, 0.36, -25.0, 1.0, -0.2];
    let found = shapes(off, speed, torque);
    assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5), "{found:?} {expected:?}");
    // Power of the first three is taken away, whichever way the joint turns.
    for speed in [-3.0f32, -0.01, 0.01, 3.0] {
        assert!(shapes(0.0, speed, 4.0)[..3].iter().all(|shape| shape * speed <= 0.0), "{speed}");
    }
}

#[test]
fn commands_are_of_their_kinds_and_within_reach() {
    let ranges = Commands { vx: [-0.5, 1.0], vy: [-0.3, 0.4], wz: [-0.8, 0.8], ..Commands::default() };
    let found = commands(&ranges, 60, 3);
    assert_eq!(found, commands(&ranges, 60, 3), "the same seed gives the same commands");
    assert_ne!(found, commands(&ranges, 60, 4));
    for (k, command) in found.iter().enumerate() {
        let shares = KINDS[k % KINDS.len()].1;
        let tops = [ranges.vx, ranges.vy, ranges.wz];
        for axis in 0..3 {
            let share = shares[axis];
            let whole = if share < 0.0 { share * -tops[axis][0] } else { share * tops[axis][1] };
            let ratio = if whole == 0.0 { 1.0 } else { command[axis] / whole };
            assert!((0.8..=1.1).contains(&ratio), "{k} {axis}: {command:?}");
        }
    }
    let walk = wander(&Commands { every: 2.0, ..ranges }, 9.0, 5);
    assert_eq!(walk.iter().map(|(time, _)| *time).collect::<Vec<_>>(), [0.0, 2.0, 4.0, 6.0, 8.0]);
    assert!(
        walk.iter().all(|(_, [x, y, turn])| (-0.5..=1.0).contains(x) && (-0.3..=0.4).contains(y) && turn.abs() <= 0.8)
    );
}

#[test]
fn a_score_is_the_mean_of_its_walks() {
    let walk = |position: f32, fell: bool| PathError { position, heading: 0.5 * position, fell };
    let score = PathScore::of(&[walk(0.1, false), walk(0.2, true), walk(0.6, false)]);
    assert!((score.position - 0.3).abs() < 1e-6 && (score.heading - 0.15).abs() < 1e-6);
    // The deviation of 0.1, 0.2, 0.6 is sqrt(0.07).
    assert!((score.position_se - (0.07f32 / 3.0).sqrt()).abs() < 1e-6, "{}", score.position_se);
    assert_eq!((score.walks, score.fell), (3, 1));
    assert!((score.cost() - (0.3 + 100.0 / 3.0)).abs() < 1e-4);
    // Half a turn about the vertical axis: what lay behind lies ahead.
    let start = [1.0, 2.0, 0.3, 0.0, 0.0, 0.0, 1.0];
    let now = [0.0, 2.5, 0.3, 0.0, 0.0, 0.0, 1.0];
    let [x, y, turn] = from_start(&start, &now);
    assert!((x - 1.0).abs() < 1e-5 && (y + 0.5).abs() < 1e-5 && turn.abs() < 1e-5, "{x} {y} {turn}");
    // A robot that goes at half of the commanded speed falls behind by a quarter of a metre a second, on the mean of 4 s by half a metre.
    let path: Vec<[f32; 3]> = (1..=250).map(|k| [0.25 * k as f32 / 50.0, 0.0, 0.0]).collect();
    let (rest, error) = measured(&path, [0.5, 0.0, 0.0], 4.0, 50.0);
    assert!(rest.len() == 200 && (error.position - 0.5).abs() < 0.01 && !error.fell, "{error:?}");
}

#[test]
fn errors_are_averaged_over_joints_time_and_lanes() {
    // Two lanes of one decision with two joints: 0.1, -0.3 and 0.5, 0.7; what the base does is left out.
    let channels = 2 + BASE_CHANNELS;
    let row = |a: f32, b: f32| [vec![a, b], vec![9.0; BASE_CHANNELS]].concat();
    let errors = Errors { lanes: 2, length: 1, channels, values: [row(0.1, -0.3), row(0.5, 0.7)].concat() };
    let near = |a: &[f64], b: &[f64]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(near(&[errors.joints()], &[0.4]));
    assert!(near(&errors.by_joint(), &[0.3, 0.5]) && near(&errors.by_lane(), &[0.2, 0.6]));
    assert_eq!(errors.lane(1)[..2], [0.5, 0.7]);
}

#[test]
fn windows_follow_each_other_behind_their_warm_up() {
    let robot = qv_go2::walk::robot().unwrap();
    let log = squats::log(&robot, &[], 2, 0.0);
    let found = windows(&log, 50, |_| true);
    let expected: Vec<Window> =
        (0..2).flat_map(|stretch| (0..3).map(move |k| Window { stretch, decision: WARM + 50 * k })).collect();
    assert_eq!(found, expected);
    assert!(windows(&log, 50, |stretch| stretch == 1).iter().all(|w| w.stretch == 1));
    assert!((log.seconds() - 8.0).abs() < 1e-9 && log.stretches[0].decisions(log.joints) == 200);
}

#[test]
fn a_replay_with_the_hidden_parameters_has_the_least_error() {
    let (robot, terrain) = (qv_go2::walk::robot().unwrap(), Terrain::plane());
    let log = squats::log(&robot, &[("joint.*.viscous_friction", 0.8)], 1, 0.0);
    let replayer = Replayer::new(&log, &robot, &terrain, &TaskSettings::default());
    let places = windows(&log, 20, |_| true);
    let error = |friction: f64| {
        let named: Vec<(String, f64)> =
            robot.model.joint_names().iter().map(|j| (format!("joint.{j}.viscous_friction"), friction)).collect();
        Compensation::given(&robot, &named).replay(&replayer, &places, 20).unwrap().joints()
    };
    let [none, truth, twice] = [0.0, 0.8, 1.6].map(error);
    // What is left starts from the smoothed state of the log.
    assert!(none > 3.0 * truth && twice > 3.0 * truth, "{none} {truth} {twice}");
    let nominal = Compensation::nominal(&robot).replay(&replayer, &places, 20).unwrap().joints();
    assert_eq!(nominal, none);
}

#[test]
fn coordinates_name_parameters_and_their_neutral_point_changes_nothing() {
    let (robot, terrain) = (qv_go2::walk::robot().unwrap(), Terrain::plane());
    let log = squats::log(&robot, &[], 1, 0.0);
    let replayer = Replayer::new(&log, &robot, &terrain, &TaskSettings::default());
    let (tops, batch) = (tops(&replayer), replayer.batch(1).unwrap());
    assert!(tops.len() == 12 && tops.iter().all(|top| *top > 0.0 && *top < 60.0), "{tops:?}");
    let all = coordinates(&replayer, &Prior::default(), &tops, true).unwrap();
    // Four of all motors, five of each joint, three of the trunk, the feet, and a number for each shape and joint.
    assert_eq!(all.len(), 4 + 5 * 12 + 3 + 1 + 12 * SHAPES.len());
    let neutral: Vec<f64> = all.iter().map(|c| c.neutral).collect();
    assert!(lane_of(&all, &neutral, 0, 12).parameters.is_empty());
    let mut moved = neutral.clone();
    let at = all.iter().position(|c| c.name == "actuator.FL_hip_joint.torque_limit").unwrap();
    moved[at] = 0.25;
    let lane = lane_of(&all, &moved, 4, 12);
    let index = batch.parameter_index("actuator.FL_hip_joint.torque_limit").unwrap();
    assert_eq!((lane.window, lane.parameters.as_slice()), (4, &[(index, tops[0] * 0.75)][..]));
    let named = values_of(&all[at], 0.25, batch.catalogue());
    assert_eq!(named, [("actuator.FL_hip_joint.torque_limit".to_string(), tops[0] * 0.75)]);
    let last = all.len() - 1;
    moved[last] = 0.5;
    let shapes = shapes_of(&all, &moved, 12);
    assert_eq!((shapes.len(), shapes[shapes.len() - 1], shapes.iter().sum::<f32>()), (12 * SHAPES.len(), 0.5, 0.5));
    let all = coordinates(&replayer, &Prior::default(), &tops, false).unwrap();
    assert_eq!(all.len(), 4 + 5 * 12 + 3 + 1 + 2, "contacts, too");
    assert!(values_of(&all[all.len() - 1], 1.0, batch.catalogue()).is_empty(), "which are no correction");
    let few = shared(&all);
    // Seven of all motors, three of the trunk, feet and contacts.
    assert_eq!(few.len(), 7 + 3 + 3);
    let mut point: Vec<f64> = few.iter().map(|c| c.neutral).collect();
    assert!(shapes_of(&few, &point, 12).is_empty());
    let strength = few.iter().position(|c| c.name == "actuator.*.strength").unwrap();
    point[strength] = 0.8;
    assert_eq!(values(&few, &point).len(), 12);
    let each = expanded(&all, &few, &point);
    let changed = all.iter().zip(&each).filter(|(c, x)| **x != c.neutral);
    assert!(changed.clone().count() == 12 && changed.clone().all(|(c, x)| c.name.ends_with("strength") && *x == 0.8));
}

#[test]
fn what_is_identified_is_not_drawn_for_all_joints_together() {
    let task = TaskSettings { randomise: Randomise::robust("base"), ..TaskSettings::default() };
    let nominal = CorrectedSimulator::nominal().task(&task);
    assert_eq!(nominal.randomise, task.randomise, "nothing was identified");
    let mut corrected = CorrectedSimulator::nominal();
    corrected.ranges.insert("actuator.FL_hip_joint.command_latency".into(), [0.011, 0.013]);
    let found = corrected.task(&task).randomise;
    assert!(found.together.is_empty(), "{:?}", found.together);
    assert_eq!(found.parameters["actuator.FL_hip_joint.command_latency"], [0.011, 0.013]);
    assert_eq!(found.parameters["actuator.*.strength"], task.randomise.parameters["actuator.*.strength"]);
}
