//! Measured tosses of a box reproduced from their start states, and the friction that fits them best:
//! `cargo run --release -p quadverse-sim --example cube_tosses -- TOSSES.csv [EDGE MASS INERTIA]` \[m, kg, kg m²\].

mod interval;
mod tosses;

use qv_sim::{Model, State};
use tosses::{Cube, Setting, Toss, TossError, errors, mean, median, parse, simulate, turning_convention};

/// Most samples that a start is fitted to.
const FITTED: usize = 10;
/// Height of the lowest corner from which a sample counts as flight \[m\].
const CLEARANCE: f64 = 0.003;

fn main() {
    if let Err(error) = run() {
        eprintln!("{error}");
        std::process::exit(1);
    }
}

/// What every run of the tosses needs.
struct Bench {
    model: Model,
    tosses: Vec<Toss>,
    starts: Vec<State>,
}

impl Bench {
    fn run(&self, setting: &[(&str, f64)]) -> Result<Vec<TossError>, String> {
        Ok(errors(&self.tosses, &simulate(&self.model, &self.tosses, &self.starts, setting)?))
    }
}

fn run() -> Result<(), String> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (Some(path), cube) = (arguments.first(), cube(&arguments)?) else {
        return Err("expected: cube_tosses TOSSES.csv [EDGE MASS INERTIA], found no file".into());
    };
    let text = std::fs::read_to_string(path).map_err(|error| format!("{path}: {error}"))?;
    let tosses = parse(&text).map_err(|error| format!("{path}: {error}"))?;
    let (in_box, in_world) = turning_convention(&tosses);
    println!(
        "{} tosses; angular velocity differs from the poses by {in_box:.2} rad/s read in box axes, {in_world:.2} in world axes",
        tosses.len()
    );
    if in_world < in_box {
        return Err("expected angular velocities in box axes, found them in world axes".into());
    }
    let resting = tosses.iter().map(|toss| cube.lowest_corner(&toss.samples[toss.samples.len() - 1])).collect();
    let sunk = median(resting);
    println!("lowest corner at the end, median: {:.2} mm", 1e3 * sunk);
    let written = tosses.iter().map(Toss::start_as_written).collect();
    let flights: Vec<usize> = tosses.iter().map(|toss| toss.flight(&cube, CLEARANCE, FITTED)).collect();
    let fitted = tosses.iter().zip(&flights).map(|(toss, &n)| toss.start_fitted(&toss.samples[..n])).collect();
    let model = cube.model().map_err(|error| error.to_string())?;
    let mut bench = Bench { model, tosses, starts: written };
    println!("\nmean position error [mm], neutral contact, by start:");
    for friction in [0.18, 0.22] {
        println!(
            "  friction {friction:.2}, start as written: {:.2}",
            1e3 * mean(&bench.run(&[("contact.friction", friction)])?)
        );
    }
    bench.starts = fitted;
    per_toss(&bench)?;
    let best =
        scan(&bench, vec![("contact.friction", 0.2), ("contact.restitution", 0.0), ("contact.time_constant", 0.008)])?;
    let (friction, [low, high]) = interval::friction(&bench, best.clone())?;
    println!("friction {friction:.4}, 95 % interval {low:.4} to {high:.4} over {} tosses", bench.tosses.len());
    limits(&bench, &flights, best.clone())?;
    println!("\nthe same with the plane where the box came to rest ({:.2} mm):", 1e3 * sunk);
    let mut lowered = best;
    lowered.push(("terrain.height", sunk));
    scan(&bench, lowered)?;
    Ok(())
}

fn cube(arguments: &[String]) -> Result<Cube, String> {
    let mut values = [0.1048, 0.37, 0.00081];
    for (value, text) in values.iter_mut().zip(arguments.iter().skip(1)) {
        *value = text
            .parse()
            .ok()
            .filter(|x: &f64| x.is_finite() && *x > 0.0)
            .ok_or_else(|| format!("edge, mass, inertia: expected positive numbers, found {text:?}"))?;
    }
    let [edge, mass, inertia] = values;
    Ok(Cube { edge, mass, inertia })
}

/// Both published frictions, toss by toss.
fn per_toss(bench: &Bench) -> Result<(), String> {
    let (low, high) = (bench.run(&[("contact.friction", 0.18)])?, bench.run(&[("contact.friction", 0.22)])?);
    println!("\nstart fitted to the flight; mean (and last) position error per toss [mm]:");
    println!("| toss | friction 0.18 | 0.22 |\n|---:|---:|---:|");
    for ((toss, a), b) in bench.tosses.iter().zip(&low).zip(&high) {
        let text = |e: &TossError| format!("{:.2} ({:.2})", 1e3 * e.mean, 1e3 * e.last);
        println!("| {} | {} | {} |", toss.number, text(a), text(b));
    }
    println!("| mean | {:.2} | {:.2} |", 1e3 * mean(&low), 1e3 * mean(&high));
    let middle = |errors: &[TossError]| 1e3 * median(errors.iter().map(|e| e.mean).collect());
    println!("| median | {:.2} | {:.2} |", middle(&low), middle(&high));
    Ok(())
}

