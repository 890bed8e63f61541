//! Walking policies: a robot learns to follow velocity commands in the simulator, on the CPU, and carries it away as ONNX.
//!
//! [`velocity`] is the task, for any robot that a URDF and a few lines describe ([`velocity::TaskRobot`]); [`ppo`] is the learner, over any
//! [`env::VectorEnv`]; [`train`] puts them together with scores and checkpoints; [`policy`] is what comes out. [`onnx`] writes files, and
//! with the feature `onnx` runs anyone's; [`roll`] runs them on a robot from a description. See `docs/guide/walking.md`.
//!
//! ```
//! use qv_policy::train::{TrainSettings, Training};
//! use qv_policy::velocity::{Ground, RobotFile};
//!
//! let urdf = include_str!("../robots/go1.urdf");
//! let robot = RobotFile::parse(include_str!("../robots/go1.toml"))?.robot(urdf)?;
//! // A real training has 256 robots and some hundred iterations.
//! let settings = TrainSettings { robots: 16, ..Default::default() };
//! let mut training = Training::new(&robot, &Ground::plane(), &settings)?;
//! let line = training.advance()?;
//! assert_eq!(line.samples, 16 * 24);
//! let file = training.policy().to_onnx(&robot)?;
//! assert!(file.len() > 10_000);
//! # Ok::<(), qv_policy::PolicyError>(())
//! ```

/// Types of these stand in the interface of this crate.
pub use {glam, qv_core};

pub mod adam;
mod checkpoint;
pub mod distribution;
pub mod env;
mod error;
#[cfg(test)]
#[path = "../../../fixtures/facts.rs"]
mod facts;
pub mod gait;
pub mod net;
pub mod onnx;
pub mod play;
pub mod policy;
pub mod ppo;
pub mod roll;
pub mod score;
pub mod shape_torques;
pub mod stand;
pub mod symmetry;
pub mod train;
pub mod velocity;

pub use error::PolicyError;
