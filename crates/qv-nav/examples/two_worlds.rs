//! A student of `learn_in_the_yard` in two worlds, on the same episodes: eye (Gaussians, or the yard's ray caster) by legs (those it was trained
//! on, or weaker, later and slipping ones): `two_worlds WEIGHTS.bin [EPISODES [SOWN [RESULTS.json]]] [NAME=VALUE ...]`. `SOWN` is the distance
//! between Gaussians \[m\]. Names:
//!
//! - `scene=SCENE.ply`: a reconstruction of the yard with boxes is shown instead of sown Gaussians;
//! - `camera=REPORT.json`: the camera of a report of `qv diagnose --scene` instead of any wide one;
//! - `gpu=N`: Gaussians are drawn on adapter `N` (feature `gpu`);
//! - any other name is a student and its weights, such as of a training that lacks a part. All are tested beside the first one where something is
//!   unknown; p is against the first one in the same world.

mod yard_eye;
mod yard_scene;

use glam::DVec2;
use qv_core::Pose;
use qv_nav::eye::{BlindEye, Eye, FnEye, Shot, SplatEye};
use qv_nav::legs::{Effects, Follower};
use qv_nav::lens::LensSpread;
use qv_nav::map::{Map, MapSettings};
use qv_nav::net::Net;
use qv_nav::pilots::{BlobPilot, NetPilot, TeacherPilot};
use qv_nav::recall::Drift;
use qv_nav::reflex::Reflex;
use qv_nav::roll::{Pilot, Stage, roll};
use qv_nav::score::{Row, compared};
use qv_nav::sight::Rig;
use qv_nav::task::{End, Episode, EpisodeSettings, Limits, Trial};
use qv_nav::teacher::World;
use qv_nav::{measured, weights};
use std::path::PathBuf;
use std::time::Instant;
use yard::layout::mesh_with;
use yard::objects::CRATES;
use yard::{Yard, sow};
use yard_scene::Place;

/// As in `learn_in_the_yard`.
const HEIGHT: f64 = 0.3;
const TESTED: u64 = 777;
/// Names that are no student.
const OPTIONS: [&str; 3] = ["scene", "camera", "gpu"];
/// Robots at once.
const ROBOTS: usize = 100;

type Fallible<T> = Result<T, Box<dyn std::error::Error>>;

struct Bench<'a> {
    world: &'a World,
    spread: LensSpread,
    reflex: Reflex,
    episodes: Vec<Episode>,
    rows: Vec<(String, Vec<Trial>)>,
}

impl Bench<'_> {
    /// A row of the table, beside the first of all.
    fn row(&mut self, name: &str, eye: &dyn Eye, effects: Effects, pilot: &mut dyn Pilot) -> Fallible<()> {
        self.beside(0, name, eye, effects, pilot)
    }

    /// A row beside another one.
    fn beside(
        &mut self,
        first: usize,
        name: &str,
        eye: &dyn Eye,
        effects: Effects,
        pilot: &mut dyn Pilot,
    ) -> Fallible<()> {
        let (stage, clock) = (
            Stage { world: self.world, eye, spread: self.spread, drift: Drift::default(), reflex: self.reflex },
            Instant::now(),
        );
        let mut legs = Follower::with_effects(&self.world.map, ROBOTS, HEIGHT, effects)?;
        let rolled = roll(&stage, &mut legs, &self.episodes, pilot, |_| false, &mut |_| {})?;
        let trials: Vec<Trial> = rolled.into_iter().map(|(trial, _)| trial).collect();
        let row = Row::of(&trials);
        let [low, high] = row.interval.map(|x| 100.0 * x);
        let p = self.rows.get(first).map_or(1.0, |(_, first)| compared(first, &trials));
        let ends: Vec<String> =
            End::ALL.iter().zip(row.ends).skip(1).map(|(end, n)| format!("{} {n}", end.name())).collect();
        println!(
            "{name}: {:.1} % ({low:.1} to {high:.1}), SPL {:.2}, {:.1} s, p = {p:.4}; {}; took {:.0} s",
            100.0 * row.success,
            row.spl,
            row.time.unwrap_or(f64::NAN),
            ends.join(", "),
            clock.elapsed().as_secs_f64()
        );
        self.rows.push((name.into(), trials));
        Ok(())
    }
}

