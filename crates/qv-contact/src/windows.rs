//! Friction from short windows: what each window says of the friction of each label that it touches.

use crate::ContactError;
use crate::measured::{Recording, difference, heading};
use crate::simulate::{Simulator, Task};
use crate::whiten::{FEWEST, Usual};
use qv_sim::State;
use std::collections::BTreeMap;

/// Length of a window, in ticks.
pub const TICKS: usize = 2;
/// Windows that count as one when asked how much they agree.
const CLUSTER: usize = 5;
/// Ratio by which frictions are changed to see whether a window asks for them.
const NUDGE: f64 = 1.35;
/// Square for each number by which the simulated end of a window moves under that, below which it does not ask.
const UNMOVED: f64 = 0.02;

/// A window, from an instant of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Window {
    /// Recording.
    pub run: usize,
    /// Instant that it starts from.
    pub from: usize,
    /// Labels under standing feet in it.
    pub labels: Vec<usize>,
}

impl Window {
    pub(crate) fn cluster(&self) -> usize {
        // Runs apart from each other; no run has a million clusters.
        self.run * 1_000_000 + self.from / (TICKS * CLUSTER)
    }

    /// A simulation of it under each of these sets of frictions.
    fn task(&self, frictions: Vec<Vec<f64>>) -> Task {
        Task { run: self.run, from: self.from, frictions }
    }

    /// Measured minus simulated states at its ticks; empty when the simulation ran away.
    fn difference(&self, recordings: &[Recording], states: &[State]) -> Vec<f64> {
        let instants = &recordings[self.run].instants;
        let measured = |k: usize| instants.get(self.from + k).and_then(Option::as_ref).map(|i| &i.state);
        let Some(start) = measured(0) else { return Vec::new() };
        let mut out = Vec::new();
        for (k, simulated) in states.iter().enumerate() {
            let Some(state) = measured(k + 1) else { return Vec::new() };
            out.extend(difference(state, simulated, heading(start)));
        }
        if states.len() == TICKS { out } else { Vec::new() }
    }
}

/// Windows one after the other in which feet stand on a label, but for those that overlap a stretch in `away` (run, first
/// and last instant); evenly spread ones where there are more than `most`.
pub fn cut(recordings: &[Recording], away: &[(usize, usize, usize)], most: usize) -> Vec<Window> {
    let mut windows = Vec::new();
    for (run, recording) in recordings.iter().enumerate() {
        for from in (0..recording.instants.len().saturating_sub(TICKS)).step_by(TICKS) {
            let overlaps = |a: &&(usize, usize, usize)| a.0 == run && a.1 < from + TICKS && from < a.2;
            let Some(labels) = recording.touched(from, from + TICKS) else { continue };
            if !labels.is_empty() && away.iter().find(overlaps).is_none() {
                windows.push(Window { run, from, labels });
            }
        }
    }
    let all = windows.len();
    if all <= most { windows } else { (0..most).map(|k| windows[k * all / most].clone()).collect() }
}

/// What windows say of one label.
pub struct Losses {
    /// For each window that touches it: cluster, and loss for each friction of the grid.
    pub windows: Vec<(usize, Vec<f64>)>,
    /// Root mean square over windows by which their ends move when the friction changes by a tenth, in units of what is
    /// usual, by friction of the grid (between it and the next).
    pub movement: Vec<f64>,
}

/// Windows that do not ask for friction, and what is usual in them.
pub struct Background {
    /// Usual differences.
    pub usual: Usual,
    /// Windows that the middle and spread are of.
    pub windows: usize,
    /// Whether those were all windows, since too few do not ask for friction.
    pub is_of_all: bool,
}

