//! Recordings, robots and ground from files on disk: what the command line and Python share.
//!
//! [`open_run`] reads whatever a path is (a bag, a table, a dataset of another program), [`model_of`] finds the robot that
//! was recorded, [`ground::terrain_of`] the ground. Nothing here prints; who waits is reported how far reading is.
//!
//! ```no_run
//! use qv_open::{Reading, ground, model_of, open_run};
//! use std::path::Path;
//! let path = Path::new("walk.mcap");
//! let run = open_run(path, &Reading::default(), &|_, _| {})?;
//! let model = model_of(&run, path, None)?;
//! let terrain = ground::terrain_of("plane")?;
//! ground::check_ground(&run, &terrain)?;
//! println!("{} has {} joints", model.name, model.joints.len());
//! # Ok::<(), qv_recording::RecordingError>(())
//! ```

/// Types of these stand in the interface of this crate.
pub use {glam, qv_core, qv_gap};

mod calibration;
mod description;
pub mod diagnosis;
mod error;
#[cfg(test)]
#[path = "../../../fixtures/facts.rs"]
mod facts;
pub mod foreign;
pub mod ground;
pub mod mesh_file;
mod model;
mod recording;
mod robot;
mod table;
pub mod unread;

pub use calibration::{Calibration, calibration_of};
pub use description::description_of;
pub use error::{file_error, write_error};
pub use model::{included, model_named, model_of, read_model, read_urdf, robot_mapping, urdf_of};
pub use recording::{Reading, bag_files, beyond_range, lost_from, lost_from_model, open_run, remarks_of};
pub use robot::robot_model;
pub use table::{mapping_of, run_of_table, urdf_beside};

/// Its code is compiled, so that it is not wrong one day.
#[cfg(doctest)]
#[doc = include_str!("../../../docs/guide/tutorial_rust.md")]
struct Tutorial;
