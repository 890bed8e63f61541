//! What is learned of cameras that are one, and which photographs are of one.

use super::dataset::{Dataset, Photograph};
use qv_core::{Camera, Pose};

/// What photographs of one camera share, with the optimiser's memory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SharedAppearance {
    /// Motion of the camera in its own axes \[m\].
    pub motion: Pose,
    /// Running means of derivatives by the motion.
    pub first: [f32; 6],
    /// Running means of their squares.
    pub second: [f32; 6],
    /// How often one of the photographs was seen.
    pub seen: u32,
}

impl SharedAppearance {
    /// Nothing learned yet.
    pub const NONE: Self = Self { motion: Pose::IDENTITY, first: [0.0; 6], second: [0.0; 6], seen: 0 };
}

/// Which camera took each photograph to learn from: those with equal lenses are one.
pub fn groups(dataset: &Dataset) -> Vec<usize> {
    let mut known: Vec<Camera> = vec![];
    let mut of = |one: &Photograph| {
        let found = known.iter().position(|camera| same_lens(camera, &one.camera));
        found.unwrap_or_else(|| {
            known.push(one.camera);
            known.len() - 1
        })
    };
    dataset.training.iter().map(&mut of).collect()
}

/// Whether two cameras have one lens: all but their poses is equal.
pub fn same_lens(a: &Camera, b: &Camera) -> bool {
    Camera { camera_from_world: b.camera_from_world, ..*a } == *b
}
