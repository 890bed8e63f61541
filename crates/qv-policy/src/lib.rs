//! Walking policies: networks, PPO, the velocity task, ONNX files written and read.

pub mod adam;
pub mod distribution;
pub mod env;
mod error;
pub mod net;
pub mod onnx;
pub mod ppo;
pub mod random;
pub mod score;
pub mod velocity;

pub use error::PolicyError;
