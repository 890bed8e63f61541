//! What is blended: a list of numbers per Gaussian and view, of which each output takes its part.

use crate::Scene;
use crate::scene::Outputs;
use crate::stages::project::Projections;
use std::ops::Range;

/// Where each output's numbers are: colour first, then depth, normal and plane distance, features.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Channels {
    outputs: Outputs,
    features: usize,
}

impl Channels {
    /// Those of some outputs of clouds with so many features.
    pub fn new(outputs: Outputs, feature_count: usize) -> Self {
        Self { outputs, features: if outputs.features { feature_count } else { 0 } }
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.features().end
    }

    /// The one that holds the depth \[m\].
    pub fn depth(&self) -> Option<usize> {
        self.outputs.depth.then_some(3)
    }

    /// The first of four that hold normal and distance of the plane.
    pub fn plane(&self) -> Option<usize> {
        self.outputs.plane.then_some(3 + self.outputs.depth as usize)
    }

    /// Those that hold the features.
    pub fn features(&self) -> Range<usize> {
        let first = 3 + self.outputs.depth as usize + 4 * self.outputs.plane as usize;
        first..first + self.features
    }

    /// The numbers of one record, shape `[count]`.
    pub fn fill(&self, scene: &Scene, projections: &Projections, record: usize, out: &mut [f32]) {
        let projected = &projections.records[record];
        out[..3].copy_from_slice(&projected.colour);
        if let Some(at) = self.depth() {
            out[at] = projected.depth;
        }
        if let Some(at) = self.plane() {
            let plane = &projections.planes[record];
            out[at..at + 3].copy_from_slice(&plane.normal);
            out[at + 3] = plane.distance;
        }
        if self.features > 0 {
            out[self.features()].copy_from_slice(scene.cloud.features_of(projected.splat as usize));
        }
    }
}
