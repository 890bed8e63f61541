//! The rivals of the diagnosis on recordings of a simulated Go2 whose cause is known.

use crate::facts::States;
use crate::recorded::{go2, recorded};
use qv_baselines::{Baselines, baselines};
use qv_gap::Options;
use qv_gap::inference::linearised::NullOptions;
use qv_gap::problem::library;
use qv_go2::synthetic;
use qv_recording::Run;
use qv_rollout::WindowOptions;
use qv_sim::Terrain;
use std::sync::Mutex;

/// Some effects of each kind: slopes and limits, deviations and values of their own, one axis and several.
const SOME: [&str; 8] = [
    "command_latency",
    "joint_coulomb_friction",
    "motor_strength",
    "torque_limit",
    "payload_mass",
    "ground_friction",
    "external_force",
    "imu_tilt",
];
const FEW_STEPS: usize = 150_000;

fn quick() -> Options<'static> {
    Options {
        library: library::built_in().into_iter().filter(|e| SOME.contains(&e.name.as_str())).collect(),
        cut: WindowOptions { most: 16, ..Default::default() },
        effort: NullOptions { replicates: 3, seed: 1, ..Default::default() },
        ..Default::default()
    }
}

fn of(run: &Run, options: &Options) -> Baselines {
    baselines(std::slice::from_ref(run), &go2(), &Terrain::plane(), options, FEW_STEPS).unwrap()
}

#[test]
fn a_latency_is_named_by_one_effect_at_a_time_and_the_same_on_any_number_of_threads() {
    let run = recorded(synthetic::command_latency(0.012), 4);
    let told = Mutex::new(Vec::new());
    let tell = |at: &qv_gap::Progress| told.lock().unwrap().push(at.name.to_string());
    let all = of(&run, &Options { progress: Some(&tell), ..quick() });
    let one = &all.one_at_a_time;
    assert_eq!((one.verdict.as_str(), one.effect.as_deref()), ("explained", Some("command_latency")), "{one:?}");
    assert_eq!(one.causes.first(), one.effect.as_ref());
    assert!(one.sizes.len() == 1 && (one.sizes[0].value - 0.012).abs() < 0.0025, "{:?}", one.sizes);
    assert_eq!((one.sizes[0].scope.as_slice(), one.sizes[0].unit.as_str()), (["all".to_string()].as_slice(), "s"));
    assert!(one.closed > 0.9, "{one:?}");
    // A generation is begun only while there are steps left.
    assert!((FEW_STEPS..2 * FEW_STEPS).contains(&all.cma_es.steps), "{:?}", all.cma_es);
    assert!(all.cma_es.causes.len() <= 5 && (0.0..=1.0).contains(&all.cma_es.closed), "{:?}", all.cma_es);
    let network = &all.residual_network;
    assert_eq!((network.verdict.as_str(), &network.effect, network.causes.len()), ("unnamed", &None, 0));
    assert!(network.closed > 0.05 && network.closed < one.closed, "{network:?}");
    assert_eq!(told.lock().unwrap().len(), 4);
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(all, alone.install(|| of(&run, &quick())));
}

#[test]
fn what_may_not_be_accused_is_named_by_none() {
    let run = recorded(synthetic::command_latency(0.012), 4);
    let without = SOME.map(String::from).to_vec();
    let all = of(&run, &Options { without, ..quick() });
    for answer in [&all.one_at_a_time, &all.cma_es] {
        assert_eq!((answer.verdict.as_str(), &answer.effect, answer.closed), ("no_gap", &None, 0.0));
        assert!(answer.causes.is_empty() && answer.sizes.is_empty());
    }
    assert!(all.residual_network.closed > 0.05);
}

#[test]
fn runs_that_are_missing_or_too_short_are_refused_by_name() {
    let refused = |runs: &[Run]| {
        baselines(runs, &go2(), &Terrain::plane(), &quick(), FEW_STEPS).err().map(|e| e.to_string()).unwrap()
    };
    assert!(refused(&[]).states("least"));
    let short = qv_rollout::channels::snippet(&recorded(Vec::new(), 5), 0.0, 1.5);
    assert!(refused(&[short]).states("windows 8"));
}
