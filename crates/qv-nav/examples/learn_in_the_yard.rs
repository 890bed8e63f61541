//! A student learns to find cones in the yard of `fixtures/yard`, and says how often it does: `learn_in_the_yard [KEY=VALUE ...]`. Keys:
//!
//! - those of `TrainSettings` (numbers) and of `Paints`; `test` (episodes), `every` (rounds from one test to the next);
//! - `scene=FILE,FILE`: reconstructions of the yard with boxes; `sown=[0.03,0.06]` or one number: its true surface, sown with Gaussians so many
//!   metres apart (0.06 where neither is given). Each episode has one of all, evenly; tests have the first;
//! - `eye=bare`: the collision geometry in flat colours instead, a training without a reconstruction;
//! - `legs=ideal`: legs that do at once what they are reported, a training without the residual; `legs=CHECKPOINT.bin`: a Go2 that walks in the
//!   simulator by what `qv walk train` wrote, and `simulator=NAME:VALUE,...` are corrections of it;
//! - `latency`, `strength`, `slip`: bounds of the [`Effects`] that legs suffer in training;
//! - `camera`: `wide`, `none`, or the report.json of a diagnosis;
//! - `within`: a time \[s\], and the number of rounds is as many as fit;
//! - `learn=trials` (with `from`): from its own trials, `policy={"deviation":[0.2,0.05]}` says how;
//! - `from`: the weights.bin of an earlier training to go on from; `out`: a directory for weights.bin, made if need be;
//! - `gpu=N` (feature `gpu`): draws and learns on adapter `N`; `gpu=N learner=cpu` only draws on it.
//!
//! All settings are printed.

mod yard_legs;
mod yard_scene;

use qv_go2::walk;
use qv_nav::bare::Bare;
use qv_nav::dagger::{Student, TrainSettings};
use qv_nav::eye::{Eye, Paints, Several, SplatEye};
use qv_nav::fit::Fit;
use qv_nav::legs::{Effects, Follower, Legs, Response};
use qv_nav::lens::LensSpread;
use qv_nav::map::{Map, MapSettings};
use qv_nav::pilots::{BlobPilot, NetPilot, TeacherPilot};
use qv_nav::recall::Drift;
use qv_nav::reflex::Reflex;
use qv_nav::roll::{Pilot, Record, Stage, roll};
use qv_nav::score::Row;
use qv_nav::sight::Rig;
use qv_nav::task::{End, Episode, EpisodeSettings, Limits};
use qv_nav::teacher::World;
use qv_nav::{measured, weights};
use qv_sim::Terrain;
use std::path::PathBuf;
use std::time::Instant;
use yard::layout::mesh_with;
use yard::objects::CRATES;
use yard::{Yard, sow};
use yard_scene::Place;

/// Height of a robot's base over the ground \[m\].
const HEIGHT: f64 = 0.3;
/// Seeds of the episodes that are tested, and of those whose fit is reported: no training draws from them.
const TESTED: u64 = 777;
const HELD_OUT: u64 = 778;

type Fallible<T> = Result<T, Box<dyn std::error::Error>>;

struct Options {
    settings: TrainSettings,
    test: usize,
    every: usize,
    out: Option<PathBuf>,
    from: Option<PathBuf>,
    paints: Paints,
    sown: Vec<f64>,
    scenes: Vec<PathBuf>,
    is_bare: bool,
    response: Response,
    effects: Effects,
    walking: Option<String>,
    simulator: Vec<(String, f64)>,
    camera: String,
    within: Option<f64>,
    gpu: Option<usize>,
    learns_on_card: bool,
}

