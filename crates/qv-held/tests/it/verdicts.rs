//! Recordings of a simulated arm whose cause is known, beside references of it.

use crate::weigh::{ARM, recorded};
use qv_held::{Decision, Evidence, Outcome, Policy, Request, decide, measure};
use qv_recording::Run;
use qv_sim::{BaseKind, Model, ModelOptions};

/// Parameters of a changed robot, names of the effect, part, size, and how far it may be off.
type Case = (&'static [(&'static str, f64)], &'static [&'static str], &'static str, f64, f64);

fn model() -> Model {
    Model::from_urdf(ARM, &ModelOptions { base: BaseKind::Fixed, ..Default::default() }).unwrap()
}

fn references(model: &Model) -> Vec<Run> {
    [0.0, 1.0, 2.0].map(|phase| recorded(model, &[], phase).unwrap()).into()
}

fn judged(run: Run, references: &[Run]) -> (Evidence, Decision) {
    let (model, policy) = (model(), Policy::default());
    let runs = [run];
    let request =
        Request { runs: &runs, references, model: &model, given: &[], without: &[], seed: 1, policy: &policy };
    let evidence = measure(&request).unwrap();
    let decision = decide(&evidence, &policy);
    (evidence, decision)
}

/// Effect, place, size and interval of the named cause.
fn named(evidence: &Evidence, decision: &Decision) -> (String, String, f64, [f64; 2]) {
    let Outcome::Cause(k, _) = decision.outcome else { panic!("{:?}", decision.outcome) };
    let tested = &evidence.tested[k];
    let hypothesis = &tested.hypothesis;
    (hypothesis.effect.clone(), hypothesis.scope.join(","), tested.size[0], decision.judged[k].ci95[0])
}

#[test]
fn the_same_robot_in_another_motion_has_no_gap() {
    let model = model();
    let references = references(&model);
    for phase in [3.0, 4.0] {
        let (_, decision) = judged(recorded(&model, &[], phase).unwrap(), &references);
        assert_eq!(decision.outcome, Outcome::None);
    }
}

#[test]
fn what_was_changed_is_named_with_its_size() {
    let model = model();
    let references = references(&model);
    let cases: [Case; 4] = [
        (&[("link.lower.payload_mass", 0.5)], &["payload_mass", "payload_off_centre"], "lower", 0.5, 0.02),
        (&[("joint.elbow.viscous_friction", 0.6)], &["joint_viscous_friction"], "elbow", 0.5, 0.03),
        (&[("actuator.shoulder.kp_scale", 0.6)], &["motor_gain_kp"], "shoulder", -0.4, 0.01),
        (&[("actuator.*.strength", 0.7)], &["motor_strength"], "all", -0.3, 0.01),
    ];
    for (parameters, effects, scope, size, tolerance) in cases {
        let spelt: Vec<(String, f64)> =
            parameters.iter().flat_map(|(name, x)| ["shoulder", "elbow"].map(|j| (name.replace('*', j), *x))).collect();
        let mut set: Vec<(&str, f64)> = spelt.iter().map(|(name, x)| (name.as_str(), *x)).collect();
        set.dedup();
        let (evidence, decision) = judged(recorded(&model, &set, 3.0).unwrap(), &references);
        let (effect, place, found, ci95) = named(&evidence, &decision);
        assert!(effects.contains(&effect.as_str()), "{parameters:?}: {effect}");
        assert_eq!(place, scope, "{parameters:?}");
        assert!((found - size).abs() < tolerance, "{parameters:?}: {found}");
        // Without noise intervals of gains are narrower than what steps of 1 ms and rows of 5 ms are off by.
        let slack = 1e-3 * size.abs();
        assert!(ci95[0] - slack < size && size < ci95[1] + slack, "{parameters:?}: {ci95:?}");
    }
}

