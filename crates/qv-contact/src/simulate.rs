//! Stretches of a recording simulated from its measured states, under several frictions side by side.

use crate::ContactError;
use crate::measured::{Recording, TICK};
use qv_replay::Run;
use qv_replay::replay::{Command, SensorErrors, expand, sensor_errors, stated_parameters};
use qv_sim::{Batch, Model, SimOptions, State, Terrain};
use rayon::prelude::*;

/// Time step \[s\].
pub const TIMESTEP: f64 = 0.001;
/// Environments that one thread steps together.
const TOGETHER: usize = 32;

/// The robot on the labelled ground, with all but the friction of labels settled.
pub struct Simulator<'a> {
    model: &'a Model,
    terrain: Terrain,
    options: SimOptions,
    /// Parameters that are known: index in the catalogue, value.
    known: Vec<(usize, f64)>,
    /// Index of each label's friction in the catalogue.
    frictions: Vec<usize>,
    height: usize,
    /// Index of the time of the run at which a simulation begins, and the value \[s\] that it has at the start of a recording: motors may drift.
    run_start: (usize, f64),
    /// Steps that a command may be late.
    past: usize,
    /// Depth to which the feet sink in when the robot stands on all of them \[m\].
    depth: f64,
    /// Errors of the sensors that are known.
    pub errors: SensorErrors,
}

/// A stretch to simulate.
#[derive(Debug, Clone, PartialEq)]
pub struct Task {
    /// Recording that it is of.
    pub run: usize,
    /// Instant that it starts from.
    pub from: usize,
    /// Frictions of all labels, one set for each simulation.
    pub frictions: Vec<Vec<f64>>,
}

impl<'a> Simulator<'a> {
    /// `given` are parameters that are known already, such as those of a diagnosis.
    ///
    /// # Errors
    /// When a parameter is unknown or means nothing.
    pub fn new(
        run: &Run,
        model: &'a Model,
        terrain: &Terrain,
        labels: &[String],
        given: &[(String, f64)],
    ) -> Result<Self, ContactError> {
        let mut named = stated_parameters(run, model);
        named.extend(expand(model, terrain, given)?);
        // Frictions of labels are what is asked for.
        named.retain(|(name, _)| !(name.starts_with("material.") && name.ends_with(".friction")));
        let late = named.iter().filter(|(n, _)| n.ends_with(".command_latency")).map(|n| n.1).fold(0.0, f64::max);
        let options = SimOptions { timestep: TIMESTEP, max_command_latency: late.min(1.0), ..Default::default() };
        let mut probe = Batch::<f64>::new(model, terrain, &options, 1)?;
        let frictions = labels
            .iter()
            .map(|l| probe.parameter_index(&format!("material.{l}.friction")))
            .collect::<Result<_, _>>()?;
        let height = probe.parameter_index("terrain.height")?;
        let mut known = Vec::new();
        // Sensors are freed of their errors on the measured side.
        for (name, value) in named.iter().filter(|(n, _)| !n.starts_with("sensor.")) {
            probe.set_parameter(0, name, *value)?;
            known.push((probe.parameter_index(name)?, *value));
        }
        for (name, _) in named.iter().filter(|(n, _)| n.starts_with("sensor.")) {
            probe.parameter_index(name)?;
        }
        let run_start = (probe.parameter_index("run.start")?, probe.parameter(0, "run.start")?);
        let past = (options.max_command_latency / TIMESTEP).ceil() as usize;
        let errors = sensor_errors(model, &named);
        let terrain = terrain.clone();
        Ok(Self { model, terrain, options, known, frictions, height, run_start, past, depth: 0.0, errors })
    }

    /// Finds how deep the feet sink in, by letting the robot settle at the first instant at which it stands on all feet.
    ///
    /// # Errors
    /// When the simulator refuses.
    pub fn settle(&mut self, recording: &Recording) -> Result<(), ContactError> {
        let mut standing = recording.instants.iter().enumerate().filter_map(|(k, i)| Some((k, i.as_ref()?)));
        let Some((from, instant)) = standing.find(|(_, i)| i.gap.1 == i.feet.len()) else { return Ok(()) };
        let mut batch = self.batch(1)?;
        let frictions: Vec<f64> = self.terrain.materials().iter().map(|m| m.1).collect();
        self.set(&mut batch, 0, recording, from, &frictions)?;
        let before = instant.state.q[2];
        let command = self.command(recording, recording.time(from));
        batch.set_command(0, &command.view())?;
        batch.step_many(250);
        let depth = before - batch.state(0)?.q[2];
        // A robot that moved on says nothing.
        self.depth = if batch.is_faulty(0)? || !(0.0..0.01).contains(&depth) { 0.0 } else { depth };
        Ok(())
    }

