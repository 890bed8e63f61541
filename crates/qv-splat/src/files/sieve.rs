//! Gaussians one by one into a cloud, without those whose numbers say nothing.

use super::format::{Format, SplatFile};
use super::quantised::OPAQUE_LOGIT;
use crate::SplatError;
use qv_core::{CoreError, GaussianCloud};

/// Log scale that stands for a Gaussian without extent along an axis: that of a picometre.
pub const FLAT_LOG_SCALE: f32 = -27.631_021;

/// One Gaussian as a file has it.
pub struct Splat<'a> {
    pub mean: [f32; 3],
    pub log_scale: [f32; 3],
    /// w, x, y, z.
    pub rotation: [f32; 4],
    pub opacity_logit: f32,
    /// Shape `[(degree + 1)², 3]`.
    pub sh: &'a [[f32; 3]],
    pub features: &'a [f32],
}

/// Collects a cloud.
pub struct Sieve {
    cloud: GaussianCloud,
    left_out: usize,
}

impl Sieve {
    /// For `count` Gaussians, which the caller has held against the bytes of the file.
    pub fn new(count: usize, sh_degree: u8, feature_count: usize) -> Self {
        let functions = (sh_degree as usize + 1).pow(2);
        let cloud = GaussianCloud {
            means: Vec::with_capacity(count),
            log_scales: Vec::with_capacity(count),
            rotations: Vec::with_capacity(count),
            opacity_logits: Vec::with_capacity(count),
            sh_degree,
            sh: Vec::with_capacity(count * functions),
            feature_count,
            features: Vec::with_capacity(count * feature_count),
        };
        Self { cloud, left_out: 0 }
    }

    /// Adds a Gaussian, or counts it when its numbers say nothing. An opacity of exactly 0 or 1 and an extent of exactly 0,
    /// which are infinite as logits and logarithms and which converters write, become the nearest finite ones.
    pub fn push(&mut self, splat: &Splat) {
        let flat = |log: f32| if log == f32::NEG_INFINITY { FLAT_LOG_SCALE } else { log };
        let log_scale = splat.log_scale.map(flat);
        let logit = match splat.opacity_logit {
            infinite if infinite.is_infinite() => OPAQUE_LOGIT.copysign(infinite),
            logit => logit,
        };
        if !is_good(&splat.mean, &log_scale, &splat.rotation, logit, splat.sh, splat.features) {
            self.left_out += 1;
            return;
        }
        self.cloud.means.push(splat.mean);
        self.cloud.log_scales.push(log_scale);
        self.cloud.rotations.push(splat.rotation);
        self.cloud.opacity_logits.push(logit);
        self.cloud.sh.extend_from_slice(splat.sh);
        self.cloud.features.extend_from_slice(splat.features);
    }

    /// What was collected.
    pub fn finish(self, format: Format, lost: Vec<String>) -> SplatFile {
        SplatFile {
            cloud: self.cloud,
            format,
            left_out: self.left_out,
            lost,
            remarks: vec![],
            background: None,
            antialias: false,
        }
    }
}

/// Whether all numbers are finite and the quaternion has a direction.
pub fn is_good(
    mean: &[f32; 3],
    log_scale: &[f32; 3],
    rotation: &[f32; 4],
    opacity_logit: f32,
    sh: &[[f32; 3]],
    features: &[f32],
) -> bool {
    let finite = |numbers: &[f32]| numbers.iter().all(|x| x.is_finite());
    let squared: f32 = rotation.iter().map(|x| x * x).sum();
    finite(mean)
        && finite(log_scale)
        && squared.is_finite()
        && squared > qv_raster::constants::MIN_QUATERNION
        && opacity_logit.is_finite()
        && sh.iter().all(|colour| finite(colour))
        && finite(features)
}

/// What every writer asks of a cloud.
pub(super) fn check(cloud: &GaussianCloud) -> Result<(), SplatError> {
    cloud.check()?;
    for index in 0..cloud.len() {
        if !is_good(
            &cloud.means[index],
            &cloud.log_scales[index],
            &cloud.rotations[index],
            cloud.opacity_logits[index],
            cloud.sh_of(index),
            cloud.features_of(index),
        ) {
            let found = format!("mean {:?}, rotation {:?}", cloud.means[index], cloud.rotations[index]);
            return Err(CoreError::NotFinite { what: "Gaussian", index, found }.into());
        }
    }
    Ok(())
}