impl Options {
    fn of(arguments: impl Iterator<Item = String>) -> Fallible<Self> {
        let arguments: Vec<String> = arguments.collect();
        let by_trials = arguments.iter().any(|argument| argument == "learn=trials");
        let usual = if by_trials { TrainSettings::tuning() } else { TrainSettings::default() };
        let mut settings = serde_json::to_value(usual)?;
        let mut paints = serde_json::to_value(Paints::default())?;
        let (mut test, mut every, mut out, mut from) = (96, 1, None, None);
        let (mut sown, mut scenes) = (None, Vec::new());
        let mut effects = serde_json::to_value(Effects::default())?;
        let (mut is_bare, mut response, mut camera) = (false, Response::default(), "wide".to_string());
        let (mut within, mut gpu, mut learns_on_card) = (None, None, true);
        let (mut walking, mut simulator) = (None, Vec::new());
        for argument in arguments {
            let (key, value) = argument.split_once('=').ok_or_else(|| format!("{argument}: expected KEY=VALUE"))?;
            match key {
                "test" => test = value.parse()?,
                "sown" if value.starts_with('[') => sown = Some(serde_json::from_str(value)?),
                "sown" => sown = Some(vec![value.parse()?]),
                "every" => every = value.parse()?,
                "scene" => scenes = value.split(',').map(PathBuf::from).collect(),
                "from" => from = Some(PathBuf::from(value)),
                "out" => out = Some(PathBuf::from(value)),
                "eye" => is_bare = one_of(key, value, [("splat", false), ("bare", true)])?,
                "learn" => drop(one_of(key, value, [("trials", ()), ("teacher", ())])?),
                "legs" if value.ends_with(".bin") => walking = Some(value.into()),
                "legs" => {
                    response = one_of(key, value, [("known", Response::default()), ("ideal", Response::ideal())])?
                }
                "simulator" => simulator = value.split(',').map(named).collect::<Fallible<_>>()?,
                "camera" => camera = value.into(),
                "within" => within = Some(value.parse()?),
                "gpu" => gpu = Some(value.parse()?),
                "learner" => learns_on_card = one_of(key, value, [("cpu", false), ("card", true)])?,
                "latency" | "strength" | "slip" => effects[key] = serde_json::from_str(value)?,
                "count" | "grain" | "tint" => paints[key] = serde_json::from_str(value)?,
                _ => settings[key] = serde_json::from_str(value)?,
            }
        }
        if is_bare && !scenes.is_empty() {
            return Err("scene: expected none with eye=bare, which draws no reconstruction".into());
        }
        let sown = sown.unwrap_or(if scenes.is_empty() { vec![0.06] } else { Vec::new() });
        let paints = serde_json::from_value(paints)?;
        Ok(Self {
            settings: serde_json::from_value(settings)?,
            test,
            every,
            out,
            from,
            paints,
            sown,
            scenes,
            is_bare,
            response,
            effects: serde_json::from_value(effects)?,
            walking,
            simulator,
            camera,
            within,
            gpu,
            learns_on_card,
        })
    }

    /// How cameras differ, and how they sit.
    fn spread(&self) -> Fallible<(LensSpread, Rig)> {
        Ok(match self.camera.as_str() {
            "wide" => (LensSpread::wide(), Rig::default()),
            "none" => (LensSpread::none(), Rig::default()),
            file => measured::camera(&serde_json::from_slice(&std::fs::read(file)?)?, &Rig::default())?,
        })
    }

    /// Eyes that are learnt from, and that of the tests: the first one with its first paint alone.
    fn eyes(&self, map: &Map) -> Fallible<(Vec<SplatEye>, SplatEye)> {
        let seed = self.settings.seed;
        if self.is_bare {
            let first = *self.sown.first().ok_or("sown: expected at least one distance, found none")?;
            let bare = |paints, spacing| SplatEye::bare(&mesh_with(&CRATES), &Bare { spacing, paints }, seed);
            let eyes = self.sown.iter().map(|&sown| bare(self.paints.count, sown)).collect::<Result<_, _>>()?;
            return Ok((eyes, bare(1, first)?));
        }
        let yard = Yard::with_crates(&CRATES, Vec::new(), 1);
        let scenes = self.scenes.iter().map(|file| Place::read(file, map));
        let sown = self.sown.iter().map(|&sown| Ok(Place::sown(sow::cloud(&yard, sown))));
        let places: Vec<Place> = scenes.chain(sown).collect::<Fallible<_>>()?;
        let first = places.first().ok_or("expected a distance of sown or a scene, found neither")?;
        let painted = |place: &Place| place.eye(|cloud| SplatEye::painted(cloud, &self.paints, seed));
        Ok((places.iter().map(painted).collect(), first.eye(SplatEye::new)))
    }
}

