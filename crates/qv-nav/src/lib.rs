//! Visual navigation: a network learns from pictures of a reconstructed place to reach a coloured cone. It knows no robot.
//!
//! [`map`] says where one can go on a labelled mesh; [`teacher`] plans, but uses the cone only once it could be seen; an [`eye::Eye`] draws what
//! a camera on the robot sees, [`veils`] leaves out what a reconstruction left hanging in the air, [`lens`] makes of it what a real camera would; [`legs::Legs`] carry it. [`dagger`] lets a [`net::Net`] drive
//! and learn from what the teacher says, [`tune`] lets it learn from its own trials (PPO). [`photographs`] holds the eye against photographs. [`task`] draws episodes and judges them, [`score`] counts. [`mod@env`] is the same for learners of other programs. See `docs/guide/navigation.md`.

/// Types of these stand in the interface of this crate.
pub use {glam, qv_core};

pub(crate) mod augment;
pub mod bare;
#[cfg(feature = "gpu")]
pub mod card;
pub mod dagger;
pub mod env;
mod error;
pub mod exam;
pub mod eye;
#[cfg(test)]
#[path = "../../../fixtures/facts.rs"]
mod facts;
pub mod fit;
mod flat;
pub mod goals;
pub mod legs;
pub mod lens;
mod limits;
mod loss;
pub mod map;
pub mod measured;
#[cfg(feature = "onnx")]
pub mod navigator;
pub mod net;
pub mod onnx;
pub mod photographs;
pub mod pilots;
pub mod places;
pub mod recall;
pub mod reflex;
pub mod roll;
pub mod score;
#[cfg(feature = "rapier")]
pub mod second;
mod settings;
pub mod sight;
mod sizes;
pub mod task;
pub mod teacher;
pub mod tune;
pub mod veils;
pub mod walkers;
pub mod weights;

#[cfg(all(test, feature = "gpu"))]
#[path = "../../../fixtures/skipped.rs"]
mod skipped;

pub use error::NavError;
