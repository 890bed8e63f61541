//! A round of training in an open place. That a student learns, the golden of the pipeline's stage `navigate` says.

use glam::DVec3;
use qv_core::{GaussianCloud, TriangleMesh};
use qv_nav::dagger::{Student, TrainSettings};
use qv_nav::eye::SplatEye;
use qv_nav::legs::Follower;
use qv_nav::lens::LensSpread;
use qv_nav::map::{Map, MapSettings};
use qv_nav::roll::Stage;
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
