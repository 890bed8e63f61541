//! The error of this crate.

use qv_raster::RasterError;
/// Why nothing can be said of a camera.
#[derive(Debug, thiserror::Error)]
pub enum CameraError {
    /// Camera, poses, images or scene are missing or off.
    #[error("{what}: expected {expected}, found {found}")]
    Input {
        /// What is missing or off.
        what: String,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
}

impl CameraError {
    pub(crate) fn new(what: impl Into<String>, expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self::Input { what: what.into(), expected: expected.into(), found: found.into() }
    }
}

pub(crate) fn raster_error(error: RasterError) -> CameraError {
    CameraError::new("scene", "Gaussians that can be drawn", error.to_string())
}