    fn batch(&self, count: usize) -> Result<Batch<f64>, ContactError> {
        let mut batch = Batch::<f64>::new(self.model, &self.terrain, &self.options, count)?;
        for env in 0..count {
            self.known.iter().try_for_each(|&(id, value)| batch.set_parameter_at(env, id, value))?;
        }
        Ok(batch)
    }

    fn command(&self, recording: &Recording, time: f64) -> Command {
        let mut command = Command::default();
        recording.commands.at(time, TIMESTEP, &mut command);
        command
    }

    fn set(
        &self,
        batch: &mut Batch<f64>,
        env: usize,
        recording: &Recording,
        from: usize,
        frictions: &[f64],
    ) -> Result<(), ContactError> {
        let missing = || ContactError::run("start of a window", "a measured state", "none");
        let instant = recording.instants.get(from).and_then(Option::as_ref).ok_or_else(missing)?;
        for (id, friction) in self.frictions.iter().zip(frictions) {
            batch.set_parameter_at(env, *id, *friction)?;
        }
        // Feet that only touched would slide freely until they have sunk in.
        let (gap, feet) = instant.gap;
        let sunk = if feet == 0 { 0.0 } else { self.depth * instant.feet.len() as f64 / feet as f64 };
        batch.set_parameter_at(env, self.height, gap + sunk)?;
        let (run_start, begins) = self.run_start;
        batch.set_parameter_at(env, run_start, begins + recording.time(from) - recording.time(0))?;
        batch.set_state(env, &instant.state)?;
        for age in (1..=self.past).rev() {
            let command = self.command(recording, recording.time(from) - age as f64 * TIMESTEP);
            batch.set_past_command(env, age, &command.view())?;
        }
        Ok(())
    }

    /// States at the `ticks` instants after the start of each task, shape `[tasks][frictions][ticks]`; a simulation that
    /// ran away has fewer. `done` is told how many tasks have ended since it was last told.
    ///
    /// # Errors
    /// When a task starts where nothing was measured, or the simulator refuses.
    pub fn run(
        &self,
        recordings: &[Recording],
        tasks: &[Task],
        ticks: usize,
        done: &(dyn Fn(usize) + Sync),
    ) -> Result<Vec<Vec<Vec<State>>>, ContactError> {
        let pieces: Vec<(usize, usize)> = (0..tasks.len())
            .flat_map(|t| (0..tasks[t].frictions.len()).step_by(TOGETHER).map(move |first| (t, first)))
            .collect();
        let simulated: Vec<Vec<Vec<State>>> = pieces
            .par_iter()
            .map_init(Vec::new, |batches, &(t, first)| {
                let task = &tasks[t];
                let last = (first + TOGETHER).min(task.frictions.len());
                let out = self.piece(batches, &recordings[task.run], task, first..last, ticks);
                if last == task.frictions.len() {
                    done(1);
                }
                out
            })
            .collect::<Result<_, ContactError>>()?;
        let mut out: Vec<Vec<Vec<State>>> = tasks.iter().map(|t| Vec::with_capacity(t.frictions.len())).collect();
        pieces.iter().zip(simulated).for_each(|(&(t, _), states)| out[t].extend(states));
        Ok(out)
    }

    /// All environments of a piece start alike and follow the same commands.
    fn piece(
        &self,
        batches: &mut Vec<Batch<f64>>,
        recording: &Recording,
        task: &Task,
        which: std::ops::Range<usize>,
        ticks: usize,
    ) -> Result<Vec<Vec<State>>, ContactError> {
        let count = which.len();
        // Setting a batch up costs more than a short stretch: each thread keeps its own.
        let kept = match batches.iter().position(|b| b.len() == count) {
            Some(kept) => kept,
            None => {
                batches.push(self.batch(count)?);
                batches.len() - 1
            }
        };
        let batch = &mut batches[kept];
        for (env, k) in which.enumerate() {
            self.set(batch, env, recording, task.from, &task.frictions[k])?;
        }
        let start = recording.time(task.from);
        let steps = (TICK / TIMESTEP).round() as usize;
        let mut out = vec![Vec::with_capacity(ticks); count];
        for tick in 0..ticks {
            let at = |s: usize| self.command(recording, start + (tick * steps + s) as f64 * TIMESTEP);
            let commands: Vec<Command> = (0..steps).map(at).collect();
            let views: Vec<_> = commands.iter().map(Command::view).collect();
            batch.follow(&views, false)?;
            for (env, states) in out.iter_mut().enumerate() {
                if states.len() == tick && !batch.is_faulty(env)? {
                    states.push(batch.state(env)?);
                }
            }
        }
        Ok(out)
    }
}