#[cfg(feature = "gpu")]
fn gpu(adapter: usize) -> Fallible<qv_nav::card::Gpu> {
    Ok(qv_nav::card::Gpu::new(&qv_nav::card::GpuOptions { adapter: Some(adapter), ..Default::default() })?)
}

/// The same eye on the card that was asked for, if any.
fn placed(eye: SplatEye, options: &Options) -> Fallible<Box<dyn Eye>> {
    match options.gpu {
        None => Ok(Box::new(eye)),
        #[cfg(feature = "gpu")]
        Some(adapter) => {
            let eye = qv_nav::card::GpuEye::new(&eye, gpu(adapter)?)?;
            println!("pictures on {}, {} Gaussians there", eye.adapter(), eye.count());
            Ok(Box::new(eye))
        }
        #[cfg(not(feature = "gpu"))]
        Some(_) => Err(WITHOUT_GPU.into()),
    }
}

#[cfg(not(feature = "gpu"))]
const WITHOUT_GPU: &str = "gpu: expected a build with the feature gpu, found one without";

/// A student that learns on the card, if that was asked for.
fn student(options: &Options) -> Fallible<Student> {
    let student = Student::new(&options.settings)?;
    match options.gpu.filter(|_| options.learns_on_card) {
        None => Ok(student),
        #[cfg(feature = "gpu")]
        Some(adapter) => Ok(student.on_card(gpu(adapter)?)?),
        #[cfg(not(feature = "gpu"))]
        Some(_) => Err(WITHOUT_GPU.into()),
    }
}

/// A parameter and its value, of NAME:VALUE.
fn named(text: &str) -> Fallible<(String, f64)> {
    let (name, value) = text.split_once(':').ok_or_else(|| format!("simulator: expected NAME:VALUE, found {text}"))?;
    Ok((name.into(), value.parse()?))
}

/// Legs that the options ask for.
fn legs<'a>(options: &Options, world: &'a World) -> Fallible<Box<dyn Legs + 'a>> {
    let count = options.settings.robots;
    let Some(file) = &options.walking else {
        let follower = Follower::new(&world.map, count, HEIGHT).responding(options.response)?;
        return Ok(Box::new(follower.suffering(options.effects)?));
    };
    let robot = walk::robot()?;
    let terrain = Terrain::from_mesh(&mesh_with(&CRATES))?;
    let policy = yard_legs::walking(file, &robot)?;
    Ok(Box::new(yard_legs::simulated(&robot, policy, (&world.map, &terrain), &options.simulator, count)?))
}

/// What a word of two stands for.
fn one_of<T>(key: &str, word: &str, words: [(&str, T); 2]) -> Fallible<T> {
    let names = words.each_ref().map(|(name, _)| *name);
    let found = words.into_iter().find(|(name, _)| *name == word);
    Ok(found.ok_or_else(|| format!("{key}: expected {}, found {word}", names.join(" or ")))?.1)
}

