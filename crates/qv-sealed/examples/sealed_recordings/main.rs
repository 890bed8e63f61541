//! Recordings whose cause is known to whoever holds the answers, which go to standard output as one JSON document:
//! `cargo run --release -p qv-sealed --features rapier --example sealed_recordings -- --out DIR --seed 7 --effects
//! motor_strength,payload_mass --per-effect 2 --none 2 --withheld 3 > answers.json`.

mod answers;
mod order;

use clap::{Parser, ValueEnum};
use order::Order;
use qv_core::random::sub_seed;
use qv_go2::model::JOINT_NAMES;
use qv_go2::synthetic::{Message, write_bag};
use qv_sealed::{DrawnRecipe, EngineChoice, Motion, Outcome, Request};
use rayon::prelude::*;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::error::Error;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};

#[derive(Parser)]
struct Arguments {
    /// Folder for the recordings: one folder of an opaque name for each, with run.mcap in it
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Seed of everything
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Effects of the library to record one at a time, or `all`
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    effects: Vec<String>,
    /// Recordings of each of them
    #[arg(long, default_value_t = 1, value_name = "N")]
    per_effect: usize,
    /// What the robot does in recordings of --effects and --none, in turn, or `all`. What cannot show in a motion is left out, and what no draw
    /// makes in one other than `mixed`, with a remark
    #[arg(long, value_delimiter = ',', default_value = "mixed", value_name = "NAMES")]
    motions: Vec<String>,
    /// Recordings with two effects at once, out of --effects or all
    #[arg(long, default_value_t = 0, value_name = "N")]
    pairs: usize,
    /// Recordings with an effect that no library has
    #[arg(long, default_value_t = 0, value_name = "N")]
    withheld: usize,
    /// Recordings of a robot with nothing but small unnamed differences
    #[arg(long, default_value_t = 0, value_name = "N")]
    none: usize,
    /// Recordings whose motion, effects and sizes are drawn: 35 % without an effect, 40 % with one, 10 % with two, 15 % with one that no
    /// library has; sizes go down to what cannot be seen. What no draw makes is left out, with a remark
    #[arg(long, default_value_t = 0, value_name = "N")]
    study: usize,
    /// Recordings on ground of four materials, with terrain.glb beside them
    #[arg(long, default_value_t = 0, value_name = "N")]
    mixed: usize,
    /// Faults of motors, or soft ground, in each of those
    #[arg(long, default_value_t = 0, value_name = "N")]
    mixed_faults: usize,
    /// Length of those \[s\]
    #[arg(long, default_value_t = 60.0, value_name = "SECONDS")]
    seconds: f64,
    /// Engine to record with; `both` takes turns
    #[arg(long, value_enum, default_value_t = Engines::Second)]
    engine: Engines,
    /// Where taking turns begins
    #[arg(long, default_value_t = 0, value_name = "N")]
    first_turn: usize,
    /// Beside each recording the same one without its effect, unless the robot falls then
    #[arg(long)]
    twins: bool,
    /// How often each recording was redrawn, as JSON by name: those that are there are not made again
    #[arg(long, value_name = "FILE")]
    redraws: Option<PathBuf>,
    /// Answers to this file instead of standard output: for development
    #[arg(long, value_name = "FILE")]
    answers: Option<PathBuf>,
    /// Recordings made at a time
    #[arg(long, default_value_t = 2, value_name = "N")]
    jobs: usize,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Engines {
    Ours,
    Second,
    Both,
}

impl Engines {
    /// Engine of the `turn`-th recording of a kind.
    fn of(self, turn: usize) -> EngineChoice {
        match self {
            Self::Both if turn.is_multiple_of(2) => EngineChoice::Second,
            Self::Second => EngineChoice::Second,
            Self::Ours | Self::Both => EngineChoice::Ours,
        }
    }
}

/// A name that says nothing.
fn opaque(seed: u64, index: usize, twin: bool) -> String {
    let of = |part: u64| sub_seed(sub_seed(seed, index as u64), 2 * part + u64::from(twin));
    format!("{:016x}", of(0x6e61_6d65))
}

fn write(folder: &Path, messages: &[Message]) -> Result<(), Failure> {
    fs::create_dir_all(folder)?;
    // Under its name only when it is whole.
    let (half, whole) = (folder.join("run.mcap.part"), folder.join("run.mcap"));
    write_bag(messages, BufWriter::new(File::create(&half)?))?;
    Ok(fs::rename(half, whole)?)
}

type Failure = Box<dyn Error + Send + Sync>;

/// Makes one recording, and its twin; their names and answers.
fn carry_out(
    arguments: &Arguments,
    known: &BTreeMap<String, u64>,
    index: usize,
    order: &Order,
) -> Result<Vec<(String, Value)>, Failure> {
    let request = Request {
        engine: arguments.engine.of(arguments.first_turn + order.turn),
        wanted: order.wanted.clone(),
        motion: order.motion,
        down_to_unseen: order.is_of_study,
    };
    let seed = sub_seed(arguments.seed, index as u64);
    let [name, twin] = [false, true].map(|twin| opaque(arguments.seed, index, twin));
    let at = |name: &str| arguments.out.join(name);
    let is_there = |name: &str| at(name).join("run.mcap").is_file();
    let (drawn, redraws) = match known.get(&name) {
        Some(&redraws) if is_there(&name) => (qv_sealed::redraw(&request, seed, redraws)?, redraws),
        _ => {
            let made = match qv_sealed::make(&request, seed) {
                Err(error) if order.is_of_study || order.motion != Motion::Mixed => {
                    eprintln!("{error}");
                    return Ok(Vec::new());
                }
                made => made?,
            };
            write(&at(&name), &made.messages)?;
            (made.drawn, made.rejected.len() as u64)
        }
    };
    let mut answer = answers::of(order.case, &drawn, redraws);
    answer["motion_kind"] = json!(order.motion.name());
    if !arguments.twins {
        return Ok(vec![(name, answer)]);
    }
    let plain = DrawnRecipe { recipe: drawn.recipe.without_effects(), ..drawn };
    let (outcome, messages) = qv_sealed::record(&plain.recipe)?;
    if matches!(outcome, Outcome::Fell { .. }) {
        // Friction may keep a robot up that falls without it: then there is no twin.
        return Ok(vec![(name, answer)]);
    }
    write(&at(&twin), &messages)?;
    answer["twin"] = json!(twin);
    let mut other = answers::of("none", &plain, redraws);
    other["twin"] = json!(name);
    Ok(vec![(name, answer), (twin, other)])
}

/// Makes one recording on mixed ground; its name and answer.
fn carry_out_mixed(
    arguments: &Arguments,
    known: &BTreeMap<String, u64>,
    turn: usize,
) -> Result<(String, Value), Failure> {
    let engine = arguments.engine.of(arguments.first_turn + turn);
    // Names of their own: the other recordings count from 0.
    let index = usize::MAX / 2 + turn;
    let (name, seed) = (opaque(arguments.seed, index, false), sub_seed(arguments.seed, index as u64));
    let folder = arguments.out.join(&name);
    let request = qv_sealed::MixedRequest { engine, seconds: arguments.seconds, faults: arguments.mixed_faults };
    let mixed = match known.get(&name) {
        Some(&redraws) if folder.join("run.mcap").is_file() && folder.join("terrain.glb").is_file() => {
            return Ok((name, answers::of_mixed(&qv_sealed::redraw_mixed(request, seed, redraws), redraws)));
        }
        _ => {
            let (mixed, messages) = qv_sealed::make_mixed(request, seed)?;
            fs::create_dir_all(&folder)?;
            fs::write(folder.join("terrain.glb"), qv_mesh::files::glb::write(&mixed.labelled()))?;
            write(&folder, &messages)?;
            mixed
        }
    };
    let redraws = mixed.rejected.len() as u64;
    Ok((name, answers::of_mixed(&mixed, redraws)))
}

fn known_redraws(arguments: &Arguments) -> Result<BTreeMap<String, u64>, Failure> {
    let Some(file) = &arguments.redraws else { return Ok(BTreeMap::new()) };
    let text = fs::read_to_string(file).map_err(|e| format!("{}: {e}", file.display()))?;
    Ok(serde_json::from_str(&text).map_err(|e| format!("{}: expected counts by name: {e}", file.display()))?)
}

fn main() -> Result<(), Failure> {
    let arguments = Arguments::parse();
    let orders = order::list(&arguments)?;
    let known = known_redraws(&arguments)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(arguments.jobs.max(1)).build()?;
    let made: Vec<_> = pool.install(|| {
        let numbered = orders.par_iter().enumerate().with_max_len(1);
        numbered.map(|(index, order)| carry_out(&arguments, &known, index, order)).collect::<Result<_, _>>()
    })?;
    let mixed: Vec<(String, Value)> = pool.install(|| {
        let turns = (0..arguments.mixed).into_par_iter().with_max_len(1);
        turns.map(|turn| carry_out_mixed(&arguments, &known, turn)).collect::<Result<_, _>>()
    })?;
    let recordings: Map<String, Value> = made.into_iter().flatten().chain(mixed).collect();
    let answers = json!({
        "format": "qv-sealed/1", "seed": arguments.seed, "joints": JOINT_NAMES, "recordings": recordings,
    });
    let text = format!("{answers:#}\n");
    match &arguments.answers {
        Some(file) => fs::write(file, text)?,
        None => print!("{text}"),
    }
    Ok(())
}
