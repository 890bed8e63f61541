use super::*;
use crate::eye::BlindEye;
use crate::facts::States;
use crate::legs::Follower;
use crate::lens::LensSpread;
use crate::map::{Map, MapSettings};
use crate::roll::Record;
use crate::settings::TrainSettings;
use crate::sight::Rig;
use crate::task::{End, EpisodeSettings, Limits, Stratum, Trial};
use glam::DVec3;
use qv_core::TriangleMesh;

/// A square of six metres without walls: its rim blocks.
fn world() -> World {
    let corners = [(-3.0, -3.0), (3.0, -3.0), (3.0, 3.0), (-3.0, 3.0)];
    let vertices = corners.map(|(x, y)| DVec3::new(x, y, 0.0)).to_vec();
    let mesh = TriangleMesh { vertices, triangles: vec![[0, 1, 2], [0, 2, 3]], ..Default::default() };
    World::new(Map::new(&mesh, &MapSettings::default()).unwrap(), Rig::default(), Limits::default())
}

fn near_by() -> EpisodeSettings {
    EpisodeSettings { geodesic: [1.2, 2.0], strata: vec![Stratum::InView], ..Default::default() }
}

/// An episode whose robot goes `way` metres towards the cone in ten decisions.
fn driven(world: &World, way: f64, end: End) -> EpisodeTrace {
    let episode = near_by().draw(world, 1, 3).unwrap().swap_remove(0);
    let start = glam::DVec2::from(episode.start);
    let along = (episode.goal.axis() - start).normalize();
    let at = |k: usize| start + way * k as f64 / 10.0 * along;
    let track = (0..=10).map(|k| [at(k).x as f32, at(k).y as f32, episode.yaw as f32]).collect();
    let trial = Trial { end, time: 2.0, length: way, shortest: 1.0, nearest: 0.5, seen: Some(0.0), track };
    let record = Record {
        commands: vec![[0.0; 3]; 10],
        cones: vec![[0.0; 4]; 10],
        found: vec![true; 10],
        acted: vec![StudentAction::default(); 10],
        ..Default::default()
    };
    EpisodeTrace { episode, alone: true, trial, record }
}

#[test]
fn rewards_are_metres_gained_and_what_the_end_is_worth() {
    let world = world();
    for (way, end, worth) in [(0.8, End::Reached, 5.0), (0.5, End::Collision, -2.0), (-0.3, End::Slow, 0.0)] {
        let journey = Journey::of(&world, &driven(&world, way, end));
        let sum: f32 = journey.rewards.iter().sum();
        // Ways are read off a grid of 5 cm.
        assert!((f64::from(sum) - way - worth).abs() < 0.08, "{sum} for {way} and {end:?}");
        assert_eq!(journey.rewards.len(), 10);
    }
}

#[test]
fn with_a_whole_look_ahead_an_advantage_is_the_return_less_the_value() {
    let world = world();
    let journey = Journey::of(&world, &driven(&world, 0.8, End::Reached));
    let values: Vec<f32> = (0..10).map(|k| 0.3 * k as f32).collect();
    let policy = PolicySettings { gamma: 0.9, lambda: 1.0, ..Default::default() };
    let (advantages, returns) = journey.estimate(&values, &policy);
    let all = journey.returns(0.9);
    for k in 0..10 {
        assert!((advantages[k] - (all[k] - values[k])).abs() < 1e-5 && (returns[k] - all[k]).abs() < 1e-5, "{k}");
    }
    // Without any, it is what one decision brings over what was expected.
    let (advantages, _) = journey.estimate(&values, &PolicySettings { lambda: 0.0, ..policy });
    assert!((advantages[4] - (journey.rewards[4] + 0.9 * values[5] - values[4])).abs() < 1e-6);
    assert!((advantages[9] - (journey.rewards[9] - values[9])).abs() < 1e-6, "nothing comes after the end");
}

