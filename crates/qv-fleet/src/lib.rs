//! Many recordings at once, as plain data: a [`Plan`] of units of work, the [`state`] of each unit, and what all of them say
//! together ([`gather`]). Nothing here reads files, starts programs or looks at a clock: `qv fleet` does.
//!
//! ```
//! use qv_fleet::{Command, InputFile, Plan, Recording, Task};
//! let file = InputFile { path: "a/run.mcap".into(), bytes: 3, sha256: "0".repeat(64) };
//! let run = Recording { path: "a/run.mcap".into(), robot: "arm".into(), start_ns: None, seconds: 20.0, files: vec![file] };
//! let task = Task { version: "0.2.0".into(), command: Command::Diagnose, ..Task::default() };
//! let plan = Plan::new(task, vec![run.clone(), run], vec![], false);
//! // The same contents twice are one unit.
//! assert_eq!((plan.units.len(), plan.repeated.len()), (1, 1));
//! assert_eq!(Plan::parse(&plan.to_text(), "plan.json").unwrap(), plan);
//! ```

mod error;
#[cfg(test)]
#[path = "../../../fixtures/facts.rs"]
mod facts;
pub mod finding;
pub mod fit;
pub mod gather;
mod hash;
pub mod page;
mod plan;
pub mod script;
pub mod state;

pub use error::FleetError;
pub use hash::sha256;
pub use plan::{Command, DuplicateRecording, InputFile, Plan, Recording, RefusedPath, Task, Unit};
