//! Robot recordings become [`Run`]s.
mod error;
pub mod cdr;
pub mod plan;
pub mod schema;
pub use error::ReplayError;
