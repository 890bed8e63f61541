//! The simulated side of a comparison: windows under settings of the parameters, many side by side.

use crate::GapError;
use crate::problem::command_cache::Commands;
use crate::problem::features::{Channel, middle, middles, turn};
use crate::problem::start_cache::{Prepared, prepare_one};
use crate::problem::{Numerics, Overrides, Problem, Role, Window};
use crate::rollout::actuator_model;
use glam::{DQuat, DVec3};
use qv_replay::replay::{SensorErrors, Trace};
use qv_sim::{Batch, Precision, Shape, State};
use rayon::prelude::*;
use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

/// Environments that one thread steps together: a few registers' worth of each window; one register's where there are few cases, so
/// that all threads have some.
const TOGETHER: usize = 32;
const FEW_TOGETHER: usize = 16;
const FEW: usize = 512;

/// Up to this far from the origin \[m\] single precision, twice as fast, resolves how deep feet sink in: places to 1 µm.
const NEAR: f64 = 16.0;

/// Measured minus simulated features of windows under settings.
pub struct Residuals {
    /// For each setting and window, shape `[settings][windows][features]`; empty where the simulation ran away or the
    /// recording has a hole.
    pub values: Vec<Vec<Vec<f64>>>,
    /// Simulated steps.
    pub steps: usize,
}

/// The same, and what joints did in the windows that no fit sees, under the first setting.
pub(crate) struct Traced {
    /// As [`compare`] has them.
    pub residuals: Residuals,
    /// Shape `[windows]`; `None` where a fit sees the window, or the simulation ran away.
    pub traces: Vec<Option<Trace>>,
}

/// One simulation.
struct Case {
    setting: usize,
    window: usize,
    prepared: usize,
}

/// Compares `windows` with simulations under each of `settings`.
///
/// # Errors
/// When a parameter has a value that means nothing.
pub fn compare(
    problem: &Problem,
    numerics: &Numerics,
    windows: &[&Window],
    settings: &[Overrides],
) -> Result<Residuals, GapError> {
    Ok(compare_some(problem, numerics, windows, settings, false)?.residuals)
}

/// The same, and what joints did in the windows that no fit sees. It takes no more steps.
///
/// # Errors
/// When a parameter has a value that means nothing.
pub(crate) fn compare_and_trace(
    problem: &Problem,
    numerics: &Numerics,
    windows: &[&Window],
    settings: &[Overrides],
) -> Result<Traced, GapError> {
    compare_some(problem, numerics, windows, settings, true)
}

fn compare_some(
    problem: &Problem,
    numerics: &Numerics,
    windows: &[&Window],
    settings: &[Overrides],
    traced: bool,
) -> Result<Traced, GapError> {
    let (prepared, cases) = prepare(problem, windows, settings);
    let latency = settings.iter().map(|s| longest_latency(problem, s)).fold(0.0, f64::max);
    let past = (latency / numerics.timestep).ceil() as usize;
    let told = |w: &&Window| w.told.of_ticks(problem, w, numerics, past);
    let commands: Vec<Arc<Commands>> = windows.par_iter().map(told).collect::<Result<_, _>>()?;
    let together = if cases.len() < FEW { FEW_TOGETHER } else { TOGETHER };
    let chunks: Vec<&[Case]> = cases.chunks(together).collect();
    let simulate = if is_near(problem, prepared.iter().flatten()) { simulate::<f32> } else { simulate::<f64> };
    let done: Vec<Vec<Done>> = chunks
        .par_iter()
        .map(|chunk| simulate(problem, numerics, windows, settings, (&prepared, &commands), (chunk, traced)))
        .collect::<Result<_, GapError>>()?;
    let mut values = vec![vec![Vec::new(); windows.len()]; settings.len()];
    let mut traces = vec![None; windows.len()];
    for (case, done) in cases.iter().zip(done.into_iter().flatten()) {
        if done.residual.iter().all(|x| x.is_finite()) {
            values[case.setting][case.window] = done.residual;
            traces[case.window] = done.trace.or(traces[case.window].take());
        }
    }
    let ticks = (problem.cut.window / numerics.timestep).round() as usize;
    Ok(Traced { residuals: Residuals { values, steps: ticks * cases.len() }, traces })
}

