//! mkkellogg's `.ksplat` (mkkellogg/GaussianSplats3D, `src/loaders/SplatBuffer.js`, version 0.1).
//!
//! A header of 4096 bytes, one of 1024 for each section, then the sections: the lengths of buckets that are not full, the buckets' centres, the
//! Gaussians. At level 0 all is floats; at level 1 positions are 16-bit steps within the bucket's block, other numbers half floats; at level 2
//! harmonics are bytes. Scales are standard deviations, rotations w, x, y, z, colours and opacity a byte each. Harmonics come degree by degree,
//! red first, then green, then blue. The frame is that of the PLY that it was made of.

use super::quantised::{half_float, logit_of_byte};
use super::sieve::{Sieve, Splat};
use super::splat::colour;
use super::{Format, SplatFile};
use crate::SplatError;
use crate::cursor::{f32_at, u32_at};
use crate::error::off;

/// Bytes of the header, and of that of a section.
const HEADER: usize = 4096;
const SECTION: usize = 1024;
/// Steps of half a block, where a section does not say.
const USUAL_STEPS: u32 = 32767;
/// Range of harmonics at level 2, where the file does not say.
const USUAL_RANGE: [f32; 2] = [-1.5, 1.5];
/// Numbers of all colours by degree.
const HARMONICS: [usize; 4] = [0, 9, 24, 45];

/// How numbers are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Level {
    Floats,
    Halves,
    Bytes,
}

impl Level {
    /// Bytes of a number of a scale or a rotation, and of a harmonic.
    fn widths(self) -> [usize; 2] {
        match self {
            Self::Floats => [4, 4],
            Self::Halves => [2, 2],
            Self::Bytes => [2, 1],
        }
    }
}

/// A part of the file, checked against its length.
struct Section<'a> {
    count: usize,
    degree: usize,
    /// Bytes of a Gaussian.
    stride: usize,
    rows: &'a [u8],
    /// Centres of the buckets \[m\]; none at level 0.
    centres: Vec<[f32; 3]>,
    /// First Gaussian after each bucket.
    ends: Vec<usize>,
    steps: u32,
    metres_per_step: f32,
}

/// Reads a file. Sections may differ in the degree of their harmonics: the largest counts.
///
/// # Errors
/// The version or the level is another, or a section claims more than is there.
pub fn read(bytes: &[u8]) -> Result<SplatFile, SplatError> {
    let cut = |place: &str, expected: usize| SplatError::CutOff {
        place: format!(".ksplat, {place}"),
        byte: 0,
        expected: expected as u64,
        found: bytes.len() as u64,
    };
    if bytes.len() < HEADER {
        return Err(cut("header", HEADER));
    }
    if bytes[..2] != [0, 1] {
        return Err(off(".ksplat, byte 0", "version 0.1", format!("{}.{}", bytes[0], bytes[1])));
    }
    let level = match u16::from_le_bytes([bytes[20], bytes[21]]) {
        0 => Level::Floats,
        1 => Level::Halves,
        2 => Level::Bytes,
        found => return Err(off(".ksplat, byte 20", "a level of compression from 0 to 2", found)),
    };
    let range: [f32; 2] = std::array::from_fn(|k| match f32_at(bytes, 36 + 4 * k) {
        0.0 => USUAL_RANGE[k],
        told => told,
    });
    let sections = u32_at(bytes, 4) as usize;
    if sections > (bytes.len() - HEADER) / SECTION {
        return Err(cut(&format!("headers of {sections} sections"), HEADER.saturating_add(sections * SECTION)));
    }
    let (mut parts, mut at) = (Vec::new(), HEADER + sections * SECTION);
    for index in 0..sections {
        let head = &bytes[HEADER + index * SECTION..HEADER + (index + 1) * SECTION];
        let (part, end) = section(bytes, head, at, level, index)?;
        parts.push(part);
        at = end;
    }
    let count = parts.iter().map(|part| part.count).sum();
    if count == 0 {
        return Err(off(".ksplat", "Gaussians", format!("none in {sections} sections")));
    }
    let degree = parts.iter().map(|part| part.degree).max().unwrap_or(0);
    let mut sieve = Sieve::new(count, degree as u8, 0);
    parts.iter().for_each(|part| part.unpack(level, range, degree, &mut sieve));
    Ok(sieve.finish(Format::Ksplat, vec![]))
}

