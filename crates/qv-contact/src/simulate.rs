//! Stretches of a recording simulated from their measured states, under several frictions side by side.

use crate::ContactError;
use crate::measured::{ABOVE, Recording, TICK};
use qv_recording::Run;
use qv_rollout::{Numerics, Overrides, Rollout, Sensors, Simulation, Start, WindowOptions};
use qv_sim::{ActsOn, Model, State, Terrain};
use rayon::prelude::*;

/// Environments that one thread steps together.
const TOGETHER: usize = 32;

/// The robot on the labelled ground, with all but the friction of labels settled.
pub struct Simulator<'a> {
    rollout: Rollout<'a>,
    numerics: Numerics,
    /// Index of each label's friction in the catalogue.
    frictions: Vec<usize>,
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
    pub fn new(run: &Run, model: &'a Model, terrain: &Terrain, given: &[(String, f64)]) -> Result<Self, ContactError> {
        let mut rollout = Rollout::new(run, model, terrain, given, WindowOptions::default())?;
        rollout.above = ABOVE;
        // Frictions of labels are what is asked for.
        rollout.stated.retain(|s| !matches!(rollout.catalogue[s.0].acts_on, ActsOn::Material(_)));
        let labels = 0..terrain.materials().len();
        let frictions = labels.filter_map(|label| rollout.parameter_of(ActsOn::Material(label))).collect();
        Ok(Self { rollout, numerics: Numerics::default(), frictions })
    }

    /// The same with other values of some parameters: index in the catalogue, value. [`Self::settle`] is called anew.
    pub fn with(&self, values: &Overrides) -> Self {
        let mut rollout = self.rollout.clone();
        for &(index, value) in values {
            let value = rollout.catalogue[index].clamped(value);
            rollout.nominal[index] = value;
            match rollout.stated.binary_search_by_key(&index, |s| s.0) {
                Ok(at) => rollout.stated[at].1 = value,
                Err(at) => rollout.stated.insert(at, (index, value)),
            }
        }
        Self { rollout, numerics: self.numerics, frictions: self.frictions.clone() }
    }

    /// The robot on its ground.
    pub fn rollout(&self) -> &Rollout<'a> {
        &self.rollout
    }

    /// Finds how deep the feet sink in, by letting the robot settle at the first instant at which it stands on all feet.
    ///
    /// # Errors
    /// When the simulator refuses.
    pub fn settle(&mut self, recording: &Recording) -> Result<(), ContactError> {
        let mut measured = recording.instants.iter().enumerate().filter_map(|(k, i)| Some((k, &i.as_ref()?.state)));
        let standing = measured.find(|(_, state)| self.rollout.stands(&state.q));
        let Some((from, state)) = standing else { return Ok(()) };
        let start = recording.start_at(from, 0.0);
        Ok(self.rollout.settle(&self.numerics, &start, state)?)
    }

    fn setting(&self, frictions: &[f64]) -> Overrides {
        self.frictions.iter().copied().zip(frictions.iter().copied()).collect()
    }

    /// States at the `ticks` instants after the start of each task, shape `[tasks][frictions][ticks]`; a simulation that
    /// ran away has fewer. `done` is reported how many tasks have ended since it was last reported.
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
    fn piece<'r>(
        &self,
        kept: &mut Vec<Simulation<'r, f64>>,
        recording: &'r Recording,
        task: &Task,
        which: std::ops::Range<usize>,
        ticks: usize,
    ) -> Result<Vec<Vec<State>>, ContactError> {
        let count = which.len();
        // Setting environments up costs more than a short stretch: each thread keeps its own.
        let at = match kept.iter().position(|s| s.batch.len() == count) {
            Some(at) => at,
            None => {
                let latencies = [self.rollout.longest_latency(&Overrides::new()), 0.0];
                kept.push(Simulation::new(&self.rollout, self.numerics, latencies, count)?);
                kept.len() - 1
            }
        };
        let simulation = &mut kept[at];
        simulation.rewind();
        let missing = || ContactError::run("start of a window", "a measured state", "none");
        let instant = recording.instants.get(task.from).and_then(Option::as_ref).ok_or_else(missing)?;
        let start: Start<'r> = recording.start_at(task.from, ticks as f64 * TICK);
        for (env, k) in which.enumerate() {
            let setting = self.setting(&task.frictions[k]);
            simulation.start(&self.rollout, env, &setting, (&start, Sensors::Ideal), &instant.state)?;
        }
        let steps = (TICK / self.numerics.timestep).round() as usize;
        let mut out = vec![Vec::with_capacity(ticks); count];
        for tick in 0..ticks {
            for _ in 0..steps {
                simulation.step()?;
            }
            for (env, states) in out.iter_mut().enumerate() {
                if states.len() == tick && !simulation.batch.is_faulty(env)? {
                    states.push(simulation.batch.state(env)?);
                }
            }
        }
        Ok(out)
    }
}