fn main() -> Fallible<()> {
    let (named, plain): (Vec<String>, Vec<String>) = std::env::args().skip(1).partition(|a| a.contains('='));
    let file = plain.first().ok_or("expected WEIGHTS.bin [EPISODES [SOWN [RESULTS.json]]] [NAME=VALUE ...]")?;
    let count = plain.get(1).map_or(Ok(200), |a| a.parse())?;
    let sown = plain.get(2).map_or(Ok(0.06), |a| a.parse())?;
    let net = Net::default();
    let parameters = read(file, &net)?;
    let map = Map::new(&mesh_with(&CRATES), &MapSettings::default())?;
    let named: Vec<(&str, &str)> = named.iter().filter_map(|argument| argument.split_once('=')).collect();
    if let Some((_, (name, _))) = named.iter().enumerate().find(|(k, one)| named[..*k].iter().any(|o| o.0 == one.0)) {
        return Err(format!("{name}: expected one value for a name, found two").into());
    }
    let value = |name: &str| named.iter().find(|(known, _)| *known == name).map(|(_, value)| *value);
    let (spread, rig) = match value("camera") {
        None => (LensSpread::wide(), Rig::default()),
        Some(file) => measured::camera(&serde_json::from_slice(&std::fs::read(file)?)?, &Rig::default())?,
    };
    let world = World::new(map, rig, Limits::default());
    let yard = Yard::with_crates(&CRATES, Vec::new(), 1);
    let (place, own) = match value("scene") {
        Some(file) => (Place::read(file.as_ref(), &world.map)?, "reconstruction"),
        None => (Place::sown(sow::cloud(&yard, sown)), "sown Gaussians"),
    };
    let splat = placed(place.eye(SplatEye::new), value("gpu"))?;
    let rays = FnEye(|shot: &Shot| yard_eye::cast(&yard, shot));
    let (known, hidden, limits) = (Effects::default(), Effects::hidden(), world.limits);
    println!("{count} episodes of seed {TESTED}; hidden effects of the legs: {hidden:?}");
    let episodes = EpisodeSettings::default().draw(&world, count, TESTED)?;
    println!(
        "pictures of both eyes at the starts of the episodes: PSNR {:.2} dB",
        apart(&world, &*splat, &rays, &episodes)?
    );
    let mut bench = Bench { world: &world, spread, reflex: Reflex::default(), episodes, rows: Vec::new() };
    let worlds: [(&str, &dyn Eye, Effects); 4] = [
        ("ray caster, hidden effects", &rays, hidden),
        (&format!("{own}, hidden effects"), &*splat, hidden),
        ("ray caster, legs of training", &rays, known),
        (&format!("{own}, legs of training"), &*splat, known),
    ];
    let others = others(&named, &net)?;
    if others.is_empty() {
        one_student(&mut bench, &worlds, &mut NetPilot::new(&net, &parameters, ROBOTS), limits)?;
    } else {
        for (world, eye, effects) in worlds {
            let first = bench.rows.len();
            for (name, parameters) in
                std::iter::once(("first", &parameters)).chain(others.iter().map(|(n, p)| (n.as_str(), p)))
            {
                let mut pilot = NetPilot::new(&net, parameters, ROBOTS);
                bench.beside(first, &format!("{name}: {world}"), eye, effects, &mut pilot)?;
            }
        }
    }
    if let Some(out) = plain.get(3).map(PathBuf::from) {
        let rows: Vec<_> = bench
            .rows
            .iter()
            .map(|(name, trials)| serde_json::json!({"name": name, "row": Row::of(trials), "trials": trials}))
            .collect();
        let results = serde_json::json!({"seed": TESTED, "episodes": bench.episodes, "rows": rows});
        let part = out.with_extension("part");
        std::fs::write(&part, serde_json::to_vec(&results)?)?;
        std::fs::rename(part, out)?;
    }
    Ok(())
}