/// Starts and measured features, once for each window and each distinct set of sensor errors; cases by window.
fn prepare(problem: &Problem, windows: &[&Window], settings: &[Overrides]) -> (Vec<Option<Arc<Prepared>>>, Vec<Case>) {
    let mut distinct: Vec<SensorErrors> = Vec::new();
    let of_setting: Vec<usize> = settings
        .iter()
        .map(|setting| {
            let errors = problem.sensor_errors(setting);
            distinct.iter().position(|e| *e == errors).unwrap_or_else(|| {
                distinct.push(errors);
                distinct.len() - 1
            })
        })
        .collect();
    let of_window = |window: &&Window| {
        let mut others = Vec::new();
        let one = |errors| window.start_kept.get(problem, window, errors, &mut others);
        distinct.iter().map(one).collect::<Vec<_>>()
    };
    let prepared = windows.par_iter().flat_map_iter(of_window).collect();
    let mut cases = Vec::new();
    for window in 0..windows.len() {
        for (setting, errors) in of_setting.iter().enumerate() {
            cases.push(Case { setting, window, prepared: window * distinct.len() + errors });
        }
    }
    (prepared, cases)
}

/// Whether single precision will do for windows of a robot with a free base that begin at `starts`: what noise does in them is a hundred
/// times what rounding does. An arm is held for longer, and stands on its head, where rounding grows.
fn is_near<'p>(problem: &Problem, mut starts: impl Iterator<Item = &'p Arc<Prepared>>) -> bool {
    problem.free && starts.all(|p| DVec3::from_slice(&p.state.q).length() < NEAR)
}

/// The same for windows as they were recorded.
pub(crate) fn are_near(problem: &Problem, windows: &[Window]) -> bool {
    let errors = problem.sensor_errors(&Overrides::new());
    let starts: Vec<_> =
        windows.iter().filter_map(|w| w.start_kept.get(problem, w, &errors, &mut Vec::new())).collect();
    is_near(problem, starts.iter())
}

/// What is left of one simulation; nothing where it ran away.
#[derive(Default, Clone)]
struct Done {
    residual: Vec<f64>,
    trace: Option<Trace>,
}

