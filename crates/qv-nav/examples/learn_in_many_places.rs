//! A student learns in many drawn places within a time, and is examined in others: `learn_in_many_places [KEY=VALUE ...]`. Keys:
//!
//! - those of `TrainSettings` (numbers);
//! - `places`: number of different places of the training; `absent`: share of episodes without the goal;
//! - `within`: a time \[s\], and the number of rounds is as many as fit;
//! - `from`: the weights.bin of an earlier training to go on from; `out`: a directory for weights.bin and places.json, made if need be;
//! - `exam`: places of the test, each with `episodes` and `pictures`; `exam_seed`: of them; `goals=unseen`: of a shape and colours that no training
//!   draws; `goals=turned`: a network that knows goals by name is asked by turned hues; `role=training`: in places of the training, which places.json beside `from` lists.
//!
//! - `gpu=N` (feature `gpu`): draws and learns on adapter `N`;
//! - `show=FILE.ppm`: pictures of the first places of that role, a row for each, and nothing else.
//!
//! Without `rounds=0` it learns first. `qv navigate train --places` and `test --places` do the same without a time.

use qv_nav::dagger::{Student, TrainSettings};
use qv_nav::exam::{Answers, Exam, ExamRow, ExamSettings, PILOTS, examine};
use qv_nav::eye::{Eye, Shot};
use qv_nav::goals::{GoalKind, turn_hues};
use qv_nav::lens::LensSpread;
use qv_nav::map::standing;
use qv_nav::net::{HEIGHT, HIDDEN, NetInput, STATE, WIDTH};
use qv_nav::places::{ManySites, PlaceEyes, Role, Site, SiteSettings, TrainingPlaces, number};
use qv_nav::recall::RECALL;
use qv_nav::task::Stratum;
use qv_nav::weights::{self, GoalInput};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Instant;

type Fallible<T> = Result<T, Box<dyn std::error::Error>>;

struct Options {
    settings: TrainSettings,
    places: u64,
    absent: f32,
    within: Option<f64>,
    from: Option<PathBuf>,
    out: PathBuf,
    exam: u64,
    episodes: usize,
    pictures: usize,
    exam_seed: u64,
    goals: Option<GoalKind>,
    role: Role,
    show: Option<PathBuf>,
    is_turned: bool,
    gpu: Option<usize>,
}

impl Options {
    fn of(arguments: impl Iterator<Item = String>) -> Fallible<Self> {
        let mut settings = serde_json::to_value(TrainSettings::of_many_places())?;
        let mut out = Self {
            settings: TrainSettings::of_many_places(),
            places: 1000,
            absent: 0.25,
            within: None,
            from: None,
            out: "out/places".into(),
            exam: 10,
            episodes: 20,
            pictures: 40,
            exam_seed: 1,
            goals: Some(GoalKind::Trained),
            role: Role::Test,
            show: None,
            is_turned: false,
            gpu: None,
        };
        let mut is_examined_only = false;
        for argument in arguments {
            let (key, value) = argument.split_once('=').ok_or_else(|| format!("{argument}: expected KEY=VALUE"))?;
            match (key, value) {
                ("places", _) => out.places = value.parse()?,
                ("absent", _) => out.absent = value.parse()?,
                ("within", _) => out.within = Some(value.parse()?),
                ("from", _) => out.from = Some(value.into()),
                ("out", _) => out.out = value.into(),
                ("exam", _) => out.exam = value.parse()?,
                ("episodes", _) => out.episodes = value.parse()?,
                ("pictures", _) => out.pictures = value.parse()?,
                ("exam_seed", _) => out.exam_seed = value.parse()?,
                ("goals", "unseen") => out.goals = Some(GoalKind::Unseen),
                ("goals", "turned") => out.is_turned = true,
                ("gpu", _) => out.gpu = Some(value.parse()?),
                ("show", _) => out.show = Some(value.into()),
                ("role", "training") => out.role = Role::Training,
                ("rounds", "0") => is_examined_only = true,
                _ => settings[key] = serde_json::from_str(value)?,
            }
        }
        out.settings = serde_json::from_value(settings)?;
        if is_examined_only {
            out.settings.rounds = 0;
        }
        Ok(out)
    }
}

