//! What is drawn: a cloud, the groups of it that move, and the views.

use crate::RasterError;
use crate::constants::{ANTIALIAS_LOW_PASS, LOW_PASS};
use qv_core::{Camera, GaussianCloud, Pose};

/// A cloud that all environments share, with groups of Gaussians that move in each environment on their own.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    /// The Gaussians.
    pub cloud: &'a GaussianCloud,
    /// Group of each Gaussian, shape `[N]`: 0 stays, g > 0 moves with group g. Empty when all stay.
    pub group_of: &'a [u32],
    /// `world_from_group` of the groups 1 to G, shape `[environments, G]`; `None` where a group is absent. Empty when there are no
    /// groups; there is one environment then.
    pub environments: &'a [Vec<Option<Pose>>],
}

impl<'a> Scene<'a> {
    /// A cloud that stays where it is.
    pub fn still(cloud: &'a GaussianCloud) -> Self {
        Self { cloud, group_of: &[], environments: &[] }
    }

    /// Number of groups, the one that stays included.
    pub fn group_count(&self) -> usize {
        1 + self.environments.first().map_or(0, Vec::len)
    }

    /// Group of a Gaussian.
    pub(crate) fn group(&self, splat: usize) -> usize {
        self.group_of.get(splat).map_or(0, |&group| group as usize)
    }

    /// Checks lengths and indices of the cloud, the groups and the environments.
    ///
    /// # Errors
    /// Names what is off.
    pub fn check(&self) -> Result<(), RasterError> {
        self.cloud.check().map_err(|source| RasterError::Input { place: "cloud".into(), source })?;
        if !self.group_of.is_empty() && self.group_of.len() != self.cloud.len() {
            return Err(RasterError::Length {
                what: "group of each Gaussian".into(),
                expected: self.cloud.len(),
                found: self.group_of.len(),
            });
        }
        for (e, poses) in self.environments.iter().enumerate() {
            if poses.len() + 1 != self.group_count() {
                return Err(RasterError::Length {
                    what: format!("poses of groups in environment {e}"),
                    expected: self.group_count() - 1,
                    found: poses.len(),
                });
            }
        }
        let beyond = self.group_of.iter().position(|&group| group as usize >= self.group_count());
        match beyond {
            Some(splat) => Err(RasterError::Index {
                what: format!("group of Gaussian {splat}"),
                count: self.group_count(),
                found: self.group_of[splat] as usize,
            }),
            None => Ok(()),
        }
    }
}

/// A camera in an environment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// The camera.
    pub camera: Camera,
    /// Index into [`Scene::environments`]; 0 when there are none.
    pub environment: usize,
}

impl View {
    /// A view of the first environment.
    pub fn of(camera: Camera) -> Self {
        Self { camera, environment: 0 }
    }
}

/// What is drawn besides colour and alpha.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Outputs {
    /// Expected depth.
    pub depth: bool,
    /// Normal and plane depth.
    pub plane: bool,
    /// The feature vector.
    pub features: bool,
}

impl Outputs {
    /// Everything.
    pub const ALL: Self = Self { depth: true, plane: true, features: true };
}

/// How to draw.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Settings {
    /// What is drawn besides colour and alpha.
    pub outputs: Outputs,
    /// Colour behind all Gaussians.
    pub background: [f32; 3],
    /// Gaussians that are made wider so as not to fall between pixels are made fainter by as much (the 2D filter of Yu et al.,
    /// *Mip-Splatting*, CVPR 2024, eq. 12): images of a scene become right at any size, for a cloud that was trained so.
    pub antialias: bool,
}

impl Settings {
    /// What is added to both variances of a projected Gaussian \[px²\].
    pub(crate) fn low_pass(&self) -> f32 {
        if self.antialias { ANTIALIAS_LOW_PASS } else { LOW_PASS }
    }
}

/// One image, row by row from the top. Arrays of outputs that were not asked for are empty.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Image {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Colour over the background, shape `[height, width, 3]`.
    pub colour: Vec<f32>,
    /// One minus the transmittance, shape `[height, width]`.
    pub alpha: Vec<f32>,
    /// Mean depth along z of the camera of what is seen, weighted by visibility \[m\], shape `[height, width]`; 0 where alpha is.
    pub depth: Vec<f32>,
    /// Depth along z of the blended plane under the pixel's ray \[m\], shape `[height, width]`; 0 where no plane faces the camera.
    pub plane_depth: Vec<f32>,
    /// Sum of the Gaussians' unit normals in camera axes, towards the camera, weighted by visibility, shape `[height, width, 3]`;
    /// not normalised.
    pub normal: Vec<f32>,
    /// Sum of the features, weighted by visibility, shape `[height, width, k]`.
    pub features: Vec<f32>,
}

impl Image {
    /// The colour rounded to 0 to 255, shape `[height, width, 3]`.
    pub fn colour_u8(&self) -> Vec<u8> {
        self.colour.iter().map(|c| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8).collect()
    }
}

/// Derivatives of a scalar with respect to a cloud and the poses of the cameras.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Gradients {
    /// Shape `[N, 3]`, as the cloud's arrays below.
    pub means: Vec<[f32; 3]>,
    /// Shape `[N, 3]`.
    pub log_scales: Vec<[f32; 3]>,
    /// Shape `[N, 4]`.
    pub rotations: Vec<[f32; 4]>,
    /// Shape `[N]`.
    pub opacity_logits: Vec<f32>,
    /// Shape `[N, (degree + 1)², 3]`.
    pub sh: Vec<[f32; 3]>,
    /// Shape `[N, k]`.
    pub features: Vec<f32>,
    /// With respect to a twist on the left of `camera_from_world`: exp((v, w)) `camera_from_world` with translation v \[m\] first,
    /// then rotation w \[rad\], both in camera axes; shape `[views, 6]`.
    pub poses: Vec<[f32; 6]>,
}

impl Gradients {
    /// Zeros of the shapes of a cloud.
    pub fn zeros(cloud: &GaussianCloud, views: usize) -> Self {
        Self {
            means: vec![[0.0; 3]; cloud.len()],
            log_scales: vec![[0.0; 3]; cloud.len()],
            rotations: vec![[0.0; 4]; cloud.len()],
            opacity_logits: vec![0.0; cloud.len()],
            sh: vec![[0.0; 3]; cloud.sh.len()],
            features: vec![0.0; cloud.features.len()],
            poses: vec![[0.0; 6]; views],
        }
    }
}
