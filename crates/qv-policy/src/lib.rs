//! Walking policies: networks, PPO, the velocity task, ONNX files written and read.

pub mod adam;
mod checkpoint;
pub mod distribution;
pub mod env;
mod error;
pub mod net;
pub mod onnx;
pub mod play;
pub mod policy;
pub mod ppo;
pub mod random;
pub mod roll;
pub mod score;
pub mod train;
pub mod velocity;

pub use error::PolicyError;
