//! A student learns to reach cones that it sees, in an open place, within a minute or two.

use glam::DVec3;
use qv_core::{GaussianCloud, TriangleMesh};
use qv_nav::dagger::{Student, TrainSettings};
use qv_nav::eye::{BlindEye, SplatEye};
use qv_nav::legs::Follower;
use qv_nav::lens::LensSpread;
use qv_nav::map::{Map, MapSettings};
use qv_nav::pilots::{NetPilot, TeacherPilot};
use qv_nav::roll::{Pilot, Stage, roll};
use qv_nav::score::Row;
use qv_nav::sight::Rig;
use qv_nav::task::{EpisodeSettings, Limits, Stratum};
use qv_nav::teacher::World;

const SIDE: f64 = 3.0;

/// A square without walls: its rim blocks.
fn plane() -> TriangleMesh {
    let corners = [(-SIDE, -SIDE), (SIDE, -SIDE), (SIDE, SIDE), (-SIDE, SIDE)];
    let vertices = corners.map(|(x, y)| DVec3::new(x, y, 0.0)).to_vec();
    TriangleMesh { vertices, triangles: vec![[0, 1, 2], [0, 2, 3]], ..Default::default() }
}

/// Flat grey Gaussians on it, darker and brighter by turns.
fn ground() -> GaussianCloud {
    const SPACING: f64 = 0.2;
    let mut cloud = GaussianCloud::default();
    let count = (2.0 * SIDE / SPACING) as usize;
    for (i, j) in (0..count).flat_map(|i| (0..count).map(move |j| (i, j))) {
        let at = |k: usize| ((k as f64 + 0.5) * SPACING - SIDE) as f32;
        cloud.means.push([at(i), at(j), 0.0]);
        cloud.log_scales.push([0.6 * SPACING, 0.6 * SPACING, 0.004].map(|s| s.ln() as f32));
        cloud.rotations.push([1.0, 0.0, 0.0, 0.0]);
        cloud.opacity_logits.push(4.0);
        cloud.sh.push([if (i / 2 + j / 2) % 2 == 0 { -0.5 } else { 0.1 }; 3]);
    }
    cloud
}

fn near_by() -> EpisodeSettings {
    EpisodeSettings { geodesic: [1.2, 2.5], strata: vec![Stratum::InView], ..Default::default() }
}

fn reached(stage: &Stage, pilot: &mut dyn Pilot, count: usize) -> Row {
    let episodes = near_by().draw(stage.world, count, 777).unwrap();
    let mut legs = Follower::new(&stage.world.map, 16, 0.3);
    let rolled = roll(stage, &mut legs, &episodes, pilot, |_| false, &mut |_| {}).unwrap();
    Row::of(&rolled.into_iter().map(|(trial, _)| trial).collect::<Vec<_>>())
}

#[test]
fn a_student_learns_to_reach_cones_that_it_sees() {
    let map = Map::new(&plane(), &MapSettings::default()).unwrap();
    let (world, eye) = (World::new(map, Rig::default(), Limits::default()), SplatEye::new(&ground()));
    let stage = Stage::new(&world, &eye, LensSpread::none());
    let settings = TrainSettings {
        rounds: 3,
        frames: 1500,
        epochs: 8,
        last_epochs: 8,
        batch: 2,
        truncated: 20,
        robots: 32,
        ..Default::default()
    };
    let mut legs = Follower::new(&world.map, settings.robots, 0.3);
    let mut student = Student::new(&settings).unwrap();
    let before = reached(&stage, &mut NetPilot::new(&student.net, &student.parameters, 16), 16);
    for _ in 0..settings.rounds {
        student.round(&stage, &mut legs, &near_by(), &mut |_| {}).unwrap();
    }
    let after = reached(&stage, &mut NetPilot::new(&student.net, &student.parameters, 16), 32);
    // The same network without pictures: what it would reach by driving ahead.
    let grey = Stage { world: &world, eye: &BlindEye, ..stage };
    let blind = reached(&grey, &mut NetPilot::new(&student.net, &student.parameters, 16), 32);
    let teacher = reached(&stage, &mut TeacherPilot { limits: world.limits }, 32);
    println!("before {before:?}\nafter {after:?}\nblind {blind:?}\nteacher {teacher:?}");
    assert!(teacher.success >= 0.97, "{teacher:?}");
    // A network that knows nothing says 0: it drifts ahead at 0.2 m/s, which is slow enough to be counted where a cone stands ahead by chance.
    assert!(before.success < 0.7 && after.success >= 0.85, "{before:?} {after:?}");
    assert!(after.success > blind.success + 0.3, "{after:?} {blind:?}");
}

#[test]
fn a_round_has_the_same_bits_on_any_number_of_threads() {
    let map = Map::new(&plane(), &MapSettings::default()).unwrap();
    let (world, eye) = (World::new(map, Rig::default(), Limits::default()), SplatEye::new(&ground()));
    let stage = Stage::new(&world, &eye, LensSpread::wide());
    let settings =
        TrainSettings { rounds: 2, frames: 150, epochs: 1, last_epochs: 1, batch: 6, robots: 5, ..Default::default() };
    let learnt = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut student = Student::new(&settings).unwrap();
            let mut legs = Follower::new(&world.map, settings.robots, 0.3);
            for _ in 0..settings.rounds {
                student.round(&stage, &mut legs, &near_by(), &mut |_| {}).unwrap();
            }
            student.parameters
        })
    };
    let one = learnt(1);
    assert!(one == learnt(3) && one.iter().all(|x| x.is_finite()));
}
