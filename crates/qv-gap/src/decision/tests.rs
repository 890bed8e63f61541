use super::evidence::*;
use super::*;
use crate::checks::stationarity::Dependence;
use crate::facts::States;
use crate::findings::Verdict;
use crate::problem::columns::Extent;
use std::collections::BTreeMap;

fn level(ratio: f64) -> Level {
    Level { ratio, null: 1.0, count: 1000.0 }
}

/// A good candidate with that evidence.
fn candidate(effect: &str, log_evidence: f64) -> Candidate {
    Candidate {
        effect: effect.into(),
        scope: vec!["all".into()],
        members: vec![0, 3, 6],
        extent: None,
        values: vec![0.2],
        parameters: vec![],
        log_evidence,
        by_chance: 4.0,
        least_evidence: None,
        size: 10.0,
        from_edge: 0.3,
        share: 0.9,
        held_out: Some(HeldOut {
            closed: 0.9,
            fall: [8.0, 1.0],
            fall_of_logarithm: [2.0, 0.2],
            fall_of_pieces: None,
            actuator_residual: [4.0, 1.1],
            log_evidence: Some(80.0),
            falls: vec![],
        }),
    }
}

fn facts(name: &str) -> EffectFacts {
    EffectFacts {
        name: name.into(),
        acts_on: ActsOn::Joints,
        is_known: true,
        interface: "actuator".into(),
        experiment: String::new(),
    }
}

fn round(candidates: Vec<Candidate>, accused: &[usize]) -> Round {
    let after = After { level: level(1.1), held_out: [1.0, 0.8] };
    let after = (!accused.is_empty()).then_some(after);
    let (level, excess, is_first, accused) = (level(9.0), 8000.0, true, accused.to_vec());
    Round { level, excess, is_first, candidates, accused, after }
}

/// A robot with a latency, which is accused, and nothing left.
fn latency() -> Evidence {
    let rounds = vec![round(vec![candidate("command_latency", 900.0), candidate("actuator_lag", 700.0)], &[0])];
    let accused = IdentifiedCause {
        round: 0,
        candidate: 0,
        values: vec![0.01],
        parameters: vec![],
        fading: None,
        depends_on: vec![],
    };
    let closed = Closure {
        loss: [9.0, 1.1],
        floor: 0.8,
        share: 0.96,
        share_with_events: 0.96,
        fall: [8.0, 1.0],
        actuator_residual: [4.0, 1.1],
        log_evidence: 300.0,
    };
    let corrected = CorrectedRobot {
        accused: vec![accused],
        same_joints: vec![],
        beside: BTreeMap::from([("actuator_lag".to_owned(), 3.0)]),
        closed,
    };
    Evidence {
        format: FORMAT.into(),
        is_free: true,
        joints: vec!["hip".into(), "knee".into()],
        effects: ["command_latency", "actuator_lag"].map(facts).to_vec(),
        level: level(9.0),
        held_out: [9.0, 0.8],
        rounds,
        corrected: Some(corrected),
        report: None,
        camera: None,
        held: None,
    }
}

fn decided(evidence: &Evidence, policy: &Policy) -> Decision {
    decide(evidence, policy).unwrap()
}

#[test]
fn what_closes_the_gap_is_accused_and_ranks_first() {
    let decision = decided(&latency(), &Policy::default());
    assert_eq!((decision.verdict, &decision.doubt), (Verdict::Explained, &None));
    assert_eq!(decision.ranking[0].effect, "command_latency");
    assert!(decision.ranking[0].score > 0.8, "{:?}", decision.ranking);
}

#[test]
fn evidence_is_the_same_after_it_was_written_and_read() {
    let mut evidence = latency();
    evidence.rounds[0].candidates[1].size = f64::INFINITY;
    let read: Evidence = serde_json::from_str(&serde_json::to_string(&evidence).unwrap()).unwrap();
    assert!(read.rounds[0].candidates[1].size.is_nan(), "JSON has no infinity");
    assert_eq!(decide(&read, &Policy::default()), decide(&evidence, &Policy::default()));
    // To the last bit.
    for k in 1..2000 {
        let x = 1e-5 * f64::from(k).sin() / f64::from(k);
        evidence.rounds[0].excess = x;
        let read: Evidence = serde_json::from_str(&serde_json::to_string(&evidence).unwrap()).unwrap();
        assert_eq!(read.rounds[0].excess.to_bits(), x.to_bits());
    }
}

