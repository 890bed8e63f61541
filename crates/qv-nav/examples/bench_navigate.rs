//! What navigation costs, for `cargo xtask bench navigate`: `bench_navigate [SCALE] [ADAPTER]` prints one line of JSON. Rates are for each CPU second
//! of all threads; those of a graphics card, with the feature `gpu` and the number of an adapter, for each second. `SCALE` shortens all parts
//! (1 = about a minute).

use cpu_time::ProcessTime;
use qv_nav::dagger::{Student, TrainSettings};
use qv_nav::eye::{BlindEye, Eye, Shot, SplatEye};
use qv_nav::legs::Follower;
use qv_nav::lens::LensSpread;
use qv_nav::map::{Map, MapSettings};
use qv_nav::pilots::{NetPilot, TeacherPilot};
use qv_nav::roll::{Pilot, Record, Stage, roll};
use qv_nav::sight::Rig;
use qv_nav::task::{Episode, EpisodeSettings, Limits};
use qv_nav::teacher::World;
use serde_json::{Value, json};
use std::error::Error;
use yard::layout::mesh_with;
use yard::objects::CRATES;
use yard::{Yard, sow};

/// Robots at once, and height of a base over the ground \[m\].
const ROBOTS: usize = 32;
const HEIGHT: f64 = 0.3;
/// Distances between Gaussians \[m\].
const SOWN: [f64; 2] = [0.06, 0.04];

fn main() -> Result<(), Box<dyn Error>> {
    let scale: f64 = std::env::args().nth(1).map_or(Ok(1.0), |text| text.parse())?;
    if !(0.01..=100.0).contains(&scale) {
        return Err(format!("SCALE: expected 0.01 to 100, found {scale}").into());
    }
    let many = |count: f64| (count * scale).ceil() as usize;
    let world = World::new(Map::new(&mesh_with(&CRATES), &MapSettings::default())?, Rig::default(), Limits::default());
    let yard = Yard::with_crates(&CRATES, Vec::new(), 1);
    let episodes = EpisodeSettings::default().draw(&world, many(64.0), 5)?;
    let eyes = SOWN.map(|spacing| SplatEye::new(&sow::cloud(&yard, spacing)));
    let images: Vec<Value> = eyes.iter().map(|eye| drawn(&world, eye, &episodes)).collect::<Result<_, _>>()?;
    let net = Student::new(&TrainSettings::default())?;
    let limits = world.limits;
    let blind = Stage::new(&world, &BlindEye, LensSpread::wide());
    let seeing = Stage { eye: &eyes[0], ..Stage::new(&world, &BlindEye, LensSpread::wide()) };
    let (teacher, records) = driven(&blind, &episodes, &mut TeacherPilot { limits })?;
    let (student, _) = driven(&seeing, &episodes, &mut NetPilot::new(&net.net, &net.parameters, ROBOTS))?;
    let mut learner = Student::new(&TrainSettings::default())?;
    let decisions: usize = records.iter().map(Record::len).sum();
    learner.add(records.iter().cloned());
    let clock = ProcessTime::now();
    learner.epoch(0)?;
    let learnt = decisions as f64 / clock.elapsed().as_secs_f64();
    let card = match std::env::args().nth(2) {
        Some(adapter) => on_card(adapter.parse()?, &world, &eyes[1], &episodes, records)?,
        None => Value::Null,
    };
    let line = json!({
        "card": card,
        "images": images,
        "decisions_driven_by_the_teacher_without_pictures": teacher,
        "decisions_driven_by_the_student": student,
        "decisions_learnt": learnt,
    });
    println!("{line}");
    Ok(())
}

/// What is seen from the starts of episodes.
fn shots(world: &World, episodes: &[Episode]) -> Vec<Shot> {
    let shot = |e: &Episode| {
        let base = qv_core::Pose::from_xyz_rpy([e.start[0], e.start[1], HEIGHT], [0.0, 0.0, e.yaw]);
        let cones = std::iter::once(e.goal).chain(e.others.iter().copied()).collect();
        Shot { camera: world.rig.camera(&base), cones, seed: e.seed }
    };
    episodes.iter().map(shot).collect()
}

/// Pictures a CPU second, from the starts of episodes.
fn drawn(world: &World, eye: &SplatEye, episodes: &[Episode]) -> Result<Value, Box<dyn Error>> {
    let shots: Vec<Shot> = shots(world, episodes).into_iter().flat_map(|shot| std::iter::repeat_n(shot, 8)).collect();
    let clock = ProcessTime::now();
    let images = eye.look(&shots)?;
    Ok(json!({"gaussians": eye.count(), "each_cpu_second": images.len() as f64 / clock.elapsed().as_secs_f64()}))
}

/// Decisions a CPU second, and what was recorded.
fn driven(stage: &Stage, episodes: &[Episode], pilot: &mut dyn Pilot) -> Result<(f64, Vec<Record>), Box<dyn Error>> {
    let mut legs = Follower::new(&stage.world.map, ROBOTS, HEIGHT);
    let clock = ProcessTime::now();
    let rolled = roll(stage, &mut legs, episodes, pilot, |_| true, &mut |_| {})?;
    let seconds = clock.elapsed().as_secs_f64();
    let decisions: usize = rolled.iter().map(|(trial, _)| trial.track.len()).sum();
    Ok((decisions as f64 / seconds, rolled.into_iter().map(|(_, record)| record).collect()))
}

/// Pictures and decisions learnt, each second of the clock, on a graphics card.
#[cfg(feature = "gpu")]
fn on_card(
    adapter: usize,
    world: &World,
    eye: &SplatEye,
    episodes: &[Episode],
    records: Vec<Record>,
) -> Result<Value, Box<dyn Error>> {
    use qv_nav::card::{Gpu, GpuEye, GpuOptions};
    let gpu = || Gpu::new(&GpuOptions { adapter: Some(adapter), ..Default::default() });
    let eye = GpuEye::new(eye, gpu()?)?;
    let shots: Vec<Shot> = shots(world, episodes).into_iter().cycle().take(ON_CARD).collect();
    let pictures = best(|| Ok(eye.look(&shots)?.len()))?;
    let decisions: usize = records.iter().map(Record::len).sum();
    let mut learner = Student::new(&TrainSettings::default())?.on_card(gpu()?)?;
    learner.add(records);
    let learnt = best(|| Ok(learner.epoch(0).map(|_| decisions)?))?;
    Ok(json!({"adapter": eye.adapter(), "images_each_second": pictures, "decisions_learnt_each_second": learnt}))
}

/// Robots whose pictures are drawn at once on a card.
#[cfg(feature = "gpu")]
const ON_CARD: usize = 192;

/// Things done each second of the clock: the best of five times, after one that does not count.
#[cfg(feature = "gpu")]
fn best(mut work: impl FnMut() -> Result<usize, Box<dyn Error>>) -> Result<f64, Box<dyn Error>> {
    work()?;
    let mut best: f64 = 0.0;
    for _ in 0..5 {
        let clock = std::time::Instant::now();
        best = best.max(work()? as f64 / clock.elapsed().as_secs_f64());
    }
    Ok(best)
}

#[cfg(not(feature = "gpu"))]
fn on_card(_: usize, _: &World, _: &SplatEye, _: &[Episode], _: Vec<Record>) -> Result<Value, Box<dyn Error>> {
    Err("ADAPTER: expected a build with the feature gpu, found one without".into())
}
