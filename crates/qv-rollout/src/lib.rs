//! Stretches of a recording simulated from their measured starts, under any parameters of the simulator.
//!
//! A [`Rollout`] knows a robot, its ground and what is known of both. It finds where a simulation starts ([`Starts`]), puts an environment
//! there ([`Rollout::place`]): ground under the feet, joints behind their springs, motors behind their lags, commands on their way; and
//! lets it follow the recorded commands ([`Simulation`]). What is measured minus what is simulated, by channel, is a residual
//! ([`compare`]): replay, diagnosis, calibration and tuning differ in what they ask of it, not in how it comes about.

/// Types of these stand in the interface of this crate.
pub use {glam, qv_core};

pub mod channels;
mod commands;
mod error;
#[cfg(test)]
#[path = "../../../fixtures/facts.rs"]
mod facts;
pub mod features;
mod feet;
pub mod law;
mod legs;
pub mod noise;
mod options;
mod parameters;
mod place;
pub mod replicate;
mod residuals;
mod robot;
mod sensors;
mod simulation;
mod start;
mod start_cache;
mod stretches;
mod trace;
mod window;
mod windows;

pub use channels::{Channel, is_alive};
pub use commands::{Command, HeldCommands};
pub use error::RolloutError;
pub use feet::{Feet, feet_of, feet_of_model};
pub use legs::Legs;
pub use options::{ENGINE_ERROR, Numerics, WindowOptions};
pub use parameters::{
    Overrides, expand, joint_columns, name_parts, parameters_from_toml, stated_parameters, with_stated_rotors,
};
pub use place::Sensors;
pub use residuals::{Raw, Residuals, TracedResiduals, are_near, compare, compare_and_trace};
pub use robot::{Event, Rollout};
pub use sensors::SensorErrors;
pub use simulation::Simulation;
pub use start::{CoveredSeries, Starts};
pub use start_cache::measured;
pub use stretches::{Recording, Stretch, joint_lags};
pub use trace::Trace;
pub use window::{Start, Window};
