//! The visual task on the legs of hidden robots in the second engine, under walking policies that lack a part of the tuning:
//! `tuned_legs STUDENT.bin NOMINAL.bin ROBUST.bin FIRST_SEED LAST_SEED [KEY=VALUE ...]`. The last two files are checkpoints of trainings with the default
//! settings and with those of `qv walk train --robust`. A hidden robot records walks under the first policy; parameters and torques are fitted to them;
//! the first policy is fine-tuned with each, with what `--robust` draws, and with all of it. Then each policy follows commands on the plane, and carries
//! the student through the yard. Keys: `rows` (some of `n`ominal, identified `p`arameters, parameters and `t`orques, `r`obust, fine-tuned with what
//! robust `d`raws, `a`ll), `episodes` and `walks` (of each robot and row), `log` (recorded walks of 20 s), `eye` (`rays` or `sown`), `out` (a file of
//! one line of JSON for each robot and row; what it has is not done again, nor are the fits in the files OUT.SEED).

mod hidden_legs;
mod yard_eye;

use hidden_legs::HiddenLegs;
use qv_core::random::Xoshiro256PlusPlus;
use qv_nav::eye::{Eye, FnEye, Shot, SplatEye};
use qv_nav::lens::LensSpread;
use qv_nav::map::{Map, MapSettings};
use qv_nav::net::Net;
use qv_nav::pilots::NetPilot;
use qv_nav::roll::{Stage, roll};
use qv_nav::score::{Row, compared};
use qv_nav::sight::Rig;
use qv_nav::task::{End, EpisodeSettings, Limits, Trial};
use qv_nav::teacher::World;
use qv_nav::weights;
use qv_policy::policy::Policy;
use qv_policy::train::Checkpoint;
use qv_policy::velocity::{Ground, Randomise, TaskRobot, TaskSettings};
use qv_residual::close::{Candidate, Event, Forget, HeldOut, Inputs, LoopSettings, fit_candidates};
use qv_residual::hidden::{Engine, HiddenRobot, SCORED};
use qv_residual::paths::{PathScore, SECONDS, commands};
use qv_residual::tune::{CorrectedSimulator, train_on};
use qv_sim::Terrain;
use serde::{Deserialize, Serialize};
use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::fs;
use std::io::Write;
use std::time::Instant;
use yard::layout::mesh_with;
use yard::objects::CRATES;
use yard::{Yard, sow};

/// Added to a robot's seed for its episodes.
const TESTED: u64 = 777;
/// Length of a recorded walk \[s\].
const RECORDED: f32 = 20.0;
/// Rows of the table by their letters.
const ROWS: [(char, &str); 6] = [
    ('n', "nominal policy"),
    ('p', "identified parameters"),
    ('t', "identified parameters + residual torques"),
    ('r', "domain randomization, trained from nothing"),
    ('d', "fine-tuned with domain randomization"),
    ('a', "all: domain randomization, parameters, torques"),
];

type Fallible<T> = Result<T, Box<dyn std::error::Error>>;

/// One robot under one policy.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Entry {
    robot: u64,
    name: String,
    row: char,
    paths: PathScore,
    /// In the order of the robot's episodes, without tracks.
    trials: Vec<Trial>,
    /// Wall time of the paths and of the episodes \[s\].
    seconds: [f64; 2],
}

impl Entry {
    fn falls(&self) -> usize {
        self.paths.fell + self.trials.iter().filter(|t| t.end == End::Fell).count()
    }
}

/// Names and their values.
struct Keys(BTreeMap<String, String>);

impl Keys {
    fn text(&self, name: &str, usual: &str) -> String {
        self.0.get(name).cloned().unwrap_or_else(|| usual.into())
    }

    fn number<T: std::str::FromStr>(&self, name: &str, usual: &str) -> Fallible<T> {
        let text = self.text(name, usual);
        text.parse().map_err(|_| format!("{name}: expected a number, found {text}").into())
    }
}

