//! A student learns to find cones in the yard of `fixtures/yard`, whose surfaces are sown with Gaussians, and says how often it does:
//! `learn_in_the_yard [ROUNDS] [DECISIONS A ROUND]`.

use qv_nav::dagger::{Student, TrainSettings};
use qv_nav::eye::SplatEye;
use qv_nav::legs::Follower;
use qv_nav::lens::LensSpread;
use qv_nav::map::{Map, MapSettings};
use qv_nav::pilots::{BlobPilot, NetPilot, TeacherPilot};
use qv_nav::roll::{Pilot, Stage, roll};
use qv_nav::score::Row;
use qv_nav::sight::Rig;
use qv_nav::task::{End, EpisodeSettings, Limits};
use qv_nav::teacher::World;
use std::time::Instant;
use yard::layout::mesh_with;
use yard::objects::CRATES;
use yard::{Yard, sow};

/// Height of a robot's base over the ground \[m\].
const HEIGHT: f64 = 0.3;
/// Distance between Gaussians \[m\].
const SOWN: f64 = 0.08;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let numbers: Vec<usize> = std::env::args().skip(1).map(|a| a.parse()).collect::<Result<_, _>>()?;
    let (rounds, frames) = (numbers.first().copied().unwrap_or(3), numbers.get(1).copied().unwrap_or(4000));
    let map = Map::new(&mesh_with(&CRATES), &MapSettings::default())?;
    let world = World::new(map, Rig::default(), Limits::default());
    println!("{} places for cones", world.candidates.len());
    let eye = SplatEye::new(&sow::cloud(&Yard::with_crates(&CRATES, Vec::new(), 1), SOWN));
    println!("{} Gaussians", eye.count());
    let stage = Stage { world: &world, eye: &eye, spread: LensSpread::wide() };
    let settings = TrainSettings { rounds, frames, ..Default::default() };
    let mut legs = Follower::new(&world.map, settings.robots, HEIGHT);
    let tests = EpisodeSettings::default().draw(&world, 96, 777)?;
    let show = |name: &str, pilot: &mut dyn Pilot, legs: &mut Follower| -> Result<(), qv_nav::NavError> {
        let clock = Instant::now();
        let trials: Vec<_> =
            roll(&stage, legs, &tests, pilot, |_| false, &mut |_| {})?.into_iter().map(|(trial, _)| trial).collect();
        let row = Row::of(&trials);
        let decisions: usize = trials.iter().map(|t| t.track.len()).sum();
        let seconds = clock.elapsed().as_secs_f64();
        let [low, high] = row.interval.map(|x| 100.0 * x);
        let ends: Vec<String> = End::ALL.iter().zip(row.ends).map(|(end, n)| format!("{} {n}", end.name())).collect();
        println!(
            "{name}: {:.1} % ({low:.1} to {high:.1}), SPL {:.2}, {}",
            100.0 * row.success,
            row.spl,
            ends.join(", ")
        );
        println!("    mean time {:.1} s; {decisions} decisions in {seconds:.0} s", row.time.unwrap_or(f64::NAN));
        Ok(())
    };
    show("teacher", &mut TeacherPilot { limits: world.limits }, &mut legs)?;
    show("blob", &mut BlobPilot { limits: world.limits }, &mut legs)?;
    let mut student = Student::new(&settings)?;
    let clock = Instant::now();
    for _ in 0..rounds {
        let told = student.round(&stage, &mut legs, &EpisodeSettings::default(), &mut |_| {})?;
        println!("{told:?} after {:.0} s", clock.elapsed().as_secs_f64());
        show("student", &mut NetPilot::new(&student.net, &student.parameters, settings.robots), &mut legs)?;
    }
    Ok(())
}
