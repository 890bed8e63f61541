//! A student of `learn_in_the_yard` on legs that walk: eye (sown Gaussians, or the yard's ray caster) by legs (a Go2 in the simulator, or in
//! the second engine with hidden effects), on the same episodes:
//! `walks_to_cones WEIGHTS.bin CHECKPOINT.bin [KEY=VALUE ...]`, where CHECKPOINT.bin is of `qv walk train`. Keys: `episodes`, `sown` (metres between
//! Gaussians), `rows` (some of `f`ollower, simulator `s`, simulator and ray caster `S`, second engine `r`, both `R`), `known` (a checkpoint of a
//! training that knew the hidden effects: one more row), `hidden` (other effects: NAME:VALUE,NAME:VALUE, or `no`), `simulator` (the same for
//! the simulator), `timestep` of the second engine \[s\], `out`.

mod yard_eye;
mod yard_legs;

use qv_go2::walk;
use qv_nav::eye::{Eye, FnEye, Shot, SplatEye};
use qv_nav::legs::{Follower, Legs};
use qv_nav::lens::LensSpread;
use qv_nav::map::{Map, MapSettings};
use qv_nav::net::Net;
use qv_nav::pilots::{NetPilot, TeacherPilot};
use qv_nav::roll::{Pilot, Stage, roll};
use qv_nav::score::{Row, compared};
use qv_nav::second::SecondWalkers;
use qv_nav::sight::Rig;
use qv_nav::task::{End, Episode, EpisodeSettings, Limits, Trial};
use qv_nav::teacher::World;
use qv_nav::weights;
use qv_sim::Terrain;
use qv_sim::rapier::RapierOptions;
use std::collections::BTreeMap;
use std::time::Instant;
use yard::layout::mesh_with;
use yard::objects::CRATES;
use yard::{Yard, sow};
use yard_legs::walking;

/// As in `learn_in_the_yard`.
const HEIGHT: f64 = 0.3;
const TESTED: u64 = 777;
/// Robots at once.
const ROBOTS: usize = 50;

/// What the robot of the second world has and no training knew of: late commands, weak motors, a heavier trunk, ground that slips.
const HIDDEN: [(&str, f64); 4] = [
    ("actuator.*.command_latency", 0.012),
    ("actuator.*.strength", 0.85),
    ("link.base.payload_mass", 1.0),
    ("material.*.friction", 0.5),
];

type Fallible<T> = Result<T, Box<dyn std::error::Error>>;

/// Those of [`HIDDEN`], or others.
fn effects(text: Option<&str>) -> Fallible<Vec<(String, f64)>> {
    let one = |part: &str| -> Fallible<(String, f64)> {
        let (name, value) = part.split_once(':').ok_or("hidden: expected NAME:VALUE")?;
        Ok((name.into(), value.parse()?))
    };
    match text {
        None => Ok(HIDDEN.iter().map(|(name, value)| ((*name).into(), *value)).collect()),
        Some("no") => Ok(Vec::new()),
        Some(list) => list.split(',').map(one).collect(),
    }
}

struct Bench<'a> {
    world: &'a World,
    episodes: Vec<Episode>,
    rows: Vec<(String, Vec<Trial>)>,
}

