//! What a mesh is made of.

use crate::rgbd::DepthCapture;
use qv_core::Material;
use qv_mesh::labels::LabelledPoints;

/// What is to be fused, and what labels it.
pub(super) struct Input {
    pub(super) capture: DepthCapture,
    pub(super) points: Option<LabelledPoints>,
    pub(super) materials: Vec<Material>,
}
