//! The simulated side of a comparison: windows under settings of the parameters, many side by side.

use crate::channels::Channel;
use crate::features::{middle, middles, turn};
use crate::options::Numerics;
use crate::parameters::Overrides;
use crate::place::Sensors;
use crate::robot::Rollout;
use crate::sensors::SensorErrors;
use crate::simulation::Simulation;
use crate::trace::Trace;
use crate::window::{PreparedWindow, Window};
use crate::{HeldCommands, RolloutError};
use glam::{DQuat, DVec3};
use qv_sim::{ActsOn, Batch, Precision, State, WorldField};
use rayon::prelude::*;
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
pub struct TracedResiduals {
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
    rollout: &Rollout,
    numerics: &Numerics,
    windows: &[&Window],
    settings: &[Overrides],
) -> Result<Residuals, RolloutError> {
    Ok(compare_some(rollout, numerics, windows, settings, false)?.residuals)
}

/// The same, and what joints did in the windows that no fit sees. It takes no more steps.
///
/// # Errors
/// When a parameter has a value that means nothing.
pub fn compare_and_trace(
    rollout: &Rollout,
    numerics: &Numerics,
    windows: &[&Window],
    settings: &[Overrides],
) -> Result<TracedResiduals, RolloutError> {
    compare_some(rollout, numerics, windows, settings, true)
}

fn compare_some(
    rollout: &Rollout,
    numerics: &Numerics,
    windows: &[&Window],
    settings: &[Overrides],
    traced: bool,
) -> Result<TracedResiduals, RolloutError> {
    let (prepared, cases) = prepare(rollout, windows, settings);
    let held: Vec<Arc<HeldCommands>> = windows.par_iter().map(|w| w.held(rollout)).collect::<Result<_, _>>()?;
    let together = if cases.len() < FEW { FEW_TOGETHER } else { TOGETHER };
    let chunks: Vec<&[Case]> = cases.chunks(together).collect();
    let simulate = if is_near(rollout, prepared.iter().flatten()) { simulate::<f32> } else { simulate::<f64> };
    let done: Vec<Vec<CaseResult>> = chunks
        .par_iter()
        .map(|chunk| simulate(rollout, numerics, windows, settings, (&prepared, &held), (chunk, traced)))
        .collect::<Result<_, RolloutError>>()?;
    let mut values = vec![vec![Vec::new(); windows.len()]; settings.len()];
    let mut traces = vec![None; windows.len()];
    for (case, done) in cases.iter().zip(done.into_iter().flatten()) {
        if done.residual.iter().all(|x| x.is_finite()) {
            values[case.setting][case.window] = done.residual;
            traces[case.window] = done.trace.or(traces[case.window].take());
        }
    }
    let ticks = (rollout.cut.window / numerics.timestep).round() as usize;
    Ok(TracedResiduals { residuals: Residuals { values, steps: ticks * cases.len() }, traces })
}

