//! How often `drift` alarms without a change, and how often it finds changes that it says are visible, on fresh recordings of simulated robots:
//! `cargo run --release -p quadverse-gap --example drift_rates -- 100 100 7` (pairs without a change, pairs with one, seed). One line of JSON for
//! each pair, then the shares with their 95 % intervals after Wilson. Half of the pairs repeat the motion of the calibration, half move otherwise.

use qv_core::random::{SplitMix64, sub_seed};
use qv_gap::Options;
use qv_gap::drift::{Answer, Baseline, Difference, Drift, DriftPolicy};
use qv_go2::model::{ARMATURE, FOOT_LINKS, JOINT_NAMES, urdf};
use qv_recording::{BagFile, Run};
use qv_sealed::{Cause, EngineChoice, FaultRequest, Motion, Outcome, Plan, Recipe, Request, make, record};
use qv_sim::{BaseKind, Model, ModelOptions, Terrain};
use rayon::prelude::*;
use std::error::Error;
use std::io::Cursor;
use std::time::Instant;

/// Effects with a slope, which act always and everywhere.
const EFFECTS: [&str; 16] = [
    "command_latency",
    "actuator_lag",
    "joint_coulomb_friction",
    "joint_viscous_friction",
    "joint_armature",
    "motor_strength",
    "motor_gain_kp",
    "motor_gain_kd",
    "encoder_bias",
    "payload_mass",
    "com_offset",
    "link_inertia",
    "foot_radius",
    "imu_tilt",
    "gyro_bias",
    "terrain_slope",
];

type Failure = Box<dyn Error + Send + Sync>;

/// A pair of recordings, as it was judged.
struct PairResult {
    drift: Drift,
    /// Whether the truth is at least as large as what is said to be visible; `None` where no tested part is that of the truth.
    visible: Option<bool>,
    /// Whether a change of the true effect was named.
    named: bool,
    /// What it took \[s\].
    seconds: f64,
}

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<u64> = std::env::args().skip(1).map(|w| w.parse()).collect::<Result<_, _>>()?;
    let [same, changed, seed] = words[..] else { return Err("expected PAIRS CHANGES SEED".into()) };
    let model = Model::from_urdf(
        &urdf(),
        &ModelOptions { base: BaseKind::Floating, armature: ARMATURE, ..Default::default() },
    )?;
    let mut alarms = [[0, 0]; 2];
    let all: Vec<_> = (0..same).into_par_iter().map(|k| judge(&model, None, sub_seed(seed, k), k % 2 == 1)).collect();
    for (k, judged) in all.into_iter().enumerate() {
        let Some(judged) = made(judged, "none", k) else { continue };
        let k = k as u64;
        report("none", k, &judged);
        count(&mut alarms[(k % 2) as usize], judged.drift.answer == Answer::Changed);
    }
    let (mut found, mut named, mut silent) = ([[0, 0]; 2], [0, 0], [0, 0]);
    let order = |k: usize| (EFFECTS[k % EFFECTS.len()], (k / EFFECTS.len()) % 2 == 1);
    let of_order = |k: usize| judge(&model, Some(order(k).0), sub_seed(seed, 100_000 + k as u64), order(k).1);
    let all: Vec<_> = (0..changed as usize).into_par_iter().map(of_order).collect();
    for (k, judged) in all.into_iter().enumerate() {
        let (effect, other_motion) = order(k);
        let Some(judged) = made(judged, effect, k) else { continue };
        report(effect, k as u64, &judged);
        let is_found = judged.drift.answer == Answer::Changed;
        match judged.visible {
            Some(true) => {
                count(&mut found[usize::from(other_motion)], is_found);
                if is_found {
                    count(&mut named, judged.named);
                }
            }
            _ => count(&mut silent, is_found),
        }
    }
    let both = |all: [[usize; 2]; 2]| [all[0][0] + all[1][0], all[0][1] + all[1][1]];
    println!("alarms without a change: {}", share(both(alarms)));
    println!("  same motion {}; another motion {}", share(alarms[0]), share(alarms[1]));
    println!("visible changes found: {}", share(both(found)));
    println!("  same motion {}; another motion {}", share(found[0]), share(found[1]));
    println!("  of those found, the effect named: {}", share(named));
    println!("changes said not to be visible that were found: {}", share(silent));
    Ok(())
}

/// A pair; one that could not be made is reported, and counts as none.
fn made(pair: Result<PairResult, Failure>, effect: &str, index: usize) -> Option<PairResult> {
    pair.inspect_err(|e| println!("{effect} {index}: not made: {e}")).ok()
}

fn count(of: &mut [usize; 2], is_hit: bool) {
    of[0] += usize::from(is_hit);
    of[1] += 1;
}

