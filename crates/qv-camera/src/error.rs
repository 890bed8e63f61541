//! The error of this crate.

/// Camera, poses, images or scene are missing or off.
pub use qv_core::Mismatch as CameraError;