/// Starts and measured features, once for each window and each distinct set of sensor errors; cases by window.
fn prepare(
    rollout: &Rollout,
    windows: &[&Window],
    settings: &[Overrides],
) -> (Vec<Option<Arc<PreparedWindow>>>, Vec<Case>) {
    let mut distinct: Vec<SensorErrors> = Vec::new();
    let of_setting: Vec<usize> = settings
        .iter()
        .map(|setting| {
            let errors = rollout.sensor_errors(setting);
            distinct.iter().position(|e| *e == errors).unwrap_or_else(|| {
                distinct.push(errors);
                distinct.len() - 1
            })
        })
        .collect();
    let of_window = |window: &&Window| {
        let mut others = Vec::new();
        let one = |errors| window.start_kept.get(rollout, window, errors, &mut others);
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
fn is_near<'p>(rollout: &Rollout, mut starts: impl Iterator<Item = &'p Arc<PreparedWindow>>) -> bool {
    rollout.free && starts.all(|p| DVec3::from_slice(&p.state.q).length() < NEAR)
}

/// The same for windows as they were recorded.
pub fn are_near(rollout: &Rollout, windows: &[Window]) -> bool {
    let errors = rollout.sensor_errors(&Overrides::new());
    let starts: Vec<_> =
        windows.iter().filter_map(|w| w.start_kept.get(rollout, w, &errors, &mut Vec::new())).collect();
    is_near(rollout, starts.iter())
}

/// What is left of one simulation; nothing where it ran away.
#[derive(Default, Clone)]
struct CaseResult {
    residual: Vec<f64>,
    trace: Option<Trace>,
}

fn simulate<T: Precision>(
    rollout: &Rollout,
    numerics: &Numerics,
    windows: &[&Window],
    settings: &[Overrides],
    (prepared, held): (&[Option<Arc<PreparedWindow>>], &[Arc<HeldCommands>]),
    (cases, traced): (&[Case], bool),
) -> Result<Vec<CaseResult>, RolloutError> {
    let live: Vec<&Case> = cases.iter().filter(|c| prepared[c.prepared].is_some()).collect();
    if live.is_empty() {
        return Ok(vec![CaseResult::default(); cases.len()]);
    }
    let latency = live.iter().map(|c| rollout.longest_latency(&settings[c.setting])).fold(0.0, f64::max);
    let mut simulation = Simulation::<T>::new(rollout, *numerics, [latency, 0.0], live.len())?;
    let (mut tracks, mut refused) = (Vec::with_capacity(live.len()), vec![false; live.len()]);
    for (env, case) in live.iter().enumerate() {
        let seen = &prepared[case.prepared].as_ref().expect("live").state;
        let (setting, window) = (&settings[case.setting], windows[case.window]);
        let start = window.starting(rollout, &held[case.window]);
        // What a search tries may mean nothing to the simulator (a trunk of less than no mass): such a case says nothing.
        let (height, state) = match simulation.start(rollout, env, setting, (&start, Sensors::Ideal), seen) {
            Err(RolloutError::Sim(_)) if !setting.is_empty() => {
                refused[env] = true;
                (0.0, std::borrow::Cow::Borrowed(seen))
            }
            started => started?,
        };
        let mut track = Track::new(rollout, setting, window, height);
        if traced && case.setting == 0 && window.held_out {
            track.begin_trace(&state);
        }
        tracks.push(track);
    }
    let is_traced = tracks.iter().any(|track| track.trace.is_some());
    let is_sprung = tracks.iter().any(|track| track.compliances.is_some());
    let joints = rollout.columns.len();
    let mut torques = vec![0.0; live.len() * joints];
    let ticks = (rollout.cut.window / numerics.timestep).round() as usize;
    let every = (rollout.cut.sample / numerics.timestep).round() as usize;
    let mut now = simulation.batch.state(0)?;
    for tick in 0..ticks {
        simulation.step()?;
        let batch = &simulation.batch;
        if is_traced {
            batch.read_torques(&mut torques)?;
            let time = (tick + 1) as f64 * numerics.timestep;
            let of_env = tracks.iter_mut().zip(torques.chunks_exact(joints.max(1))).enumerate();
            of_env.filter(|(_, (track, _))| track.trace.is_some()).try_for_each(|(env, (track, torques))| {
                batch.read_state(env, &mut now)?;
                track.note(time, &now, torques.iter().map(|&t| f64::from(t)));
                Ok::<(), RolloutError>(())
            })?;
        }
        if (tick + 1) % every == 0 {
            if is_sprung {
                batch.read_torques(&mut torques)?;
            }
            let mut of_env = tracks.iter_mut().enumerate();
            of_env.try_for_each(|(env, track)| {
                track.sample(batch, env, &mut now, &torques[env * joints..(env + 1) * joints])
            })?;
        }
    }
    let mut out = vec![CaseResult::default(); cases.len()];
    let mut tracks = tracks.into_iter().zip(refused);
    for (k, case) in cases.iter().enumerate() {
        if let (Some(start), true) = (&prepared[case.prepared], prepared[case.prepared].is_some()) {
            let (track, is_refused) = tracks.next().expect("one for each live case");
            out[k] = if is_refused { CaseResult::default() } else { track.done(rollout, start) };
        }
    }
    Ok(out)
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
    rollout: &'a Rollout<'a>,
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
    fn new(rollout: &'a Rollout, setting: &Overrides, window: &'a Window, touching: f64) -> Self {
        let errors = rollout.sensor_errors(setting);
        let expected = rollout.value_of(setting, ActsOn::World(WorldField::Height));
        Self {
            rollout,
            reference: &window.attitude,
            bias: errors.encoder_bias,
            compliances: rollout.compliances(setting),
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
        let joints = self.rollout.columns.len();
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
    ) -> Result<(), RolloutError> {
        self.broken |= batch.is_faulty(env)?;
        batch.read_state(env, state)?;
        let State { q, v } = &*state;
        if self.rollout.free {
            self.places.push(DVec3::new(q[0], q[1], q[2]));
            self.rates.push(DVec3::new(v[3], v[4], v[5]));
            let rotation = DQuat::from_xyzw(q[4], q[5], q[6], q[3]);
            self.turns.push(turn(rotation, self.reference[self.turns.len()]));
        }
        let joints = self.rollout.columns.len();
        let ahead = lead(self.compliances.as_deref(), torques.iter().map(|&t| f64::from(t)));
        let read = q[q.len() - joints..].iter().zip(&self.bias).map(|(q, b)| q + b);
        self.q.extend(read.zip(ahead).map(|(q, ahead)| q + ahead));
        self.v.extend(&v[v.len() - joints..]);
        Ok(())
    }

    /// Measured minus simulated features, and the trace; nothing when the simulation ran away.
    fn done(mut self, rollout: &Rollout, start: &PreparedWindow) -> CaseResult {
        if self.broken {
            return CaseResult::default();
        }
        let trace = self.trace.take();
        let (bins, per_bin, joints) = (rollout.cut.bins(), rollout.cut.samples_per_bin(), rollout.columns.len());
        let of_joint = |values: &[f64], j: usize| -> Vec<f64> {
            let at = |b: usize| middle((0..per_bin).map(|k| values[(b * per_bin + k) * joints + j]), per_bin);
            (0..bins).map(at).collect()
        };
        let mut simulated = Vec::with_capacity(start.measured.len());
        for &channel in &rollout.channels {
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
        CaseResult { residual: start.measured.iter().zip(simulated).map(|(m, s)| m - s).collect(), trace }
    }
}

/// Raw features of a window: simulated ones, then those of the actuator's law.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Raw {
    /// Measured minus simulated, shape `[features]`.
    pub motion: Vec<f64>,
    /// Measured minus expected torque, shape `[law joints, bins]`.
    pub law: Vec<f64>,
    /// Numbers whose squares correct those of each law for the noise of the states that it is fed with, shape `[law joints]` \[N m\]: constant but for
    /// what a setting takes from the noise. 0 in what is compared with a recording, whose own states do not enter the sensitivities.
    pub state_noise: Vec<f64>,
}

impl Raw {
    /// Whether there is nothing.
    pub fn is_empty(&self) -> bool {
        self.motion.is_empty()
    }

    /// `self - other`.
    pub fn minus(&self, other: &Self) -> Self {
        let minus = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect();
        Self {
            motion: minus(&self.motion, &other.motion),
            law: minus(&self.law, &other.law),
            state_noise: minus(&self.state_noise, &other.state_noise),
        }
    }
}
