//! Teacher, task and judge in the yard with boxes.

use crate::facts::States;
use qv_core::Pose;
use qv_core::random::Xoshiro256PlusPlus;
use qv_nav::NavError;
use qv_nav::eye::{BlindEye, Eye, FnEye, Shot};
use qv_nav::legs::{Follower, Legs, Motion, Start};
use qv_nav::lens::LensSpread;
use qv_nav::map::{Map, MapSettings};
use qv_nav::net::Net;
use qv_nav::pilots::{MixedPilot, Mixture, NetPilot, TeacherPilot};
use qv_nav::roll::{Decision, Pilot, PilotInput, Stage, roll};
use qv_nav::sight::Rig;
use qv_nav::task::{End, Episode, EpisodeSettings, Limits, Stratum};
use qv_nav::teacher::World;
use std::sync::atomic::{AtomicUsize, Ordering};
use yard::layout::mesh_with;
use yard::objects::CRATES;

fn world() -> World {
    let map = Map::new(&mesh_with(&CRATES), &MapSettings::default()).unwrap();
    World::new(map, Rig::default(), Limits::default())
}

#[test]
fn episodes_are_what_they_say() {
    let world = world();
    let episodes = EpisodeSettings::default().draw(&world, 30, 5).unwrap();
    for (k, e) in episodes.iter().enumerate() {
        assert_eq!(e.stratum, Stratum::ALL[k % 3]);
        assert!((2.5..=7.0).contains(&e.geodesic) && world.map.room(e.start.into()) > 0.45, "{e:?}");
        assert!(e.others.iter().all(|o| o.colour != e.goal.colour && o.axis().distance(e.goal.axis()) > 0.9));
    }
    assert!(episodes.iter().any(|e| e.others.len() == 2) && episodes.iter().any(|e| e.others.is_empty()));
    assert_eq!(EpisodeSettings::default().draw(&world, 12, 5).unwrap(), episodes[..12]);
    assert_ne!(EpisodeSettings::default().draw(&world, 12, 6).unwrap(), episodes[..12]);
}

#[test]
fn the_teacher_finds_cones_without_a_collision() {
    let world = world();
    let stage = Stage::new(&world, &BlindEye, LensSpread::none());
    let episodes = EpisodeSettings::default().draw(&world, 48, 11).unwrap();
    let mut legs = Follower::new(&world.map, 16, 0.3);
    let mut pilot = TeacherPilot { limits: world.limits };
    let rolled = roll(&stage, &mut legs, &episodes, &mut pilot, |k| k != 1, &mut |_| {}).unwrap();
    let reached = |s: Stratum| {
        let of: Vec<bool> =
            episodes.iter().zip(&rolled).filter(|(e, _)| e.stratum == s).map(|(_, (t, _))| t.reached()).collect();
        of.iter().filter(|r| **r).count()
    };
    let [seen, turned, hidden] = Stratum::ALL.map(reached);
    assert!(seen >= 15 && turned >= 15 && hidden >= 14, "{seen} {turned} {hidden} of 16 each");
    assert_eq!(rolled.iter().filter(|(t, _)| matches!(t.end, End::Collision | End::Pushed)).count(), 0);
    for (episode, (trial, _)) in episodes.iter().zip(&rolled).filter(|(_, (t, _))| t.reached()) {
        assert!(trial.nearest <= 0.35 && trial.length > 0.8 * trial.shortest, "{episode:?} {}", trial.length);
    }
    // What a student must judge by eye it can see: near a cone in the open, the teacher goes on only while it is in the picture.
    for (_, record) in &rolled {
        for (cone, command) in record.cones.iter().zip(&record.commands) {
            let ahead = world.limits.command(*command)[0];
            let bearing = f64::from(cone[0]).atan2(f64::from(cone[1]));
            let near = cone[2].exp() < 0.8;
            assert!(!near || ahead < 0.25 || bearing.abs() < 0.5, "{ahead} m/s at a bearing of {bearing}");
        }
    }
    let record = &rolled[0].1;
    assert_eq!(record.pictures.len(), record.len() * 80 * 60 * 3);
    assert!(rolled[1].1.is_empty() && record.cones.iter().any(|c| c[3] == 1.0));
}

/// Legs that stay where they are, whatever is commanded.
struct StandingLegs(Vec<Start>);

impl Legs for StandingLegs {
    fn count(&self) -> usize {
        4
    }
    fn begin(&mut self, starts: &[Start]) -> Result<(), NavError> {
        self.0 = starts.to_vec();
        Ok(())
    }
    fn step(&mut self, _commands: &[[f64; 3]], _active: &[bool]) -> Result<(), NavError> {
        Ok(())
    }
    fn motion(&self, env: usize) -> Motion {
        Motion { world_from_base: self.past(env, 0.0), gyro: [0.0; 3], fell: false }
    }
    fn past(&self, env: usize, _ago: f64) -> Pose {
        let [x, y] = self.0[env].place;
        Pose::from_xyz_rpy([x, y, 0.3], [0.0, 0.0, self.0[env].yaw])
    }
}

/// A follower whose robots are apart or must all go on at once, and that stumbles once it has made some steps.
struct Odd<'a> {
    follower: Follower<'a>,
    are_apart: bool,
    steps_left: usize,
}

