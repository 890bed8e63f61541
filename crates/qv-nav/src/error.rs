//! The error of this crate.

use qv_core::Mismatch;
use qv_policy::PolicyError;
use qv_policy::onnx::OnnxError;
use qv_raster::RasterError;
use qv_sim::SimError;

/// Why navigation did not work.
#[derive(Debug, thiserror::Error)]
pub enum NavError {
    /// A setting or an input means nothing.
    #[error(transparent)]
    Value(#[from] Mismatch),
    /// A picture could not be drawn.
    #[error(transparent)]
    Raster(#[from] RasterError),
    /// The walking policy or its task failed.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// The file of the network could not be made.
    #[error(transparent)]
    Onnx(#[from] OnnxError),
    /// A simulator failed.
    #[error(transparent)]
    Sim(#[from] SimError),
}

impl NavError {
    /// An error of a value.
    pub fn value(what: &str, expected: &str, found: impl std::fmt::Display) -> Self {
        Self::Value(Mismatch::new(what, expected, found))
    }
}
