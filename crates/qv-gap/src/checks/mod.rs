//! Statistics that decisions are checked by: windows that no fit has seen, actuator residuals, whether a size is one size.

pub(crate) mod actuator_residual;
pub mod by_recording;
pub mod held_out;
pub mod stationarity;
