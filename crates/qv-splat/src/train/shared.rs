//! What is learned of cameras that are one, and which photographs are of one.

use super::dataset::{Dataset, Photograph};
use super::vignetting::{self, Vignetting};
use qv_core::{Camera, Pose};

/// What photographs of one camera share, with the optimiser's memory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SharedAppearance {
    /// Natural logarithm of the factor of both focal lengths; shift of the principal point in units of the focal lengths.
    pub lens: [f32; 3],
    /// How the lens darkens photographs towards their corners.
    pub vignetting: Vignetting,
    /// Motion of the camera in its own axes \[m\].
    pub motion: Pose,
    /// Running means of derivatives by the motion (6), the lens and its vignetting.
    pub first: [f32; 12],
    /// Running means of their squares.
    pub second: [f32; 12],
    /// How often one of the photographs was seen.
    pub seen: u32,
}

impl SharedAppearance {
    /// Nothing learned yet.
    pub const NONE: Self = Self {
        lens: [0.0; 3],
        vignetting: vignetting::NONE,
        motion: Pose::IDENTITY,
        first: [0.0; 12],
        second: [0.0; 12],
        seen: 0,
    };

    /// The lens of a camera as it was learned; its pose stays.
    pub fn camera(&self, given: &Camera) -> Camera {
        let [zoom, x, y] = self.lens.map(f64::from);
        let factor = zoom.exp();
        let (fx, fy) = (given.fx * factor, given.fy * factor);
        Camera { fx, fy, cx: given.cx + x * given.fx, cy: given.cy + y * given.fy, ..*given }
    }
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
