//! Visual navigation.
pub mod net;
mod error;
pub use error::NavError;
