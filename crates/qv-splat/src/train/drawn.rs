//! What a camera of a data set sees of a cloud.

use super::dataset::Dataset;
use crate::SplatError;
use qv_core::{Camera, GaussianCloud};
use qv_raster::{Image, Outputs, Scene, View};

/// Colour over the background of the photographs, and alpha, as a camera sees them.
///
/// # Errors
/// Drawing fails.
pub fn drawn(cloud: &GaussianCloud, camera: &Camera, dataset: &Dataset) -> Result<Image, SplatError> {
    drawn_with(cloud, camera, dataset, Outputs::default())
}

/// As [`drawn`], with more than the colours.
pub(super) fn drawn_with(
    cloud: &GaussianCloud,
    camera: &Camera,
    dataset: &Dataset,
    outputs: Outputs,
) -> Result<Image, SplatError> {
    let filtered = dataset.filtered(cloud);
    let settings = dataset.settings(outputs);
    Ok(qv_raster::render(&Scene::still(&filtered), &[View::of(*camera)], &settings)?.0.remove(0))
}

/// What is drawn to find pixels of the ground.
pub(super) const DEPTH: Outputs = Outputs { depth: true, plane: false, features: false };
