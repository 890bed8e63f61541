//! Clouds from and to files, one module per format.
//!
//! Frames: a cloud is in the frame of the PLY file that it is written to, which by habit has y down and z forward. SPZ stores
//! y up and z back; its reader and writer turn the world by half a turn about x, so that one cloud written to both formats is
//! the same cloud in both. Coordinates in glTF are taken as they are, after the transforms of its nodes.

mod accessor;
pub mod compressed_ply;
mod format;
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

pub use format::{Beside, Format, SplatFile};
pub use points::Points;
pub use quantised::OPAQUE_LOGIT;
pub use sieve::FLAT_LOG_SCALE;

use crate::SplatError;
use crate::error::off;
use qv_core::GaussianCloud;

/// Reads a file of any format that its content shows, and that needs no other file.
///
/// # Errors
/// The content is of no format, is cut off, or contradicts itself. See each format's `read`.
pub fn read_any(bytes: &[u8]) -> Result<SplatFile, SplatError> {
    read_named(bytes, "", &mut |_| Err("not looked for".into()))
}

/// Reads a file of any format, which its content shows, or else its name; `beside` gives the files that it names.
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