impl Bench<'_> {
    fn row(&mut self, name: &str, eye: &dyn Eye, legs: &mut dyn Legs, pilot: &mut dyn Pilot) -> Fallible<()> {
        let (stage, clock) = (Stage::new(self.world, eye, LensSpread::wide()), Instant::now());
        let rolled = roll(&stage, legs, &self.episodes, pilot, |_| false, &mut |_| {})?;
        let trials: Vec<Trial> = rolled.into_iter().map(|(trial, _)| trial).collect();
        let row = Row::of(&trials);
        let [low, high] = row.interval.map(|x| 100.0 * x);
        let p = self.rows.first().map_or(1.0, |(_, first)| compared(first, &trials));
        let ends: Vec<String> =
            End::ALL.iter().zip(row.ends).skip(1).map(|(end, n)| format!("{} {n}", end.name())).collect();
        let decisions: usize = trials.iter().map(|t| t.track.len()).sum();
        println!(
            "{name}: {:.1} % ({low:.1} to {high:.1}), SPL {:.2}, {:.1} s, p = {p:.4}; {}; {decisions} decisions in {:.0} s",
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
    let (mut plain, mut keys) = (Vec::new(), BTreeMap::new());
    for argument in std::env::args().skip(1) {
        match argument.split_once('=') {
            Some((key, value)) => drop(keys.insert(key.to_owned(), value.to_owned())),
            None => plain.push(argument),
        }
    }
    let [file, legs] = &plain[..] else { return Err("expected WEIGHTS.bin CHECKPOINT.bin [KEY=VALUE ...]".into()) };
    let key = |name: &str, usual: &str| keys.get(name).cloned().unwrap_or_else(|| usual.into());
    let (count, sown): (usize, f64) = (key("episodes", "200").parse()?, key("sown", "0.04").parse()?);
    let net = Net::default();
    let parameters = weights::from_bytes(&std::fs::read(file)?, &net)?;
    let mesh = mesh_with(&CRATES);
    let world = World::new(Map::new(&mesh, &MapSettings::default())?, Rig::default(), Limits::default());
    let yard = Yard::with_crates(&CRATES, Vec::new(), 1);
    let splat = SplatEye::new(&sow::cloud(&yard, sown));
    let rays = FnEye(|shot: &Shot| yard_eye::cast(&yard, shot));
    let (robot, terrain) = (walk::robot()?, Terrain::from_mesh(&mesh)?);
    let simulator = effects(Some(&key("simulator", "no")))?;
    let simulated = || yard_legs::simulated(&robot, walking(legs, &robot)?, (&world.map, &terrain), &simulator, ROBOTS);
    let hidden = effects(keys.get("hidden").map(String::as_str))?;
    let timestep: f64 = key("timestep", "0.002").parse()?;
    let second = |legs: &str| -> Fallible<SecondWalkers> {
        let options = RapierOptions { timestep, ..Default::default() };
        let (policy, clock) = walking(legs, &robot)?;
        Ok(SecondWalkers::new(&robot, policy, (&terrain, &options), &hidden, ROBOTS)?.with_clock(clock))
    };
    println!("{count} episodes of seed {TESTED}; hidden effects of the second world: {hidden:?}");
    let episodes = EpisodeSettings::default().draw(&world, count, TESTED)?;
    let mut bench = Bench { world: &world, episodes, rows: Vec::new() };
    let student = || NetPilot::new(&net, &parameters, ROBOTS);
    let mut teacher = TeacherPilot { limits: world.limits };
    for row in key("rows", "fsStrR").chars() {
        match row {
            'f' => {
                let mut legs = Follower::new(&world.map, ROBOTS, HEIGHT);
                bench.row("student, Gaussians, follower", &splat, &mut legs, &mut student())?;
            }
            's' => bench.row("student, Gaussians, simulator", &splat, &mut simulated()?, &mut student())?,
            'S' => bench.row("student, ray caster, simulator", &rays, &mut simulated()?, &mut student())?,
            't' => {
                let eye = qv_nav::eye::BlindEye;
                bench.row("teacher, simulator", &eye, &mut simulated()?, &mut teacher)?;
                bench.row("teacher, second engine", &eye, &mut second(legs)?, &mut teacher)?;
            }
            'r' => bench.row("student, Gaussians, second engine", &splat, &mut second(legs)?, &mut student())?,
            'R' => bench.row("student, ray caster, second engine", &rays, &mut second(legs)?, &mut student())?,
            other => return Err(format!("rows: expected some of fsStrR, found {other}").into()),
        }
    }
    if let Some(known) = keys.get("known") {
        let name = "student, ray caster, second engine, legs that knew its effects";
        bench.row(name, &rays, &mut second(known)?, &mut student())?;
    }
    if let Some(out) = keys.get("out") {
        let row = |(name, trials): &(String, Vec<Trial>)| serde_json::json!({"name": name, "row": Row::of(trials), "trials": trials});
        let rows: Vec<_> = bench.rows.iter().map(row).collect();
        std::fs::write(out, serde_json::to_vec(&serde_json::json!({"seed": TESTED, "rows": rows}))?)?;
    }
    Ok(())
}