fn simulate<T: Precision>(
    problem: &Problem,
    numerics: &Numerics,
    windows: &[&Window],
    settings: &[Overrides],
    (prepared, commands): (&[Option<Arc<Prepared>>], &[Arc<Commands>]),
    (cases, traced): (&[Case], bool),
) -> Result<Vec<Done>, GapError> {
    let live: Vec<&Case> = cases.iter().filter(|c| prepared[c.prepared].is_some()).collect();
    if live.is_empty() {
        return Ok(vec![Done::default(); cases.len()]);
    }
    let latency = live.iter().map(|c| longest_latency(problem, &settings[c.setting])).fold(0.0, f64::max);
    let past = (latency / numerics.timestep).ceil() as usize;
    let mut batch = Batch::<T>::new(problem.model, &problem.terrain, &numerics.options(latency), live.len())?;
    let (mut tracks, mut refused) = (Vec::with_capacity(live.len()), vec![false; live.len()]);
    for (env, case) in live.iter().enumerate() {
        let seen = &prepared[case.prepared].as_ref().expect("live").state;
        let (setting, window) = (&settings[case.setting], windows[case.window]);
        let start = behind_springs(problem, window, setting, seen, window.start);
        // What a search tries may mean nothing to the simulator (a trunk of less than no mass): such a case says nothing.
        let height = match set(problem, &mut batch, env, setting, window, &start) {
            Err(GapError::Sim(_)) if !setting.is_empty() => {
                refused[env] = true;
                0.0
            }
            height => height?,
        };
        for age in (1..=past).rev() {
            batch.set_past_command(env, age, &commands[case.window].before(age).view())?;
        }
        if let Some(torques) = actuator_model::lagged(problem, window, setting, numerics.timestep) {
            batch.set_lagged_torques(env, &torques)?;
        }
        let mut track = Track::new(problem, setting, window, height);
        if traced && case.setting == 0 && window.held_out {
            track.begin_trace(&start);
        }
        tracks.push(track);
    }
    let is_traced = tracks.iter().any(|track| track.trace.is_some());
    let is_sprung = tracks.iter().any(|track| track.compliances.is_some());
    let joints = problem.columns.len();
    let mut torques = vec![0.0; live.len() * joints];
    let ticks = (problem.cut.window / numerics.timestep).round() as usize;
    let every = (problem.cut.sample / numerics.timestep).round() as usize;
    let mut now = batch.state(0)?;
    let of_windows = by_window(&live);
    for tick in 0..ticks {
        for (window, environments) in &of_windows {
            if let Some(command) = commands[*window].given_at(tick) {
                batch.set_command_in(environments.clone(), &command.view())?;
            }
        }
        batch.step();
        if is_traced {
            batch.read_torques(&mut torques)?;
            let time = (tick + 1) as f64 * numerics.timestep;
            let of_env = tracks.iter_mut().zip(torques.chunks_exact(joints.max(1))).enumerate();
            of_env.filter(|(_, (track, _))| track.trace.is_some()).try_for_each(|(env, (track, torques))| {
                batch.read_state(env, &mut now)?;
                track.note(time, &now, torques.iter().map(|&t| f64::from(t)));
                Ok::<(), GapError>(())
            })?;
        }
        if (tick + 1) % every == 0 {
            if is_sprung {
                batch.read_torques(&mut torques)?;
            }
            let mut of_env = tracks.iter_mut().enumerate();
            of_env.try_for_each(|(env, track)| {
                track.sample(&batch, env, &mut now, &torques[env * joints..(env + 1) * joints])
            })?;
        }
    }
    let mut out = vec![Done::default(); cases.len()];
    let mut tracks = tracks.into_iter().zip(refused);
    for (k, case) in cases.iter().enumerate() {
        if let (Some(start), true) = (&prepared[case.prepared], prepared[case.prepared].is_some()) {
            let (track, is_refused) = tracks.next().expect("one for each live case");
            out[k] = if is_refused { Done::default() } else { track.done(problem, start) };
        }
    }
    Ok(out)
}

/// Runs of environments that are in one window, and which it is.
fn by_window(live: &[&Case]) -> Vec<(usize, Range<usize>)> {
    let mut first = 0;
    let run = |cases: &[&Case]| {
        let run = first..first + cases.len();
        first = run.end;
        (cases[0].window, run)
    };
    live.chunk_by(|a, b| a.window == b.window).map(run).collect()
}

/// Longest latency of commands under a setting \[s\].
pub fn longest_latency(problem: &Problem, setting: &Overrides) -> f64 {
    let is_latency = |id: usize| problem.catalogue[id].name.ends_with(".command_latency");
    problem.stated.iter().chain(setting).filter(|(id, _)| is_latency(*id)).map(|s| s.1).fold(0.0, f64::max)
}

/// Either side of a time, within which the torque of a motor is differentiated \[s\].
const BESIDE: f64 = 0.01;

/// The state at a `time` near a window that the encoders on motors tell as `seen`: joints are behind the springs between them. Where speeds were
/// not measured, those of `seen` are the motors', too.
pub fn behind_springs<'s>(
    problem: &Problem,
    window: &Window,
    setting: &Overrides,
    seen: &'s State,
    time: f64,
) -> Cow<'s, State> {
    if problem.compliances(setting).is_none() {
        return Cow::Borrowed(seen);
    }
    let mut state = seen.clone();
    let (first, first_speed) = (state.q.len() - problem.columns.len(), state.v.len() - problem.columns.len());
    if window.view.measured.velocity.is_none()
        && let Ok(starts) = problem.starts(&window.view, problem.sensor_errors(setting))
    {
        let leads = |time: f64| actuator_model::leads(problem, window, setting, &starts.at(time)?, time);
        if let Some((before, after)) = leads(time - BESIDE).zip(leads(time + BESIDE)) {
            let rates = before.iter().zip(after).map(|(before, after)| (after - before) / (2.0 * BESIDE));
            state.v[first_speed..].iter_mut().zip(rates).for_each(|(v, rate)| *v -= rate);
        }
    }
    if let Some(leads) = actuator_model::leads(problem, window, setting, &state, time) {
        state.q[first..].iter_mut().zip(leads).for_each(|(q, lead)| *q -= lead);
    }
    Cow::Owned(state)
}

