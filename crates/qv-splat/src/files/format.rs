//! The formats, and what a file of one held.

use super::ply_header;
use crate::SplatError;
use crate::captures::json;
use crate::error::off;
use qv_core::GaussianCloud;

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

    /// What a file's first bytes say. Those of `.splat` say nothing: its name does ([`super::read_named`]).
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
    pub remarks: Vec<String>,
    /// Colour that the scene was made to be drawn over, 0 to 1, where the file shows one.
    pub background: Option<[f32; 3]>,
    /// Whether the scene was made to be drawn with opacities that make up for the low-pass ([`qv_raster::Settings::antialias`]).
    pub antialias: bool,
}

/// Gives the contents of a file beside the one that is read, or says where it is missed.
pub type Beside<'a> = &'a mut dyn FnMut(&str) -> Result<Vec<u8>, String>;

/// Whether the first byte that is no blank or mark begins an object.
pub(super) fn is_json(bytes: &[u8]) -> bool {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    bytes.iter().find(|byte| !byte.is_ascii_whitespace()) == Some(&b'{')
}
