//! Replay on ground of known friction: the truth is nearest, and the search and the posterior find it.

use crate::strips::{TRUTH, go2, mesh, prepared, run, run_of};
use qv_contact::prior::{Prior, from_table};
use qv_contact::report::Status;
use qv_contact::{Ground, Options, calibrate, segments};

#[test]
fn the_true_friction_has_the_least_error_of_the_base() {
    let (model, ground) = (go2(), Ground::new(&mesh()).unwrap());
    let (simulator, recordings) = prepared(&model, &ground, &TRUTH);
    let cut = segments::cut(&recordings, 1.0);
    let sets = vec![TRUTH.to_vec(), vec![0.8, 0.8], vec![0.1, 0.8]];
    let errors = segments::base_errors(&simulator, &recordings, &cut, &sets, &|_| {}).unwrap();
    let on_ice: Vec<&Vec<f64>> =
        errors.iter().zip(&cut).filter(|(_, s)| s.labels.contains(&0)).map(|(e, _)| e).collect();
    let mean = |set: usize| on_ice.iter().map(|e| e[set]).sum::<f64>() / on_ice.len() as f64;
    assert!(
        on_ice.len() >= 4 && mean(0) < 0.5 * mean(1) && mean(0) < 0.5 * mean(2),
        "{} {} {}",
        mean(0),
        mean(1),
        mean(2)
    );
    // The same simulator that recorded is left with noise and the smoothing of the start.
    assert!(mean(0) < 0.01, "{}", mean(0));
    let grid = [0.1, 0.15, TRUTH[0], 0.35, 0.55, 0.8];
    let found = segments::search(&simulator, &recordings, &cut, &[0.5, 0.8], &[0], &grid, &|_| {}).unwrap();
    assert_eq!(found[0].as_ref().unwrap().friction, TRUTH[0]);
    assert!(found[1].is_none(), "it was not asked for");
    let curve = &found[0].as_ref().unwrap().curve;
    assert!(curve.iter().map(|c| c[0]).eq(grid) && curve.iter().all(|c| c[1] >= curve[2][1]));
}

#[test]
fn a_calibration_finds_the_friction_that_the_recording_has() {
    let (model, ground) = (go2(), Ground::new(&mesh()).unwrap());
    let table = qv_contact::prior::built_in();
    let priors: Vec<Prior> = from_table(&ground.labels(), &table).unwrap();
    let options = Options { most_windows: 250, ..Options::default() };
    let report = calibrate(std::slice::from_ref(run()), &model, &mesh(), &priors, &options).unwrap();
    let ice = &report.regions[0];
    assert_eq!((ice.label.as_str(), ice.status), ("ice", Status::Refined));
    let [low, high] = ice.posterior.interval95;
    assert!((low..=high).contains(&TRUTH[0]) && (ice.friction / TRUTH[0] - 1.0).abs() < 0.15, "{:?}", ice.posterior);
    assert_eq!(report.frictions()[0], ice.friction);
    let swapped: Vec<Prior> = priors.iter().rev().cloned().collect();
    assert!(
        calibrate(std::slice::from_ref(run()), &model, &mesh(), &swapped, &options).is_err(),
        "priors of other labels"
    );
    assert!(calibrate(&[], &model, &mesh(), &priors, &options).is_err(), "no recording");
}

#[test]
fn weak_and_late_motors_are_identified_beside_the_friction() {
    let (model, ground) = (go2(), Ground::new(&mesh()).unwrap());
    let priors: Vec<Prior> = from_table(&ground.labels(), &qv_contact::prior::built_in()).unwrap();
    let faulty: Vec<(String, f64)> = model
        .joint_names()
        .iter()
        .flat_map(|n| [(format!("actuator.{n}.strength"), 0.8), (format!("actuator.{n}.command_latency"), 0.012)])
        .collect();
    let run = run_of(faulty.clone());
    let calibrated = |given: Vec<(String, f64)>| {
        let options = Options { most_windows: 250, given, ..Options::default() };
        calibrate(std::slice::from_ref(&run), &model, &mesh(), &priors, &options).unwrap()
    };
    let found = calibrated(vec![]);
    let of = |name: &str| found.robot.iter().find(|v| v.parameter == name).unwrap();
    let (strength, latency) = (of("actuator.*.strength"), of("actuator.*.command_latency"));
    assert!((strength.value - 0.8).abs() < 3.0 * strength.deviation.max(0.01), "{:?}", found.robot);
    assert!((latency.value - 0.012).abs() < 3.0 * latency.deviation.max(0.0005), "{:?}", found.robot);
    let ice = &found.regions[0];
    assert!((ice.friction / TRUTH[0] - 1.0).abs() < 0.15, "{:?} {}", ice.posterior, ice.of_robot);
    // What is given is not identified.
    let known = calibrated(faulty);
    let names: Vec<&str> = known.robot.iter().map(|v| v.parameter.as_str()).collect();
    assert!(!names.contains(&"actuator.*.strength") && names.contains(&"contact.time_constant"), "{names:?}");
}
