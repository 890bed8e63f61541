//! Clouds of 3D Gaussians.

use crate::CoreError;

/// N anisotropic Gaussians with opacity and view-dependent colour (Kerbl et al., *3D Gaussian Splatting*, 2023), as a
/// structure of arrays. Numbers may be anything: a renderer skips a Gaussian whose numbers are not finite.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct GaussianCloud {
    /// Centres in the world, or in the frame of the group that a Gaussian moves with \[m\], shape `[N, 3]`.
    pub means: Vec<[f32; 3]>,
    /// Natural logarithm of the standard deviation along the Gaussian's own axes \[ln m\], shape `[N, 3]`.
    pub log_scales: Vec<[f32; 3]>,
    /// Quaternions w, x, y, z from the Gaussian's axes to those of `means`, shape `[N, 4]`; need not be normalised.
    pub rotations: Vec<[f32; 4]>,
    /// Opacity before the logistic function, shape `[N]`.
    pub opacity_logits: Vec<f32>,
    /// Degree of the spherical harmonics, 0 to 3.
    pub sh_degree: u8,
    /// Coefficients, red, green, blue, shape `[N, (sh_degree + 1)², 3]`. Order and signs are those of the 3DGS authors and of
    /// gsplat; colour = max(0, 0.5 + sum of coefficient times basis function).
    pub sh: Vec<[f32; 3]>,
    /// Length k of the feature vector, 0 to 16.
    pub feature_count: usize,
    /// Features such as label scores, shape `[N, k]`.
    pub features: Vec<f32>,
}

impl GaussianCloud {
    /// Largest degree of the spherical harmonics.
    pub const MAX_SH_DEGREE: u8 = 3;
    /// Longest feature vector.
    pub const MAX_FEATURES: usize = 16;

    /// Number of Gaussians `N`.
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// Whether there is no Gaussian.
    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    /// Spherical harmonics per Gaussian and colour, `(sh_degree + 1)²`.
    pub fn sh_count(&self) -> usize {
        (self.sh_degree as usize + 1).pow(2)
    }

    /// Coefficients of one Gaussian, shape `[(sh_degree + 1)², 3]`.
    pub fn sh_of(&self, index: usize) -> &[[f32; 3]] {
        &self.sh[index * self.sh_count()..(index + 1) * self.sh_count()]
    }

    /// Features of one Gaussian, shape `[k]`.
    pub fn features_of(&self, index: usize) -> &[f32] {
        &self.features[index * self.feature_count..(index + 1) * self.feature_count]
    }

    /// The Gaussians for whose index `keep` is true, in their order.
    pub fn filtered(&self, keep: impl Fn(usize) -> bool) -> Self {
        let kept: Vec<usize> = (0..self.len()).filter(|&k| keep(k)).collect();
        Self {
            means: kept.iter().map(|&k| self.means[k]).collect(),
            log_scales: kept.iter().map(|&k| self.log_scales[k]).collect(),
            rotations: kept.iter().map(|&k| self.rotations[k]).collect(),
            opacity_logits: kept.iter().map(|&k| self.opacity_logits[k]).collect(),
            sh_degree: self.sh_degree,
            sh: kept.iter().flat_map(|&k| self.sh_of(k)).copied().collect(),
            feature_count: self.feature_count,
            features: kept.iter().flat_map(|&k| self.features_of(k)).copied().collect(),
        }
    }

    /// Checks degree, feature count and the lengths of all arrays.
    ///
    /// # Errors
    /// Names the first that is off.
    pub fn check(&self) -> Result<(), CoreError> {
        if self.sh_degree > Self::MAX_SH_DEGREE {
            let found = self.sh_degree.to_string();
            return Err(CoreError::Range { what: "degree of spherical harmonics", expected: "0 to 3", found });
        }
        if self.feature_count > Self::MAX_FEATURES {
            let found = self.feature_count.to_string();
            return Err(CoreError::Range { what: "features per Gaussian", expected: "0 to 16", found });
        }
        if self.len() > u32::MAX as usize {
            let found = self.len().to_string();
            return Err(CoreError::Range { what: "number of Gaussians", expected: "less than 2^32", found });
        }
        let n = self.len();
        for (what, expected, found) in [
            ("log scales of a cloud", n, self.log_scales.len()),
            ("rotations of a cloud", n, self.rotations.len()),
            ("opacity logits of a cloud", n, self.opacity_logits.len()),
            ("spherical harmonics of a cloud", n * self.sh_count(), self.sh.len()),
            ("features of a cloud", n * self.feature_count, self.features.len()),
        ] {
            if expected != found {
                return Err(CoreError::Length { what, expected, found });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two() -> GaussianCloud {
        GaussianCloud {
            means: vec![[0.0; 3]; 2],
            log_scales: vec![[-3.0; 3]; 2],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; 2],
            opacity_logits: vec![0.0; 2],
            sh_degree: 1,
            sh: (0..8).map(|i| [i as f32; 3]).collect(),
            feature_count: 3,
            features: (0..6).map(|i| i as f32).collect(),
        }
    }

    #[test]
    fn a_good_cloud_passes_and_is_cut_by_gaussian() {
        assert_eq!(two().check(), Ok(()));
        assert_eq!(GaussianCloud::default().check(), Ok(()));
        assert_eq!(two().sh_of(1)[0], [4.0; 3]);
        assert_eq!(two().features_of(1), [3.0, 4.0, 5.0]);
    }

    #[test]
    fn a_filtered_cloud_has_all_of_the_gaussians_that_stay() {
        let second = two().filtered(|k| k == 1);
        assert_eq!(second.check(), Ok(()));
        assert_eq!((second.len(), second.sh_of(0), second.features_of(0)), (1, two().sh_of(1), two().features_of(1)));
        assert_eq!(two().filtered(|_| true), two());
        assert!(two().filtered(|_| false).is_empty());
    }

    #[test]
    fn each_fault_is_named() {
        let what = |change: fn(&mut GaussianCloud)| {
            let mut cloud = two();
            change(&mut cloud);
            match cloud.check() {
                Err(CoreError::Length { what, .. } | CoreError::Range { what, .. }) => what,
                other => panic!("{other:?}"),
            }
        };
        assert_eq!(what(|c| c.sh_degree = 4), "degree of spherical harmonics");
        assert_eq!(what(|c| c.feature_count = 17), "features per Gaussian");
        assert_eq!(what(|c| c.log_scales.truncate(1)), "log scales of a cloud");
        assert_eq!(what(|c| c.rotations.push([0.0; 4])), "rotations of a cloud");
        assert_eq!(what(|c| c.opacity_logits.clear()), "opacity logits of a cloud");
        assert_eq!(what(|c| c.sh_degree = 2), "spherical harmonics of a cloud");
        assert_eq!(what(|c| c.features.truncate(5)), "features of a cloud");
    }
}
