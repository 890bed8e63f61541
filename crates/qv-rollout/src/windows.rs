//! How a recording is cut into windows, each of which is simulated from its measured start.

use crate::channels::snippet;
use crate::robot::Rollout;
use crate::start::CoveredSeries;
use crate::window::{PreparedCache, Window};
use crate::{RolloutError, features};
use qv_core::JointSeries;
use qv_core::random::SplitMix64;
use qv_recording::faults::{FASTEST_BASE, jumped};
use qv_recording::{Run, median_interval};
use std::sync::OnceLock;

/// One window of so many on end is held out.
const HELD_OUT: usize = 4;
/// Seed of which one: the same recording is always divided alike.
const DRAW_SEED: u64 = 0x6865_6c64;

impl Rollout<'_> {
    /// Windows of the run: whole ones, one after the other; of a long recording evenly spread ones. Of each four one is held
    /// out, drawn: every fourth could be in step with a gait or a motion that repeats.
    ///
    /// # Errors
    /// When there are fewer than eight whole ones.
    pub fn windows(&self, run: &Run) -> Result<Vec<Window>, RolloutError> {
        let [first, last] = run.span();
        let (cut, mut starts) = (self.cut, Vec::new());
        let needed = needed(run);
        // The margin may reach beyond the ends: the start is found from what there is.
        let mut from = first + 0.1_f64.min(cut.margin);
        while from + cut.window + 0.05 <= last {
            if self.is_usable(run, &needed, from) {
                starts.push(from);
            }
            from += cut.window;
        }
        let all = starts.len();
        if all > cut.most {
            starts = (0..cut.most).map(|k| starts[k * all / cut.most]).collect();
        }
        let is_held_out = |k: usize| k % HELD_OUT == drawn(k / HELD_OUT);
        let mut windows: Vec<Window> =
            starts.into_iter().enumerate().filter_map(|(k, start)| self.window(run, start, is_held_out(k))).collect();
        if windows.len() < 8 {
            let expected = format!("at least 8 windows of {} s with all channels", cut.window);
            let found = format!("{} in {:.1} s{}", windows.len(), last - first, self.why_so_few(run));
            return Err(RolloutError::run("recording", expected, found));
        }
        mark_moving(&mut windows, &self.columns);
        Ok(windows)
    }

    /// Those of `starts` \[s\] at which a window begins in which no channel of `run` is missing.
    pub fn usable(&self, run: &Run, mut starts: Vec<f64>) -> Vec<f64> {
        let needed = needed(run);
        starts.retain(|&from| self.is_usable(run, &needed, from));
        starts
    }

    /// Why a run has too few windows, as far as that can be seen.
    fn why_so_few(&self, run: &Run) -> String {
        let [first, last] = run.span();
        let m = &run.measured;
        let mut why = Vec::new();
        let least = 8.0 * self.cut.window + 0.3;
        if last - first < least {
            why.push(format!("record {least:.1} s at least"));
        }
        if let Some(position) = &m.position {
            let names = self.columns.iter().filter(|c| !position.column(**c).any(f64::is_finite));
            let names: Vec<&str> = names.map(|c| run.joint_names[*c].as_str()).collect();
            if !names.is_empty() {
                why.push(format!("positions of {} were not measured", names.join(", ")));
            }
            if median_interval(&position.time) > 0.02 {
                why.push(format!("joint states are {:.2} s apart (0.02 at most)", median_interval(&position.time)));
            }
        }
        if why.is_empty() { String::new() } else { format!(": {}", why.join("; ")) }
    }

    fn is_usable(&self, run: &Run, needed: &[NeededChannel], from: f64) -> bool {
        let (from, to) = (from - 0.05, from + self.cut.window + 0.05);
        // What is smoothed looks as far beyond the window as the margin.
        let margin = self.cut.margin;
        let jumps = run.measured.base_pose.as_ref().is_some_and(|pose| jumps(pose, from - margin, to + margin));
        needed.iter().all(|one| one.covered.is_whole(from, to) && has_values(one, from, to)) && !jumps
    }

    /// One window; `None` when its start cannot be found.
    pub fn window(&self, run: &Run, start: f64, held_out: bool) -> Option<Window> {
        let view = snippet(run, start - self.cut.margin, start + self.cut.window + self.cut.margin);
        let starts = self.starts(&view, self.sensor_errors(&Vec::new())).ok()?;
        starts.at(start)?;
        let attitude = if self.free { features::attitudes(self, &view, &starts, start)? } else { Vec::new() };
        Some(Window {
            start,
            since: start - run.span()[0],
            view,
            attitude,
            moving: true,
            held_out,
            run: 0,
            start_kept: PreparedCache::default(),
            held: OnceLock::new(),
        })
    }
}

