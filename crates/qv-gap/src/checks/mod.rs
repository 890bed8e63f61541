//! Statistics that decisions are checked by: windows that no fit has seen, whether a size is one size.

pub mod by_recording;
pub mod held_out;
pub mod stationarity;
