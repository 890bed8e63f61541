//! The simulator driven by a recording: one environment for the whole run, one for each window.

use crate::ReplayError;
use qv_core::JointSeries;
use qv_recording::Run;
use qv_rollout::{
    CoveredSeries, Feet, HeldCommands, Numerics, Overrides, Recording, Rollout, Starts, Stretch, Trace, WindowOptions,
};
use qv_sim::{Model, Terrain};

/// How to replay.
#[derive(Debug, Clone, PartialEq)]
pub struct ReplayOptions {
    /// Length of a window \[s\].
    pub window: f64,
    /// Parameters by name and value; a `*` in a name stands for every joint, link or shape that fits.
    pub parameters: Vec<(String, f64)>,
    /// Time step of the simulation \[s\].
    pub timestep: f64,
    /// Whether the ground of each window is moved to the loaded feet.
    pub anchor_ground: bool,
}

impl Default for ReplayOptions {
    fn default() -> Self {
        Self { window: 0.3, parameters: Vec::new(), timestep: 0.001, anchor_ground: true }
    }
}

/// One window.
#[derive(Debug, Clone, PartialEq)]
pub struct Window {
    /// Index into the recorded times of its first instant.
    pub first: usize,
    /// What the simulator did, from that instant on.
    pub trace: Trace,
}

/// All windows.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Windows {
    /// Length \[s\].
    pub length: f64,
    /// Windows that were simulated.
    pub windows: Vec<Window>,
    /// Windows left out, since something is missing in them.
    pub skipped: usize,
    /// Windows left out, since the simulation ran away in them.
    pub ran_away: usize,
}

/// What the simulator did, beside what was recorded at the same times.
pub struct ReplayTrace {
    /// Column of the run for each joint of the model.
    pub columns: Vec<usize>,
    /// Feet.
    pub feet: Feet,
    /// Recorded.
    pub recorded: Trace,
    /// Whole run.
    pub whole: Trace,
    /// Windows.
    pub windows: Windows,
    /// Time at which the simulation of the whole run ran away \[s\]; there is no whole run to compare then.
    pub ran_away: Option<f64>,
    /// Simulated time of all environments \[s\].
    pub seconds: f64,
}

/// Replays `run`: whole, and in windows.
///
/// # Errors
/// See [`crate::replay`].
pub fn simulate(
    run: &Run,
    model: &Model,
    terrain: &Terrain,
    options: &ReplayOptions,
) -> Result<ReplayTrace, ReplayError> {
    check(options)?;
    let mut rollout = Rollout::new(run, model, terrain, &options.parameters, WindowOptions::default())?;
    rollout.anchors = options.anchor_ground;
    let held = HeldCommands::new(run, &rollout.columns)?;
    let starts = rollout.starts(run, rollout.sensor_errors(&Overrides::new()))?;
    let recorded = recorded(run, &rollout.columns, &rollout.feet, starts.velocities());
    let times = &recorded.time;
    let whole_start = (0..times.len()).find_map(|i| starts.at(times[i]).map(|s| (i, s)));
    let Some((first, state)) = whole_start else {
        return Err(ReplayError::run("replay", "a stretch with all joints (and poses) measured", "none"));
    };
    let (plan, skipped) = plan_windows(run, times, &starts, &held, options);
    let numerics = Numerics { timestep: options.timestep, ..Numerics::default() };
    let recording = Recording { run, held: &held, starts: &starts, times };
    // A whole run settles by itself, and its start, at the edge of the recording, is rough: windows alone start as deep as feet stand.
    let whole = recording.follow(&rollout, numerics, &[Stretch { first, end: times.len(), state }])?.remove(0);
    if let Some(stretch) = plan.iter().find(|s| rollout.stands(&s.state.q)).filter(|_| rollout.anchors) {
        rollout.settle(&numerics, &recording.start(stretch), &stretch.state)?;
    }
    // A trace ends where its state is no longer finite.
    let ran_away = (whole.time.len() < times.len() - first).then(|| times[first + whole.time.len()]);
    let joints = rollout.columns.len();
    let whole = if ran_away.is_some() { Trace { joints, ..Default::default() } } else { whole };
    let traces = if plan.is_empty() { Vec::new() } else { recording.follow(&rollout, numerics, &plan)? };
    let (mut windows, mut lost) = (Vec::new(), 0);
    for (stretch, trace) in plan.iter().zip(traces) {
        if trace.time.len() == stretch.end - stretch.first {
            windows.push(Window { first: stretch.first, trace });
        } else {
            lost += 1;
        }
    }
    let length = |t: &Trace| t.time.last().unwrap_or(&0.0) - t.time.first().unwrap_or(&0.0);
    let seconds = length(&whole) + windows.iter().map(|w| length(&w.trace)).sum::<f64>();
    let whole = padded(whole, first, times, joints, rollout.feet.names.len());
    let windows = Windows { length: options.window, windows, skipped, ran_away: lost };
    Ok(ReplayTrace { columns: rollout.columns, feet: rollout.feet, recorded, whole, windows, ran_away, seconds })
}