/// What differences are usual when frictions are these.
///
/// # Errors
/// When there are too few windows, or the simulator refuses.
pub fn background(
    simulator: &Simulator,
    recordings: &[Recording],
    windows: &[Window],
    frictions: &[f64],
) -> Result<Background, ContactError> {
    let sets = [1.0, NUDGE, 1.0 / NUDGE].map(|f| frictions.iter().map(|mu| mu * f).collect::<Vec<f64>>());
    let tasks: Vec<Task> = windows.iter().map(|w| w.task(sets.to_vec())).collect();
    let simulated = simulator.run(recordings, &tasks, TICKS, &|_| {})?;
    let differences: Vec<[Vec<f64>; 3]> = windows
        .iter()
        .zip(&simulated)
        .map(|(w, of)| std::array::from_fn(|k| w.difference(recordings, &of[k])))
        .collect();
    let all: Vec<Vec<f64>> = differences.iter().map(|d| d[0].clone()).collect();
    let few = || {
        let expected =
            format!("at least {FEWEST} windows of 0.1 s in which the robot stands on a label and can be simulated");
        let ended = all.iter().filter(|d| !d.is_empty()).count();
        ContactError::run("recording", expected, format!("{ended}, of {} in which it stands on one", windows.len()))
    };
    let rough = Usual::of(&all).ok_or_else(few)?;
    let is_unmoved = |d: &&[Vec<f64>; 3]| {
        let size = d[0].len().max(1) as f64;
        [1, 2].iter().all(|&k| rough.distance(&d[0], &d[k]) < UNMOVED * size)
    };
    let calm: Vec<Vec<f64>> = differences.iter().filter(is_unmoved).map(|d| d[0].clone()).collect();
    // A middle and a spread of so many numbers want more windows than numbers.
    let size = all.iter().map(Vec::len).max().unwrap_or(0);
    let usual = if calm.len() > size + FEWEST { Usual::of(&calm) } else { None };
    Ok(match usual {
        Some(usual) => Background { usual, windows: calm.len(), is_of_all: false },
        None => Background { usual: rough.centred(), windows: all.len(), is_of_all: true },
    })
}

/// Measured minus simulated ends of windows under some frictions, in the axes of the heading; empty where a simulation ran away.
///
/// # Errors
/// When the simulator refuses.
pub(crate) fn differences(
    simulator: &Simulator,
    recordings: &[Recording],
    windows: &[Window],
    frictions: &[f64],
) -> Result<Vec<Vec<f64>>, ContactError> {
    let tasks: Vec<Task> = windows.iter().map(|w| w.task(vec![frictions.to_vec()])).collect();
    let simulated = simulator.run(recordings, &tasks, TICKS, &|_| {})?;
    Ok(windows.iter().zip(&simulated).map(|(w, of)| w.difference(recordings, &of[0])).collect())
}

/// Frictions of one label over a grid, beside those of the others.
#[derive(Debug, Clone, Copy)]
pub struct FrictionGrid<'a> {
    /// The label.
    pub label: usize,
    /// Frictions of all labels.
    pub frictions: &'a [f64],
    /// Those of the label, ascending.
    pub grid: &'a [f64],
}

/// Losses of the windows that touch the label of a grid, for each of its frictions.
///
/// # Errors
/// When the simulator refuses.
pub fn losses(
    simulator: &Simulator,
    recordings: &[Recording],
    windows: &[Window],
    usual: &Usual,
    varied: FrictionGrid,
    done: &(dyn Fn(usize) + Sync),
) -> Result<Losses, ContactError> {
    let FrictionGrid { label, frictions, grid } = varied;
    let touching: Vec<&Window> = windows.iter().filter(|w| w.labels.contains(&label)).collect();
    let with = |mu: &f64| {
        let mut set = frictions.to_vec();
        set[label] = *mu;
        set
    };
    let tasks: Vec<Task> = touching.iter().map(|w| w.task(grid.iter().map(with).collect())).collect();
    let simulated = simulator.run(recordings, &tasks, TICKS, done)?;
    let mut out = Losses { windows: Vec::new(), movement: vec![0.0; grid.len().saturating_sub(1)] };
    for (window, of) in touching.iter().zip(&simulated) {
        let differences: Vec<Vec<f64>> = of.iter().map(|s| window.difference(recordings, s)).collect();
        out.windows.push((window.cluster(), differences.iter().map(|d| usual.loss(d)).collect()));
        for (k, pair) in differences.windows(2).enumerate() {
            let tenths = (grid[k + 1] / grid[k]).ln() / 0.1;
            let moved = usual.distance(&pair[0], &pair[1]).min(1e6) / pair[0].len().max(1) as f64;
            out.movement[k] += moved / (tenths * tenths);
        }
    }
    let count = touching.len().max(1) as f64;
    out.movement.iter_mut().for_each(|m| *m = (*m / count).sqrt());
    Ok(out)
}

/// Number of windows that touch each label.
pub fn counts(windows: &[Window]) -> BTreeMap<usize, usize> {
    let mut counts = BTreeMap::new();
    windows.iter().flat_map(|w| &w.labels).for_each(|l| *counts.entry(*l).or_default() += 1);
    counts
}