/// Puts an environment at the start of a window; returns the height at which the ground touches the feet there.
fn set<T: Precision>(
    problem: &Problem,
    batch: &mut Batch<T>,
    env: usize,
    setting: &Overrides,
    window: &Window,
    state: &State,
) -> Result<f64, GapError> {
    let until = window.start + problem.cut.window;
    for (id, value) in problem.acting(setting, window.start, until) {
        match problem.roles[id] {
            // Freed of on the measured side.
            Role::Tilt(_) | Role::GyroBias(_) | Role::PoseDelay | Role::EncoderLatency(_) | Role::Height => {}
            Role::ForceStart => batch.set_parameter_at(env, id, value - window.start)?,
            Role::RunStart => {}
            _ => batch.set_parameter_at(env, id, value)?,
        }
    }
    if let Some((id, start)) = problem.run_start(setting, window.since) {
        batch.set_parameter_at(env, id, start)?;
    }
    let touching = if problem.free { ground_at(problem, setting, &state.q) } else { 0.0 };
    if let (true, Some(id)) = (touching != 0.0, problem.parameter("terrain.height")) {
        batch.set_parameter_at(env, id, touching)?;
    }
    batch.set_state(env, state)?;
    Ok(touching)
}

/// How far the ground must rise \[m\] to carry the lowest feet at positions `q`: their mean height above it, those within
/// 5 mm of the lowest, and the depth to which the robot's weight on that many feet sinks in. Feet that only touched
/// would slide freely until they have sunk in.
pub fn ground_at(problem: &Problem, setting: &Overrides, q: &[f64]) -> f64 {
    let (touching, feet) = gap_below(problem, setting, q);
    if feet == 0 { 0.0 } else { touching + problem.depth * problem.feet.geoms.len() as f64 / feet as f64 }
}

/// Depth to which the feet sink in when the robot stands on all of them \[m\]: found by letting it settle at the start of a
/// window.
///
/// # Errors
/// When the simulator refuses.
pub fn standing_depth(problem: &Problem, window: &Window) -> Result<f64, GapError> {
    const SETTLING: f64 = 0.25;
    let nothing = Overrides::new();
    if !problem.free || problem.terrain.is_none() || problem.feet.geoms.is_empty() {
        return Ok(0.0);
    }
    let Some(start) = prepare_one(problem, window, &problem.sensor_errors(&nothing), &mut Vec::new()) else {
        return Ok(0.0);
    };
    let options = problem.numerics.options(longest_latency(problem, &nothing));
    let mut batch = Batch::<f64>::new(problem.model, &problem.terrain, &options, 1)?;
    let height = set(problem, &mut batch, 0, &nothing, window, &start.state)?;
    let commands = problem.commands(window, &problem.numerics, 0)?;
    batch.set_command(0, &commands[0].view())?;
    batch.step_many((SETTLING / problem.numerics.timestep) as usize);
    let (gap, feet) = gap_below(problem, &nothing, &batch.state(0)?.q);
    let depth = (height - gap) * feet as f64 / problem.feet.geoms.len() as f64;
    // A robot that did not settle says nothing.
    Ok(if batch.is_faulty(0)? || !(0.0..0.01).contains(&depth) { 0.0 } else { depth })
}

/// Mean height above the ground of the lowest feet, and how many those are.
fn gap_below(problem: &Problem, setting: &Overrides, q: &[f64]) -> (f64, usize) {
    let near: Vec<f64> = lowest_feet(problem, setting, q).into_iter().map(|f| f.1).collect();
    (if near.is_empty() { 0.0 } else { near.iter().sum::<f64>() / near.len() as f64 }, near.len())
}