impl Legs for Odd<'_> {
    fn count(&self) -> usize {
        self.follower.count()
    }
    fn begin(&mut self, starts: &[Start]) -> Result<(), NavError> {
        self.follower.begin(starts)
    }
    fn step(&mut self, commands: &[[f64; 3]], active: &[bool]) -> Result<(), NavError> {
        let left = self.steps_left.checked_sub(1);
        self.steps_left = left.ok_or_else(|| NavError::value("legs", "legs that stand", "none"))?;
        self.follower.step(commands, active)
    }
    fn motion(&self, env: usize) -> Motion {
        self.follower.motion(env)
    }
    fn past(&self, env: usize, ago: f64) -> Pose {
        self.follower.past(env, ago)
    }
    fn are_apart(&self) -> bool {
        self.are_apart
    }
}

/// Legs that are apart are driven in two halves; each robot does what it would have done beside all others.
#[test]
fn halves_drive_as_all_at_once() {
    let world = world();
    let eye = FnEye(|shot: &Shot| {
        let at = shot.camera.camera_from_world.position;
        (0..80 * 60 * 3).map(|k| (0.1 * (at.x + at.y + f64::from(k))).sin().abs() as f32).collect()
    });
    let stage = Stage::new(&world, &eye, LensSpread::wide());
    let episodes = EpisodeSettings::default().draw(&world, 10, 21).unwrap();
    let limits = world.limits;
    let follower = || Follower::new(&world.map, 7, 0.3);
    let driven = |legs: &mut dyn Legs| {
        let net = Net::default();
        let parameters = net.draw(&mut Xoshiro256PlusPlus::new(4));
        let later = Mixture { alone: 0.3, taught: 0.6, stray: 0.1, stretch: 4.0, goal_given: 0.5 };
        let mut pilot = MixedPilot::new(NetPilot::new(&net, &parameters, 7), limits, later, 7);
        roll(&stage, legs, &episodes, &mut pilot, |_| true, &mut |_| {}).unwrap()
    };
    let (halves, whole) =
        (driven(&mut follower()), driven(&mut Odd { follower: follower(), are_apart: false, steps_left: usize::MAX }));
    let lengths: Vec<usize> = whole.iter().map(|(trial, _)| trial.track.len()).collect();
    assert!(lengths.iter().any(|n| *n != lengths[0]), "episodes end at different times: {lengths:?}");
    assert!(halves == whole);
    // On one thread as well, where nothing can be done at the same time.
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert!(one.install(|| driven(&mut follower())) == whole);
}

/// An eye of which some look fails, or shows too little.
struct Tires {
    looks: AtomicUsize,
    fails: bool,
}

impl Eye for Tires {
    fn look(&self, shots: &[Shot]) -> Result<Vec<Vec<f32>>, NavError> {
        let is_tired = self.looks.fetch_add(1, Ordering::Relaxed) >= 3;
        match is_tired && self.fails {
            true => Err(NavError::value("eye", "one that is awake", "none")),
            false => Ok(vec![vec![0.5; 80 * 60 * 3]; shots.len() - usize::from(is_tired)]),
        }
    }
}

#[test]
fn what_fails_on_the_way_is_told() {
    let world = world();
    let episodes = EpisodeSettings::default().draw(&world, 5, 2).unwrap();
    let said = |eye: &dyn Eye, legs: &mut dyn Legs| {
        let stage = Stage::new(&world, eye, LensSpread::none());
        let mut pilot = TeacherPilot { limits: world.limits };
        roll(&stage, legs, &episodes, &mut pilot, |_| true, &mut |_| {}).err().map(|e| e.to_string())
    };
    let follower = || Follower::new(&world.map, 5, 0.3);
    let stumbles = |steps_left| Odd { follower: follower(), are_apart: true, steps_left };
    let tires = |fails| Tires { looks: AtomicUsize::new(0), fails };
    assert_eq!(said(&BlindEye, &mut stumbles(1000)), None);
    assert!(said(&BlindEye, &mut stumbles(3)).unwrap().states("stand"));
    assert!(said(&tires(true), &mut follower()).unwrap().states("awake"));
    assert!(said(&tires(false), &mut follower()).unwrap().states("pictures 80 60 3"));
}

/// Always the same.
struct Constant([f32; 3]);

impl Pilot for Constant {
    fn begin(&mut self, _env: usize, _episode: &Episode) {}
    fn decide(&mut self, seen: &[PilotInput]) -> Vec<Decision> {
        vec![Decision { command: self.0, sight: None }; seen.len()]
    }
}

/// A student that sees what was commanded last copies it, since a teacher's commands are alike from one decision to the next, and does not look.
#[test]
fn what_a_student_sees_does_not_tell_its_last_command() {
    let world = world();
    let stage = Stage::new(&world, &BlindEye, LensSpread::none());
    let episodes = EpisodeSettings::default().draw(&world, 4, 3).unwrap();
    let seen = |command| {
        let rolled =
            roll(&stage, &mut StandingLegs(Vec::new()), &episodes, &mut Constant(command), |_| true, &mut |_| {});
        rolled.unwrap().into_iter().map(|(_, r)| (r.states, r.recalls, r.pictures)).collect::<Vec<_>>()
    };
    let still = seen([0.0; 3]);
    assert!(still[0].0.len() > 10 && still == seen([1.0, -1.0, 0.5]));
}

#[test]
fn strata_can_be_chosen() {
    let world = world();
    let settings = EpisodeSettings { strata: vec![Stratum::Turned], ..Default::default() };
    assert!(settings.draw(&world, 5, 1).unwrap().iter().all(|e| e.stratum == Stratum::Turned));
    let none = EpisodeSettings { strata: Vec::new(), ..Default::default() };
    assert!(none.draw(&world, 5, 1).unwrap_err().to_string().contains("strata"));
}
