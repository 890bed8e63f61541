//! The model on the card, and the way there and back.

use super::super::exposure::Exposure;
use super::super::model::Model;
use super::super::shared::SharedAppearance;
use crate::SplatError;
use qv_core::Pose;
use qv_raster::gpu::{Gpu, GpuCloud};
use qv_raster::{Gradients, RasterError};

/// Buffers of what is learned, with room for more Gaussians.
#[derive(Debug)]
pub struct Store {
    /// The Gaussians.
    pub cloud: GpuCloud,
    /// For how many there is room.
    pub capacity: usize,
    /// Running means of derivatives: mean and logit, log scales, quaternion.
    pub first: wgpu::Buffer,
    /// Running means of squares.
    pub second: wgpu::Buffer,
    /// Running means of derivatives by harmonics.
    pub sh_first: wgpu::Buffer,
    /// Running means of squares.
    pub sh_second: wgpu::Buffer,
    /// Running means of derivatives by features.
    pub features_first: wgpu::Buffer,
    /// Running means of squares.
    pub features_second: wgpu::Buffer,
    /// Each exposure followed by its running means, 36 floats.
    pub exposures: wgpu::Buffer,
    /// Running means for each pose, 12 floats.
    pub pose_moments: wgpu::Buffer,
    /// What photographs of one camera share, 48 floats.
    pub shared: wgpu::Buffer,
    /// Pulls at projected means, two floats for each Gaussian.
    pub pulls: wgpu::Buffer,
}

impl Store {
    /// Copies a model.
    ///
    /// # Errors
    /// The device has no room.
    pub fn new(gpu: &Gpu, model: &Model, capacity: usize) -> Result<Self, SplatError> {
        let capacity = capacity.max(model.cloud.len());
        let sh = 12 * model.cloud.sh_count() as u64 * capacity as u64;
        let features = 4 * (model.cloud.feature_count * capacity) as u64;
        let views = model.exposures.len() as u64;
        let store = Self {
            cloud: GpuCloud::with_room(gpu, capacity, model.cloud.sh_degree, model.cloud.feature_count)?,
            capacity,
            first: gpu.buffer("first", 48 * capacity as u64)?,
            second: gpu.buffer("second", 48 * capacity as u64)?,
            sh_first: gpu.buffer("sh first", sh)?,
            sh_second: gpu.buffer("sh second", sh)?,
            features_first: gpu.buffer("features first", features)?,
            features_second: gpu.buffer("features second", features)?,
            exposures: gpu.buffer("exposures", 144 * views)?,
            pose_moments: gpu.buffer("pose moments", 48 * views)?,
            shared: gpu.filled("shared", &model.shared.iter().map(floats_of).collect::<Vec<_>>())?,
            pulls: gpu.buffer("pulls", 8 * capacity as u64)?,
        };
        Ok(store.filled(gpu, model))
    }

    fn filled(mut self, gpu: &Gpu, model: &Model) -> Self {
        let cloud = &model.cloud;
        let n = cloud.len();
        self.cloud.count = n;
        let write = |buffer: &wgpu::Buffer, floats: &[f32]| {
            // Copies are of whole words of four bytes, which floats are.
            gpu.queue.write_buffer(buffer, 0, bytemuck::cast_slice(floats));
        };
        let four = |rows: &[[f32; 3]], last: &dyn Fn(usize) -> f32| -> Vec<f32> {
            rows.iter().enumerate().flat_map(|(i, row)| [row[0], row[1], row[2], last(i)]).collect()
        };
        write(&self.cloud.means, &four(&cloud.means, &|_| 0.0));
        write(&self.cloud.scales, &four(&cloud.log_scales, &|i| cloud.opacity_logits[i]));
        write(&self.cloud.rotations, cloud.rotations.as_flattened());
        write(&self.cloud.sh, cloud.sh.as_flattened());
        let shapes = |moments: &Gradients| -> Vec<f32> {
            let of = |i: usize| {
                let ([x, y, z], [a, b, c]) = (moments.means[i], moments.log_scales[i]);
                let [p, q, r, s] = moments.rotations[i];
                [x, y, z, moments.opacity_logits[i], a, b, c, 0.0, p, q, r, s]
            };
            (0..n).flat_map(of).collect()
        };
        write(&self.first, &shapes(&model.first));
        write(&self.second, &shapes(&model.second));
        write(&self.sh_first, model.first.sh.as_flattened());
        write(&self.sh_second, model.second.sh.as_flattened());
        write(&self.cloud.features, &cloud.features);
        write(&self.features_first, &model.first.features);
        write(&self.features_second, &model.second.features);
        let lists = model.exposures.iter().zip(&model.exposures_first).zip(&model.exposures_second);
        let exposures: Vec<Exposure> = lists.flat_map(|((e, m), v)| [*e, *m, *v]).collect();
        write(&self.exposures, exposures.as_flattened());
        let both = model.first.poses.iter().zip(&model.second.poses);
        let poses: Vec<[f32; 6]> = both.flat_map(|(m, v)| [*m, *v]).collect();
        write(&self.pose_moments, poses.as_flattened());
        write(&self.pulls, model.pulls.as_flattened());
        self
    }

