//! PlayCanvas' compressed PLY (playcanvas/splat-transform, `write-compressed-ply.ts`; SuperSplat 2 writes the same).
//!
//! Element `chunk` has the least and largest position, log scale and colour of 256 Gaussians each; `vertex` four words per
//! Gaussian, all steps within the chunk's range: position 11, 10, 11 bits of x, y, z; rotation 2 bits for the largest of w, x,
//! y, z and 10 bits each of the others within ±1/√2; log scale 11, 10, 11 bits; colour of the constant harmonic and opacity, 8
//! bits each. Element `sh`, when there is one, has a byte per coefficient of the others within ±4, red first, then green, then
//! blue. Files of before 2024 have no colours in the chunks; their colours lie within 0 to 1.

use super::format::{Format, SplatFile};
use super::ply_header::{Element, Header, Kind, Property, Remarks};
use super::quantised::{SH_C0, from_smallest_three, logit_of_byte, opacity, pack_unit, smallest_three, unpack_unit};
use super::sieve::{Sieve, Splat, check};
use crate::SplatError;
use crate::cursor::u32_at;
use crate::error::off;
use qv_core::GaussianCloud;

/// Gaussians of a chunk.
const CHUNK: usize = 256;
/// Bits of a word's three parts, from the highest down.
const BITS: [u32; 3] = [11, 10, 11];
/// Log scales are clamped to plus and minus this.
const LARGEST_LOG_SCALE: f32 = 20.0;
const RANGES: [&str; 18] = [
    "min_x",
    "min_y",
    "min_z",
    "max_x",
    "max_y",
    "max_z",
    "min_scale_x",
    "min_scale_y",
    "min_scale_z",
    "max_scale_x",
    "max_scale_y",
    "max_scale_z",
    "min_r",
    "min_g",
    "min_b",
    "max_r",
    "max_g",
    "max_b",
];

/// Least and largest of three numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Range {
    low: [f32; 3],
    high: [f32; 3],
}

impl Range {
    const NOTHING: Self = Self { low: [f32::INFINITY; 3], high: [f32::NEG_INFINITY; 3] };
    const UNIT: Self = Self { low: [0.0; 3], high: [1.0; 3] };

    fn add(&mut self, numbers: [f32; 3]) {
        self.low = std::array::from_fn(|k| self.low[k].min(numbers[k]));
        self.high = std::array::from_fn(|k| self.high[k].max(numbers[k]));
    }

    fn at(&self, shares: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|k| {
            let [low, high, share] = [self.low[k], self.high[k], shares[k]].map(f64::from);
            (low * (1.0 - share) + high * share) as f32
        })
    }

    fn shares(&self, numbers: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|k| {
            let extent = self.high[k] - self.low[k];
            if extent > 0.0 { (numbers[k] - self.low[k]) / extent } else { 0.0 }
        })
    }
}

#[derive(Debug, Clone, Copy)]
struct Chunk {
    position: Range,
    log_scale: Range,
    colour: Range,
}

/// Largest errors of rounding in a chunk, when the file was written from exact numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfSteps {
    /// Of x, y, z \[m\].
    pub mean: [f32; 3],
    /// Of the log scales.
    pub log_scale: [f32; 3],
    /// Of the constant harmonic's coefficients.
    pub constant: [f32; 3],
}

/// The half steps of each Gaussian's chunk, shape `[chunks]`; Gaussian i is in chunk i / 256.
///
/// # Errors
/// As [`read`].
pub fn half_steps(bytes: &[u8]) -> Result<Vec<HalfSteps>, SplatError> {
    let parts = Parts::of(bytes)?;
    let half = |range: Range, steps: [f32; 3]| -> [f32; 3] {
        std::array::from_fn(|k| 0.5 * (range.high[k] - range.low[k]) / steps[k])
    };
    let words = BITS.map(|bits| ((1u32 << bits) - 1) as f32);
    let of = |chunk: Chunk| HalfSteps {
        mean: half(chunk.position, words),
        log_scale: half(chunk.log_scale, words),
        constant: half(chunk.colour, [255.0; 3]).map(|step| step / SH_C0),
    };
    Ok(parts.chunk.rows(bytes).map(|row| of(parts.chunk_of(row))).collect())
}

