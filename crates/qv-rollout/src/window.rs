//! A stretch of a recording that is simulated, and the moment at which it starts.

use crate::RolloutError;
use crate::commands::HeldCommands;
use crate::options::WindowOptions;
use crate::parameters::Overrides;
use crate::robot::Rollout;
use crate::sensors::SensorErrors;
use crate::start::Starts;
use qv_recording::Run;
use qv_sim::State;
use std::sync::{Arc, OnceLock};

/// A moment of a recording at which a simulation starts.
#[derive(Clone, Copy)]
pub struct Start<'a> {
    /// What was recorded around it: it says where lags and springs stand.
    pub view: &'a Run,
    /// The commands of that.
    pub held: &'a HeldCommands,
    /// When it is, on the clock of the run \[s\].
    pub time: f64,
    /// Time since the start of its recording \[s\].
    pub since: f64,
    /// Between which times what acts from outside is looked for \[s\].
    pub during: [f64; 2],
    /// Smoothed states of `view`, where they are there already.
    pub starts: Option<&'a Starts<'a>>,
}

/// A stretch of the recording that is simulated from its measured start.
pub struct Window {
    /// Start on the clock of the run \[s\].
    pub start: f64,
    /// Start since that of its recording \[s\]: [`Rollout::window`] takes the run that it is given for all of that.
    pub since: f64,
    /// What was recorded in and around it.
    pub view: Run,
    /// Attitude of the base at each sample, `world_from_base`, that small turns are counted from; empty with a fixed base.
    pub attitude: Vec<glam::DQuat>,
    /// Whether the robot moves much in it, against the rest of the recording.
    pub moving: bool,
    /// Whether it is kept away from every fit.
    pub held_out: bool,
    /// Which run it is of.
    pub run: usize,
    /// Where its simulation starts, once that was asked for.
    pub(crate) start_kept: PreparedCache,
    /// Its commands, once they were asked for.
    pub(crate) held: OnceLock<Arc<HeldCommands>>,
}

impl Window {
    /// The same, moving or not, that begins so long after its recording \[s\].
    pub fn with(self, moving: bool, since: f64) -> Self {
        Self { moving, since, ..self }
    }

    /// Its commands.
    ///
    /// # Errors
    /// When the run has none.
    pub fn held(&self, rollout: &Rollout) -> Result<Arc<HeldCommands>, RolloutError> {
        if let Some(held) = self.held.get() {
            return Ok(held.clone());
        }
        let held = Arc::new(HeldCommands::new(&self.view, &rollout.columns)?);
        Ok(self.held.get_or_init(|| held).clone())
    }

    /// Where feet stand at its start, x and y \[m\]; none where the start is not known.
    pub fn standing_feet(&self, rollout: &Rollout) -> Vec<[f64; 2]> {
        let feet = |start: State| rollout.lowest_feet(&Overrides::new(), &start.q);
        self.measured_start(rollout).map_or(Vec::new(), |start| feet(start).into_iter().map(|f| f.0).collect())
    }

    /// The state that is measured at its start, freed of what is known of the sensors' errors; `None` where something is missing.
    pub(crate) fn measured_start(&self, rollout: &Rollout) -> Option<State> {
        let errors = rollout.sensor_errors(&Overrides::new());
        rollout.starts(&self.view, errors).ok()?.at(self.start)
    }

    /// Where its simulation starts, with its commands.
    pub fn starting<'a>(&'a self, rollout: &Rollout, held: &'a HeldCommands) -> Start<'a> {
        let during = [self.start, self.start + rollout.cut.window];
        Start { view: &self.view, held, time: self.start, since: self.since, during, starts: None }
    }
}

/// What depends on the errors of the sensors alone.
pub(crate) struct PreparedWindow {
    /// Measured features.
    pub measured: Vec<f64>,
    /// State at the start.
    pub state: State,
}

/// What a window looks like under the sensor errors that were asked for first, which are those of nearly all settings: smoothing the start
/// takes as long as some hundred steps.
#[derive(Default)]
pub(crate) struct PreparedCache(pub(crate) OnceLock<(SensorErrors, WindowOptions, Option<Arc<PreparedWindow>>)>);