#[test]
fn another_policy_is_followed_as_far_as_was_measured() {
    // It accuses nothing, and what was measured of the corrected robot does not count.
    let strict = Policy { least_evidence: 1000.0, ..Policy::default() };
    let decision = decided(&latency(), &strict);
    assert_eq!((decision.verdict, decision.doubt), (Verdict::Unexplained, None));
    // It accuses the other one, of which no corrected robot was simulated.
    let mut evidence = latency();
    evidence.rounds[0].candidates[0].size = 4.0;
    let large = Policy { least_size: 5.0, ..Policy::default() };
    assert_eq!(decide(&evidence, &large), Err(Divergence(0)));
    // It would look for one more.
    let thorough = Policy { faultless_level: 1.05, ..Policy::default() };
    assert_eq!(decide(&latency(), &thorough), Err(Divergence(1)));
}

#[test]
fn what_was_not_looked_at_held_out_is_not_accused() {
    let mut first = candidate("command_latency", 900.0);
    first.held_out = None;
    let round = round(vec![first], &[]);
    let judgement = Judge::new(&Policy::default(), &round, true).judge();
    assert!(
        judgement.accused.is_empty() && judgement.refused.as_ref().unwrap().1.to_string().states("looked"),
        "{judgement:?}"
    );
}

#[test]
fn events_at_other_times_stand_beside_an_event() {
    let push = |from: f64, evidence| {
        let mut push = candidate("external_push", evidence);
        push.extent = Some(Extent::Time([from, from + 0.5]));
        push.held_out.as_mut().unwrap().falls = vec![0.4, 0.3];
        push
    };
    let candidates = vec![push(2.0, 900.0), push(2.2, 800.0), push(6.0, 700.0), push(9.0, 20.0)];
    let policy = Policy::default();
    let judge = |candidates: Vec<Candidate>| Judge::new(&policy, &round(candidates, &[]), true).judge();
    assert_eq!(judge(candidates.clone()).accused, [0, 2]);
    let mut worse = candidates;
    worse[0].held_out.as_mut().unwrap().falls = vec![-0.4, -0.3];
    let judgement = judge(worse);
    assert!(judgement.refused.as_ref().unwrap().1.to_string().states("windows 2"), "{judgement:?}");
}

#[test]
fn what_closes_less_than_half_of_the_gap_explains_a_part() {
    let verdict = |share_with_events: f64, after: f64| {
        let mut evidence = latency();
        let corrected = evidence.corrected.as_mut().unwrap();
        corrected.closed = Closure { share_with_events, ..corrected.closed };
        evidence.rounds[0].after.as_mut().unwrap().level = level(after);
        decided(&evidence, &Policy::default()).verdict
    };
    assert_eq!(verdict(0.7, 1.1), Verdict::Explained);
    assert_eq!(verdict(0.3, 1.1), Verdict::PartlyExplained);
}

#[test]
fn what_closes_little_is_not_accused() {
    let judged = |share: f64, closed: f64, law: [f64; 2]| {
        let mut first = candidate("joint_armature", 300.0);
        first.share = share;
        let held_out = first.held_out.as_mut().unwrap();
        (held_out.closed, held_out.actuator_residual) = (closed, law);
        Judge::new(&Policy::default(), &round(vec![first], &[]), true).judge().accused
    };
    assert!(judged(0.1, 0.2, [1.0; 2]).is_empty());
    assert_eq!(judged(0.4, 0.2, [1.0; 2]), [0]);
    assert_eq!(judged(0.1, 0.4, [1.0; 2]), [0]);
    assert_eq!(judged(0.1, 0.2, [4.0, 1.1]), [0], "no contact has a part in the law of an actuator");
}

#[test]
fn what_fits_a_part_of_the_noise_is_no_gap() {
    let mut evidence = latency();
    (evidence.level, evidence.held_out) = (level(1.02), [0.79, 0.8]);
    evidence.corrected.as_mut().unwrap().closed.share_with_events = 0.02;
    let decision = decided(&evidence, &Policy::default());
    assert_eq!(decision.verdict, Verdict::NoGap);
    assert!(decision.ranking.iter().all(|r| r.score == 0.0), "{:?}", decision.ranking);
}