/// Where the lowest feet are, within 5 mm, x and y, and their heights above the ground \[m\].
fn lowest_feet(problem: &Problem, setting: &Overrides, q: &[f64]) -> Vec<([f64; 2], f64)> {
    let length = |link: usize| problem.lengths[link].map_or(1.0, |id| problem.value(setting, id));
    let poses = problem.model.world_from_scaled_links(q, length);
    let slope = |axis: &str| {
        let id = problem.parameter(&format!("terrain.slope_{axis}"));
        id.map_or(0.0, |id| problem.value(setting, id)).tan()
    };
    let (slope_x, slope_y) = (slope("x"), slope("y"));
    let foot = |g: &usize| {
        let geom = &problem.model.geoms[*g];
        let centre = poses[geom.link].transform_point(length(geom.link) * geom.link_from_geom.position);
        let Shape::Sphere(radius) = geom.shape else { return None };
        let name = format!("geom.{}.radius_offset", geom.name);
        let offset = problem.parameter(&name).map_or(0.0, |id| problem.value(setting, id));
        let ground = problem.terrain.height_below(centre.x, centre.y, centre.z + 1.0)?;
        let gap = centre.z - radius - offset - ground - slope_x * centre.x - slope_y * centre.y;
        Some(([centre.x, centre.y], gap))
    };
    let mut feet: Vec<([f64; 2], f64)> = problem.feet.geoms.iter().filter_map(foot).collect();
    let lowest = feet.iter().map(|f| f.1).fold(f64::INFINITY, f64::min);
    feet.retain(|f| f.1 < lowest + 0.005);
    feet
}

/// Where feet stand at the start of a window, x and y \[m\]; none where the start is not known.
pub fn standing_feet(problem: &Problem, window: &Window) -> Vec<[f64; 2]> {
    let nothing = Overrides::new();
    let start = problem.starts(&window.view, problem.sensor_errors(&nothing)).ok().and_then(|s| s.at(window.start));
    start.map_or(Vec::new(), |s| lowest_feet(problem, &nothing, &s.q).into_iter().map(|f| f.0).collect())
}

/// How far encoders are ahead of their joints under some torques; not at all where there are no springs, or a torque is not known.
fn lead<'c>(compliances: Option<&'c [f64]>, torques: impl Iterator<Item = f64> + 'c) -> impl Iterator<Item = f64> + 'c {
    let of = move |(joint, torque): (usize, f64)| match compliances {
        Some(compliances) if torque.is_finite() => compliances[joint] * torque,
        _ => 0.0,
    };
    torques.enumerate().map(of)
}

/// What is kept of one simulation.
struct Track<'a> {
    problem: &'a Problem<'a>,
    reference: &'a [DQuat],
    bias: Vec<f64>,
    /// Of the springs between joints and encoders.
    compliances: Option<Vec<f64>>,
    /// Measured minus expected height of the ground.
    ground: f64,
    q: Vec<f64>,
    v: Vec<f64>,
    rates: Vec<DVec3>,
    places: Vec<DVec3>,
    turns: Vec<DVec3>,
    broken: bool,
    /// Each step of the joints, where that is wanted; its times count from `start`.
    trace: Option<Trace>,
    start: f64,
}

impl<'a> Track<'a> {
    fn new(problem: &'a Problem, setting: &Overrides, window: &'a Window, touching: f64) -> Self {
        let errors = problem.sensor_errors(setting);
        let expected = problem.parameter("terrain.height").map_or(0.0, |id| problem.value(setting, id));
        Self {
            problem,
            reference: &window.attitude,
            bias: errors.encoder_bias,
            compliances: problem.compliances(setting),
            ground: touching - expected,
            q: Vec::new(),
            v: Vec::new(),
            rates: Vec::new(),
            places: Vec::new(),
            turns: Vec::new(),
            broken: false,
            trace: None,
            start: window.start,
        }
    }

    /// Keeps each step from here on, beginning with the start, whose torque is not known yet.
    fn begin_trace(&mut self, start: &State) {
        let joints = self.problem.columns.len();
        self.trace = Some(Trace { joints, ..Trace::default() });
        self.note(0.0, start, std::iter::repeat_n(f64::NAN, joints));
    }

