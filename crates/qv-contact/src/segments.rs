//! Segments of some seconds replayed open loop: the error of the base, and the grid search of QuadVerse's paper.

use crate::ContactError;
use crate::measured::{Recording, TICK};
use crate::simulate::{Simulator, Task};
use serde::Serialize;

/// Every third segment is kept away from every fit.
const HELD_OUT: usize = 3;
/// Square of the distance of a simulation that ran away, at least \[m²\].
const RAN_AWAY: f64 = 1.0;
/// Rounds over the labels.
const ROUNDS: usize = 2;

/// A stretch of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Segment {
    /// Recording.
    pub run: usize,
    /// First instant.
    pub from: usize,
    /// Number of ticks.
    pub ticks: usize,
    /// Whether no fit sees it.
    pub held_out: bool,
    /// Labels under standing feet in it.
    pub labels: Vec<usize>,
}

/// Segments of `length` \[s\] one after the other, where nothing is missing.
pub fn cut(recordings: &[Recording], length: f64) -> Vec<Segment> {
    let ticks = (length / TICK).round().max(1.0) as usize;
    let mut segments = Vec::new();
    for (run, recording) in recordings.iter().enumerate() {
        let mut from = 0;
        while from + ticks < recording.instants.len() {
            match recording.touched(from, from + ticks) {
                Some(labels) => {
                    let held_out = segments.len() % HELD_OUT == HELD_OUT - 1;
                    segments.push(Segment { run, from, ticks, held_out, labels });
                    from += ticks;
                }
                None => from += 1,
            }
        }
    }
    segments
}

/// Errors of the base \[m\] in each segment under each set of frictions, shape `[segments][sets]`: means over time of the
/// distance between simulated and measured position; a metre at least from when a simulation ran away on.
///
/// # Errors
/// When the simulator refuses.
pub fn base_errors(
    simulator: &Simulator,
    recordings: &[Recording],
    segments: &[Segment],
    sets: &[Vec<f64>],
    done: &(dyn Fn(usize) + Sync),
) -> Result<Vec<Vec<f64>>, ContactError> {
    squares_and_errors(simulator, recordings, segments, sets, done)
        .map(|all| all.into_iter().map(|of| of.into_iter().map(|e| e[1]).collect()).collect())
}

/// Mean square and mean of the distance in each segment under each set.
fn squares_and_errors(
    simulator: &Simulator,
    recordings: &[Recording],
    segments: &[Segment],
    sets: &[Vec<f64>],
    done: &(dyn Fn(usize) + Sync),
) -> Result<Vec<Vec<[f64; 2]>>, ContactError> {
    let ticks = segments.first().map_or(0, |s| s.ticks);
    let tasks: Vec<Task> =
        segments.iter().map(|s| Task { run: s.run, from: s.from, frictions: sets.to_vec() }).collect();
    let simulated = simulator.run(recordings, &tasks, ticks, done)?;
    let of = |(segment, of_sets): (&Segment, &Vec<Vec<qv_sim::State>>)| {
        let instants = &recordings[segment.run].instants;
        let apart = |states: &Vec<qv_sim::State>| {
            let distances = states.iter().enumerate().filter_map(|(k, s)| {
                let measured = &instants[segment.from + k + 1].as_ref()?.state;
                Some((0..3).map(|a| (s.q[a] - measured.q[a]).powi(2)).sum::<f64>())
            });
            let squares: Vec<f64> = distances.collect();
            // What ran away is as far off as can be, not as good as the little that is left of it.
            let missing = ticks.saturating_sub(states.len());
            let worst = squares.iter().copied().fold(RAN_AWAY, f64::max);
            let squares: Vec<f64> = squares.into_iter().chain(std::iter::repeat_n(worst, missing)).collect();
            let count = squares.len().max(1) as f64;
            [squares.iter().sum::<f64>() / count, squares.iter().map(|s| s.sqrt()).sum::<f64>() / count]
        };
        of_sets.iter().map(apart).collect()
    };
    Ok(segments.iter().zip(&simulated).map(of).collect())
}

/// The discrepancy of one label by friction.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Search {
    /// The friction of the least discrepancy.
    pub friction: f64,
    /// Frictions, and root mean square distance of the base \[m\] over the segments that touch the label.
    pub curve: Vec<[f64; 2]>,
}

/// The paper's search (its equation for `mu*`): for each label of `wanted` in turn, the friction on a grid whose replay of
/// the segments' commands is nearest to the recorded base positions, in sum of squares; two rounds, since a segment
/// touches several labels. Segments that are held out do not count.
///
/// # Errors
/// When the simulator refuses.
pub fn search(
    simulator: &Simulator,
    recordings: &[Recording],
    segments: &[Segment],
    start: &[f64],
    wanted: &[usize],
    grid: &[f64],
    done: &(dyn Fn(usize) + Sync),
) -> Result<Vec<Option<Search>>, ContactError> {
    let mut frictions = start.to_vec();
    let mut found: Vec<Option<Search>> = vec![None; start.len()];
    for _ in 0..ROUNDS {
        for &label in wanted {
            let fits = |s: &&Segment| !s.held_out && s.labels.contains(&label);
            let touching: Vec<Segment> = segments.iter().filter(fits).cloned().collect();
            if touching.is_empty() {
                continue;
            }
            let with = |mu: &f64| {
                let mut set = frictions.clone();
                set[label] = *mu;
                set
            };
            let sets: Vec<Vec<f64>> = grid.iter().map(with).collect();
            let errors = squares_and_errors(simulator, recordings, &touching, &sets, done)?;
            let mean = |k: usize| errors.iter().map(|e| e[k][0]).sum::<f64>() / errors.len() as f64;
            let curve: Vec<[f64; 2]> = grid.iter().enumerate().map(|(k, mu)| [*mu, mean(k).sqrt()]).collect();
            let least = curve.iter().min_by(|a, b| a[1].total_cmp(&b[1])).map_or(start[label], |c| c[0]);
            frictions[label] = least;
            found[label] = Some(Search { friction: least, curve });
        }
    }
    Ok(found)
}