impl Rollout<'_> {
    /// Finds how deep the feet sink in, at the start of a window in which the robot stands (see [`Rollout::settle`]).
    ///
    /// # Errors
    /// When the simulator refuses.
    pub fn settle_in(&mut self, window: &Window) -> Result<(), RolloutError> {
        let Some(state) = window.measured_start(self) else { return Ok(()) };
        let (held, numerics) = (window.held(self)?, self.numerics);
        let start = window.starting(self, &held);
        self.settle(&numerics, &start, &state)
    }
}

/// Which of some windows on end is held out.
fn drawn(some: usize) -> usize {
    (SplitMix64::of(DRAW_SEED, some as u64).uniform() * HELD_OUT as f64) as usize
}

/// A pose that moves by less from one sample to the next may be noise \[m\].
const FAR: f64 = 0.1;

/// Whether a pose moves faster between two times \[s\] than any robot: where its estimate corrects itself, or recordings were joined.
fn jumps(pose: &JointSeries, from: f64, to: f64) -> bool {
    let (first, last) = (pose.time.partition_point(|&t| t < from), pose.time.partition_point(|&t| t <= to));
    (first.max(1)..last).any(|i| jumped(pose, 0..3, i, FASTEST_BASE, FAR))
}

/// Most values on end that may be missing of a column.
const MOST_MISSING: usize = 5;

/// A channel that windows need.
struct NeededChannel<'a> {
    covered: CoveredSeries<'a>,
    /// Columns that have values somewhere.
    columns: Vec<usize>,
}

fn needed(run: &Run) -> Vec<NeededChannel<'_>> {
    let (m, c) = (&run.measured, &run.commands);
    let all = [&m.position, &m.velocity, &m.torque, &m.gyro, &m.orientation, &m.base_pose, &c.position, &c.torque];
    let one = |series| {
        let has_some = |column: &usize| JointSeries::column(series, *column).any(f64::is_finite);
        NeededChannel { covered: CoveredSeries::new(series), columns: (0..series.joints).filter(has_some).collect() }
    };
    all.into_iter().flatten().filter(|series| !series.is_empty()).map(one).collect()
}

/// Whether no column that has values elsewhere lacks more than [`MOST_MISSING`] of them on end between two times \[s\].
fn has_values(needed: &NeededChannel, from: f64, to: f64) -> bool {
    let series = needed.covered.series;
    let (first, last) = (series.time.partition_point(|&t| t < from), series.time.partition_point(|&t| t <= to));
    let lacks = |column: usize| {
        let mut missing = 0;
        (first..last).any(|i| {
            missing = if series.row(i)[column].is_nan() { missing + 1 } else { 0 };
            missing > MOST_MISSING
        })
    };
    !needed.columns.iter().any(|column| lacks(*column))
}

/// Windows with more than half of the recording's typical joint speed count as moving.
fn mark_moving(windows: &mut [Window], columns: &[usize]) {
    let speed = |w: &Window| {
        let position = w.view.measured.position.as_ref();
        let rows = position.map_or(0, |p| p.len());
        let mut sum = 0.0;
        for i in 1..rows {
            let (a, b) = (position.map(|p| p.row(i - 1)), position.map(|p| p.row(i)));
            let (Some(a), Some(b)) = (a, b) else { continue };
            sum += columns.iter().map(|&c| (b[c] - a[c]).abs()).filter(|x| x.is_finite()).sum::<f64>();
        }
        sum / rows.max(1) as f64
    };
    let speeds: Vec<f64> = windows.iter().map(speed).collect();
    let mut sorted = speeds.clone();
    sorted.sort_by(f64::total_cmp);
    let middle = 0.5 * sorted[(sorted.len() * 9) / 10];
    windows.iter_mut().zip(speeds).for_each(|(w, s)| w.moving = s > middle);
    // A mode with hardly a window has no statistics of its own.
    let moving = windows.iter().filter(|w| w.moving).count();
    if moving < 6 || windows.len() - moving < 6 {
        windows.iter_mut().for_each(|w| w.moving = true);
    }
}