#[test]
fn a_push_is_an_event_with_its_time_and_torque() {
    let model = model();
    let references = references(&model);
    let push = [("joint.elbow.external_torque", 2.0), ("external.start", 4.0), ("external.duration", 0.6)];
    let (_, decision) = judged(recorded(&model, &push, 3.0).unwrap(), &references);
    assert!(matches!(decision.outcome, Outcome::Events(_)), "{:?}", decision.outcome);
    let event = &decision.events[0];
    assert_eq!(event.joint, "elbow");
    assert!((event.time[0] - 4.0).abs() < 0.3 && (event.time[1] - 4.6).abs() < 0.3, "{event:?}");
    assert!((event.torque - 2.0).abs() < 1.0, "{event:?}");
}

#[test]
fn the_bits_do_not_depend_on_the_threads() {
    let model = model();
    let references = references(&model);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| judged(recorded(&model, &[("joint.elbow.coulomb_friction", 0.9)], 3.0).unwrap(), &references).0)
    };
    assert_eq!(on(1), on(2));
}

#[test]
fn recordings_that_cannot_be_weighed_are_refused_with_the_reason() {
    let model = model();
    let references = references(&model);
    let policy = Policy::default();
    let fails = |run: Run, references: &[Run], expected: &str| {
        let runs = [run];
        let request =
            Request { runs: &runs, references, model: &model, given: &[], without: &[], seed: 1, policy: &policy };
        let error = measure(&request).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    };
    let mut without = references[0].clone();
    without.measured.position = None;
    fails(without, &references, "no positions");
    let mut short = references[0].clone();
    for series in [&mut short.measured.position, &mut short.measured.torque].into_iter().flatten() {
        series.time.truncate(300);
        series.values.truncate(300 * series.joints);
    }
    fails(short, &references, "can be weighed");
    let mut blank = references[0].clone();
    blank.measured.position.iter_mut().for_each(|s| s.values.fill(f64::NAN));
    fails(blank, &references, "missing");
}

#[test]
fn without_references_a_fleet_says_what_a_robot_may_be() {
    let model = model();
    let (evidence, decision) = judged(recorded(&model, &[], 3.0).unwrap(), &[]);
    assert!(evidence.is_fleet && evidence.references > 11, "{}", evidence.references);
    assert_eq!(decision.outcome, Outcome::None);
    // What lies within the tolerances is no cause, however well it is seen.
    let within = recorded(&model, &[("actuator.elbow.kp_scale", 1.04), ("joint.elbow.viscous_friction", 0.12)], 3.0);
    let (_, decision) = judged(within.unwrap(), &[]);
    assert_eq!(decision.outcome, Outcome::None);
    let viscous = recorded(&model, &[("joint.elbow.viscous_friction", 1.1)], 3.0).unwrap();
    let (evidence, decision) = judged(viscous, &[]);
    let (effect, place, size, ci95) = named(&evidence, &decision);
    assert_eq!((effect.as_str(), place.as_str()), ("joint_viscous_friction", "elbow"));
    assert!(ci95[0] < 1.0 && 1.0 < ci95[1] && (size - 1.0).abs() < 0.2, "{size} {ci95:?}");
    let Outcome::Cause(k, _) = decision.outcome else { panic!("{:?}", decision.outcome) };
    let least = decision.judged[k].least[0];
    assert!(least > 0.03 && least < 1.0, "{least}: above the tolerance, and below what was found");
}

/// A recording as a servo logs it: positions and commands.
fn of_servo(mut run: Run) -> Run {
    run.measured.torque = None;
    run
}