/// What all robots share.
struct Bench {
    robot: TaskRobot,
    net: Net,
    student: Vec<f32>,
    /// The training that policies are fine-tuned from, and the same with domain randomization.
    starts: [Checkpoint; 2],
    /// A training with domain randomization from the beginning.
    robust: Checkpoint,
    /// The policy that is fine-tuned with domain randomization alone, which no robot changes.
    randomized: OnceCell<Policy>,
    world: World,
    yard: Ground,
    eye: Box<dyn Eye>,
    episodes: usize,
    walks: usize,
    log: u64,
}

impl Bench {
    fn new(files: [&str; 3], keys: &Keys) -> Fallible<Self> {
        let read = |file: &str| fs::read(file).map_err(|e| format!("cannot open '{file}': {e}"));
        let net = Net::default();
        let student = weights::from_bytes(&read(files[0])?, &net)?;
        let [start, robust] = [Checkpoint::from_bytes(&read(files[1])?)?, Checkpoint::from_bytes(&read(files[2])?)?];
        let robot = qv_go2::walk::robot()?;
        let mut randomized = start.clone();
        randomized.settings.task.randomise = Randomise::robust(&robot.model.links[0].name);
        let mesh = mesh_with(&CRATES);
        let world = World::new(Map::new(&mesh, &MapSettings::default())?, Rig::default(), Limits::default());
        let [low, high] = world.map.bounds().map(|p| p.to_array());
        let scene = Yard::with_crates(&CRATES, Vec::new(), 1);
        let eye: Box<dyn Eye> = match keys.text("eye", "rays").as_str() {
            "rays" => Box::new(FnEye(move |shot: &Shot| yard_eye::cast(&scene, shot))),
            "sown" => Box::new(SplatEye::new(&sow::cloud(&scene, 0.04))),
            other => return Err(format!("eye: expected rays or sown, found {other}").into()),
        };
        Ok(Self {
            robot,
            yard: Ground::of_terrain(Terrain::from_mesh(&mesh)?, [low, high], 0.3, 1)?,
            episodes: keys.number("episodes", "40")?,
            walks: keys.number("walks", "12")?,
            log: keys.number("log", "30")?,
            net,
            student,
            starts: [start, randomized],
            robust,
            randomized: OnceCell::new(),
            world,
            eye,
        })
    }

    /// Two of three have effects of the catalogue, the third one that no parameter describes.
    fn hidden(&self, seed: u64) -> HiddenRobot {
        match seed % 3 {
            2 => HiddenRobot::outside(&self.robot, Engine::Second, seed),
            _ => HiddenRobot::inside(&self.robot, Engine::Second, seed),
        }
    }

    /// Corrections fitted to a robot's recordings, or those that a file has of an earlier run.
    fn candidates(&self, hidden: &HiddenRobot, seed: u64, file: &str) -> Fallible<Vec<Candidate>> {
        if fs::exists(file)? {
            return Ok(serde_json::from_slice(&fs::read(file)?)?);
        }
        let found = self.fit(hidden, seed)?;
        fs::write(file, serde_json::to_vec(&found)?)?;
        Ok(found)
    }

    /// Corrections fitted to a robot's recordings.
    fn fit(&self, hidden: &HiddenRobot, seed: u64) -> Fallible<Vec<Candidate>> {
        let (start, plane, settings) = (&self.starts[0], Ground::plane(), LoopSettings::default());
        let (policy, task) = (start.best_policy(&self.robot)?, &start.settings.task);
        let log = hidden.record(&self.robot, &plane, &policy, task, (self.log, RECORDED), seed)?;
        eprintln!("{}: {:.0} s of recordings, {:?}", hidden.name, log.seconds(), log.remarks);
        let inputs = Inputs {
            robot: &self.robot,
            ground: &plane,
            train_on: &plane,
            log: &log,
            start,
            given: None,
            settings: &settings,
        };
        let found = fit_candidates(&inputs, &Forget, &mut |event| {
            if let Event::Stage(name, ..) = event {
                eprintln!("  {name}");
            }
        })?;
        for c in &found {
            let HeldOut { error, stays, .. } = c.held_out;
            eprintln!("  {}: {:.2} mrad, stays: {stays}", c.compensation.kind, 1e3 * error);
        }
        Ok(found)
    }

