//! Articulated rigid bodies on terrain, one robot or thousands: model, contact, actuators, sensors.
//!
//! A [`Model`] is read from URDF (or from MJCF, [`mjcf`]) and set on a [`Terrain`] as a [`Batch`] of environments, each with its own state and its
//! own parameters. The contact model and integrator are MuJoCo's (elliptic cone, `implicitfast`), solved by Newton's
//! method in reduced coordinates; vector lanes hold one environment each, and an environment's bits do not depend on
//! its lane, the batch or the threads. See `docs/theory/simulator.md` for the equations.
//!
//! ```
//! use qv_sim::{BaseKind, Batch, Model, ModelOptions, SimOptions, State, Terrain};
//! let urdf = r#"<robot name="ball"><link name="ball">
//!   <inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
//!   <collision><geometry><sphere radius="0.1"/></geometry></collision></link></robot>"#;
//! let model = Model::from_urdf(urdf, &ModelOptions { base: BaseKind::Floating, ..Default::default() })?;
//! let mut ball = Batch::<f64>::new(&model, &Terrain::plane(), &SimOptions::default(), 1)?;
//! ball.set_state(0, &State { q: vec![0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0], v: vec![0.0; 6] })?;
//! ball.step_many(1000);
//! assert!((ball.state(0)?.q[2] - 0.1).abs() < 1e-3);
//! # Ok::<(), qv_sim::SimError>(())
//! ```

/// Types of these stand in the interface of this crate.
pub use {glam, qv_core};

mod batch;
mod commands;
mod engine;
mod error;
#[cfg(test)]
#[path = "../../../fixtures/facts.rs"]
mod facts;
mod lanes;
pub mod mjcf;
mod model;
mod motor;
pub mod names;
mod options;
mod parameters;
#[cfg(feature = "rapier")]
pub mod rapier;
mod sensors;
pub mod servos;
mod terrain;
pub mod urdf;

pub use batch::{Batch, ContactPoint, LaneState, Precision, Snapshot, State};
pub use commands::{BatchCommand, JointCommand};
pub use error::SimError;
pub use model::inertia::{MassProperties, Payload};
pub use model::{
    BaseKind, Frame, Geom, Joint, JointKind, Link, Mechanics, MeshReader, MeshShape, Model, ModelOptions, Shape,
};
pub use motor::{Motor, MotorCommand, drift_share, lag_gain};
pub use options::{LineSearch, SimOptions, WarmStart};
pub use parameters::{ActsOn, GeomField, JointField, LinkField, ParameterInfo, WorldField};
pub use sensors::SensorReading;
pub use terrain::{DEFAULT_FRICTION, Terrain};