/// The elements of a file, checked against each other.
struct Parts {
    chunk: Element,
    vertex: Element,
    sh: Option<Element>,
    ranges: Vec<Property>,
    /// Places of the four words in a row of `vertex`, bytes.
    words: [usize; 4],
    /// Coefficients of the harmonics beyond the constant one, per colour.
    rest: usize,
    remarks: Remarks,
}

impl Parts {
    fn of(bytes: &[u8]) -> Result<Self, SplatError> {
        let header = Header::parse(bytes)?;
        let (chunk, vertex) = (header.element("chunk")?.clone(), header.element("vertex")?.clone());
        let coloured = chunk.properties.iter().any(|property| property.name == RANGES[12]);
        let names = &RANGES[..if coloured { 18 } else { 12 }];
        let ranges = names.iter().map(|name| chunk.property_of(name, Kind::F32).cloned()).collect::<Result<_, _>>()?;
        let word = |name: &str| vertex.property_of(name, Kind::U32).map(|property| property.offset);
        let words = [word("packed_position")?, word("packed_rotation")?, word("packed_scale")?, word("packed_color")?];
        if chunk.count != vertex.count.div_ceil(CHUNK) {
            let expected = format!("{} rows for {} Gaussians", vertex.count.div_ceil(CHUNK), vertex.count);
            return Err(off("PLY element chunk", expected, chunk.count));
        }
        let sh = header.find("sh").cloned();
        let rest = match &sh {
            None => 0,
            Some(sh) => harmonics(sh, vertex.count)?,
        };
        let remarks = header.remarks_of(bytes);
        Ok(Self { chunk, vertex, sh, ranges, words, rest, remarks })
    }

    fn chunk_of(&self, row: &[u8]) -> Chunk {
        let three = |first: usize| std::array::from_fn(|k| self.ranges[first + k].value(row));
        let range = |first: usize| Range { low: three(first), high: three(first + 3) };
        let colour = if self.ranges.len() > 12 { range(12) } else { Range::UNIT };
        Chunk { position: range(0), log_scale: range(6), colour }
    }
}

/// Checks the element of harmonics; returns their number per colour.
fn harmonics(sh: &Element, count: usize) -> Result<usize, SplatError> {
    if sh.count != count {
        return Err(off("PLY element sh", format!("{count} rows, one for each Gaussian"), sh.count));
    }
    let found = sh.properties.len();
    if ![9, 24, 45].contains(&found) {
        return Err(off("PLY element sh", "9, 24 or 45 properties", found));
    }
    for number in 0..found {
        // The properties are read by place, so a name out of order is a fault.
        let name = format!("f_rest_{number}");
        if sh.property_of(&name, Kind::U8)?.offset != number {
            return Err(off("PLY element sh", format!("property {name} in place {number}"), "it elsewhere"));
        }
    }
    Ok(found / 3)
}

/// Reads a file.
///
/// # Errors
/// The header or its counts are off, or a property is missing or of another type.
pub fn read(bytes: &[u8]) -> Result<SplatFile, SplatError> {
    let parts = Parts::of(bytes)?;
    let chunks: Vec<Chunk> = parts.chunk.rows(bytes).map(|row| parts.chunk_of(row)).collect();
    let degree = (parts.rest as f64 + 1.0).sqrt() as u8 - 1;
    let mut sieve = Sieve::new(parts.vertex.count, degree, 0);
    let mut sh = vec![[0.0; 3]; parts.rest + 1];
    let mut rest_rows = parts.sh.iter().flat_map(|element| element.rows(bytes));
    for (index, row) in parts.vertex.rows(bytes).enumerate() {
        let chunk = &chunks[index / CHUNK];
        let [position, rotation, scale, colour] = parts.words.map(|at| u32_at(row, at));
        let bytes_of_colour = colour.to_be_bytes();
        let rgb = chunk.colour.at(std::array::from_fn(|c| f32::from(bytes_of_colour[c]) / 255.0));
        sh[0] = rgb.map(|x| (x - 0.5) / SH_C0);
        if let Some(coefficients) = rest_rows.next() {
            for k in 0..parts.rest {
                sh[k + 1] = std::array::from_fn(|c| unpack_harmonic(coefficients[c * parts.rest + k]));
            }
        }
        sieve.push(&Splat {
            mean: chunk.position.at(unpack_three(position)),
            log_scale: chunk.log_scale.at(unpack_three(scale)),
            rotation: unpack_rotation(rotation),
            opacity_logit: logit_of_byte(bytes_of_colour[3]),
            sh: &sh,
            features: &[],
        });
    }
    let Remarks { remarks, lost } = parts.remarks;
    Ok(SplatFile { remarks, ..sieve.finish(Format::CompressedPly, lost) })
}