    /// The policy of a row.
    fn policy(&self, row: char, candidates: &[Candidate]) -> Fallible<Policy> {
        let [start, randomized] = &self.starts;
        let fitted = |kind: &str| -> Fallible<CorrectedSimulator> {
            let candidate = candidates.iter().find(|c| c.compensation.kind == kind);
            let candidate = candidate.ok_or_else(|| format!("candidates: expected {kind}, found none"))?;
            Ok(candidate.compensation.corrected(&self.robot))
        };
        match row {
            'p' => self.tune(start, &fitted("parameters at the training's step")?),
            't' => self.tune(start, &fitted("parameters and torques")?),
            'a' => self.tune(randomized, &fitted("parameters and torques")?),
            'r' => Ok(self.robust.best_policy(&self.robot)?),
            'd' => {
                if let Some(policy) = self.randomized.get() {
                    return Ok(policy.clone());
                }
                let policy = self.tune(randomized, &CorrectedSimulator::nominal())?;
                Ok(self.randomized.get_or_init(|| policy).clone())
            }
            _ => Ok(start.best_policy(&self.robot)?),
        }
    }

    fn tune(&self, start: &Checkpoint, corrected: &CorrectedSimulator) -> Fallible<Policy> {
        let settings = LoopSettings::default().tune;
        Ok(train_on(&self.robot, &Ground::plane(), start, corrected, &settings, |line, score| {
            if let Some(score) = score {
                eprintln!("    {}: {:.3} m in the corrected simulator", line.iteration.index, score.position);
            }
        })?)
    }

    fn drive(&self, hidden: &HiddenRobot, (policy, task): (&Policy, &TaskSettings), seed: u64) -> Fallible<Vec<Trial>> {
        let stage = Stage::new(&self.world, &*self.eye, LensSpread::wide());
        let episodes = EpisodeSettings::default().draw(&self.world, self.episodes, TESTED + seed)?;
        let mut legs = HiddenLegs::new(hidden, (&self.robot, &self.yard), (policy, task), self.episodes)?;
        let mut pilot = NetPilot::new(&self.net, &self.student, self.episodes);
        let rolled = roll(&stage, &mut legs, &episodes, &mut pilot, |_| false, &mut |_| {})?;
        Ok(rolled.into_iter().map(|(trial, _)| Trial { track: Vec::new(), ..trial }).collect())
    }

    fn test(&self, hidden: &HiddenRobot, seed: u64, row: char, candidates: &[Candidate]) -> Fallible<Entry> {
        let (policy, start) = (self.policy(row, candidates)?, if row == 'r' { &self.robust } else { &self.starts[0] });
        let task = &start.settings.task;
        let clock = Instant::now();
        let wanted = commands(&task.commands, self.walks, SCORED + seed);
        let paths = hidden.score(&self.robot, &Ground::plane(), &policy, task, &wanted, SECONDS, seed)?;
        let walked = clock.elapsed().as_secs_f64();
        eprintln!("  {row}: {paths:?}");
        let trials = self.drive(hidden, (&policy, task), seed)?;
        let seconds = [walked, clock.elapsed().as_secs_f64() - walked];
        Ok(Entry { robot: seed, name: hidden.name.clone(), row, paths, trials, seconds })
    }
}

/// Entries of a file; none when it is not there.
fn entries(file: &str) -> Fallible<Vec<Entry>> {
    if !fs::exists(file)? {
        return Ok(Vec::new());
    }
    fs::read_to_string(file)?.lines().map(|line| Ok(serde_json::from_str(line)?)).collect()
}

/// The 95 % interval of a mean over robots: percentiles of means of 10 000 samples with replacement.
fn bootstrap(values: &[f64]) -> [f64; 2] {
    let mut random = Xoshiro256PlusPlus::of(0, 91, 0);
    let count = values.len();
    let mut mean = || (0..count).map(|_| values[random.below(count)]).sum::<f64>() / count as f64;
    let mut means: Vec<f64> = (0..10_000).map(|_| mean()).collect();
    means.sort_by(f64::total_cmp);
    [means[249], means[9749]]
}