/// The section whose data begins at byte `at`, and where it ends.
fn section<'a>(
    bytes: &'a [u8],
    head: &[u8],
    at: usize,
    level: Level,
    index: usize,
) -> Result<(Section<'a>, usize), SplatError> {
    let place = |what: &str| format!(".ksplat, section {index}, {what}");
    let word = |k: usize| u32_at(head, 4 * k) as usize;
    let (count, room, capacity, buckets) = (word(0), word(1), word(2), word(3));
    let (full, partial) = (word(8), word(9));
    let bytes_of_centre = usize::from(u16::from_le_bytes([head[20], head[21]]));
    let degree = usize::from(u16::from_le_bytes([head[40], head[41]]));
    let Some(harmonics) = HARMONICS.get(degree) else {
        return Err(off(place("harmonics"), "degree 0 to 3", degree));
    };
    let [number, harmonic] = level.widths();
    let stride = 3 * number + 3 * number + 4 * number + 4 + harmonics * harmonic;
    // A file that was still being written has room for more than it has.
    let parts = [4 * partial as u128, bytes_of_centre as u128 * buckets as u128, stride as u128 * room as u128];
    let there = bytes.len() - at;
    if parts.iter().sum::<u128>() > there as u128 || count > room {
        let expected = u64::try_from(parts.iter().sum::<u128>()).unwrap_or(u64::MAX);
        let what = place(&format!("{count} of {room} Gaussians of {stride} bytes in {buckets} buckets"));
        return Err(SplatError::CutOff { place: what, byte: at as u64, expected, found: there as u64 });
    }
    let [lengths, centres, rows] = parts.map(|part| part as usize);
    let (first_centre, first_row) = (at + lengths, at + lengths + centres);
    let packed = level != Level::Floats && count > 0;
    let mut ends: Vec<usize> = vec![];
    if packed && bytes_of_centre == 12 {
        ends.extend((1..=full).take(buckets).map(|bucket| bucket.saturating_mul(capacity)));
        for k in 0..partial {
            let before = ends.last().copied().unwrap_or(0);
            ends.push(before.saturating_add(u32_at(bytes, at + 4 * k) as usize));
        }
    }
    if packed && (ends.len() > buckets || ends.last().is_none_or(|end| *end < count)) {
        let found = format!("{buckets} of {bytes_of_centre} bytes for {}", ends.last().unwrap_or(&0));
        return Err(off(place("buckets"), format!("buckets of 12 bytes for {count} Gaussians"), found));
    }
    let centre = |k: usize| [0, 4, 8].map(|part| f32_at(bytes, first_centre + 12 * k + part));
    let steps = match word(6) as u32 {
        0 => USUAL_STEPS,
        told => told,
    };
    Ok((
        Section {
            count,
            degree,
            stride,
            rows: &bytes[first_row..first_row + count * stride],
            centres: if packed { (0..ends.len()).map(centre).collect() } else { vec![] },
            ends,
            steps,
            metres_per_step: f32_at(head, 16) / 2.0 / steps as f32,
        },
        first_row + rows,
    ))
}

