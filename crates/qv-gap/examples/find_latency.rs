//! Command latencies of simulated Go2s that walk, and what the diagnosis says of each. Latencies \[ms\] are given, or drawn from 0 to 60 ms with
//! the robot's other differences: `cargo run --release -p quadverse-gap --example find_latency -- drawn=20 seed=7`.

use qv_core::random::SplitMix64;
use qv_gap::report::Report;
use qv_gap::{Options, diagnose};
use qv_go2::synthetic::{self, Robot};
use qv_recording::{BagFile, Run, read_bag};
use qv_sim::{BaseKind, Model, ModelOptions, Terrain};
use std::error::Error;
use std::io::Cursor;
use std::time::Instant;

/// Latencies that are drawn are shorter \[ms\].
const LONGEST: f64 = 60.0;
/// What no latency is taken for: the tolerance of the library \[ms\], twice.
const NEGLIGIBLE: f64 = 0.8;

fn recorded(latency: f64, seed: u64) -> Result<Run, Box<dyn Error>> {
    let mut parameters = synthetic::small_differences(seed);
    parameters.extend(synthetic::command_latency(1e-3 * latency));
    let messages = synthetic::record(&Terrain::plane(), &Robot { parameters, seed, start: [0.0; 3] })?;
    let mut bytes = Cursor::new(Vec::new());
    synthetic::write_bag(&messages, &mut bytes)?;
    bytes.set_position(0);
    let file = BagFile { name: "walk".into(), source: bytes };
    Ok(read_bag(vec![file], &qv_go2::wire::mapping(None))?)
}

/// Whether a latency is the only cause, of all joints, and whether its interval holds it.
fn judged(report: &Report, latency: f64) -> [bool; 2] {
    match &report.causes[..] {
        [] => [latency < NEGLIGIBLE; 2],
        [cause] if cause.effect == "command_latency" && cause.scope == ["all"] => {
            let [low, high] = cause.parameters[0].ci95.map(|x| 1e3 * x);
            [true, (low..=high).contains(&latency)]
        }
        _ => [false; 2],
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |name: &str, otherwise: u64| {
        let given = arguments.iter().find_map(|a| a.strip_prefix(name)?.strip_prefix('='));
        given.map_or(Ok(otherwise), str::parse)
    };
    let (seed, drawn) = (number("seed", 1)?, number("drawn", 0)?);
    let mut draws = SplitMix64::new(seed);
    let mut latencies: Vec<f64> = arguments.iter().filter_map(|a| a.parse().ok()).collect();
    latencies.extend((0..drawn).map(|_| LONGEST * draws.uniform()));
    let options = ModelOptions { base: BaseKind::Floating, armature: qv_go2::model::ARMATURE, ..Default::default() };
    let model = Model::from_urdf(&qv_go2::model::urdf(), &options)?;
    let mut counts = [0; 2];
    for (k, latency) in latencies.iter().enumerate() {
        let run = recorded(*latency, seed.wrapping_add(k as u64))?;
        let began = Instant::now();
        let report = diagnose(&[run], &model, &Terrain::plane(), &Options::default(), 0)?.report;
        let seconds = began.elapsed().as_secs_f64();
        print!("{latency:5.1} ms: {:?}, closed {:.2}, {seconds:.0} s;", report.verdict, report.gap.closed);
        for cause in &report.causes {
            let ([low, high], value) = (cause.parameters[0].ci95, cause.parameters[0].value);
            let [low, high, value] = [low, high, value].map(|x| 1e3 * x);
            print!(" {} of {}: {value:.1} ({low:.1} to {high:.1})", cause.effect, cause.scope.join(", "));
        }
        println!();
        for (count, right) in counts.iter_mut().zip(judged(&report, *latency)) {
            *count += usize::from(right);
        }
    }
    println!(
        "{} latencies: {} named alone and of all joints, {} in their 95 % interval",
        latencies.len(),
        counts[0],
        counts[1]
    );
    Ok(())
}
