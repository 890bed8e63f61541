//! Torques from outside for a while: stretches of a joint's balance that are farther off than any of the references.

use crate::balance::{Balance, Equation, Kind};
use crate::evidence::Event;
use crate::gram::Layout;
use crate::signal::quantile;
use qv_fit::linear::{add_scaled, squared};

/// Lengths of windows, in rows of 0.04 s.
const LENGTHS: [usize; 5] = [3, 6, 12, 25, 50];
/// Most events that are looked for.
const MOST: usize = 40;

/// What an equation leaves with values of all columns; `values` have that of `y` (1) as the last.
pub(crate) fn left(equation: &Equation, layout: Layout, values: &[f64]) -> Vec<f64> {
    let mut rows = equation.values[equation.values.len() - 1].clone();
    for (column, of) in equation.columns.iter().zip(&equation.values) {
        add_scaled(&mut rows, values[layout.place(*column)], of);
    }
    rows
}

/// Share of windows that count as the tail of all.
const TAIL: f64 = 0.1;

/// How far means over windows wander in references.
pub(crate) struct Wander {
    /// Root mean square of means, shape `[equations][lengths]`.
    spread: Vec<Vec<f64>>,
    /// Of means over that of other references, all equations together: where the tail begins, its mean excess, and the largest; shape `[lengths]`.
    tails: Vec<[f64; 3]>,
}

impl Wander {
    /// Of what references leave, each by the others: shape `[references][equations][rows]`.
    pub fn of(left: &[Vec<Vec<f64>>]) -> Self {
        let equations = left.first().map_or(0, Vec::len);
        let rms = |e: usize, length: usize, without: Option<usize>| {
            let others = left.iter().enumerate().filter(|(r, _)| Some(*r) != without);
            let all: Vec<f64> = others.flat_map(|(_, r)| means(&r[e], length)).map(|m| m.1).collect();
            (squared(&all) / all.len().max(1) as f64).sqrt().max(1e-12)
        };
        let tail = |length: usize| {
            let of = |r: usize, e: usize| {
                let scale = rms(e, length, Some(r));
                means(&left[r][e], length).into_iter().map(move |m| m.1.abs() / scale).collect::<Vec<f64>>()
            };
            let all: Vec<f64> = (0..left.len()).flat_map(|r| (0..equations).flat_map(move |e| of(r, e))).collect();
            let begins = quantile(all.clone(), 1.0 - TAIL);
            let beyond: Vec<f64> = all.iter().filter(|z| **z > begins).map(|z| z - begins).collect();
            let excess = beyond.iter().sum::<f64>() / beyond.len().max(1) as f64;
            [begins, excess.max(1e-3), all.iter().fold(0.0, |a: f64, z| a.max(*z))]
        };
        Self {
            spread: (0..equations).map(|e| LENGTHS.iter().map(|&l| rms(e, l, None)).collect()).collect(),
            tails: LENGTHS.iter().map(|&l| tail(l)).collect(),
        }
    }
}

/// Start and mean of windows, a quarter of a window apart.
fn means(rows: &[f64], length: usize) -> Vec<(usize, f64)> {
    let starts = (0..).step_by((length / 4).max(1)).take_while(|s| s + length <= rows.len());
    starts.map(|s| (s, rows[s..s + length].iter().sum::<f64>() / length as f64)).collect()
}

/// Windows of a recording that are farther off than by chance (`alpha`, all together) and than any of the references, largest first.
/// `left` has the rows of each equation; `scale` is how much more than references the robot is taken to wander.
pub(crate) fn scan(
    balance: &Balance,
    left: &[Vec<f64>],
    (wander, scale): (&Wander, f64),
    names: &[String],
    alpha: f64,
) -> Vec<Event> {
    let rows = balance.time.len();
    let joints = balance.equations.iter().filter(|e| e.kind == Kind::Balance).count();
    let mut found: Vec<(f64, usize, usize, usize, f64)> = Vec::new();
    for (e, own) in left.iter().enumerate().filter(|(e, _)| balance.equations[*e].kind == Kind::Balance) {
        for (k, &length) in LENGTHS.iter().enumerate() {
            let ([begins, excess, largest], looked) =
                (wander.tails[k], (rows / length * joints * LENGTHS.len()) as f64);
            for (start, mean) in means(own, length) {
                let is_one_run = balance.run[start] == balance.run[start + length - 1];
                let z = mean.abs() / (scale * wander.spread[e][k]);
                // An exponential tail, which is longer than a normal one (Pickands, Annals of Statistics 3, 1975, with shape 0).
                let p = looked * TAIL * (-(z - begins) / excess).exp();
                if is_one_run && p < alpha && z > largest {
                    found.push((z, e, start, length, p));
                }
            }
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut taken: Vec<(usize, usize, usize, f64)> = Vec::new();
    for (_, e, start, length, p) in found {
        let (from, until) = trimmed(&left[e], start, start + length);
        let is_free = taken.iter().all(|t| t.0 != e || from >= t.2 || t.1 >= until);
        if is_free && taken.len() < MOST {
            taken.push((e, from, until, p));
        }
    }
    let all = joined(balance, left, taken);
    all.iter().map(|&(e, from, until, p)| event(balance, &left[e], names, (e, from, until), p)).collect()
}

/// The rows about the largest of a window in which it is above half of that, means over three rows: a window may be longer than its event.
fn trimmed(left: &[f64], start: usize, end: usize) -> (usize, usize) {
    let total: f64 = left[start..end].iter().sum();
    let smooth = |k: usize| {
        let (from, until) = (k.saturating_sub(1).max(start), (k + 2).min(end));
        total.signum() * left[from..until].iter().sum::<f64>() / (until - from) as f64
    };
    let peak = (start..end).max_by(|&a, &b| smooth(a).total_cmp(&smooth(b))).unwrap_or(start);
    let half = 0.5 * smooth(peak);
    let from = (start..peak).rev().take_while(|&k| smooth(k) > half).last().unwrap_or(peak);
    let until = (peak..end).take_while(|&k| smooth(k) > half).last().unwrap_or(peak) + 1;
    (from, until)
}

/// Windows of one sign that follow each other without a window between them are one, largest first.
fn joined(
    balance: &Balance,
    left: &[Vec<f64>],
    mut taken: Vec<(usize, usize, usize, f64)>,
) -> Vec<(usize, usize, usize, f64)> {
    let sign = |e: usize, from: usize, until: usize| left[e][from..until].iter().sum::<f64>() > 0.0;
    taken.sort_by_key(|t| (t.0, t.1));
    let mut all: Vec<(usize, usize, usize, f64)> = Vec::new();
    for (e, from, until, p) in taken {
        match all.last_mut() {
            Some(last)
                if last.0 == e
                    && from <= last.2 + LENGTHS[0]
                    && balance.run[from] == balance.run[last.1]
                    && sign(e, from, until) == sign(e, last.1, last.2) =>
            {
                (last.2, last.3) = (until, last.3.min(p));
            }
            _ => all.push((e, from, until, p)),
        }
    }
    all.sort_by(|a, b| a.3.total_cmp(&b.3));
    all
}

fn event(balance: &Balance, left: &[f64], names: &[String], (e, from, until): (usize, usize, usize), p: f64) -> Event {
    // What pushes a joint along takes from the torque that its motor needs.
    let mean = left[from..until].iter().sum::<f64>() / (until - from) as f64;
    let time = [balance.time[from], balance.time[until - 1]];
    Event { joint: names[balance.equations[e].joint].clone(), run: balance.run[from], time, torque: -mean, p }
}