    /// Keeps a step \[s\] from the start: joints as encoders without a latency report them.
    fn note(&mut self, time: f64, State { q, v }: &State, torques: impl Iterator<Item = f64>) {
        let Some(trace) = &mut self.trace else { return };
        trace.time.push(self.start + time);
        let first = trace.torque.len();
        trace.torque.extend(torques);
        let ahead = lead(self.compliances.as_deref(), trace.torque[first..].iter().copied());
        let read = q[q.len() - trace.joints..].iter().zip(&self.bias).map(|(q, b)| q + b);
        trace.position.extend(read.zip(ahead).map(|(q, ahead)| q + ahead));
        trace.velocity.extend(&v[v.len() - trace.joints..]);
    }

    /// Keeps the state of its environment; `state` is one of this robot to read it into.
    /// `torques` are those of its motors, where they are behind springs.
    fn sample<T: Precision>(
        &mut self,
        batch: &Batch<T>,
        env: usize,
        state: &mut State,
        torques: &[f32],
    ) -> Result<(), GapError> {
        self.broken |= batch.is_faulty(env)?;
        batch.read_state(env, state)?;
        let State { q, v } = &*state;
        if self.problem.free {
            self.places.push(DVec3::new(q[0], q[1], q[2]));
            self.rates.push(DVec3::new(v[3], v[4], v[5]));
            let rotation = DQuat::from_xyzw(q[4], q[5], q[6], q[3]);
            self.turns.push(turn(rotation, self.reference[self.turns.len()]));
        }
        let joints = self.problem.columns.len();
        let ahead = lead(self.compliances.as_deref(), torques.iter().map(|&t| f64::from(t)));
        let read = q[q.len() - joints..].iter().zip(&self.bias).map(|(q, b)| q + b);
        self.q.extend(read.zip(ahead).map(|(q, ahead)| q + ahead));
        self.v.extend(&v[v.len() - joints..]);
        Ok(())
    }

    /// Measured minus simulated features, and the trace; nothing when the simulation ran away.
    fn done(mut self, problem: &Problem, start: &Prepared) -> Done {
        if self.broken {
            return Done::default();
        }
        let trace = self.trace.take();
        let (bins, per_bin, joints) = (problem.cut.bins(), problem.cut.samples_per_bin(), problem.columns.len());
        let of_joint = |values: &[f64], j: usize| -> Vec<f64> {
            let at = |b: usize| middle((0..per_bin).map(|k| values[(b * per_bin + k) * joints + j]), per_bin);
            (0..bins).map(at).collect()
        };
        let mut simulated = Vec::with_capacity(start.measured.len());
        for &channel in &problem.channels {
            match channel {
                Channel::Position(j) => simulated.extend(of_joint(&self.q, j)),
                Channel::Velocity(j) => simulated.extend(of_joint(&self.v, j)),
                Channel::Gyro(axis) => simulated.extend(middles(&self.rates, axis, bins)),
                Channel::Attitude(axis) => simulated.extend(middles(&self.turns, axis, bins)),
                Channel::Base(axis) => simulated.extend(middles(&self.places, axis, bins)),
                Channel::PoseAgainstImu(_) => simulated.extend(std::iter::repeat_n(0.0, bins)),
                Channel::Ground => simulated.push(-self.ground),
            }
        }
        Done { residual: start.measured.iter().zip(simulated).map(|(m, s)| m - s).collect(), trace }
    }
}

/// Raw features of a window: simulated ones, then those of the actuator's law.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Raw {
    /// Measured minus simulated, shape `[features]`.
    pub motion: Vec<f64>,
    /// Measured minus expected torque, shape `[law joints, bins]`.
    pub law: Vec<f64>,
}

impl Raw {
    /// Whether there is nothing.
    pub fn is_empty(&self) -> bool {
        self.motion.is_empty()
    }

    /// `self - other`.
    pub fn minus(&self, other: &Self) -> Self {
        let minus = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect();
        Self { motion: minus(&self.motion, &other.motion), law: minus(&self.law, &other.law) }
    }
}
