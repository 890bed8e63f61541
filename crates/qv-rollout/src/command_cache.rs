//! What the robot was told in a window, kept for all settings: reading it from the recording takes as long as a short simulation.

use crate::GapError;
use crate::problem::{Numerics, Problem, Window};
use qv_rollout::{Command, HeldCommands};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// What a window's robot was told.
pub(crate) struct Commands {
    /// At each tick, and at the ticks before the first.
    of_tick: Vec<Command>,
    /// Whether each is another one than that before it.
    is_new: Vec<bool>,
    /// Number of ticks before the first.
    past: usize,
    /// The ticks that they are for.
    ticks: Ticks,
}

/// Step and length of a window that is simulated \[s\].
#[derive(PartialEq)]
struct Ticks {
    step: f64,
    length: f64,
}

impl Ticks {
    fn new(problem: &Problem, numerics: &Numerics) -> Self {
        Self { step: numerics.timestep, length: problem.cut.window }
    }
}

impl Commands {
    fn new(problem: &Problem, window: &Window, numerics: &Numerics, past: usize) -> Result<Self, GapError> {
        let of_tick = problem.commands(window, numerics, past)?;
        let is_new = (0..of_tick.len()).map(|k| k == 0 || of_tick[k] != of_tick[k - 1]).collect();
        Ok(Self { of_tick, is_new, past, ticks: Ticks::new(problem, numerics) })
    }

    /// The command that was in force `age` ticks before the first.
    pub(crate) fn before(&self, age: usize) -> &Command {
        &self.of_tick[self.past - age]
    }

    /// The command of a tick, if it is given there: at the first, and where it changes.
    pub(crate) fn given_at(&self, tick: usize) -> Option<&Command> {
        (tick == 0 || self.is_new[self.past + tick]).then(|| &self.of_tick[self.past + tick])
    }
}

/// Commands of one window, once they were asked for.
#[derive(Default)]
pub(crate) struct Told {
    held: OnceLock<Arc<HeldCommands>>,
    of_ticks: Mutex<Option<Arc<Commands>>>,
}

impl Told {
    /// Those between the stamps of its recording.
    pub(crate) fn held(&self, problem: &Problem, window: &Window) -> Result<Arc<HeldCommands>, GapError> {
        if let Some(held) = self.held.get() {
            return Ok(held.clone());
        }
        let held = Arc::new(HeldCommands::new(&window.view, &problem.columns)?);
        Ok(self.held.get_or_init(|| held).clone())
    }

    /// Those of ticks, `past` before the first at least.
    pub(crate) fn of_ticks(
        &self,
        problem: &Problem,
        window: &Window,
        numerics: &Numerics,
        past: usize,
    ) -> Result<Arc<Commands>, GapError> {
        let serves = |c: &&Arc<Commands>| c.past >= past && c.ticks == Ticks::new(problem, numerics);
        let mut kept = self.of_ticks.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(commands) = kept.as_ref().filter(serves) {
            return Ok(commands.clone());
        }
        let commands = Arc::new(Commands::new(problem, window, numerics, past)?);
        *kept = Some(commands.clone());
        Ok(commands)
    }
}
