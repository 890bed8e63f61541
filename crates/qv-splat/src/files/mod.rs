//! Clouds from and to files, one module per format.
//!
//! Frames: a cloud is in the frame of the PLY file that it is written to, which by habit has y down and z forward. SPZ stores
//! y up and z back; its reader and writer turn the world by half a turn about x, so that one cloud written to both formats is
//! the same cloud in both. Coordinates in glTF are taken as they are, after the transforms of its nodes.

mod accessor;
pub mod compressed_ply;
mod glb;
pub mod gltf;
pub mod ply;
mod ply_header;
pub mod points;
mod quantised;
mod sieve;
pub mod spz;
mod spz_container;

pub use points::Points;

use crate::SplatError;
use crate::error::off;
use qv_core::{CoreError, GaussianCloud};

/// Log scale that stands for a Gaussian without extent along an axis: that of a picometre.
pub const FLAT_LOG_SCALE: f32 = -27.631_021;
/// Opacity logit that stands for opacity 1, and its negative for 0: what is left to 1 is half a step of single precision.
pub const OPAQUE_LOGIT: f32 = 16.635_532;

/// The formats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// The PLY of the 3DGS authors.
    Ply,
    /// PlayCanvas' compressed PLY, 16 bytes per Gaussian without harmonics.
    CompressedPly,
    /// Niantic's SPZ.
    Spz,
    /// glTF 2.0 with `KHR_gaussian_splatting`, as GLB.
    Gltf,
}

impl Format {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Ply, Self::CompressedPly, Self::Spz, Self::Gltf];

    /// What people call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ply => "3DGS PLY",
            Self::CompressedPly => "compressed PLY",
            Self::Spz => "SPZ",
            Self::Gltf => "glTF KHR_gaussian_splatting",
        }
    }

    /// What a file's first bytes say.
    ///
    /// # Errors
    /// None of the formats.
    pub fn of_content(bytes: &[u8]) -> Result<Self, SplatError> {
        let expected = "a PLY, SPZ or GLB file";
        match bytes {
            [b'p', b'l', b'y', b'\n' | b'\r', ..] => {
                let compressed = ply_header::Header::parse(bytes)?.find("chunk").is_some();
                Ok(if compressed { Self::CompressedPly } else { Self::Ply })
            }
            [0x1f, 0x8b, ..] | [b'N', b'G', b'S', b'P', ..] => Ok(Self::Spz),
            [b'g', b'l', b'T', b'F', ..] => Ok(Self::Gltf),
            [] => Err(off("file", expected, "an empty one")),
            [b'{', ..] => Err(off("file", expected, "JSON (glTF with its data in other files is not read)")),
            _ => Err(off("file", expected, format!("{:02x?}", &bytes[..bytes.len().min(4)]))),
        }
    }

    /// The format that a file's name asks for: `.compressed.ply`, `.ply`, `.spz` or `.glb`.
    pub fn of_name(name: &str) -> Option<Self> {
        let name = name.to_lowercase();
        let endings =
            [(".compressed.ply", Self::CompressedPly), (".ply", Self::Ply), (".spz", Self::Spz), (".glb", Self::Gltf)];
        endings.iter().find(|(ending, _)| name.ends_with(ending)).map(|(_, format)| *format)
    }
}

/// What a file held.
#[derive(Debug, Clone, PartialEq)]
pub struct SplatFile {
    /// The good Gaussians, in the file's order; all numbers are finite and no quaternion is zero.
    pub cloud: GaussianCloud,
    /// The format.
    pub format: Format,
    /// Gaussians that were kept out: a number that is not finite, or a quaternion of length zero.
    pub left_out: usize,
    /// What else the file holds and a cloud does not, a line each.
    pub lost: Vec<String>,
    /// Colour that the scene was made to be drawn over, 0 to 1, where the file tells one.
    pub background: Option<[f32; 3]>,
}

/// Reads a file of any format, which its content tells.
///
/// # Errors
/// The content is of no format, is cut off, or contradicts itself. See each format's `read`.
pub fn read_any(bytes: &[u8]) -> Result<SplatFile, SplatError> {
    match Format::of_content(bytes)? {
        Format::Ply => ply::read(bytes),
        Format::CompressedPly => compressed_ply::read(bytes),
        Format::Spz => spz::read(bytes),
        Format::Gltf => gltf::read(bytes),
    }
}

/// A file of a format. All but compressed PLY keep the order of the Gaussians.
///
/// # Errors
/// The cloud's arrays disagree, a number is not finite, a quaternion is zero, or the format cannot hold as much.
pub fn write(cloud: &GaussianCloud, format: Format) -> Result<Vec<u8>, SplatError> {
    match format {
        Format::Ply => ply::write(cloud),
        Format::CompressedPly => compressed_ply::write(cloud),
        Format::Spz => spz::write(cloud),
        Format::Gltf => gltf::write(cloud),
    }
}

/// What every writer asks of a cloud.
fn check(cloud: &GaussianCloud) -> Result<(), SplatError> {
    cloud.check()?;
    for index in 0..cloud.len() {
        if !sieve::is_good(
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
