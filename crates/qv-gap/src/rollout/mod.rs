//! Simulating windows of a recording: from measured starts, under recorded commands.

pub mod actuator_model;
pub mod jacobian;
pub mod windows;