#[test]
fn a_size_that_changes_is_not_one_value() {
    let doubt = |change: f64, errors: f64| {
        let mut evidence = latency();
        let cause = &mut evidence.corrected.as_mut().unwrap().accused[0];
        let change = change * cause.values[0];
        cause.depends_on = vec![Dependence { on: "speed".into(), change, errors }];
        decided(&evidence, &Policy::default()).doubt
    };
    assert_eq!(doubt(0.2, 1.5), None, "within two standard errors");
    assert_eq!(doubt(0.03, 9.0), None, "less than a twentieth");
    assert!(doubt(0.2, 4.0).unwrap().to_string().states("speed 4"));
}

#[test]
fn a_cable_is_no_row_of_pushes() {
    let doubt = |times: &[[f64; 2]]| {
        let mut evidence = latency();
        let events =
            times.iter().map(|&t| Candidate { extent: Some(Extent::Time(t)), ..candidate("external_push", 900.0) });
        evidence.rounds[0].candidates = events.collect();
        evidence.rounds[0].accused = (0..times.len()).collect();
        let one = evidence.corrected.as_ref().unwrap().accused[0].clone();
        let all = (0..times.len()).map(|candidate| IdentifiedCause { candidate, ..one.clone() });
        evidence.corrected.as_mut().unwrap().accused = all.collect();
        decided(&evidence, &Policy::default()).doubt
    };
    assert_eq!(doubt(&[[1.0, 9.0]]), None);
    assert_eq!(doubt(&[[1.0, 1.6], [4.0, 5.2]]), None);
    assert!(doubt(&[[8.6, 13.0], [13.2, 19.9]]).unwrap().to_string().states("11.1 11.1"));
}

#[test]
fn nothing_steady_is_accused_of_an_arm_that_is_nearer_than_the_null() {
    let arm = |ratio: f64, extent: Option<Extent>| {
        let mut evidence = latency();
        (evidence.is_free, evidence.level) = (false, level(ratio));
        evidence.rounds[0].candidates[0].extent = extent;
        let held_out = evidence.rounds[0].candidates[0].held_out.as_mut().unwrap();
        held_out.falls = vec![0.5; 3];
        decided(&evidence, &Policy::default()).verdict
    };
    assert_eq!(arm(9.0, None), Verdict::Explained);
    assert_eq!(arm(0.71, None), Verdict::NoGap);
    // A push may be short: it is reported all the same.
    assert_ne!(arm(3.0, Some(Extent::Time([1.0, 1.4]))), Verdict::NoGap);
}

#[test]
fn a_size_beyond_what_is_looked_for_bars_no_other_cause_of_an_arm() {
    let mut first = candidate("joint_viscous_friction", 300.0);
    first.from_edge = -1.0;
    let mut round = round(vec![first, candidate("motor_gain_kp", 280.0)], &[]);
    round.is_first = true;
    let policy = Policy::default();
    assert_eq!(Judge::new(&policy, &round, false).judge().accused, [1]);
    assert_eq!(Judge::new(&policy, &round, true).judge().accused, Vec::<usize>::new());
    // Just within, and it closes most of what no fit has seen.
    round.candidates[0].from_edge = 0.5 * policy.edge;
    assert!(round.candidates[0].held_out.as_ref().is_some_and(|h| h.closed > policy.held_windows.mostly_closed));
    assert_eq!(Judge::new(&policy, &round, false).judge().accused, [0]);
    assert_eq!(Judge::new(&policy, &round, true).judge().accused, Vec::<usize>::new());
}

#[test]
fn a_trifle_of_all_joints_is_no_cause_in_some_of_them() {
    let policy = Policy::default();
    let part = Candidate { size: 4.2, ..candidate("command_latency", 400.0) };
    let members = vec![0, 1, 3, 4, 6, 7];
    let whole = Candidate { size: 2.4, members, log_evidence: 900.0, ..part.clone() };
    let judged = |candidates: &[Candidate]| Judge::new(&policy, &round(candidates.to_vec(), &[]), true).judge();
    assert_eq!(judged(std::slice::from_ref(&part)).accused, [0]);
    assert_eq!(judged(&[whole.clone(), part.clone()]).accused, Vec::<usize>::new());
    let only_trifles = round(vec![whole.clone(), part.clone()], &[]);
    assert!(
        !Judge::new(&policy, &only_trifles, true).is_suspicious(),
        "a size that any robot may have is no sign of more"
    );
    // One of other joints stands for itself.
    let elsewhere = Candidate { members: vec![1, 4, 7], ..whole };
    assert_eq!(judged(&[elsewhere, part]).accused, [1]);
}
