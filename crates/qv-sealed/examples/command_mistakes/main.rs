//! Draws recordings without a mistake and with each of twelve, and prints how often one is reported and named first:
//! `cargo run --release -p qv-sealed --example command_mistakes -- --seed 1`.

use clap::Parser;
use qv_core::random::sub_seed;
use qv_sealed::mistakes::{MISTAKES, Motors, ROBOTS, SIZES, plant, record, reported};
use rayon::prelude::*;

#[derive(Parser)]
struct Arguments {
    /// Of the draws
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Recordings without a mistake
    #[arg(long, default_value_t = 200)]
    plain: usize,
    /// Draws of each mistake, size and robot
    #[arg(long, default_value_t = 2)]
    draws: usize,
    /// Of one mistake alone, by its place in the list
    #[arg(long)]
    only: Option<usize>,
    /// Print what was reported of those that were not named
    #[arg(long)]
    verbose: bool,
}

/// Shares of `n` in which something happened `k` times, as Wilson's interval of 95 %, in per cent.
fn interval(k: usize, n: usize) -> [f64; 2] {
    let (z, n, p) = (1.96, n as f64, k as f64 / n as f64);
    let (middle, half) = (p + z * z / (2.0 * n), z * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt());
    [middle - half, middle + half].map(|x| 100.0 * (x / (1.0 + z * z / n)).clamp(0.0, 1.0))
}

fn main() -> Result<(), qv_sim::SimError> {
    let arguments = Arguments::parse();
    let plain = |k: usize| {
        let kind = ROBOTS[k % ROBOTS.len()];
        let mut run = record(kind, Motors::default(), sub_seed(arguments.seed, k as u64))?;
        Ok((kind, reported(&mut run)))
    };
    let all: Vec<_> = (0..arguments.plain).into_par_iter().map(plain).collect::<Result<_, qv_sim::SimError>>()?;
    let accused: Vec<_> = all.iter().filter(|(_, reported)| !reported.is_empty()).collect();
    let [low, high] = interval(accused.len(), all.len());
    println!("without a mistake: {} of {} reported one ({low:.1} to {high:.1} %)", accused.len(), all.len());
    for (kind, reported) in &accused {
        println!("  {}: {}: {}", kind.name(), reported[0].0, reported[0].1);
    }
    let cases: Vec<_> = MISTAKES
        .iter()
        .enumerate()
        .filter(|(k, _)| arguments.only.is_none_or(|only| only == *k))
        .flat_map(|(_, m)| (0..SIZES).map(move |size| (*m, size)))
        .flat_map(|(m, size)| ROBOTS.iter().map(move |kind| (m, size, *kind)))
        .flat_map(|(m, size, kind)| (0..arguments.draws).map(move |draw| (m, size, kind, draw)))
        .collect();
    let named = |(k, (mistake, size, kind, _)): (usize, &(_, usize, _, usize))| {
        let mut planted = plant(*kind, *mistake, *size, sub_seed(arguments.seed, 10_000 + k as u64))?;
        let reported = reported(&mut planted.run);
        let is_named = planted.is_named_by(&reported);
        if arguments.verbose && !is_named {
            println!(
                "  {mistake:?} {size} {}: expected {} at {:?}, found {reported:?}",
                kind.name(),
                planted.words,
                planted.joints
            );
        }
        Ok(is_named)
    };
    let named: Vec<bool> = cases.par_iter().enumerate().map(named).collect::<Result<_, qv_sim::SimError>>()?;
    println!("{:<22} {}", "named first, of", ROBOTS.map(|kind| format!("{:>8}", kind.name())).concat());
    for mistake in MISTAKES {
        let of = |kind| {
            let own = || cases.iter().zip(&named).filter(|(c, _)| c.0 == mistake && c.2 == kind);
            format!("{:>8}", format!("{}/{}", own().filter(|(_, n)| **n).count(), own().count()))
        };
        println!("{:<22} {}", format!("{mistake:?}"), ROBOTS.map(of).concat());
    }
    let count = named.iter().filter(|n| **n).count();
    let [low, high] = interval(count, named.len());
    println!(
        "all: {count} of {} named first, {:.1} % ({low:.1} to {high:.1} %)",
        named.len(),
        100.0 * count as f64 / named.len() as f64
    );
    Ok(())
}
