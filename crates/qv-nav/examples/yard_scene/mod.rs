//! A reconstruction of the yard, for the examples that learn and are tested in one.

use qv_core::GaussianCloud;
use qv_nav::eye::SplatEye;
use qv_nav::map::Map;
use qv_nav::veils::{Air, without_veils};
use std::path::Path;

/// A place to be drawn, and how it was made to be.
#[derive(Default)]
pub struct Place {
    pub cloud: GaussianCloud,
    pub background: Option<[f32; 3]>,
    pub antialias: bool,
}

impl Place {
    /// The Gaussians of a scene, without those that hang in the air.
    pub fn read(file: &Path, map: &Map) -> Result<Self, Box<dyn std::error::Error>> {
        let scene =
            std::fs::read(file).map_err(|e| format!("{}: expected a scene of Gaussians, found {e}", file.display()))?;
        let scene = qv_splat::files::read_any(&scene).map_err(|e| format!("{}: {e}", file.display()))?;
        let cloud = without_veils(&scene.cloud, map, &Air::default());
        let (count, hang) = (scene.cloud.len(), scene.cloud.len() - cloud.len());
        println!("{}: {count} Gaussians, {hang} of them left out, made over {:?}", file.display(), scene.background);
        Ok(Self { cloud, background: scene.background, antialias: scene.antialias })
    }

    /// Sown Gaussians before a sky.
    pub fn sown(cloud: GaussianCloud) -> Self {
        Self { cloud, ..Self::default() }
    }

    /// An eye of its cloud, before what it was made over.
    pub fn eye(&self, eye: impl Fn(&GaussianCloud) -> SplatEye) -> SplatEye {
        eye(&self.cloud).as_made(self.background, self.antialias)
    }
}
