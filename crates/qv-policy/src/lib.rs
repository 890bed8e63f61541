//! Walking policies: networks, PPO, the velocity task, ONNX files written and read.

pub mod onnx;

pub mod roll;
