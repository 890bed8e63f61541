//! Robot recordings become [`Run`]s: commands and measurements over time, in the units and frames of the simulator.
//!
//! A recording is a ROS 2 bag ([`read_bag`]) or a tidy table ([`read_table`]), which those of other programs become ([`foreign`]). This crate opens no file: callers pass
//! readers and text.

/// Types of these stand in the interface of this crate.
pub use {glam, qv_core};

mod bag;
mod bounds;
mod bursts;
pub mod cdr;
mod choose;
mod clean;
pub mod commanded;
pub mod container;
pub mod conventions;
pub mod definitions;
pub mod derive;
mod error;
#[cfg(test)]
#[path = "../../../fixtures/facts.rs"]
mod facts;
pub mod faults;
pub mod foreign;
pub mod frames;
pub mod frozen;
mod gains;
pub mod gaps;
pub mod images;
pub mod imu;
pub mod lag;
pub mod limits;
pub mod mapping;
mod named;
pub mod plan;
pub mod robots;
pub mod run;
pub mod schema;
mod slopes;
pub mod smooth;
#[cfg(feature = "sqlite")]
mod sqlite;
pub mod stale;
pub mod stream;
mod table;
mod topic;

pub use bag::{BagFile, read_bag, read_bag_of};
pub use clean::median_interval;
pub use error::RecordingError;
pub use run::Run;
pub use table::{read_table, robot_of, states_imu};
