//! A cloud on the graphics card.

use super::device::Gpu;
use crate::{RasterError, Scene};

/// The Gaussians of a scene on the graphics card; environments and views come with each frame.
#[derive(Debug)]
pub struct GpuCloud {
    /// Mean \[m\] and the bits of the group's index, shape `[N, 4]`.
    pub means: wgpu::Buffer,
    /// Log scales and opacity logit, shape `[N, 4]`.
    pub scales: wgpu::Buffer,
    /// Quaternions w, x, y, z, shape `[N, 4]`.
    pub rotations: wgpu::Buffer,
    /// Coefficients, shape `[N, (degree + 1)², 3]`.
    pub sh: wgpu::Buffer,
    /// Features, shape `[N, k]`.
    pub features: wgpu::Buffer,
    /// N.
    pub count: usize,
    /// Degree of the spherical harmonics.
    pub sh_degree: u8,
    /// k.
    pub feature_count: usize,
    /// Number of groups, the one that stays included.
    pub groups: usize,
}

impl GpuCloud {
    /// Copies the cloud of a scene.
    ///
    /// # Errors
    /// The scene is off, or too large for the device.
    pub fn new(gpu: &Gpu, scene: &Scene) -> Result<Self, RasterError> {
        scene.check()?;
        let cloud = scene.cloud;
        let limit = gpu.most_workgroups() as u64 * 256;
        if cloud.len() as u64 > limit {
            let what = "Gaussians of a cloud on this device".to_string();
            return Err(RasterError::TooLarge { what, limit, found: cloud.len() as u64 });
        }
        let with = |rows: &[[f32; 3]], fourth: &dyn Fn(usize) -> f32| -> Vec<[f32; 4]> {
            rows.iter().enumerate().map(|(i, row)| [row[0], row[1], row[2], fourth(i)]).collect()
        };
        let means = with(&cloud.means, &|i| f32::from_bits(scene.group(i) as u32));
        let scales = with(&cloud.log_scales, &|i| cloud.opacity_logits[i]);
        Ok(Self {
            means: gpu.filled("means", &means)?,
            scales: gpu.filled("scales", &scales)?,
            rotations: gpu.filled("rotations", &cloud.rotations)?,
            sh: gpu.filled("sh", &cloud.sh)?,
            features: gpu.filled("features", &cloud.features)?,
            count: cloud.len(),
            sh_degree: cloud.sh_degree,
            feature_count: cloud.feature_count,
            groups: scene.group_count(),
        })
    }

    /// Room for so many Gaussians that stay, none of which is there yet. Whoever fills the buffers says by [`Self::count`] how many are.
    ///
    /// # Errors
    /// Too large for the device.
    pub fn with_room(gpu: &Gpu, capacity: usize, sh_degree: u8, feature_count: usize) -> Result<Self, RasterError> {
        let limit = gpu.most_workgroups() as u64 * 256;
        if capacity as u64 > limit {
            let what = "Gaussians of a cloud on this device".to_string();
            return Err(RasterError::TooLarge { what, limit, found: capacity as u64 });
        }
        let rows = |label: &str, floats: usize| gpu.buffer(label, 4 * (capacity * floats) as u64);
        Ok(Self {
            means: rows("means", 4)?,
            scales: rows("scales", 4)?,
            rotations: rows("rotations", 4)?,
            sh: rows("sh", 3 * (sh_degree as usize + 1).pow(2))?,
            features: rows("features", feature_count)?,
            count: 0,
            sh_degree,
            feature_count,
            groups: 1,
        })
    }
}