fn main() -> Fallible<()> {
    let options = Options::of(std::env::args().skip(1))?;
    let settings = &options.settings;
    println!("{}", serde_json::to_string(settings)?);
    let eye_is = if options.is_bare { "bare" } else { "splat" };
    let walks = options.walking.as_deref().unwrap_or("no");
    println!("eye {eye_is}, {:?}, {:?}, walks {walks}, camera {}", options.response, options.effects, options.camera);
    let map = Map::new(&mesh_with(&CRATES), &MapSettings::default())?;
    let (spread, rig) = options.spread()?;
    let world = World::new(map, rig, Limits::default());
    println!("{:?}", world.teacher);
    let (eyes, plain) = options.eyes(&world.map)?;
    let counts: Vec<usize> = eyes.iter().map(SplatEye::count).collect();
    println!("{counts:?} Gaussians, {} places for cones", world.candidates.len());
    let eyes = eyes.into_iter().map(|eye| placed(eye, &options)).collect::<Fallible<_>>()?;
    let (eye, plain) = (Several(eyes), placed(plain, &options)?);
    let drift = Drift::default();
    let stage = Stage { world: &world, eye: &eye, spread, drift, reflex: Reflex::default() };
    let tested = Stage { eye: &*plain, ..Stage::new(&world, &*plain, spread) };
    let mut legs = legs(&options, &world)?;
    let legs = &mut *legs;
    let tests = EpisodeSettings::default().draw(&world, options.test, TESTED)?;
    let limits = world.limits;
    show(&tested, "teacher", &mut TeacherPilot { limits }, legs, &tests)?;
    show(&tested, "blob", &mut BlobPilot { limits }, legs, &tests)?;
    let held = EpisodeSettings::default().draw(&world, 24, HELD_OUT)?;
    let held = roll(&tested, legs, &held, &mut TeacherPilot { limits }, |_| true, &mut |_| {})?;
    let held: Vec<Record> = held.into_iter().map(|(_, record)| record).collect();
    let mut student = student(&options)?;
    if let Some(from) = &options.from {
        student.start_from(weights::from_bytes(&std::fs::read(from)?, &student.net)?)?;
    }
    let (clock, mut round) = (Instant::now(), 0);
    while round < student.rounds_in_all() {
        round += 1;
        let (mut driven, began) = (None, Instant::now());
        let result = student.round(&stage, legs, &EpisodeSettings::default(), &mut |p| {
            if p.loss.is_nan() {
                driven = Some(began.elapsed().as_secs_f64());
            }
        })?;
        let seconds = (driven.unwrap_or(0.0), began.elapsed().as_secs_f64());
        println!(
            "{result:?}; drove {:.0} of {:.0} s; {:.0} s in all",
            seconds.0,
            seconds.1,
            clock.elapsed().as_secs_f64()
        );
        if let Some(within) = options.within {
            // The last rounds say best how long one takes.
            let left = (within - clock.elapsed().as_secs_f64()) / began.elapsed().as_secs_f64();
            student.end_after(round + left.floor().max(0.0) as usize);
        }
        println!("    {:.3?}", Fit::of(&student.net, &student.parameters, &held));
        if round % options.every == 0 || round == student.rounds_in_all() {
            let mut pilot = NetPilot::new(&student.net, &student.parameters, settings.robots);
            show(&tested, "student", &mut pilot, legs, &tests)?;
        }
        if let Some(out) = &options.out {
            std::fs::create_dir_all(out)?;
            let (file, whole) = (out.join("weights.part"), out.join("weights.bin"));
            std::fs::write(&file, weights::to_bytes(&student.parameters))?;
            std::fs::rename(file, whole)?;
        }
    }
    Ok(())
}

fn show(stage: &Stage, name: &str, pilot: &mut dyn Pilot, legs: &mut dyn Legs, tests: &[Episode]) -> Fallible<()> {
    let clock = Instant::now();
    let trials: Vec<_> =
        roll(stage, legs, tests, pilot, |_| false, &mut |_| {})?.into_iter().map(|(trial, _)| trial).collect();
    let row = Row::of(&trials);
    let decisions: usize = trials.iter().map(|t| t.track.len()).sum();
    let [low, high] = row.interval.map(|x| 100.0 * x);
    let ends: Vec<String> = End::ALL.iter().zip(row.ends).map(|(end, n)| format!("{} {n}", end.name())).collect();
    println!("{name}: {:.1} % ({low:.1} to {high:.1}), SPL {:.2}, {}", 100.0 * row.success, row.spl, ends.join(", "));
    let seconds = clock.elapsed().as_secs_f64();
    println!("    mean time {:.1} s; {decisions} decisions in {seconds:.0} s", row.time.unwrap_or(f64::NAN));
    Ok(())
}