/// How far the pictures of two eyes are from each other where episodes start: the peak signal-to-noise ratio \[dB\].
fn apart(world: &World, a: &dyn Eye, b: &dyn Eye, episodes: &[Episode]) -> Fallible<f64> {
    let shot = |episode: &Episode| {
        let place = DVec2::from(episode.start);
        let ground = world.map.height(place).unwrap_or(0.0);
        let base = Pose::from_xyz_rpy([place.x, place.y, ground + HEIGHT], [0.0, 0.0, episode.yaw]);
        let cones = std::iter::once(&episode.goal).chain(&episode.others).copied().collect();
        Shot { camera: world.rig.camera(&base), cones, seed: episode.seed }
    };
    let shots: Vec<Shot> = episodes.iter().map(shot).collect();
    let (a, b) = (a.look(&shots)?.concat(), b.look(&shots)?.concat());
    let squares: f64 = a.iter().zip(&b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    Ok(-10.0 * (squares / a.len() as f64).log10())
}

/// The eye on an adapter, if one is named.
#[cfg(feature = "gpu")]
fn placed(eye: SplatEye, adapter: Option<&str>) -> Fallible<Box<dyn Eye>> {
    use qv_nav::card::{Gpu, GpuEye, GpuOptions};
    let Some(adapter) = adapter else { return Ok(Box::new(eye)) };
    let options = GpuOptions { adapter: Some(adapter.parse()?), ..Default::default() };
    Ok(Box::new(GpuEye::new(&eye, Gpu::new(&options)?)?))
}

#[cfg(not(feature = "gpu"))]
fn placed(eye: SplatEye, adapter: Option<&str>) -> Fallible<Box<dyn Eye>> {
    match adapter {
        None => Ok(Box::new(eye)),
        Some(_) => Err("gpu: expected a build with the feature gpu, found one without".into()),
    }
}

/// The weights of a file.
fn read(file: &str, net: &Net) -> Fallible<Vec<f32>> {
    let bytes = std::fs::read(file).map_err(|e| format!("{file}: expected weights, found {e}"))?;
    Ok(weights::from_bytes(&bytes, net).map_err(|e| format!("{file}: {e}"))?)
}

/// Students by name.
fn others(named: &[(&str, &str)], net: &Net) -> Fallible<Vec<(String, Vec<f32>)>> {
    let students = named.iter().filter(|(name, _)| !OPTIONS.contains(name));
    students.map(|(name, file)| Ok(((*name).into(), read(file, net)?))).collect()
}

/// One student in all worlds, and who needs no network.
fn one_student(
    bench: &mut Bench,
    worlds: &[(&str, &dyn Eye, Effects); 4],
    student: &mut NetPilot,
    limits: Limits,
) -> Fallible<()> {
    let (own, known, hidden) = (worlds[3].1, worlds[3].2, worlds[0].2);
    for at in [3, 1, 2, 0] {
        let (world, eye, effects) = worlds[at];
        bench.row(&format!("student, {world}"), eye, effects, student)?;
    }
    bench.reflex = Reflex::none();
    bench.row(&format!("student without its reflex, {}", worlds[3].0), own, known, student)?;
    bench.reflex = Reflex::default();
    bench.row("student whose picture is grey", &BlindEye, known, student)?;
    bench.row("teacher, legs of training", &BlindEye, known, &mut TeacherPilot { limits })?;
    bench.row("teacher, hidden effects", &BlindEye, hidden, &mut TeacherPilot { limits })?;
    bench.row(&format!("blob follower, {}", worlds[3].0), own, known, &mut BlobPilot { limits })
}
