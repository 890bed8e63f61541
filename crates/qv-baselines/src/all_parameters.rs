//! All global parameters of the library at once, by CMA-ES. What moved farthest is named: the way in which a robot is
//! calibrated as a whole, and then looked at.

use crate::cma_es::CmaEs;
use crate::one_at_a_time::{absent, largest};
use crate::plain::Plain;
use crate::{Answer, Size, sizes};
use qv_gap::GapError;
use qv_gap::problem::columns::{Columns, Suspect};
use qv_rollout::Overrides;

/// Windows of each evaluation: fewer windows make more generations of the same budget.
const WINDOWS: usize = 12;
/// First step of each parameter, as a share of its range.
const SIGMA: f64 = 0.03;
/// Least share of its largest measured value that a limit may have.
const LEAST_LIMIT: f64 = 0.1;

/// A parameter of the search: an axis of an effect on all that it acts on, from 0 to 1 along its range.
struct Knob {
    group: usize,
    axis: usize,
    low: f64,
    high: f64,
    /// Where the effect is absent, 0 to 1.
    neutral: f64,
    /// Whether 1 stands for no limit at all.
    is_limit: bool,
}

/// Searches with about `budget` simulated steps.
///
/// # Errors
/// When a setting has a value that means nothing.
pub fn answer(plain: &mut Plain, without: &[String], budget: usize, seed: u64) -> Result<Answer, GapError> {
    let knobs = knobs(&plain.study.columns, without);
    if knobs.is_empty() {
        return Ok(Answer::new("no_gap", Vec::new(), Vec::new(), 0.0));
    }
    let start: Vec<f64> = knobs.iter().map(|k| k.neutral).collect();
    let best = search(plain, &knobs, &start, budget, seed)?;
    let setting = setting(plain, &knobs, &best);
    let closed = plain.closed(&setting)?;
    let columns = &plain.study.columns;
    let ranked = ranked(columns, &knobs, &best);
    let moved = suspects(columns, &knobs, &best);
    let of = |name: &str| {
        let of_name = |s: &&Suspect| columns.effects[columns.groups[s.group].effect].name == name;
        moved.iter().filter(of_name).flat_map(|s| sizes(columns, s)).collect::<Vec<Size>>()
    };
    let of_first = ranked.first().map_or(Vec::new(), |name| of(name));
    let verdict = if ranked.is_empty() { "no_gap" } else { "explained" };
    Ok(Answer::new(verdict, ranked, of_first, closed))
}

/// A knob for each axis of each effect: on all members, or on each where they cannot be moved together.
fn knobs(columns: &Columns, without: &[String]) -> Vec<Knob> {
    let together: Vec<bool> = (0..columns.effects.len())
        .map(|e| columns.groups.iter().any(|g| g.effect == e && g.names == ["all"]))
        .collect();
    let mut knobs = Vec::new();
    for (group, of) in columns.groups.iter().enumerate() {
        let effect = &columns.effects[of.effect];
        let is_global = !together[of.effect] || of.names == ["all"];
        if is_global && !without.contains(&effect.name) {
            knobs.extend((0..effect.axes.len()).filter_map(|axis| knob(columns, group, axis)));
        }
    }
    knobs
}

/// `None` for a limit of what was not measured.
fn knob(columns: &Columns, group: usize, axis: usize) -> Option<Knob> {
    let [mut low, mut high] = columns.effects[columns.groups[group].effect].range;
    let absent = absent(columns, group, axis);
    let is_limit = !absent.is_finite();
    if is_limit {
        // Above the largest value that was measured a limit does nothing.
        let largest = largest(columns, group);
        (low, high) = (low.max(LEAST_LIMIT * largest), high.min(largest));
        if low >= high {
            return None;
        }
    }
    let neutral = if is_limit { 1.0 } else { ((absent - low) / (high - low)).clamp(0.0, 1.0) };
    Some(Knob { group, axis, low, high, neutral, is_limit })
}

/// The suspects that stand for a point; knobs of one group belong together.
fn suspects(columns: &Columns, knobs: &[Knob], point: &[f64]) -> Vec<Suspect> {
    let mut all: Vec<Suspect> = Vec::new();
    for (knob, &u) in knobs.iter().zip(point) {
        if knob.is_limit && u >= 1.0 {
            continue;
        }
        let value = knob.low + u * (knob.high - knob.low);
        match all.last_mut().filter(|s| s.group == knob.group) {
            Some(suspect) => suspect.values[knob.axis] = value,
            None => {
                let axes = columns.effects[columns.groups[knob.group].effect].axes.len();
                let mut values: Vec<f64> = (0..axes).map(|a| absent(columns, knob.group, a)).collect();
                values[knob.axis] = value;
                all.push(Suspect::everywhere(knob.group, values));
            }
        }
    }
    all
}

fn setting(plain: &Plain, knobs: &[Knob], point: &[f64]) -> Overrides {
    let study = &plain.study;
    study.columns.setting_of(&study.rollout, &suspects(&study.columns, knobs, point))
}

/// The best point of all generations.
fn search(plain: &mut Plain, knobs: &[Knob], start: &[f64], budget: usize, seed: u64) -> Result<Vec<f64>, GapError> {
    let windows = plain.some(WINDOWS);
    let nominal = windows.iter().map(|&w| plain.nominal(w)).sum::<f64>() / windows.len().max(1) as f64;
    let (mut best, mut least) = (start.to_vec(), nominal);
    let mut cma = CmaEs::new(start, SIGMA, seed);
    let until = plain.study.steps() + budget;
    while plain.study.steps() < until && !windows.is_empty() {
        let points = cma.ask();
        let inside: Vec<Vec<f64>> = points.iter().map(|x| x.iter().map(|u| u.clamp(0.0, 1.0)).collect()).collect();
        let settings: Vec<Overrides> = inside.iter().map(|x| setting(plain, knobs, x)).collect();
        let losses = plain.losses(&settings, &windows)?;
        let mut values = Vec::with_capacity(points.len());
        for ((x, inside), of_window) in points.iter().zip(&inside).zip(&losses) {
            let loss = of_window.iter().sum::<f64>() / windows.len().max(1) as f64;
            if loss < least {
                (best, least) = (inside.clone(), loss);
            }
            // Outside the ranges: the loss at the nearest point inside, and a penalty that grows with the distance
            // (appendix B.5 of the tutorial).
            let outside: f64 = x.iter().zip(inside).map(|(a, b)| (a - b).powi(2)).sum();
            values.push(loss + nominal * outside);
        }
        cma.tell(&values);
    }
    Ok(best)
}

/// Effects by how far their parameters moved from absent, in units of their ranges.
fn ranked(columns: &Columns, knobs: &[Knob], point: &[f64]) -> Vec<String> {
    let mut moved: Vec<(String, f64)> = Vec::new();
    for (knob, u) in knobs.iter().zip(point) {
        let name = &columns.effects[columns.groups[knob.group].effect].name;
        let far = (u - knob.neutral).abs();
        match moved.iter_mut().find(|m| m.0 == *name) {
            Some(m) => m.1 = m.1.max(far),
            None => moved.push((name.clone(), far)),
        }
    }
    moved.sort_by(|a, b| b.1.total_cmp(&a.1));
    moved.into_iter().filter(|m| m.1 > 0.0).map(|m| m.0).collect()
}
