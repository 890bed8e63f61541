//! Walking policies: networks, PPO, the velocity task, ONNX files written and read.

pub mod adam;
pub mod net;
pub mod random;
