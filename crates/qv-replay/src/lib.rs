//! A run replayed in the simulator: the same commands, from the measured state; whole, and in short windows. Errors by joint, leg, phase and
//! time.

/// Types of these stand in the interface of this crate.
pub use {qv_core, qv_recording, qv_rollout};

mod bag_out;
#[cfg(test)]
#[path = "../../../fixtures/browser/mod.rs"]
mod browser;
mod engine;
mod error;
mod errors;
#[cfg(test)]
#[path = "../../../fixtures/facts.rs"]
mod facts;
mod html;
mod joint_board;
mod joint_state;
mod json;
mod layout;
mod mistaken;
mod scene_out;
#[cfg(test)]
#[path = "../../../fixtures/skipped.rs"]
mod skipped;
mod unknown_gains;
mod verdict;

pub use bag_out::{BagRobot, FrameTrace, write_mcap, write_traces};
pub use engine::{ReplayOptions, ReplayTrace, Window, Windows, simulate};
pub use error::ReplayError;
pub use errors::{BaseErrors, Errors, JointErrors, Phase, PhaseErrors, TimeErrors};
pub use html::to_html;
pub use joint_board::{NamedTrace, joint_board};
pub use json::to_json;
pub use layout::layout;
pub use mistaken::{JointMistake, MistakenJoints, mistaken_joints};
pub use scene_out::usual_force;
pub use unknown_gains::find_gains;
pub use verdict::{lag_remark, verdict};

use qv_core::JointSeries;
use qv_recording::Run;
use qv_recording::conventions::read_in_ours;
use qv_recording::lag::{Lag, lags_behind, lags_behind_command};
use qv_recording::run::FaultKind;
use qv_rollout::{Feet, Trace};
use qv_sim::{Model, Terrain};

/// Everything that a replay found, as plain data.
#[derive(Debug, Clone, PartialEq)]
pub struct Replay {
    /// Joints in the model's order.
    pub joint_names: Vec<String>,
    /// Feet of the robot, in the order of the traces' forces.
    pub feet: Feet,
    /// What was measured, at the instants of `whole`: times, joints in the model's order.
    pub recorded: Trace,
    /// The whole run, open loop from the first smoothed state.
    pub whole: Trace,
    /// Windows, each from the measured state at its start.
    pub windows: Windows,
    /// Error of the whole run.
    pub errors: Errors,
    /// Error of the windows.
    pub window_errors: Errors,
    /// Best constant lag of the measured position behind its command, joint by joint, where their correlation supports one.
    pub command_lags: Vec<Lag>,
    /// Best constant lag of the measured position behind the simulated one over the whole run, where their correlation supports one: what the
    /// model does not explain of it.
    pub model_lags: Vec<Lag>,
    /// Time at which the simulation of the whole run ran away \[s\]: its errors are unknown then.
    pub ran_away: Option<f64>,
    /// Simulated time of all environments together \[s\].
    pub simulated: f64,
}

/// Replays `run` with `model` on `terrain`.
///
/// # Errors
/// When the run lacks what a replay needs (positions, commands, poses for a free base), its joints are not the model's, or a
/// parameter means nothing.
pub fn replay(run: &Run, model: &Model, terrain: &Terrain, options: &ReplayOptions) -> Result<Replay, ReplayError> {
    let is_foreign = run.faults.iter().any(|f| f.kind == FaultKind::Convention);
    let read = is_foreign.then(|| read_in_ours(run.clone()));
    let run = read.as_ref().unwrap_or(run);
    let simulated = simulate(run, model, terrain, options)?;
    let errors = errors::of_trace(&simulated.recorded, &simulated.whole, &simulated.feet);
    let window_errors = errors::of_windows(&simulated.recorded, &simulated.windows, &simulated.feet);
    Ok(Replay {
        joint_names: model.joint_names().to_vec(),
        command_lags: supported(lags_behind_command(run, &simulated.columns)),
        model_lags: supported(model_lags(&simulated, model.joint_names())),
        feet: simulated.feet,
        recorded: simulated.recorded,
        whole: simulated.whole,
        windows: simulated.windows,
        errors,
        window_errors,
        ran_away: simulated.ran_away,
        simulated: simulated.seconds,
    })
}

fn supported(mut lags: Vec<Lag>) -> Vec<Lag> {
    lags.retain(Lag::is_supported);
    lags
}

fn model_lags(simulated: &ReplayTrace, names: &[String]) -> Vec<Lag> {
    let series =
        |trace: &Trace| JointSeries { time: trace.time.clone(), values: trace.position.clone(), joints: trace.joints };
    let columns: Vec<usize> = (0..names.len()).collect();
    lags_behind(&series(&simulated.whole), &columns, &series(&simulated.recorded), &columns, names)
}