/// A share with its interval (Wilson, Journal of the American Statistical Association 22, 1927).
fn share([hits, count]: [usize; 2]) -> String {
    let (n, z) = (count.max(1) as f64, 1.959_964_f64);
    let p = hits as f64 / n;
    let (middle, root) = (p + z * z / (2.0 * n), (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt());
    let end = |sign: f64| 100.0 * ((middle + sign * z * root) / (1.0 + z * z / n)).clamp(0.0, 1.0);
    format!("{hits} of {count} ({:.1} %, 95 % CI {:.1} to {:.1} %)", 100.0 * p, end(-1.0), end(1.0))
}

fn judge(model: &Model, effect: Option<&str>, seed: u64, other_motion: bool) -> Result<PairResult, Failure> {
    let wanted = effect.map_or(FaultRequest::Nothing, |name| FaultRequest::Effects(vec![name.into()]));
    let engine = EngineChoice::Ours;
    let request = Request { engine, wanted, motion: Motion::Mixed, down_to_unseen: effect.is_some() };
    let made = make(&request, seed)?;
    let recipe = made.drawn.recipe;
    let now = read(&made.messages)?;
    let then = read(&before(&recipe, seed, other_motion)?)?;
    let clock = Instant::now();
    let (floor, options) = (Terrain::plane(), Options::default());
    let baseline = Baseline::new(&[then], model, &floor, &options, &DriftPolicy::default())?;
    let found = baseline.compare(&[now], model, &floor, &options)?;
    let seconds = clock.elapsed().as_secs_f64();
    let cause = recipe.causes.first();
    let visible = cause.and_then(|cause| is_visible(cause, &found.parameters));
    let named = cause.is_some_and(|cause| found.changes().any(|c| c.effect == cause.effect));
    Ok(PairResult { drift: found, visible, named, seconds })
}

/// The robot of a recipe without its effect, another day: other noise, and where asked another motion.
fn before(recipe: &Recipe, seed: u64, other_motion: bool) -> Result<Vec<qv_go2::synthetic::Message>, Failure> {
    for attempt in 0..20 {
        let mut draws = SplitMix64::new(sub_seed(seed, 7000 + attempt));
        let mut before = Recipe { seed: sub_seed(seed, 8000 + attempt), ..recipe.without_effects() };
        if other_motion {
            before.plan = Plan::of(Motion::Mixed, &mut draws);
        }
        if let (Outcome::Stood { .. }, messages) = record(&before)? {
            return Ok(messages);
        }
    }
    Err("the robot falls without an effect".into())
}

/// Whether a true change is at least as large as what the row of its part and axis says is visible.
fn is_visible(cause: &Cause, rows: &[Difference]) -> Option<bool> {
    let of_effect: Vec<&Difference> =
        rows.iter().filter(|row| row.effect == cause.effect && is_part(row, cause)).collect();
    let asked = cause.figures.iter().filter(|figure| figure.asked);
    let pairs: Vec<bool> = of_effect
        .iter()
        .zip(asked)
        .map(|(row, figure)| row.visible.is_some_and(|least| figure.value.abs() >= least))
        .collect();
    if pairs.is_empty() { None } else { Some(pairs.contains(&true)) }
}

/// Whether a row is of the parts of the robot that a cause acts on.
fn is_part(row: &Difference, cause: &Cause) -> bool {
    let all: &[&str] = if cause.effect == "foot_radius" { &FOOT_LINKS } else { &JOINT_NAMES };
    let of_cause: Vec<bool> = all.iter().map(|part| names(cause, part)).collect();
    let is_begin = |name: &String, part: &str| {
        part == name || part.strip_prefix(name.as_str()).is_some_and(|rest| rest.starts_with('_'))
    };
    let is_all = row.scope == ["all"];
    if !of_cause.contains(&true) {
        // Of the body or the world.
        return is_all || row.scope.iter().any(|name| name == "base");
    }
    let of_row: Vec<bool> =
        all.iter().map(|part| is_all || row.scope.iter().any(|name| is_begin(name, part))).collect();
    of_row == of_cause
}

fn names(cause: &Cause, part: &str) -> bool {
    cause.settings.iter().any(|(name, _)| name.contains(part))
}

fn read(messages: &[qv_go2::synthetic::Message]) -> Result<Run, Failure> {
    let mut bytes = Cursor::new(Vec::new());
    qv_go2::synthetic::write_bag(messages, &mut bytes)?;
    bytes.set_position(0);
    let file = BagFile { name: "simulated".into(), source: bytes };
    Ok(qv_recording::read_bag(vec![file], &qv_go2::wire::mapping(None))?)
}

fn report(effect: &str, index: u64, judged: &PairResult) {
    let drift = &judged.drift;
    let most = drift.parameters.iter().map(|p| p.p_corrected).fold(1.0, f64::min);
    println!(
        "{effect} {index}: {:?}, least p {most:.2e}, visible {:?}, named {}, levels {:.2} {:.2}, {:.1} s; {}",
        drift.answer, judged.visible, judged.named, drift.levels[0], drift.levels[1], judged.seconds, drift.sentence
    );
}
