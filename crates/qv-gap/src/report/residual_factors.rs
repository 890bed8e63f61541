//! What is left: torques that the remaining error asks for, and what they go along with.
//!
//! In each window and joint the outside torque that would explain the residual best is found from the sensitivities; it is
//! then regressed on factors of the window, one factor at a time, and judged on windows that the regression has not seen.

use crate::checks::stationarity::mean_of;
use crate::inference::linearised::{EXTRA, LinearisedProblem, LinearisedWindow};
use crate::report::Factor;
use qv_core::JointSeries;
use qv_fit::linear::{add_diagonal, add_outer, add_scaled, dot, transposed_times};
use qv_fit::{Cholesky, Matrix};

/// Parts that windows are dealt to: each is foretold from the others.
const FOLDS: usize = 4;
/// A factor that foretells less than this is not reported.
const LEAST: f64 = 0.05;

/// A factor: a name and columns of a regression from what is known of a joint in a window.
type Terms = (&'static str, fn(&JointMeans) -> Vec<f64>);

/// What is known of a joint in a window: means over it.
struct JointMeans {
    q: f64,
    dq: f64,
    sign: f64,
    torque: f64,
    acceleration: f64,
    place: [f64; 2],
    time: f64,
}

const FACTORS: [Terms; 11] = [
    ("position q", |k| vec![k.q]),
    ("sin q, cos q", |k| vec![k.q.sin(), k.q.cos()]),
    ("sin 6q, cos 6q", |k| vec![(6.0 * k.q).sin(), (6.0 * k.q).cos()]),
    ("speed dq", |k| vec![k.dq]),
    ("speed squared |dq| dq", |k| vec![k.dq * k.dq.abs()]),
    ("direction sign dq", |k| vec![k.sign]),
    ("torque tau", |k| vec![k.torque]),
    ("load in the direction of motion |tau| sign dq", |k| vec![k.torque.abs() * k.sign]),
    ("acceleration of the command", |k| vec![k.acceleration]),
    ("place x, y", |k| vec![k.place[0], k.place[1]]),
    ("time", |k| vec![k.time]),
];

/// Factors that foretell what is left of a study, best first.
pub fn factors(study: &LinearisedProblem) -> Vec<Factor> {
    let Some(asked) = asked(study) else { return Vec::new() };
    let joints = study.rollout.columns.len();
    let known: Vec<Vec<JointMeans>> =
        study.seen.iter().map(|s| (0..joints).map(|j| known(study, s, j)).collect()).collect();
    let mut found: Vec<Factor> = FACTORS
        .iter()
        .map(|(name, terms)| Factor { factor: (*name).into(), r2_heldout: held_out_r2(&asked, &known, *terms) })
        .filter(|f| f.r2_heldout > LEAST)
        .collect();
    found.sort_by(|a, b| b.r2_heldout.total_cmp(&a.r2_heldout));
    found
}

/// Outside torque that each window asks for at each joint \[N m\]; `None` without such an effect.
fn asked(study: &LinearisedProblem) -> Option<Vec<Vec<f64>>> {
    let columns = &study.columns;
    let effect = columns
        .effects
        .iter()
        .position(|e| e.axes.iter().any(|a| a.moves.keys().any(|m| m.ends_with(".external_torque"))))?;
    let units: Vec<usize> = (0..columns.units.len()).filter(|&u| columns.units[u].effect == effect).collect();
    let of: Vec<(usize, f64)> =
        units.iter().filter_map(|&u| columns.column(u, 0).map(|c| (EXTRA + c, columns.columns[c].value))).collect();
    let span = columns.effects[effect].span();
    let ask = |seen: &LinearisedWindow| {
        let b = transposed_times(&seen.j, &seen.residual);
        let n = of.len();
        let mut h = Matrix::from_fn(n, n, |i, j| seen.h[(of[i].0, of[j].0)]);
        // A weak prior keeps joints that nothing moves at zero.
        (0..n).for_each(|i| h[(i, i)] += (of[i].1 / (0.1 * span)).powi(2));
        let g: Vec<f64> = of.iter().map(|(at, _)| b[*at]).collect();
        Cholesky::new(&h).map_or(vec![0.0; n], |c| c.solve(&g).iter().zip(&of).map(|(a, (_, v))| a * v).collect())
    };
    Some(study.seen.iter().map(ask).collect())
}

fn known(study: &LinearisedProblem, seen: &LinearisedWindow, joint: usize) -> JointMeans {
    let (view, column) = (&seen.window.view, study.rollout.columns[joint]);
    let (from, to) = (seen.window.start, seen.window.start + study.rollout.cut.window);
    let mean = |series, of| mean_of(study, seen, joint, series, of);
    let slope = |series: &Option<JointSeries>| {
        let Some(s) = series.as_ref().filter(|s| column < s.joints && !s.is_empty()) else { return 0.0 };
        let at = |t: f64| s.hold(t)[column];
        (at(to) - 2.0 * at(0.5 * (from + to)) + at(from)) / (0.5 * (to - from)).powi(2)
    };
    let m = &view.measured;
    let place = crate::inference::regions::place(&seen.window);
    JointMeans {
        q: mean(&m.position, |x| x),
        dq: mean(&m.velocity, |x| x),
        sign: mean(&m.velocity, |x| if x.abs() > 0.05 { x.signum() } else { 0.0 }),
        torque: mean(&m.torque, |x| x),
        acceleration: slope(&view.commands.position),
        place: place.map(|c| if c.is_finite() { c } else { 0.0 }),
        time: from,
    }
}

/// Share of the variance of what joints are asked that a factor foretells, each joint with coefficients of its own.
fn held_out_r2(asked: &[Vec<f64>], known: &[Vec<JointMeans>], terms: fn(&JointMeans) -> Vec<f64>) -> f64 {
    let joints = asked.first().map_or(0, Vec::len);
    let (mut left, mut all) = (0.0, 0.0);
    for j in 0..joints {
        for fold in 0..FOLDS {
            let (train, test): (Vec<usize>, Vec<usize>) = (0..asked.len()).partition(|w| w % FOLDS != fold);
            let row = |w: usize| [vec![1.0], terms(&known[w][j])].concat();
            let size = row(0).len();
            let mut normal = Matrix::zeros(size, size);
            add_diagonal(&mut normal, &vec![1e-9; size]);
            let mut right = vec![0.0; size];
            for &w in &train {
                let x = row(w);
                add_scaled(&mut right, asked[w][j], &x);
                add_outer(&mut normal, 1.0, &x);
            }
            let Some(factor) = Cholesky::new(&normal) else { continue };
            let coefficients = factor.solve(&right);
            let mean = train.iter().map(|&w| asked[w][j]).sum::<f64>() / train.len().max(1) as f64;
            for &w in &test {
                left += (asked[w][j] - dot(&coefficients, &row(w))).powi(2);
                all += (asked[w][j] - mean).powi(2);
            }
        }
    }
    if all > 0.0 { 1.0 - left / all } else { 0.0 }
}