fn main() -> Fallible<()> {
    let mut options = Options::of(std::env::args().skip(1))?;
    if let Some(file) = &options.show {
        return show_places(file, &options);
    }
    let is_trained = options.settings.rounds > 0;
    let settings = TrainSettings { rounds: options.settings.rounds.max(1), ..options.settings.clone() };
    println!("{}", serde_json::to_string(&settings)?);
    let mut student = student(&settings, options.gpu)?;
    if let Some(from) = &options.from {
        let (parameters, input) = weights::read(&std::fs::read(from)?, &student.net)?;
        if input == GoalInput::Name && !is_trained && !options.is_turned {
            options.goals = None;
        }
        student.start_from(parameters)?;
    }
    if is_trained {
        learn(&mut student, &options)?;
    }
    if options.exam > 0 {
        exam(&student, &options)?;
    }
    Ok(())
}

/// A student, learning on the card that was asked for, if any.
fn student(settings: &TrainSettings, gpu: Option<usize>) -> Fallible<Student> {
    let student = Student::new(settings)?;
    match gpu {
        None => Ok(student),
        #[cfg(feature = "gpu")]
        Some(adapter) => {
            let options = qv_nav::card::GpuOptions { adapter: Some(adapter), ..Default::default() };
            Ok(student.on_card(qv_nav::card::Gpu::new(&options)?)?)
        }
        #[cfg(not(feature = "gpu"))]
        Some(_) => Err("gpu: expected a build with the feature gpu, found one without".into()),
    }
}

/// What draws: the card that was asked for, if any.
fn eyes(gpu: Option<usize>) -> Fallible<PlaceEyes> {
    #[cfg(feature = "gpu")]
    if let Some(adapter) = gpu {
        let options = qv_nav::card::GpuOptions { adapter: Some(adapter), ..Default::default() };
        return Ok(PlaceEyes::Card(Box::new(qv_nav::card::GpuEyes::new(options)?)));
    }
    let _ = gpu;
    Ok(PlaceEyes::Processor)
}

fn learn(student: &mut Student, options: &Options) -> Fallible<()> {
    let sites = ManySites {
        settings: SiteSettings::default(),
        seed: options.settings.seed,
        count: options.places,
        given: Vec::new(),
        share_given: 0.0,
        spread: LensSpread::of_many_places(),
        eyes: eyes(options.gpu)?,
        robots: options.settings.robots,
        absent: options.absent,
        visited: Mutex::new(BTreeMap::new()),
    };
    std::fs::create_dir_all(&options.out)?;
    let (clock, mut round) = (Instant::now(), 0);
    while round < student.rounds_in_all() {
        round += 1;
        let (mut driven, began) = (0.0, Instant::now());
        let progress = student.round_over(&sites, &mut |p| {
            if p.loss.is_nan() {
                driven = began.elapsed().as_secs_f64();
            }
        })?;
        let (took, in_all) = (began.elapsed().as_secs_f64(), clock.elapsed().as_secs_f64());
        println!(
            "round {round} of {}: {} decisions, loss {:.4}, own success {:.3}; drove {driven:.0} of {took:.0} s, {in_all:.0} s in all, {} places",
            student.rounds_in_all(),
            progress.frames,
            progress.loss,
            progress.success.unwrap_or(f64::NAN),
            sites.trained().places.len()
        );
        if let Some(within) = options.within {
            // The last rounds say best how long one takes.
            student.end_after(round + ((within - in_all) / took).floor().max(0.0) as usize);
        }
        std::fs::write(options.out.join("weights.bin"), weights::to_bytes_for(&student.parameters, GoalInput::Colour))?;
        std::fs::write(options.out.join("places.json"), serde_json::to_vec(&sites.trained())?)?;
    }
    Ok(())
}

