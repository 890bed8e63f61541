//! The Unitree Go2, the one crate that knows it: model, wire mapping, gaits.

pub mod messages;
pub mod wire;