#[test]
fn servos_without_torques_are_measured_by_their_positions() {
    let model = model();
    // The zeros of the encoders are off in all recordings: that is no torque.
    let biased = |other: &[(&str, f64)], phase: f64| {
        let zeros = [("sensor.shoulder.encoder_bias", 0.01), ("sensor.elbow.encoder_bias", -0.008)];
        of_servo(recorded(&model, &[&zeros, other].concat(), phase).unwrap())
    };
    let references = [0.0, 1.0, 2.0].map(|phase| biased(&[], phase));
    let (evidence, decision) = judged(biased(&[], 3.0), &references);
    assert!(evidence.is_of_positions && evidence.traces.is_empty());
    assert_eq!(decision.outcome, Outcome::None);
    let (evidence, decision) = judged(biased(&[("joint.elbow.armature", 0.08)], 3.0), &references);
    let (effect, place, size, ci95) = named(&evidence, &decision);
    assert_eq!((effect.as_str(), place.as_str()), ("joint_armature", "elbow"));
    assert!((size - 0.05).abs() < 0.005 && ci95[0] > 0.0, "{size} {ci95:?}");
    let (evidence, decision) = judged(biased(&[("link.lower.payload_mass", 0.5)], 3.0), &references);
    let is_load = |k: &usize| {
        let hypothesis = &evidence.tested[*k].hypothesis;
        hypothesis.effect == "payload_mass" && hypothesis.scope == ["lower"]
    };
    let k = (0..evidence.tested.len()).find(is_load).unwrap();
    let size = evidence.tested[k].size[0];
    // Links may be off by their tolerances in each recording, which takes from the power.
    assert!((size - 0.5).abs() < 0.05 && decision.judged[k].p_size < 0.01, "{size} {:?}", decision.judged[k]);
}

/// Index of the hypothesis of an effect on a part.
fn hypothesis_of(evidence: &Evidence, effect: &str, part: &str) -> usize {
    let is_it = |k: &usize| {
        let hypothesis = &evidence.tested[*k].hypothesis;
        hypothesis.effect == effect && hypothesis.scope == [part]
    };
    (0..evidence.tested.len()).find(is_it).unwrap()
}

#[test]
fn a_limit_below_all_torques_of_a_servo_is_found_though_its_column_starts_at_nothing() {
    let model = model();
    let references = [0.0, 1.0, 2.0].map(|phase| of_servo(recorded(&model, &[], phase).unwrap()));
    let with = |set: &[(&str, f64)]| judged(of_servo(recorded(&model, set, 3.0).unwrap()), &references);
    // The elbow carries 1.2 N m and turns its rotor; its drive may give 40 by the model.
    let limit = 2.2;
    let (evidence, decision) = with(&[("actuator.elbow.torque_limit", limit)]);
    let k = hypothesis_of(&evidence, "torque_limit", "elbow");
    let (tested, judged) = (&evidence.tested[k], &decision.judged[k]);
    assert!(judged.is_physical && judged.p_size < 1e-6, "{judged:?}");
    // It acts when the arm starts, and hardly after: it predicts no other blocks, and is not named.
    let found = tested.hypothesis.axes[0].at_zero + tested.size[0];
    assert!((found - limit).abs() < 0.2 * limit && tested.loss < 0.05 * evidence.loss, "{found} {judged:?}");
}

#[test]
fn two_causes_at_once_are_named_as_a_pair() {
    let model = model();
    let references = references(&model);
    let both = [("joint.elbow.viscous_friction", 0.6), ("actuator.shoulder.kp_scale", 0.6)];
    let (evidence, decision) = judged(recorded(&model, &both, 3.0).unwrap(), &references);
    let Outcome::Pair(k, _) = decision.outcome else { panic!("{:?}", decision.outcome) };
    let pair = &evidence.pairs[k];
    let mut found: Vec<(&str, &str, f64)> = (pair.members.iter().zip(&pair.test.size))
        .map(|(&m, x)| (&evidence.tested[m].hypothesis, *x))
        .map(|(h, x)| (h.effect.as_str(), h.scope[0].as_str(), x))
        .collect();
    found.sort_by(|a, b| a.0.cmp(b.0));
    assert_eq!(
        [found[0].0, found[0].1, found[1].0, found[1].1],
        ["joint_viscous_friction", "elbow", "motor_gain_kp", "shoulder"]
    );
    assert!((found[0].2 - 0.5).abs() < 0.03 && (found[1].2 + 0.4).abs() < 0.02, "{found:?}");
    // One of them alone is no pair.
    let (_, decision) = judged(recorded(&model, &both[..1], 3.0).unwrap(), &references);
    assert!(matches!(decision.outcome, Outcome::Cause(..)), "{:?}", decision.outcome);
}