fn exam(student: &Student, options: &Options) -> Fallible<()> {
    let settings = ExamSettings {
        episodes: options.episodes,
        pictures: options.pictures,
        seed: options.exam_seed,
        spread: LensSpread::wide(),
    };
    let site = SiteSettings { goals: options.goals, ..SiteSettings::default() };
    let numbers: Vec<u64> = match (options.role, &options.from) {
        (Role::Training, Some(from)) => {
            let file = std::fs::read(from.with_file_name("places.json"))?;
            serde_json::from_slice::<TrainingPlaces>(&file)?.numbers().take(options.exam as usize).collect()
        }
        (role, _) => (0..options.exam).map(|index| number(role, options.exam_seed, index)).collect(),
    };
    let (mut all, clock) = (Vec::<Exam>::new(), Instant::now());
    for number in numbers {
        let (site, eye) = Site::drawn(number, &site)?;
        let exam = examine(&site.seen_by(Box::new(eye)), &student.net, &student.parameters, &settings)?;
        show(&exam.place, std::slice::from_ref(&exam), &PILOTS[..1]);
        all.push(exam);
    }
    show(&format!("all, {:.0} s", clock.elapsed().as_secs_f64()), &all, &PILOTS);
    println!("a decision of the network takes {:.2} ms on one core", decision(student));
    Ok(())
}

/// Time of a decision: hues turned, and one step of the network \[ms\].
fn decision(student: &Student) -> f64 {
    const COUNT: usize = 100;
    let (mut memory, mut scratch) = (vec![0.0; HIDDEN], student.net.scratch());
    let mut bytes: Vec<u8> = (0..3 * WIDTH * HEIGHT).map(|k| (k * 37 % 251) as u8).collect();
    let clock = Instant::now();
    for _ in 0..COUNT {
        turn_hues(&mut bytes, 40.0);
        let picture: Vec<f32> = bytes.iter().map(|&b| f32::from(b)).collect();
        let input = NetInput { picture: &picture, state: &[0.0; STATE], recall: &[0.0; RECALL] };
        student.net.step(&student.parameters, &input, &mut memory, &mut scratch);
    }
    1000.0 * clock.elapsed().as_secs_f64() / COUNT as f64
}

/// What robots see where episodes begin.
fn show_places(file: &Path, options: &Options) -> Fallible<()> {
    const COLUMNS: usize = 8;
    let site = SiteSettings { goals: options.goals, ..SiteSettings::default() };
    let mut bytes = Vec::<u8>::new();
    for index in 0..options.exam {
        let (site, eye) = Site::drawn(number(options.role, options.exam_seed, index), &site)?;
        let episodes = site.episodes(0.0).draw(&site.world, 3 * COLUMNS, options.exam_seed)?;
        let in_view = episodes.iter().filter(|e| e.stratum == Stratum::InView).chain(&episodes).take(COLUMNS);
        let mut pictures = Vec::new();
        for episode in in_view {
            let mut lens = LensSpread::of_many_places().draw(&site.world.rig, episode.seed);
            let base = standing(&site.world.map, episode.start.into(), episode.yaw, 0.3);
            let cones = std::iter::once(episode.goal).chain(episode.others.iter().copied()).collect();
            let drawn = eye.look(&[Shot { camera: lens.rig.camera(&base), cones, seed: episode.seed }])?;
            let mut bytes = lens.bytes(&drawn[0], [0.0; 3]);
            turn_hues(&mut bytes, site.world.goals.turn(episode.goal.colour));
            pictures.push(bytes);
        }
        for row in 0..HEIGHT {
            pictures.iter().for_each(|p| bytes.extend(&p[row * 3 * WIDTH..][..3 * WIDTH]));
        }
    }
    let mut out = format!("P6 {} {} 255\n", COLUMNS * WIDTH, options.exam as usize * HEIGHT).into_bytes();
    out.extend(bytes);
    Ok(std::fs::write(file, out)?)
}

fn show(name: &str, exams: &[Exam], pilots: &[&str]) {
    println!("{name}");
    for (k, pilot) in pilots.iter().enumerate() {
        let trials: Vec<_> = exams.iter().flat_map(|e| e.trials[k].iter().cloned()).collect();
        let ExamRow { row, spl, collisions, pushed, length } = ExamRow::of(&trials);
        println!(
            "  {pilot}: {:.1} % {:.3?} of {}, SPL {:.2}, collisions {:.3}, pushed {:.3}, length {:.1} m, ends {:?}",
            100.0 * row.success,
            row.interval,
            row.episodes,
            spl.value,
            collisions.share,
            pushed.share,
            length.value,
            row.ends
        );
    }
    for k in 0..2 {
        let said = exams.iter().fold(Answers::default(), |sum, e| sum.and(e.said[k]));
        println!("  {} {said:?}, balanced {:.3}", ["network", "blob"][k], said.balanced());
    }
}