impl Section<'_> {
    /// Puts all Gaussians into a sieve for harmonics of `degree`.
    fn unpack(&self, level: Level, range: [f32; 2], degree: usize, sieve: &mut Sieve) {
        let [width, harmonic_width] = level.widths();
        let mut sh = vec![[0.0; 3]; (degree + 1).pow(2)];
        let mut bucket = 0;
        for (index, row) in self.rows.chunks_exact(self.stride).enumerate() {
            let number = |k: usize| match level {
                Level::Floats => f32_at(row, 4 * k),
                _ => half_float(row[2 * k], row[2 * k + 1]),
            };
            while level != Level::Floats && self.ends[bucket] <= index {
                bucket += 1;
            }
            let step = |k: usize| f32::from(u16::from_le_bytes([row[2 * k], row[2 * k + 1]])) - self.steps as f32;
            let mean = match level {
                Level::Floats => [0, 1, 2].map(number),
                _ => std::array::from_fn(|k| self.centres[bucket][k] + step(k) * self.metres_per_step),
            };
            let colours = 10 * width;
            let harmonic = |k: usize| {
                let at = colours + 4 + k * harmonic_width;
                match level {
                    Level::Floats => f32_at(row, at),
                    Level::Halves => half_float(row[at], row[at + 1]),
                    Level::Bytes => range[0] + f32::from(row[at]) / 255.0 * (range[1] - range[0]),
                }
            };
            sh[0] = colour(&row[colours..colours + 3]);
            for l in 1..=self.degree {
                let (functions, before) = (2 * l + 1, l * l);
                for k in 0..functions {
                    sh[before + k] = std::array::from_fn(|c| harmonic(3 * (before - 1) + c * functions + k));
                }
            }
            sieve.push(&Splat {
                mean,
                log_scale: [3, 4, 5].map(|k| number(k).ln()),
                rotation: [6, 7, 8, 9].map(number),
                opacity_logit: logit_of_byte(row[colours + 3]),
                sh: &sh,
                features: &[],
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use crate::files::quantised::SH_C0;
    use crate::files::read_named;

    const HALF_ONE: [u8; 2] = [0x00, 0x3c];

    /// A file of one section; `body` is its data.
    fn file(level: u16, [count, room]: [u32; 2], words: &[(usize, u32)], degree: u16, body: &[u8]) -> Vec<u8> {
        let mut out = vec![0; HEADER + SECTION];
        out[1] = 1;
        let mut put = |at: usize, word: u32| out[at..at + 4].copy_from_slice(&word.to_le_bytes());
        put(4, 1);
        put(20, level.into());
        put(HEADER, count);
        put(HEADER + 4, room);
        words.iter().for_each(|(k, word)| put(HEADER + 4 * k, *word));
        put(HEADER + 40, degree.into());
        out.extend(body);
        out
    }

    #[test]
    fn floats_are_read_with_their_harmonics() {
        let mut row: Vec<u8> =
            [1.0f32, 2.0, 3.0, 0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        row.extend([255, 0, 0, 255]);
        row.extend((0..24).flat_map(|k| (k as f32).to_le_bytes()));
        let bytes = file(0, [1, 2], &[], 2, &[row.clone(), vec![0; row.len()]].concat());
        let read = read_named(&bytes, "x.KSPLAT", &mut |_| Err("none".into())).unwrap();
        let cloud = &read.cloud;
        assert_eq!((read.format, cloud.len(), cloud.sh_degree), (Format::Ksplat, 1, 2));
        assert_eq!((cloud.means[0], cloud.rotations[0]), ([1.0, 2.0, 3.0], [1.0, 0.0, 0.0, 0.0]));
        assert!((cloud.log_scales[0][2] - 0.3f32.ln()).abs() < 1e-6 && (cloud.sh[0][0] * SH_C0 - 0.5).abs() < 1e-6);
        // Degree by degree, colour by colour.
        assert_eq!((cloud.sh[1], cloud.sh[3]), ([0.0, 3.0, 6.0], [2.0, 5.0, 8.0]));
        assert_eq!((cloud.sh[4], cloud.sh[8]), ([9.0, 14.0, 19.0], [13.0, 18.0, 23.0]));
    }

    /// Three Gaussians in a full bucket of two and one that is not full.
    fn packed(level: u16) -> Vec<u8> {
        let mut body = 1u32.to_le_bytes().to_vec();
        for centre in [[10.0f32, 0.0, 0.0], [-10.0, 0.0, 5.0]] {
            body.extend(centre.iter().flat_map(|x| x.to_le_bytes()));
        }
        for step in [0u16, 32767, 65534] {
            body.extend([step; 3].iter().flat_map(|x| x.to_le_bytes()));
            body.extend([HALF_ONE; 7].concat());
            body.extend([128, 128, 128, 128]);
            match level {
                1 => body.extend([HALF_ONE; 9].concat()),
                _ => body.extend([0, 255, 51, 0, 0, 0, 0, 0, 0]),
            }
        }
        let words = [(2, 2), (3, 2), (4, 5.0f32.to_bits()), (5, 12), (6, 32767), (8, 1), (9, 1)];
        file(level, [3, 3], &words, 1, &body)
    }

    #[test]
    fn buckets_place_what_is_packed() {
        let cloud = read(&packed(1)).unwrap().cloud;
        assert_eq!(cloud.means, [[7.5, -2.5, -2.5], [10.0, 0.0, 0.0], [-7.5, 2.5, 7.5]]);
        assert_eq!((cloud.log_scales[0], cloud.rotations[0], cloud.sh[1]), ([0.0; 3], [1.0; 4], [1.0; 3]));
        let cloud = read(&packed(2)).unwrap().cloud;
        assert_eq!((cloud.sh[1][0], cloud.sh[2][0]), (-1.5, 1.5));
        assert!((cloud.sh[3][0] + 0.9).abs() < 1e-6);
    }

    #[test]
    fn each_fault_is_named() {
        let good = packed(1);
        let fault = |at: usize, byte: u8| {
            let mut bytes = good.clone();
            bytes[at] = byte;
            read(&bytes).unwrap_err().to_string()
        };
        assert!(fault(0, 9).states("version 0.1 9.1"));
        assert!(fault(20, 7).states("compression 0 2 7"));
        assert!(fault(7, 255).states("sections"));
        assert!(fault(HEADER + 7, 255).states("section 0 3"));
        assert!(fault(HEADER + 40, 9).states("degree 0 3 9"));
        assert!(fault(HEADER + 36, 0).states("0 12 3 Gaussians"));
        assert!(fault(HEADER, 0).states("Gaussians"));
        for length in [0, 4000, 4096, 5119, good.len() - 1] {
            assert!(read(&good[..length]).is_err(), "{length}");
        }
    }

    #[test]
    fn damaged_files_give_words_or_good_gaussians() {
        for level in [1, 2] {
            let good = packed(level);
            let places = (0..64).chain(HEADER..HEADER + 64).chain(HEADER + SECTION..good.len());
            for (at, bit) in places.flat_map(|at| (0..8).map(move |bit| (at, bit))) {
                let mut bytes = good.clone();
                bytes[at] ^= 1 << bit;
                match read(&bytes) {
                    Ok(file) => assert_eq!(file.cloud.check(), Ok(()), "byte {at}, bit {bit}"),
                    Err(error) => assert!(error.to_string().contains("expected"), "{error}"),
                }
            }
        }
    }
}
