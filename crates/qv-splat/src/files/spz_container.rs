//! The containers of SPZ: one gzip stream (versions 1 to 3), or a table of zstd streams (version 4). Both hold the same arrays
//! in the same order, which are laid out behind each other here.

use crate::SplatError;
use crate::cursor::{Cursor, u32_at};
use crate::error::off;
use flate2::{Compression, bufread::GzDecoder, write::GzEncoder};
use std::io::{Read, Write};

/// Versions of the format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Version {
    /// Positions as half floats.
    V1 = 1,
    /// Fixed-point positions, rotations in three bytes.
    V2 = 2,
    /// Rotations in four bytes.
    V3 = 3,
    /// As 3, in another container.
    V4 = 4,
}

const MAGIC: &[u8; 4] = b"NGSP";
/// Bytes of the header of versions 1 to 3, and of version 4.
const HEADERS: [usize; 2] = [16, 32];
/// Arrays that are decoded may be this many times the file's size; small files may be decoded to [`LEAST_LIMIT`] bytes anyhow.
const LARGEST_RATIO: u64 = 64;
const LEAST_LIMIT: u64 = 64 << 20;
/// Flag of the header: the scene was trained with anti-aliasing.
const ANTIALIASED: u8 = 1;
/// Flag of the header: vendors' records follow.
const HAS_EXTENSIONS: u8 = 2;
/// Type of a vendor's record that names the axes that the file is in, and the number of ours: right, up, back.
const AXES: (u32, u32) = (0xADBE_0003, 4);
/// Names of the arrays in their order.
const ARRAYS: [&str; 6] = ["positions", "alphas", "colours", "scales", "rotations", "harmonics"];
/// What an error says it is about.
const PLACE: &str = "SPZ";

/// Arrays of a file, decompressed.
#[derive(Debug)]
pub struct Arrays {
    pub version: Version,
    pub count: usize,
    /// Degree of the harmonics, 0 to 4.
    pub degree: u8,
    pub fractional_bits: u8,
    /// Whether the scene was trained with anti-aliasing.
    pub antialias: bool,
    /// All arrays behind each other.
    pub data: Vec<u8>,
    pub lost: Vec<String>,
}

/// Bytes that a Gaussian takes in each array.
pub fn widths(version: Version, degree: u8) -> [usize; 6] {
    let (position, rotation) = match version {
        Version::V1 => (6, 3),
        Version::V2 => (9, 3),
        Version::V3 | Version::V4 => (9, 4),
    };
    [position, 1, 3, 3, rotation, 3 * ((degree as usize + 1).pow(2) - 1)]
}

impl Arrays {
    /// One of the arrays, by its place in the order.
    pub fn array(&self, index: usize) -> &[u8] {
        let widths = widths(self.version, self.degree);
        let start = self.count * widths[..index].iter().sum::<usize>();
        &self.data[start..start + self.count * widths[index]]
    }

    fn header(bytes: &[u8], known: &[Version]) -> Result<Self, SplatError> {
        if bytes[..4] != *MAGIC {
            return Err(off("SPZ header, byte 0", "NGSP", format!("{:02x?}", &bytes[..4])));
        }
        let number = u32_at(bytes, 4);
        let version = known.iter().find(|version| **version as u32 == number);
        let version = *version.ok_or_else(|| {
            let known: Vec<String> = known.iter().map(|version| (*version as u32).to_string()).collect();
            off("SPZ header, byte 4", format!("version {} in this container", known.join(", ")), number)
        })?;
        let (degree, fractional_bits) = (bytes[12], bytes[13]);
        if degree > 4 {
            return Err(off("SPZ header, byte 12", "harmonics of degree 0 to 4", degree));
        }
        if fractional_bits > 24 {
            return Err(off("SPZ header, byte 13", "0 to 24 fractional bits", fractional_bits));
        }
        let count = u32_at(bytes, 8) as usize;
        let antialias = bytes[14] & ANTIALIASED != 0;
        Ok(Self { version, count, degree, fractional_bits, antialias, data: vec![], lost: vec![] })
    }

    /// Bytes of all arrays, held against what a file of `length` bytes may decode to.
    fn total(&self, length: usize) -> Result<usize, SplatError> {
        let total = self.count as u64 * widths(self.version, self.degree).iter().sum::<usize>() as u64;
        let limit = (LARGEST_RATIO * length as u64).max(LEAST_LIMIT);
        if total > limit {
            let place = format!("SPZ header, bytes of {} Gaussians in a file of {length} bytes", self.count);
            return Err(SplatError::TooLarge { place, limit, found: total });
        }
        Ok(total as usize)
    }
}

/// Opens either container.
pub fn open(bytes: &[u8]) -> Result<Arrays, SplatError> {
    if bytes.starts_with(MAGIC) { open_streams(bytes) } else { open_gzip(bytes) }
}

fn open_gzip(bytes: &[u8]) -> Result<Arrays, SplatError> {
    let mut decoder = GzDecoder::new(bytes);
    let read = |decoder: &mut GzDecoder<&[u8]>, count: usize, what: &str| {
        let mut out = Vec::new();
        let result = decoder.take(count as u64).read_to_end(&mut out);
        result.map_err(|error| off(format!("SPZ, {what}"), format!("{count} bytes in gzip"), error))?;
        Ok::<Vec<u8>, SplatError>(out)
    };
    let header = read(&mut decoder, HEADERS[0], "header")?;
    if header.len() < HEADERS[0] {
        let found = header.len() as u64;
        return Err(SplatError::CutOff { place: "SPZ header".into(), byte: 0, expected: 16, found });
    }
    let mut arrays = Arrays::header(&header, &[Version::V1, Version::V2, Version::V3])?;
    let total = arrays.total(bytes.len())?;
    arrays.data = read(&mut decoder, total, "arrays")?;
    if arrays.data.len() < total {
        let place = format!("SPZ, arrays of {} Gaussians", arrays.count);
        let found = arrays.data.len() as u64;
        return Err(SplatError::CutOff { place, byte: HEADERS[0] as u64, expected: total as u64, found });
    }
    // The next read finds the end, and holds the checksum against what was read.
    let more = read(&mut decoder, LEAST_LIMIT as usize, "after the arrays")?;
    let left = decoder.into_inner().len();
    if header[14] & HAS_EXTENSIONS != 0 {
        arrays.lost = extensions(&more)?;
    } else if !more.is_empty() || left > 0 {
        return Err(off("SPZ, after the arrays", "the end of the file", format!("{} bytes more", more.len() + left)));
    }
    Ok(arrays)
}

