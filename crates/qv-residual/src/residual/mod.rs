//! Learned compensators: nets that correct what the simulator's parameters do not describe, each with its training from a replayed log.
//!
//! | net | acts on | learnt by |
//! |---|---|---|
//! | [`PositionResidual`] | joint targets, once a decision | [`supervised::train_position`] or [`reinforce::train`] |
//! | [`TorqueResidual`] | joint torques behind latency and lag, each physics step | [`supervised::train_torque`] |
//!
//! Both are one plain [`ResidualNet`] in a file.

mod fit;
mod inputs;
mod inverse;
mod net;
mod position;
pub mod reinforce;
pub mod replay_env;
mod settings;
mod stage;
pub mod supervised;
mod torque;

pub use net::{NetKind, ResidualNet};
pub use position::PositionResidual;
pub use settings::SupervisedSettings;
pub use torque::TorqueResidual;

/// What an output of one means: radians of a target, or for torques as many radians times the joint's position gain. Outputs are then of
/// the size of one, as weights are drawn for.
pub const UNIT: f32 = 0.1;