/// A file of a cloud. Gaussians are put in the order of [`curve_order`], so that those of a chunk are neighbours. Features are
/// not kept, log scales are clamped to ±20 and coefficients of the harmonics to ±4.
///
/// # Errors
/// The cloud's arrays disagree, a number is not finite, or a quaternion is zero.
pub fn write(cloud: &GaussianCloud) -> Result<Vec<u8>, SplatError> {
    check(cloud)?;
    let order = curve_order(&cloud.means);
    let rest = cloud.sh_count() - 1;
    let mut header = format!("ply\nformat binary_little_endian 1.0\nelement chunk {}\n", order.len().div_ceil(CHUNK));
    header.extend(RANGES.iter().map(|name| format!("property float {name}\n")));
    header += &format!("element vertex {}\n", order.len());
    header.extend(["position", "rotation", "scale", "color"].map(|name| format!("property uint packed_{name}\n")));
    if rest > 0 {
        header += &format!("element sh {}\n", order.len());
        header.extend((0..3 * rest).map(|i| format!("property uchar f_rest_{i}\n")));
    }
    let mut out = (header + "end_header\n").into_bytes();
    let chunks: Vec<Chunk> = order.chunks(CHUNK).map(|members| chunk_around(cloud, members)).collect();
    for chunk in &chunks {
        for range in [chunk.position, chunk.log_scale, chunk.colour] {
            out.extend(range.low.iter().chain(&range.high).flat_map(|x| x.to_le_bytes()));
        }
    }
    for (at, &index) in order.iter().enumerate() {
        out.extend(words(cloud, index as usize, &chunks[at / CHUNK]).iter().flat_map(|word| word.to_le_bytes()));
    }
    for &index in &order {
        let sh = &cloud.sh_of(index as usize)[1..];
        (0..3).for_each(|c| out.extend(sh.iter().map(|colour| pack_harmonic(colour[c]))));
    }
    Ok(out)
}

fn clamped(log_scale: [f32; 3]) -> [f32; 3] {
    log_scale.map(|log| log.clamp(-LARGEST_LOG_SCALE, LARGEST_LOG_SCALE))
}

fn colour_of(cloud: &GaussianCloud, index: usize) -> [f32; 3] {
    cloud.sh_of(index)[0].map(|x| x * SH_C0 + 0.5)
}

fn chunk_around(cloud: &GaussianCloud, members: &[u32]) -> Chunk {
    let mut chunk = Chunk { position: Range::NOTHING, log_scale: Range::NOTHING, colour: Range::NOTHING };
    for &member in members {
        let index = member as usize;
        chunk.position.add(cloud.means[index]);
        chunk.log_scale.add(clamped(cloud.log_scales[index]));
        chunk.colour.add(colour_of(cloud, index));
    }
    chunk
}

fn words(cloud: &GaussianCloud, index: usize, chunk: &Chunk) -> [u32; 4] {
    let [r, g, b] = chunk.colour.shares(colour_of(cloud, index));
    let alpha = opacity(cloud.opacity_logits[index]);
    [
        pack_three(chunk.position.shares(cloud.means[index])),
        pack_rotation(cloud.rotations[index]),
        pack_three(chunk.log_scale.shares(clamped(cloud.log_scales[index]))),
        [r, g, b, alpha].iter().fold(0, |word, x| word << 8 | pack_unit(*x, 8)),
    ]
}