fn open_streams(bytes: &[u8]) -> Result<Arrays, SplatError> {
    let mut cursor = Cursor::new(bytes, PLACE);
    let header = cursor.take(HEADERS[1] as u64, "header")?;
    let mut arrays = Arrays::header(header, &[Version::V4])?;
    let (streams, table) = (header[15] as usize, u32_at(header, 16) as u64);
    if table < HEADERS[1] as u64 {
        return Err(off("SPZ header, byte 16", "a table of streams from byte 32 on", table));
    }
    let records = cursor.take(table - HEADERS[1] as u64, "extensions")?;
    if header[14] & HAS_EXTENSIONS != 0 {
        arrays.lost = extensions(records)?;
    }
    let total = arrays.total(bytes.len())?;
    let sizes = widths(arrays.version, arrays.degree).map(|width| width * arrays.count);
    let wanted: Vec<usize> = (0..6).filter(|&index| sizes[index] > 0).collect();
    if streams != wanted.len() {
        return Err(off("SPZ header, byte 15", format!("{} streams", wanted.len()), streams));
    }
    let mut claims = Vec::with_capacity(wanted.len());
    for &index in &wanted {
        let (packed, size) = (cursor.u64("table of streams")?, cursor.u64("table of streams")?);
        if size != sizes[index] as u64 {
            return Err(off(format!("SPZ table, {}", ARRAYS[index]), format!("{} bytes", sizes[index]), size));
        }
        claims.push((index, packed));
    }
    let mut packed = Vec::with_capacity(claims.len());
    for (index, length) in claims {
        packed.push((index, cursor.take(length, ARRAYS[index])?));
    }
    if cursor.left() > 0 {
        let found = format!("{} bytes more", cursor.left());
        return Err(off(format!("SPZ, byte {}", cursor.at()), "the end of the file", found));
    }
    arrays.data = vec![0; total];
    let mut rest = arrays.data.as_mut_slice();
    for (index, stream) in packed {
        let (target, after) = rest.split_at_mut(sizes[index]);
        unpack(stream, target, ARRAYS[index])?;
        rest = after;
    }
    Ok(arrays)
}

/// Decompresses into a slice that it must fill. In one go, so that no window is taken on the stream's word.
fn unpack(stream: &[u8], target: &mut [u8], what: &str) -> Result<(), SplatError> {
    let expected = target.len();
    let fault = |found: String| off(format!("SPZ, {what}"), format!("zstd of {expected} bytes"), found);
    let mut decoder = zstd::bulk::Decompressor::new().map_err(|error| fault(error.to_string()))?;
    match decoder.decompress_to_buffer(stream, target) {
        Ok(found) if found == expected => Ok(()),
        Ok(found) => Err(fault(format!("{found} bytes"))),
        Err(error) => Err(fault(error.to_string())),
    }
}

/// Names the vendors' records, none of which are kept.
fn extensions(records: &[u8]) -> Result<Vec<String>, SplatError> {
    let mut cursor = Cursor::new(records, PLACE);
    let mut lost = Vec::new();
    while cursor.left() > 0 {
        let (kind, length) = (cursor.u32("extension")?, cursor.u32("extension")?);
        let record = cursor.take(u64::from(length), "extension")?;
        if kind == AXES.0 && length == 4 {
            let axes = u32_at(record, 0);
            if axes != AXES.1 && axes != 0 {
                return Err(off("SPZ, coordinate system", "4, which is right, up, back", axes));
            }
        } else {
            lost.push(format!("SPZ extension {kind:#010x}, {length} bytes"));
        }
    }
    Ok(lost)
}

/// A file of arrays.
pub fn close(arrays: &Arrays) -> Result<Vec<u8>, SplatError> {
    let mut header = MAGIC.to_vec();
    header.extend((arrays.version as u32).to_le_bytes());
    header.extend((arrays.count as u32).to_le_bytes());
    header.extend([arrays.degree, arrays.fractional_bits, 0, 0]);
    let failed = |error: std::io::Error| off("SPZ", "data to be compressed", error);
    if arrays.version != Version::V4 {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(&header).map_err(failed)?;
        encoder.write_all(&arrays.data).map_err(failed)?;
        return encoder.finish().map_err(failed);
    }
    let full: Vec<&[u8]> = (0..6).map(|index| arrays.array(index)).filter(|array| !array.is_empty()).collect();
    header[15] = full.len() as u8;
    header.extend((HEADERS[1] as u32).to_le_bytes());
    header.resize(HEADERS[1], 0);
    let packed: Vec<Vec<u8>> =
        full.iter().map(|array| zstd::bulk::compress(array, 12)).collect::<Result<_, _>>().map_err(failed)?;
    for (array, stream) in full.iter().zip(&packed) {
        header.extend((stream.len() as u64).to_le_bytes());
        header.extend((array.len() as u64).to_le_bytes());
    }
    header.extend(packed.concat());
    Ok(header)
}
