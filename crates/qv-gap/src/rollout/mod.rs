//! Simulating windows of a recording: from measured starts, under recorded commands.

pub mod law;
pub mod jacobian;
pub mod windows;
