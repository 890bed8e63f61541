//! Teacher, task and judge in the yard with boxes.

use qv_nav::eye::BlindEye;
use qv_nav::legs::Follower;
use qv_nav::lens::LensSpread;
use qv_nav::map::{Map, MapSettings};
use qv_nav::pilots::TeacherPilot;
use qv_nav::roll::{Stage, roll};
use qv_nav::sight::Rig;
use qv_nav::task::{End, EpisodeSettings, Limits, Stratum};
use qv_nav::teacher::World;
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
fn the_teacher_finds_most_cones_without_a_collision() {
    let world = world();
    let stage = Stage { world: &world, eye: &BlindEye, spread: LensSpread::none() };
    let episodes = EpisodeSettings::default().draw(&world, 48, 11).unwrap();
    let mut legs = Follower::new(&world.map, 16, 0.3);
    let mut pilot = TeacherPilot { limits: world.limits };
    let rolled = roll(&stage, &mut legs, &episodes, &mut pilot, |k| k == 0, &mut |_| {}).unwrap();
    let reached = |s: Stratum| {
        let of: Vec<bool> =
            episodes.iter().zip(&rolled).filter(|(e, _)| e.stratum == s).map(|(_, (t, _))| t.reached()).collect();
        of.iter().filter(|r| **r).count()
    };
    let [seen, turned, hidden] = Stratum::ALL.map(reached);
    assert!(seen >= 13 && turned >= 13 && hidden >= 8, "{seen} {turned} {hidden} of 16 each");
    assert!(rolled.iter().filter(|(t, _)| t.end == End::Collision).count() <= 3);
    for (episode, (trial, _)) in episodes.iter().zip(&rolled).filter(|(_, (t, _))| t.reached()) {
        assert!(trial.nearest <= 0.35 && trial.length > 0.8 * trial.shortest, "{episode:?} {}", trial.length);
    }
    let record = &rolled[0].1;
    assert_eq!(record.pictures.len(), record.len() * 80 * 60 * 3);
    assert!(rolled[1].1.is_empty() && record.cones.iter().any(|c| c[3] == 1.0));
}