#[test]
fn the_critic_learns_what_episodes_bring() {
    let world = world();
    let ways = [(0.8, End::Reached), (0.2, End::Slow), (0.5, End::Collision)];
    let journeys: Vec<Journey> =
        (0..60).map(|k| Journey::of(&world, &driven(&world, ways[k % 3].0, ways[k % 3].1))).collect();
    let returns: Vec<Vec<f32>> = journeys.iter().map(|j| j.returns(0.99)).collect();
    let mut critic = Critic::new(1);
    let off = |critic: &Critic| {
        let all = journeys.iter().zip(&returns).flat_map(|(j, r)| critic.values(j).into_iter().zip(r.clone()));
        let errors: Vec<f32> = all.map(|(value, wanted)| value - wanted).collect();
        errors.iter().map(|e| e * e).sum::<f32>() / errors.len() as f32
    };
    let before = off(&critic);
    (0..150).for_each(|_| critic.learn(&journeys, &returns).unwrap());
    let after = off(&critic);
    assert!(after < 0.2 * before, "{before} {after}");
}

/// What a student that sees nothing gains in each round of its own trials: it can learn to go ahead, and to stop in time.
fn gained(settings: &TrainSettings) -> (Vec<f64>, Vec<f32>) {
    let world = world();
    let stage = Stage::new(&world, &BlindEye, LensSpread::none());
    let mut legs = Follower::new(&world.map, settings.robots, 0.3);
    let mut student = Student::new(settings).unwrap();
    let gains = (0..settings.rounds).map(|_| {
        let result = student.round(&stage, &mut legs, &near_by(), &mut |_| {}).unwrap();
        result.gains.unwrap().reward
    });
    (gains.collect(), student.parameters)
}

#[test]
fn trials_teach_a_student_without_a_teacher() {
    let settings =
        TrainSettings { rounds: 5, frames: 1500, robots: 64, batch: 16, rate: [1e-3, 3e-4], ..TrainSettings::tuning() };
    let (gains, _) = gained(&settings);
    let ([first, second, ..], [.., before, last]) = (&gains[..], &gains[..]) else {
        panic!("too few rounds: {gains:?}")
    };
    assert!(before + last > first + second + 1.0, "{gains:?}");
}

#[test]
fn a_round_of_trials_has_the_same_bits_on_any_number_of_threads() {
    let settings = TrainSettings { rounds: 2, frames: 150, robots: 6, batch: 5, ..TrainSettings::tuning() };
    let learnt = |threads: usize| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| gained(&settings))
    };
    assert!(learnt(1) == learnt(3));
}

#[test]
fn noise_shrinks_by_the_same_factor_from_round_to_round() {
    let policy = PolicySettings { deviation: [0.2, 0.05], ..Default::default() };
    for (round, rounds, expected) in [(0, 9, 0.2), (4, 9, 0.1), (8, 9, 0.05), (12, 9, 0.05), (0, 1, 0.2)] {
        let found = policy.deviation_at(round, rounds);
        assert!((found - expected).abs() < 1e-6, "{round} of {rounds}: {found}");
    }
    // What a student draws with is that of its round.
    let settings = TrainSettings { rounds: 2, robots: 4, policy: Some(policy), ..TrainSettings::tuning() };
    let world = world();
    let stage = Stage::new(&world, &BlindEye, LensSpread::none());
    let mut student = Student::new(&settings).unwrap();
    for (round, expected) in [(0, 0.2f32), (1, 0.05)] {
        student.rounds = round;
        let mut legs = Follower::new(&world.map, 4, 0.3);
        let drawn = near_by().draw(&world, 4, 5).unwrap();
        let driven = student.explore(&policy, &stage, &mut legs, (drawn, 5)).unwrap();
        let acted: Vec<&StudentAction> = driven.iter().flat_map(|d| &d.record.acted).collect();
        assert!(acted.iter().all(|acted| acted.deviation == expected) && acted.len() > 40);
        let squares: f32 = acted.iter().map(|acted| (acted.action[0] - acted.mean[0]).powi(2)).sum();
        let found = (squares / acted.len() as f32).sqrt();
        assert!((found / expected - 1.0).abs() < 0.3, "{found} for {expected}");
    }
}

#[test]
fn settings_that_mean_nothing_are_named() {
    let policy = Some(PolicySettings { deviation: [0.2, 0.0], ..Default::default() });
    let said = Student::new(&TrainSettings { policy, ..TrainSettings::tuning() }).err().unwrap().to_string();
    assert!(said.states("deviation 0.01 1 0"), "{said}");
}