/// The table, and under it each robot.
fn print_table(entries: &[Entry]) {
    let of = |row: char| entries.iter().filter(|e| e.row == row).collect::<Vec<_>>();
    let trials = |found: &[&Entry]| found.iter().flat_map(|e| e.trials.clone()).collect::<Vec<_>>();
    println!(
        "| policy | robots | path error [m] | 95 % | falls: walks, episodes | success of the visual task | 95 % | p against nominal |"
    );
    println!("|---|---:|---:|---|---:|---:|---|---:|");
    for (row, name) in ROWS {
        let found = of(row);
        if found.is_empty() {
            continue;
        }
        let errors: Vec<f64> = found.iter().map(|e| f64::from(e.paths.position)).collect();
        let ([low, high], mean) = (bootstrap(&errors), errors.iter().sum::<f64>() / errors.len() as f64);
        let walks: [usize; 2] = found.iter().fold([0, 0], |[fell, all], e| [fell + e.paths.fell, all + e.paths.walks]);
        let all = trials(&found);
        let result = Row::of(&all);
        let [least, most] = result.interval.map(|x| 100.0 * x);
        // On robots that have both, in one order: their episodes are the same.
        let paired = |own: char, other: char| {
            let both = of(own).into_iter().filter(|e| of(other).iter().any(|o| o.robot == e.robot));
            let mut both: Vec<&Entry> = both.collect();
            both.sort_by_key(|e| e.robot);
            trials(&both)
        };
        let p = compared(&paired('n', row), &paired(row, 'n'));
        println!(
            "| {name} | {} | {mean:.3} | {low:.3} to {high:.3} | {}/{}, {}/{} | {:.1} % | {least:.1} to {most:.1} | {p:.3} |",
            found.len(),
            walks[0],
            walks[1],
            result.ends[6],
            all.len(),
            100.0 * result.success
        );
    }
    println!();
    for e in entries {
        let row = Row::of(&e.trials);
        println!(
            "{} {}: {:.3} m, falls {}, reached {}/{}, ends {:?}, SPL {:.2}, {:.1} s; took {:.0} and {:.0} s",
            e.name,
            e.row,
            e.paths.position,
            e.falls(),
            row.reached,
            row.episodes,
            row.ends,
            row.spl,
            row.time.unwrap_or(f64::NAN),
            e.seconds[0],
            e.seconds[1]
        );
    }
}

fn main() -> Fallible<()> {
    let (named, plain): (Vec<String>, Vec<String>) = std::env::args().skip(1).partition(|a| a.contains('='));
    let keys = Keys(named.iter().filter_map(|a| a.split_once('=')).map(|(k, v)| (k.into(), v.into())).collect());
    let [student, nominal, robust, first, last] = &plain[..] else {
        return Err("expected STUDENT.bin NOMINAL.bin ROBUST.bin FIRST_SEED LAST_SEED [KEY=VALUE ...]".into());
    };
    let bench = Bench::new([student, nominal, robust], &keys)?;
    let (rows, out) = (keys.text("rows", "nptrda"), keys.text("out", "tuned_legs.jsonl"));
    if let Some(other) = rows.chars().find(|row| ROWS.iter().all(|(known, _)| known != row)) {
        return Err(format!("rows: expected some of nptrda, found {other}").into());
    }
    let mut done = entries(&out)?;
    let mut file = fs::OpenOptions::new().create(true).append(true).open(&out)?;
    for seed in first.parse::<u64>()?..=last.parse()? {
        let missing: Vec<char> =
            rows.chars().filter(|&row| !done.iter().any(|e| (e.robot, e.row) == (seed, row))).collect();
        let hidden = bench.hidden(seed);
        let is_fitted = missing.iter().any(|row| "pta".contains(*row));
        let clock = Instant::now();
        let candidates = match is_fitted {
            true => bench.candidates(&hidden, seed, &format!("{out}.{seed}"))?,
            false => Vec::new(),
        };
        eprintln!("{}: fitted in {:.0} s", hidden.name, clock.elapsed().as_secs_f64());
        for row in missing {
            let entry = bench.test(&hidden, seed, row, &candidates)?;
            eprintln!("  {row}: {} reached", entry.trials.iter().filter(|t| t.reached()).count());
            writeln!(file, "{}", serde_json::to_string(&entry)?)?;
            done.push(entry);
        }
    }
    print_table(&done);
    Ok(())
}