    /// Opacity logits. Waits for the card.
    ///
    /// # Errors
    /// The device fails.
    pub fn logits(&self, gpu: &Gpu) -> Result<Vec<f32>, RasterError> {
        let rows: Vec<[f32; 4]> = gpu.read(&self.cloud.scales, self.cloud.count)?;
        Ok(rows.iter().map(|row| row[3]).collect())
    }

    /// Means. Waits for the card.
    ///
    /// # Errors
    /// The device fails.
    pub fn means(&self, gpu: &Gpu) -> Result<Vec<[f32; 3]>, RasterError> {
        let rows: Vec<[f32; 4]> = gpu.read(&self.cloud.means, self.cloud.count)?;
        Ok(rows.iter().map(|row| [row[0], row[1], row[2]]).collect())
    }

    /// Copies everything but poses into a model. Waits for the card.
    ///
    /// # Errors
    /// The device fails.
    pub fn read(&self, gpu: &Gpu, model: &mut Model) -> Result<(), RasterError> {
        let n = self.cloud.count;
        let three = |rows: Vec<[f32; 4]>| -> Vec<[f32; 3]> { rows.iter().map(|r| [r[0], r[1], r[2]]).collect() };
        let cloud = &mut model.cloud;
        cloud.sh_degree = self.cloud.sh_degree;
        let sh = n * cloud.sh_count();
        let features = n * cloud.feature_count;
        cloud.features = gpu.read(&self.cloud.features, features)?;
        cloud.opacity_logits = self.logits(gpu)?;
        cloud.means = self.means(gpu)?;
        cloud.log_scales = three(gpu.read(&self.cloud.scales, n)?);
        cloud.rotations = gpu.read(&self.cloud.rotations, n)?;
        cloud.sh = gpu.read(&self.cloud.sh, sh)?;
        let views = model.exposures.len();
        let poses: Vec<[[f32; 6]; 2]> = gpu.read(&self.pose_moments, views)?;
        for (k, (shape, harmonics)) in
            [(&self.first, &self.sh_first), (&self.second, &self.sh_second)].into_iter().enumerate()
        {
            let rows: Vec<[f32; 12]> = gpu.read(shape, n)?;
            let moments = Gradients {
                means: rows.iter().map(|r| [r[0], r[1], r[2]]).collect(),
                opacity_logits: rows.iter().map(|r| r[3]).collect(),
                log_scales: rows.iter().map(|r| [r[4], r[5], r[6]]).collect(),
                rotations: rows.iter().map(|r| [r[8], r[9], r[10], r[11]]).collect(),
                sh: gpu.read(harmonics, sh)?,
                features: gpu.read(if k == 0 { &self.features_first } else { &self.features_second }, features)?,
                poses: poses.iter().map(|both| both[k]).collect(),
            };
            *(if k == 0 { &mut model.first } else { &mut model.second }) = moments;
        }
        let exposures: Vec<[Exposure; 3]> = gpu.read(&self.exposures, views)?;
        model.exposures = exposures.iter().map(|all| all[0]).collect();
        model.exposures_first = exposures.iter().map(|all| all[1]).collect();
        model.exposures_second = exposures.iter().map(|all| all[2]).collect();
        let shared: Vec<[f32; 48]> = gpu.read(&self.shared, model.shared.len())?;
        model.shared.iter_mut().zip(&shared).for_each(|(one, floats)| *one = shared_of(floats, one.seen));
        model.pulls = gpu.read(&self.pulls, n)?;
        Ok(())
    }
}

fn floats_of(one: &SharedAppearance) -> [f32; 48] {
    let mut out = [0.0; 48];
    out[..12].copy_from_slice(&one.first);
    out[12..24].copy_from_slice(&one.second);
    out[24..27].copy_from_slice(&one.lens);
    out[27..30].copy_from_slice(&one.vignetting);
    let matrix = one.motion.matrix();
    for row in 0..3 {
        (0..3).for_each(|k| out[32 + 4 * row + k] = matrix.row(row)[k] as f32);
        out[35 + 4 * row] = one.motion.position[row] as f32;
    }
    out
}

fn shared_of(floats: &[f32; 48], seen: u32) -> SharedAppearance {
    let row = |k: usize| [0, 1, 2, 3].map(|i| floats[32 + 4 * k + i]);
    SharedAppearance {
        lens: [floats[24], floats[25], floats[26]],
        vignetting: [floats[27], floats[28], floats[29]],
        motion: pose_of(&[row(0), row(1), row(2)]),
        first: std::array::from_fn(|k| floats[k]),
        second: std::array::from_fn(|k| floats[12 + k]),
        seen,
    }
}

/// The pose of rows of a matrix.
pub fn pose_of(rows: &[[f32; 4]; 3]) -> Pose {
    let column = |k: usize| glam::DVec3::new(rows[0][k] as f64, rows[1][k] as f64, rows[2][k] as f64);
    let matrix = glam::DMat3::from_cols(column(0), column(1), column(2));
    Pose { position: column(3), rotation: glam::DQuat::from_mat3(&matrix).normalize() }
}
