//! The error of this crate.

use qv_raster::RasterError;

/// Camera, poses, images or scene are missing or off.
pub use qv_core::Mismatch as CameraError;

pub(crate) fn raster_error(error: RasterError) -> CameraError {
    CameraError::new("scene", "Gaussians that can be drawn", error)
}
