//! Cameras and poses as COLMAP states them.

use super::distortion::Distortion;
use crate::SplatError;
use crate::error::off;
use qv_core::{Camera, Pose};

/// All models in the order of COLMAP's numbers, with those that are not read.
const MODELS: [(&str, Option<Model>); 11] = [
    ("SIMPLE_PINHOLE", Some(Model::SimplePinhole)),
    ("PINHOLE", Some(Model::Pinhole)),
    ("SIMPLE_RADIAL", Some(Model::SimpleRadial)),
    ("RADIAL", Some(Model::Radial)),
    ("OPENCV", Some(Model::OpenCv)),
    ("OPENCV_FISHEYE", None),
    ("FULL_OPENCV", Some(Model::FullOpenCv)),
    ("FOV", None),
    ("SIMPLE_RADIAL_FISHEYE", None),
    ("RADIAL_FISHEYE", None),
    ("THIN_PRISM_FISHEYE", None),
];

/// Intrinsics that images share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Intrinsics {
    pub camera: Camera,
    pub distortion: Distortion,
}

/// An image with its pose.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PosedImage {
    pub camera: u32,
    pub camera_from_world: Pose,
    pub name: String,
}

/// Camera models that are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Model {
    /// f, cx, cy.
    SimplePinhole,
    /// fx, fy, cx, cy.
    Pinhole,
    /// f, cx, cy, k1.
    SimpleRadial,
    /// f, cx, cy, k1, k2.
    Radial,
    /// fx, fy, cx, cy, k1, k2, p1, p2.
    OpenCv,
    /// fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6, of which the last three must be 0.
    FullOpenCv,
}

impl Model {
    /// # Errors
    /// It is one that is not read, or unknown.
    pub(super) fn of_name(name: &str, place: &str) -> Result<Self, SplatError> {
        let found = MODELS.iter().find(|(known, _)| *known == name).and_then(|(_, model)| *model);
        found.ok_or_else(|| {
            let read: Vec<&str> = MODELS.iter().filter(|(_, model)| model.is_some()).map(|(name, _)| *name).collect();
            off(format!("{place}, camera model"), read.join(", "), name)
        })
    }

    /// # Errors
    /// As [`Self::of_name`].
    pub(super) fn of_number(number: u32, place: &str) -> Result<Self, SplatError> {
        let name = MODELS.get(number as usize).map_or_else(|| format!("number {number}"), |(name, _)| (*name).into());
        Self::of_name(&name, place)
    }

    /// How many numbers it has.
    pub(super) fn parameters(self) -> usize {
        match self {
            Self::SimplePinhole => 3,
            Self::Pinhole | Self::SimpleRadial => 4,
            Self::Radial => 5,
            Self::OpenCv => 8,
            Self::FullOpenCv => 12,
        }
    }

    /// The camera, at the origin, with its distortion; `p` has as many numbers as [`Self::parameters`] says.
    pub(super) fn intrinsics(self, size: [u64; 2], p: &[f64], place: &str) -> Result<Intrinsics, SplatError> {
        let (fx, fy, cx, cy) = match self {
            Self::SimplePinhole | Self::SimpleRadial | Self::Radial => (p[0], p[0], p[1], p[2]),
            Self::Pinhole | Self::OpenCv | Self::FullOpenCv => (p[0], p[1], p[2], p[3]),
        };
        let mut distortion = Distortion::default();
        match self {
            Self::SimplePinhole | Self::Pinhole => {}
            Self::SimpleRadial => distortion.k1 = p[3],
            Self::Radial => (distortion.k1, distortion.k2) = (p[3], p[4]),
            Self::OpenCv | Self::FullOpenCv => {
                distortion = Distortion { k1: p[4], k2: p[5], p1: p[6], p2: p[7], k3: 0.0 };
            }
        }
        if self == Self::FullOpenCv {
            distortion.k3 = p[8];
            if p[9..12] != [0.0; 3] {
                return Err(off(format!("{place}, k4, k5, k6"), "0, 0, 0", format!("{:?}", &p[9..12])));
            }
        }
        let side = |side: u64| u32::try_from(side).map_err(|_| off(place, "a size in pixels", side));
        let (width, height) = (side(size[0])?, side(size[1])?);
        let camera = Camera { fx, fy, cx, cy, width, height, camera_from_world: Pose::IDENTITY };
        Ok(Intrinsics { camera, distortion })
    }
}

/// `camera_from_world` from w, x, y, z, and translation.
pub(super) fn pose(wxyz: [f64; 4], translation: [f64; 3], place: &str) -> Result<Pose, SplatError> {
    let pose = Pose::from_position_wxyz(translation, wxyz);
    pose.ok_or_else(|| off(place, "a quaternion and a translation", format!("{wxyz:?} {translation:?}")))
}