fn check(options: &ReplayOptions) -> Result<(), ReplayError> {
    if options.window > 2.0 * options.timestep && options.window < 1e4 {
        return Ok(());
    }
    let expected = "a length above two time steps and below 10000 s";
    Err(ReplayError::run("window", expected, format!("{} s", options.window)))
}

/// The measured channels at the stamps of the positions.
fn recorded(run: &Run, columns: &[usize], feet: &Feet, velocity: Option<&JointSeries>) -> Trace {
    let m = &run.measured;
    let position = m.position.as_ref().expect("checked before");
    let time = position.time.clone();
    let pick = |series: Option<&JointSeries>, columns: &[usize]| match series {
        None => Vec::new(),
        Some(series) => {
            let mut row = vec![0.0; series.joints];
            let mut values = Vec::with_capacity(time.len() * columns.len());
            for &t in &time {
                series.interpolate(t, &mut row);
                values.extend(columns.iter().map(|&c| row[c]));
            }
            values
        }
    };
    let foot_columns: Vec<usize> =
        feet.names.iter().filter_map(|name| run.foot_names.iter().position(|n| n == name)).collect();
    let base = pick(m.base_pose.as_ref(), &[0, 1, 2, 3, 4, 5, 6]);
    Trace {
        position: pick(Some(position), columns),
        velocity: pick(velocity, columns),
        torque: pick(m.torque.as_ref(), columns),
        foot_force: if feet.names.is_empty() { Vec::new() } else { pick(m.foot_force.as_ref(), &foot_columns) },
        base: base.chunks_exact(7).map(|c| c.try_into().expect("seven columns")).collect(),
        joints: columns.len(),
        time,
    }
}

/// The windows, and how many are left out.
fn plan_windows(
    run: &Run,
    times: &[f64],
    starts: &Starts,
    commands: &HeldCommands,
    options: &ReplayOptions,
) -> (Vec<Stretch>, usize) {
    let (mut plan, mut skipped) = (Vec::new(), 0);
    let position = CoveredSeries::new(run.measured.position.as_ref().expect("checked before"));
    let pace = commands.pace().map(CoveredSeries::new);
    let mut from = times[0];
    while from + options.window <= times[times.len() - 1] + 1e-9 {
        let to = from + options.window;
        let first = times.partition_point(|&t| t < from - 1e-9);
        let end = times.partition_point(|&t| t < to - 1e-9);
        let whole = position.is_whole(from, to) && pace.is_some_and(|pace| pace.is_whole(from, to));
        match (end > first + 1 && whole).then(|| starts.at(times[first])).flatten() {
            Some(state) => plan.push(Stretch { first, end, state }),
            None => skipped += 1,
        }
        from = to;
    }
    (plan, skipped)
}

/// The trace on all recorded times: NaN before its start and after it ended.
fn padded(trace: Trace, first: usize, times: &[f64], joints: usize, feet: usize) -> Trace {
    if first == 0 && trace.time.len() == times.len() {
        return trace;
    }
    let pad = |values: &[f64], width: usize| {
        let mut all = vec![f64::NAN; times.len() * width];
        let from = first * width;
        all[from..from + values.len()].copy_from_slice(values);
        all
    };
    let mut base = Vec::new();
    if !trace.base.is_empty() {
        base = vec![[f64::NAN; 7]; times.len()];
        base[first..first + trace.base.len()].copy_from_slice(&trace.base);
    }
    Trace {
        time: times.to_vec(),
        position: pad(&trace.position, joints),
        velocity: pad(&trace.velocity, joints),
        torque: pad(&trace.torque, joints),
        foot_force: pad(&trace.foot_force, feet),
        base,
        joints,
    }
}
