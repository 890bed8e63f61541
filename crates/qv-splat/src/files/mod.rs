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
pub mod splat;
pub mod spz;
mod spz_container;

pub use points::Points;

use crate::SplatError;
use crate::captures::json;
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
    /// glTF 2.0 with `KHR_gaussian_splatting`, as GLB or as JSON.
    Gltf,
    /// antimatter15's rows of 32 bytes; read only.
    Splat,
}

impl Format {
    /// Those that are written.
    pub const ALL: [Self; 4] = [Self::Ply, Self::CompressedPly, Self::Spz, Self::Gltf];

    /// What people call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ply => "3DGS PLY",
            Self::CompressedPly => "compressed PLY",
            Self::Spz => "SPZ",
            Self::Gltf => "glTF KHR_gaussian_splatting",
            Self::Splat => ".splat",
        }
    }

    /// What a file's first bytes say. Those of `.splat` say nothing: its name does ([`read_named`]).
    ///
    /// # Errors
    /// None of the formats; a SOG is named.
    pub fn of_content(bytes: &[u8]) -> Result<Self, SplatError> {
        let expected = "a PLY, SPZ, GLB or glTF file (.splat is known by name)";
        match bytes {
            [b'p', b'l', b'y', b'\n' | b'\r', ..] => {
                // Whether the rows are all there, the reader says.
                let compressed = ply_header::Header::parse_head(bytes, u64::MAX)?.find("chunk").is_some();
                Ok(if compressed { Self::CompressedPly } else { Self::Ply })
            }
            [0x1f, 0x8b, ..] | [b'N', b'G', b'S', b'P', ..] => Ok(Self::Spz),
            [b'g', b'l', b'T', b'F', ..] => Ok(Self::Gltf),
            [b'P', b'K', 3, 4, ..] => Err(SplatError::Unread { format: "a SOG, or another ZIP archive" }),
            [] => Err(off("file", expected, "an empty one")),
            _ if is_json(bytes) => {
                let document = json::parse(bytes, "file")?;
                let has = |key: &str| document.get(key).is_some();
                match (has("asset") && has("buffers"), has("means") && has("quats") || has("lodLevels")) {
                    (true, _) => Ok(Self::Gltf),
                    (false, true) => Err(SplatError::Unread { format: "a SOG" }),
                    (false, false) => Err(off("file", expected, "other JSON")),
                }
            }
            _ if bytes.starts_with(b"version https://git-lfs") => Err(off("file", expected, "a pointer of Git LFS")),
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
    /// What was done with the file's numbers, or passed over, a line each; nothing is lost by it.
    pub told: Vec<String>,
    /// Colour that the scene was made to be drawn over, 0 to 1, where the file tells one.
    pub background: Option<[f32; 3]>,
    /// Whether the scene was made to be drawn with opacities that make up for the low-pass ([`qv_raster::Settings::antialias`]).
    pub antialias: bool,
}

/// Gives the contents of a file beside the one that is read, or says where it is missed.
pub type Beside<'a> = &'a mut dyn FnMut(&str) -> Result<Vec<u8>, String>;

/// Reads a file of any format that its content tells, and that needs no other file.
///
/// # Errors
/// The content is of no format, is cut off, or contradicts itself. See each format's `read`.
pub fn read_any(bytes: &[u8]) -> Result<SplatFile, SplatError> {
    read_named(bytes, "", &mut |_| Err("not looked for".into()))
}

/// Reads a file of any format, which its content tells, or else its name; `beside` gives the files that it names.
///
/// # Errors
/// As [`read_any`].
pub fn read_named(bytes: &[u8], name: &str, beside: Beside) -> Result<SplatFile, SplatError> {
    let name = name.to_lowercase();
    let format = match Format::of_content(bytes) {
        Err(_) if name.ends_with(".ksplat") => return Err(SplatError::Unread { format: "a .ksplat file" }),
        Err(_) if name.ends_with(".splat") => Format::Splat,
        format => format?,
    };
    match format {
        Format::Ply => ply::read(bytes),
        Format::CompressedPly => compressed_ply::read(bytes),
        Format::Spz => spz::read(bytes),
        Format::Gltf => gltf::read_with(bytes, beside),
        Format::Splat => splat::read(bytes),
    }
}

/// Whether the first byte that is no blank or mark begins an object.
fn is_json(bytes: &[u8]) -> bool {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    bytes.iter().find(|byte| !byte.is_ascii_whitespace()) == Some(&b'{')
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
        Format::Splat => {
            Err(off(format.name(), "PLY, compressed PLY, SPZ or glTF to write", "a format that is only read"))
        }
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
