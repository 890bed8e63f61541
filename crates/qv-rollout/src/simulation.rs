//! Simulations side by side, each from a start of its own, that follow the commands of a recording.

use crate::RolloutError;
use crate::commands::{Command, HeldCommands};
use crate::law;
use crate::options::Numerics;
use crate::parameters::Overrides;
use crate::place::Sensors;
use crate::robot::Rollout;
use crate::window::Start;
use qv_sim::{Batch, Precision, SimOptions, State};
use std::borrow::Cow;
use std::ops::Range;

/// Time for which a robot settles on its feet \[s\].
const SETTLING: f64 = 0.25;
/// Feet that sink in by more on ground as it usually is are none that stand \[m\].
const DEEPEST: f64 = 0.01;

/// Environments that begin at the same moment, and the command that they follow.
struct Feed<'a> {
    environments: Range<usize>,
    held: &'a HeldCommands,
    from: f64,
    /// Stamp of the command after the one in force.
    until: f64,
    command: Command,
}

/// Environments at their starts, on the way from there.
pub struct Simulation<'a, T: Precision> {
    /// The environments.
    pub batch: Batch<T>,
    timestep: f64,
    latency: f64,
    feeds: Vec<Feed<'a>>,
    tick: usize,
}

impl<'a, T: Precision> Simulation<'a, T> {
    /// `count` environments that remember commands, and what sensors saw, for so long \[s\].
    ///
    /// # Errors
    /// When the simulator refuses the robot.
    pub fn new(
        rollout: &Rollout,
        numerics: Numerics,
        [latency, sensor_latency]: [f64; 2],
        count: usize,
    ) -> Result<Self, RolloutError> {
        let options = SimOptions { max_sensor_latency: sensor_latency.min(1.0), ..numerics.options(latency) };
        let batch = Batch::new(rollout.model, &rollout.terrain, &options, count)?;
        Ok(Self { batch, timestep: numerics.timestep, latency, feeds: Vec::new(), tick: 0 })
    }

    /// Begins anew, with other starts.
    pub fn rewind(&mut self) {
        self.feeds.clear();
        self.tick = 0;
    }

    /// Puts an environment at a start where sensors see `seen`, commands and torques on their way (see [`Self::place`] and [`Self::remember`]).
    /// Environments are started in order.
    ///
    /// # Errors
    /// When a value of `setting` means nothing.
    pub fn start<'s>(
        &mut self,
        rollout: &Rollout,
        env: usize,
        setting: &Overrides,
        (start, sensors): (&Start<'a>, Sensors),
        seen: &'s State,
    ) -> Result<(f64, Cow<'s, State>), RolloutError> {
        let placed = self.place(rollout, env, setting, (start, sensors), seen)?;
        self.remember(rollout, env, setting, start)?;
        Ok(placed)
    }

    /// Puts an environment at a start where sensors see `seen`: the height at which the ground touches its feet \[m\], and its true state.
    ///
    /// # Errors
    /// When a value of `setting` means nothing.
    pub fn place<'s>(
        &mut self,
        rollout: &Rollout,
        env: usize,
        setting: &Overrides,
        (start, sensors): (&Start<'a>, Sensors),
        seen: &'s State,
    ) -> Result<(f64, Cow<'s, State>), RolloutError> {
        let state = rollout.behind_springs(start, setting, seen, start.time);
        let height = rollout.place(&mut self.batch, env, setting, (start, sensors), &state)?;
        Ok((height, state))
    }

    /// Gives an environment that was placed the commands before its start and the torques behind its motors' lags, which a state that is set
    /// forgets, and lets it follow the commands from there.
    ///
    /// # Errors
    /// When a command is not finite.
    pub fn remember(
        &mut self,
        rollout: &Rollout,
        env: usize,
        setting: &Overrides,
        start: &Start<'a>,
    ) -> Result<(), RolloutError> {
        let mut command = Command::default();
        for age in (1..=(self.latency / self.timestep).ceil() as usize).rev() {
            start.held.at(start.time - age as f64 * self.timestep, self.timestep, &mut command);
            self.batch.set_past_command(env, age, &command.view())?;
        }
        if let Some(torques) = law::lagged(rollout, start, setting, self.timestep) {
            self.batch.set_lagged_torques(env, &torques)?;
        }
        self.follow(env, start.held, start.time);
        Ok(())
    }

    /// Lets an environment follow commands from a time \[s\] on.
    fn follow(&mut self, env: usize, held: &'a HeldCommands, from: f64) {
        if let Some(last) = self.feeds.last_mut()
            && std::ptr::eq(last.held, held)
            && last.from == from
            && last.environments.end == env
        {
            last.environments.end += 1;
            return;
        }
        let (until, command) = (f64::NEG_INFINITY, Command::default());
        self.feeds.push(Feed { environments: env..env + 1, held, from, until, command });
    }

    /// Gives the commands of this step, where they change, and steps, on this thread.
    ///
    /// # Errors
    /// When a command is not finite.
    pub fn step(&mut self) -> Result<(), RolloutError> {
        self.command()?;
        self.batch.step();
        Ok(())
    }

    /// The same on all threads.
    ///
    /// # Errors
    /// When a command is not finite.
    pub fn step_parallel(&mut self) -> Result<(), RolloutError> {
        self.command()?;
        self.batch.step_parallel();
        Ok(())
    }

    fn command(&mut self) -> Result<(), RolloutError> {
        let (batch, step) = (&mut self.batch, self.timestep);
        for feed in &mut self.feeds {
            let time = feed.from + self.tick as f64 * step;
            if time + 0.5 * step >= feed.until {
                feed.held.at(time, step, &mut feed.command);
                feed.until = feed.held.until(time, step);
                batch.set_command_in(feed.environments.clone(), &feed.command.view())?;
            }
        }
        self.tick += 1;
        Ok(())
    }
}

impl Rollout<'_> {
    /// Finds the depth to which the feet sink in when the robot stands on all of them, by letting it settle at a start, at the measured
    /// `state`. A robot that does not settle says nothing: 0.
    ///
    /// # Errors
    /// When the simulator refuses.
    pub fn settle(&mut self, numerics: &Numerics, start: &Start, state: &State) -> Result<(), RolloutError> {
        self.depth = 0.0;
        if !self.free || self.terrain.is_none() || self.feet.geoms.is_empty() {
            return Ok(());
        }
        let nothing = Overrides::new();
        let mut simulation = Simulation::<f64>::new(self, *numerics, [self.longest_latency(&nothing), 0.0], 1)?;
        let height = self.place(&mut simulation.batch, 0, &nothing, (start, Sensors::Ideal), state)?;
        let mut command = Command::default();
        start.held.at(start.time, numerics.timestep, &mut command);
        let batch = &mut simulation.batch;
        batch.set_command(0, &command.view())?;
        batch.step_many((SETTLING / numerics.timestep) as usize);
        let (gap, feet) = self.gap_below(&nothing, &batch.state(0)?.q);
        let depth = (height - gap) * feet as f64 / self.feet.geoms.len() as f64;
        // Softer ground gives way by more.
        let softer = self.softness(|id| self.nominal[id]) / self.softness(|id| self.catalogue[id].neutral);
        let settled = !batch.is_faulty(0)? && (0.0..DEEPEST * softer.max(1.0)).contains(&depth);
        drop(simulation);
        self.depth = if settled { depth } else { 0.0 };
        Ok(())
    }
}