/// Order along a Z-shaped space-filling curve through the box around all points (Morton, 1966), 21 bits an axis; equal places
/// keep their order. Shape `[N]`.
pub fn curve_order(points: &[[f32; 3]]) -> Vec<u32> {
    let mut around = Range::NOTHING;
    points.iter().for_each(|point| around.add(*point));
    let key = |point: [f32; 3]| {
        let shares = around.shares(point);
        let steps = shares.map(|share| (f64::from(share) * 2_097_151.0) as u64);
        (0..21).fold(0u64, |key, bit| (0..3).fold(key, |key, axis| key | (steps[axis] >> bit & 1) << (3 * bit + axis)))
    };
    let keys: Vec<u64> = points.iter().map(|point| key(*point)).collect();
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    order.sort_by_key(|&index| keys[index as usize]);
    order
}

fn unpack_three(word: u32) -> [f32; 3] {
    [unpack_unit(word >> 21, BITS[0]), unpack_unit(word >> 11, BITS[1]), unpack_unit(word, BITS[2])]
}

fn pack_three(shares: [f32; 3]) -> u32 {
    pack_unit(shares[0], BITS[0]) << 21 | pack_unit(shares[1], BITS[1]) << 11 | pack_unit(shares[2], BITS[2])
}

fn unpack_rotation(word: u32) -> [f32; 4] {
    let part = |shift: u32| (unpack_unit(word >> shift, 10) - 0.5) * std::f32::consts::SQRT_2;
    from_smallest_three((word >> 30) as usize, [part(20), part(10), part(0)])
}

fn pack_rotation(rotation: [f32; 4]) -> u32 {
    let (largest, rest) = smallest_three(rotation);
    rest.iter().fold(largest as u32, |word, x| word << 10 | pack_unit(x * std::f32::consts::FRAC_1_SQRT_2 + 0.5, 10))
}

/// 256 steps within ±4, of which a byte means the middle, but for the first and the last, which mean the ends.
fn unpack_harmonic(byte: u8) -> f32 {
    match byte {
        0 => -4.0,
        255 => 4.0,
        byte => ((f32::from(byte) + 0.5) / 256.0 - 0.5) * 8.0,
    }
}

fn pack_harmonic(coefficient: f32) -> u8 {
    ((coefficient / 8.0 + 0.5) * 256.0) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_as_the_format_has_them() {
        assert_eq!(unpack_three(2047 << 21 | 1023 << 11), [1.0, 1.0, 0.0]);
        assert_eq!(pack_three([0.0, 1.0, 1.0]), 1023 << 11 | 2047);
        // The largest is w, index 0, and the others are near the middle of their ranges.
        let q = unpack_rotation(512 << 20 | 511 << 10 | 512);
        assert!((q[0] - 1.0).abs() < 1e-5 && (q[1] - 0.000_691).abs() < 1e-5 && (q[2] + 0.000_691).abs() < 1e-5);
        assert_eq!(pack_rotation([0.0, 0.0, 0.0, -1.0]) >> 30, 3);
        for byte in 0..=255 {
            assert_eq!(pack_harmonic(unpack_harmonic(byte)), byte);
        }
    }

    #[test]
    fn neighbours_on_the_curve_are_neighbours_in_space() {
        let points: Vec<[f32; 3]> = (0..64).map(|i| [(i % 4) as f32, (i / 4 % 4) as f32, (i / 16) as f32]).collect();
        let order = curve_order(&points);
        let first: Vec<[f32; 3]> = order[..8].iter().map(|&i| points[i as usize]).collect();
        assert!(first.iter().all(|p| p.iter().all(|x| *x < 2.0)), "{first:?}");
        assert_eq!(curve_order(&[[1.0; 3]; 3]), [0, 1, 2]);
    }
}