/// Values that are tried of each parameter.
fn tried(name: &str) -> Vec<f64> {
    match name {
        "contact.friction" => (5..=50).step_by(1).map(|k| 0.01 * f64::from(k)).collect(),
        "contact.restitution" => (0..=12).map(|k| 0.05 * f64::from(k)).collect(),
        _ => vec![0.002, 0.003, 0.004, 0.006, 0.008, 0.012, 0.016, 0.024, 0.032, 0.05],
    }
}

/// One parameter after the other to its best value, twice; prints the tables of the second round.
fn scan(bench: &Bench, mut setting: Setting) -> Result<Setting, String> {
    for round in 0..2 {
        for index in 0..3 {
            let name = setting[index].0;
            let mut rows = Vec::new();
            for value in tried(name) {
                setting[index].1 = value;
                rows.push((value, mean(&bench.run(&setting)?)));
            }
            let best = rows.iter().min_by(|a, b| a.1.total_cmp(&b.1)).copied().unwrap_or((f64::NAN, f64::NAN));
            setting[index].1 = best.0;
            if round == 1 {
                let shown = rows
                    .iter()
                    .filter(|(value, _)| index > 0 || ((100.0 * value).round() as i64) % 5 == 0 || *value == best.0);
                let cells: Vec<String> =
                    shown.map(|(value, error)| format!("{value:.3}: {:.2}", 1e3 * error)).collect();
                println!("\n{name}, mean error [mm]: {}", cells.join(", "));
            }
        }
    }
    let errors = bench.run(&setting)?;
    println!("best: {setting:?}, mean error {:.2} mm", 1e3 * mean(&errors));
    Ok(setting)
}

/// Reports how much of the error comes from where: the start, and a friction that differs from toss to toss.
fn limits(bench: &Bench, flights: &[usize], mut setting: Setting) -> Result<(), String> {
    let paths = simulate(&bench.model, &bench.tosses, &bench.starts, &setting)?;
    let flown: Vec<f64> = (bench.tosses.iter().zip(&paths).zip(flights))
        .flat_map(|((toss, path), &n)| path.iter().zip(&toss.samples).take(n).map(|(p, s)| (*p - s.position).length()))
        .collect();
    println!("\nwhat limits, at the best setting:");
    println!("  in flight, where the start was fitted: {:.2} mm", 1e3 * flown.iter().sum::<f64>() / flown.len() as f64);
    // Two estimates of the same start, each from half of the poses: how far its noise is carried.
    let half = |parity: usize| -> Vec<State> {
        let of = |(toss, &n): (&Toss, &usize)| {
            let every_other: Vec<_> = toss.samples[..n].iter().skip(parity).step_by(2).copied().collect();
            toss.start_fitted(&every_other)
        };
        bench.tosses.iter().zip(flights).map(of).collect()
    };
    let even = simulate(&bench.model, &bench.tosses, &half(0), &setting)?;
    let odd = simulate(&bench.model, &bench.tosses, &half(1), &setting)?;
    let apart = even
        .iter()
        .zip(&odd)
        .map(|(a, b)| a.iter().zip(b).map(|(a, b)| (*a - *b).length()).sum::<f64>() / a.len() as f64);
    println!(
        "  starts from even and odd poses end up {:.2} mm apart in the mean",
        1e3 * apart.sum::<f64>() / even.len() as f64
    );
    let mut least = vec![(f64::INFINITY, f64::NAN); bench.tosses.len()];
    for friction in tried("contact.friction") {
        setting[0].1 = friction;
        for (best, error) in least.iter_mut().zip(bench.run(&setting)?) {
            if error.mean < best.0 {
                *best = (error.mean, friction);
            }
        }
    }
    let own = least.iter().map(|best| best.0).sum::<f64>() / least.len() as f64;
    let mut frictions: Vec<f64> = least.iter().map(|best| best.1).collect();
    frictions.sort_by(f64::total_cmp);
    let quarter = |k: usize| frictions[(k * (frictions.len() - 1)) / 4];
    println!(
        "  with each toss's own best friction: {:.2} mm; its quartiles {:.2}, {:.2}, {:.2}",
        1e3 * own,
        quarter(1),
        quarter(2),
        quarter(3)
    );
    Ok(())
}
