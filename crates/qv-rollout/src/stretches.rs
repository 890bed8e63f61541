//! Stretches of a recording followed in the simulator, and what its sensors report at the recorded instants.

use crate::RolloutError;
use crate::channels::snippet;
use crate::commands::HeldCommands;
use crate::options::Numerics;
use crate::parameters::Overrides;
use crate::place::Sensors;
use crate::robot::Rollout;
use crate::simulation::Simulation;
use crate::start::Starts;
use crate::trace::Trace;
use crate::window::Start;
use qv_core::JointSeries;
use qv_recording::Run;
use qv_recording::lag::lags_behind;
use qv_sim::{Batch, State};

/// Most of a recording that is followed to find how late its joints are \[s\].
const FOLLOWED: f64 = 60.0;

/// A recording, as a simulation follows it.
#[derive(Clone, Copy)]
pub struct Recording<'a> {
    /// What was recorded.
    pub run: &'a Run,
    /// Its commands.
    pub held: &'a HeldCommands,
    /// Its smoothed states.
    pub starts: &'a Starts<'a>,
    /// Instants at which the simulation is read \[s\].
    pub times: &'a [f64],
}

/// Recorded instants that are simulated from the state that was measured at the first of them.
#[derive(Debug, Clone)]
pub struct Stretch {
    /// Index of the first instant.
    pub first: usize,
    /// Index after the last.
    pub end: usize,
    /// Measured state at the first.
    pub state: State,
}

impl<'a> Recording<'a> {
    /// Where a stretch starts.
    pub fn start(&self, stretch: &Stretch) -> Start<'a> {
        let [time, until] = [stretch.first, stretch.end - 1].map(|index| self.times[index]);
        let since = time - self.times[0];
        Start { view: self.run, held: self.held, time, since, during: [time, until], starts: Some(self.starts) }
    }

    /// Simulates stretches, each from its own state, side by side; a trace ends where its state is no longer finite.
    ///
    /// # Errors
    /// When the simulator refuses a parameter.
    pub fn follow(
        &self,
        rollout: &Rollout,
        numerics: Numerics,
        stretches: &[Stretch],
    ) -> Result<Vec<Trace>, RolloutError> {
        let (times, nothing) = (self.times, Overrides::new());
        let latencies = [rollout.longest_latency(&nothing), rollout.sensor_latency(&nothing)];
        let mut simulation = Simulation::<f64>::new(rollout, numerics, latencies, stretches.len())?;
        for (env, stretch) in stretches.iter().enumerate() {
            let start = self.start(stretch);
            simulation.start(rollout, env, &nothing, (&start, Sensors::AsTheyAre), &stretch.state)?;
        }
        let mut traces = vec![Trace { joints: rollout.columns.len(), ..Default::default() }; stretches.len()];
        let due = |stretch: &Stretch, index: usize| {
            ((times[index] - times[stretch.first]) / numerics.timestep).round() as u64
        };
        let last = stretches.iter().map(|s| due(s, s.end - 1)).max().unwrap_or(0);
        let mut next: Vec<usize> = stretches.iter().map(|s| s.first).collect();
        // Stamps may be uneven: each environment is read at the step nearest to its own next stamp.
        for step in 0..=last {
            for (env, stretch) in stretches.iter().enumerate() {
                while next[env] < stretch.end && due(stretch, next[env]) <= step {
                    if simulation.batch.is_faulty(env)? {
                        next[env] = stretch.end;
                    } else {
                        read(rollout, &simulation.batch, env, times[next[env]], &mut traces[env])?;
                        next[env] += 1;
                    }
                }
            }
            simulation.step_parallel()?;
        }
        Ok(traces)
    }
}

fn read(rollout: &Rollout, batch: &Batch<f64>, env: usize, time: f64, trace: &mut Trace) -> Result<(), RolloutError> {
    let sensed = batch.sensors(env)?;
    trace.time.push(time);
    trace.position.extend(&sensed.q);
    trace.velocity.extend(&sensed.dq);
    trace.torque.extend(&sensed.tau);
    trace.foot_force.extend(rollout.feet.geoms.iter().map(|&g| sensed.foot_force[g]));
    if rollout.free {
        let ([x, y, z], [qw, qx, qy, qz]) = (sensed.base_position, sensed.base_orientation);
        trace.base.push([x, y, z, qw, qx, qy, qz]);
    }
    Ok(())
}

/// How far each joint of a recording is behind the simulated one \[s\], shape `[joints]`, by their correlation over the beginning of the
/// run, simulated from its first measured state on; `None` for a joint that hardly moves, or where the simulation runs away.
///
/// # Errors
/// When the simulator refuses a parameter.
pub fn joint_lags(rollout: &Rollout, run: &Run) -> Result<Vec<Option<f64>>, RolloutError> {
    let joints = rollout.columns.len();
    let unknown = vec![None; joints];
    // As a replay of the whole run starts, which settles by itself.
    let mut settled_by_itself = rollout.clone();
    settled_by_itself.depth = 0.0;
    let rollout = &settled_by_itself;
    let from = run.span()[0];
    let run = &snippet(run, from, from + FOLLOWED);
    let Some(position) = &run.measured.position else { return Ok(unknown) };
    let held = HeldCommands::new(run, &rollout.columns)?;
    let Ok(starts) = rollout.starts(run, rollout.sensor_errors(&Overrides::new())) else { return Ok(unknown) };
    let measured = |(index, &time): (usize, &f64)| starts.at(time).map(|state| (index, state));
    let Some((first, state)) = position.time.iter().enumerate().find_map(measured) else { return Ok(unknown) };
    let end = position.len();
    let recording = Recording { run, held: &held, starts: &starts, times: &position.time };
    let trace = recording.follow(rollout, rollout.numerics, &[Stretch { first, end, state }])?.remove(0);
    if trace.time.len() < end - first {
        return Ok(unknown);
    }
    let simulated = JointSeries { time: trace.time, values: trace.position, joints };
    let columns: Vec<usize> = (0..joints).collect();
    let found = lags_behind(&simulated, &columns, position, &rollout.columns, &run.joint_names);
    let of_joint = |name: &String| found.iter().find(|lag| lag.joint == *name).map(|lag| lag.lag);
    Ok(rollout.model.joint_names().iter().map(of_joint).collect())
}
