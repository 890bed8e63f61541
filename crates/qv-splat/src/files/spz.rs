//! Niantic's SPZ (nianticlabs/spz; commits in `docs/reference/splat_files.md`).
//!
//! Per Gaussian: position, 24-bit fixed point (version 1: half floats); opacity, 8 bits; colour of the constant harmonic,
//! coefficient times 0.15 plus 0.5 in 8 bits; log scale plus 10, times 16, 8 bits; rotation, x, y, z in 8 bits each with w
//! positive (versions 1, 2), or the three components beside the largest of x, y, z, w as sign and 9 bits each (from version 3
//! on); the other harmonics, coefficient times 128 plus 128, 8 bits, coefficient by coefficient with red, green, blue inside.
//! The axes are x right, y up, z back; they are turned by half a turn about x (see [`files`](super)).

use super::format::{Format, SplatFile};
use super::quantised::{from_smallest_three, half_float, logit_of_byte, opacity, smallest_three};
use super::sieve::check;
use super::sieve::{Sieve, Splat};
pub use super::spz_container::Version;
use super::spz_container::{Arrays, close, open, widths};
use crate::SplatError;
use crate::cursor::u32_at;
use crate::harmonics::HALF_TURN_ABOUT_X;
use qv_core::GaussianCloud;

/// Colour per coefficient of the constant harmonic; less than the harmonic's own, so that there is room beyond 0 and 1.
const COLOUR_SCALE: f32 = 0.15;
/// Most fractional bits that are written; a quarter of a millimetre.
const FRACTIONAL_BITS: u8 = 12;
/// Largest fixed-point number plus one half, which still rounds to 24 bits.
const LARGEST_FIXED: f32 = 8_388_607.0;

/// Reads a file of any version. Of harmonics of degree 4, degrees 0 to 3 are read.
///
/// # Errors
/// The container is cut off, damaged or of another length than its header says; a file that would decode to more than 64
/// times its size (and 64 MiB) is refused before memory is taken.
pub fn read(bytes: &[u8]) -> Result<SplatFile, SplatError> {
    let arrays = open(bytes)?;
    let [positions, alphas, colours, scales, rotations, harmonics] = std::array::from_fn(|index| arrays.array(index));
    let [position_width, _, _, _, rotation_width, sh_width] = widths(arrays.version, arrays.degree);
    let degree = arrays.degree.min(GaussianCloud::MAX_SH_DEGREE);
    let mut sieve = Sieve::new(arrays.count, degree, 0);
    let mut sh = vec![[0.0; 3]; (degree as usize + 1).pow(2)];
    for i in 0..arrays.count {
        let three = |array: &[u8]| [array[3 * i], array[3 * i + 1], array[3 * i + 2]];
        sh[0] = three(colours).map(|byte| (f32::from(byte) / 255.0 - 0.5) / COLOUR_SCALE);
        for k in 1..sh.len() {
            let at = i * sh_width + 3 * (k - 1);
            sh[k] = std::array::from_fn(|c| HALF_TURN_ABOUT_X[k] * (f32::from(harmonics[at + c]) - 128.0) / 128.0);
        }
        let position = &positions[i * position_width..(i + 1) * position_width];
        let rotation = &rotations[i * rotation_width..(i + 1) * rotation_width];
        sieve.push(&Splat {
            mean: half_turn(match arrays.version {
                Version::V1 => std::array::from_fn(|k| half_float(position[2 * k], position[2 * k + 1])),
                _ => std::array::from_fn(|k| fixed(&position[3 * k..], arrays.fractional_bits)),
            }),
            log_scale: three(scales).map(|byte| f32::from(byte) / 16.0 - 10.0),
            rotation: half_turn_of(match arrays.version {
                Version::V1 | Version::V2 => first_three(rotation),
                Version::V3 | Version::V4 => unpack_rotation(u32_at(rotation, 0)),
            }),
            opacity_logit: logit_of_byte(alphas[i]),
            sh: &sh,
            features: &[],
        });
    }
    let antialias = arrays.antialias;
    let mut lost = arrays.lost;
    if arrays.degree > GaussianCloud::MAX_SH_DEGREE {
        lost.push("spherical harmonics of degree 4".into());
    }
    Ok(SplatFile { antialias, ..sieve.finish(Format::Spz, lost) })
}

/// A file of version 3, which every reader knows. See [`write_version`].
///
/// # Errors
/// As [`write_version`].
pub fn write(cloud: &GaussianCloud) -> Result<Vec<u8>, SplatError> {
    write_version(cloud, Version::V3)
}

/// A file of a cloud in version 2, 3 or 4; for version 1, whose positions are half floats, version 2 is written. Log scales
/// are clamped to -10 to 5.9375, coefficients of the constant harmonic to ±3.33, of the others to -1 to 0.992. Positions have 12
/// fractional bits, fewer when a Gaussian is farther out than 2047 m. Features are not kept.
///
/// # Errors
/// The cloud's arrays disagree, a number is not finite, a quaternion is zero, or a position is beyond 8 388 607 m.
pub fn write_version(cloud: &GaussianCloud, version: Version) -> Result<Vec<u8>, SplatError> {
    check(cloud)?;
    let version = if version == Version::V1 { Version::V2 } else { version };
    let farthest = cloud.means.iter().flatten().fold(0.0f32, |most, x| most.max(x.abs()));
    if farthest > LARGEST_FIXED {
        let place = "SPZ, distance of a mean from the origin along an axis in metres".to_string();
        return Err(SplatError::TooLarge { place, limit: LARGEST_FIXED as u64, found: farthest as u64 });
    }
    let fits = |bits: &u8| farthest * (1u32 << bits) as f32 <= LARGEST_FIXED;
    let fractional_bits = (0..=FRACTIONAL_BITS).rev().find(fits).unwrap_or(0);
    let mut data = Vec::with_capacity(cloud.len() * widths(version, cloud.sh_degree).iter().sum::<usize>());
    for mean in &cloud.means {
        let step = (1u32 << fractional_bits) as f32;
        half_turn(*mean).iter().for_each(|x| data.extend(&((x * step).round() as i32).to_le_bytes()[..3]));
    }
    data.extend(cloud.opacity_logits.iter().map(|logit| (opacity(*logit) * 255.0).round() as u8));
    for i in 0..cloud.len() {
        data.extend(cloud.sh_of(i)[0].map(|x| ((x * COLOUR_SCALE + 0.5) * 255.0).round() as u8));
    }
    data.extend(cloud.log_scales.iter().flatten().map(|log| ((log + 10.0) * 16.0).round() as u8));
    for rotation in &cloud.rotations {
        match version {
            Version::V1 | Version::V2 => data.extend(pack_first_three(half_turn_of(*rotation))),
            Version::V3 | Version::V4 => data.extend(pack_rotation(half_turn_of(*rotation)).to_le_bytes()),
        }
    }
    for i in 0..cloud.len() {
        let rest = cloud.sh_of(i).iter().zip(HALF_TURN_ABOUT_X).skip(1);
        rest.for_each(|(colour, sign)| data.extend(colour.map(|x| (sign * x * 128.0 + 128.0).round() as u8)));
    }
    close(&Arrays {
        version,
        count: cloud.len(),
        degree: cloud.sh_degree,
        fractional_bits,
        antialias: false,
        data,
        lost: vec![],
    })
}

/// A point after half a turn of the world about x.
fn half_turn([x, y, z]: [f32; 3]) -> [f32; 3] {
    [x, -y, -z]
}

/// The same for a rotation, w, x, y, z. Its own axes are turned, too, which a Gaussian cannot show: this is what other writers
/// of the format do.
fn half_turn_of([w, x, y, z]: [f32; 4]) -> [f32; 4] {
    [w, x, -y, -z]
}

/// 24 bits with sign.
fn fixed(bytes: &[u8], fractional_bits: u8) -> f32 {
    let number = i32::from_le_bytes([0, bytes[0], bytes[1], bytes[2]]) >> 8;
    number as f32 / (1u32 << fractional_bits) as f32
}

/// w, x, y, z from x, y, z.
fn first_three(bytes: &[u8]) -> [f32; 4] {
    let [x, y, z]: [f32; 3] = std::array::from_fn(|k| f32::from(bytes[k]) / 127.5 - 1.0);
    [(1.0 - x * x - y * y - z * z).max(0.0).sqrt(), x, y, z]
}

fn pack_first_three(rotation: [f32; 4]) -> [u8; 3] {
    let length = rotation.iter().map(|x| x * x).sum::<f32>().sqrt();
    let scale = if rotation[0] < 0.0 { -127.5 } else { 127.5 } / length;
    std::array::from_fn(|k| (rotation[k + 1] * scale + 127.5).round() as u8)
}

/// w, x, y, z from the index of the largest of x, y, z, w and the others.
fn unpack_rotation(word: u32) -> [f32; 4] {
    let part = |shift: u32| {
        let size = (word >> shift & 511) as f32 / 511.0 * std::f32::consts::FRAC_1_SQRT_2;
        if word >> (shift + 9) & 1 == 1 { -size } else { size }
    };
    let [x, y, z, w] = from_smallest_three((word >> 30) as usize, [part(20), part(10), part(0)]);
    [w, x, y, z]
}

fn pack_rotation([w, x, y, z]: [f32; 4]) -> u32 {
    let (largest, rest) = smallest_three([x, y, z, w]);
    rest.iter().fold(largest as u32, |word, part| {
        let size = (part.abs() * std::f32::consts::SQRT_2 * 511.0).round().min(511.0) as u32;
        word << 10 | u32::from(*part < 0.0) << 9 | size
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_as_the_format_has_them() {
        assert_eq!(fixed(&[0, 0x10, 0], 12), 1.0);
        assert_eq!(fixed(&[0xff, 0xff, 0xff], 12), -1.0 / 4096.0);
        assert_eq!(half_float(0x00, 0x3c), 1.0);
        assert_eq!(half_float(0x00, 0xc5), -5.0);
        assert_eq!(half_float(0x01, 0x00), 2f32.powi(-24));
        assert!(half_float(0x00, 0x7c).is_infinite() && half_float(0x01, 0x7c).is_nan());
        let [w, x, y, z] = first_three(&[0, 128, 127]);
        assert!(w == 0.0 && x == -1.0 && (y - 1.0 / 255.0).abs() < 1e-6 && (z + 1.0 / 255.0).abs() < 1e-6);
        // The largest is w, index 3; x is the topmost of the others, then y, then z with its sign.
        let [w, x, y, z] = unpack_rotation(3 << 30 | 511 << 20 | (512 | 100));
        assert!((x - 0.5f32.sqrt()).abs() < 1e-6 && y == 0.0 && (z + 0.138_378).abs() < 1e-5, "{x} {y} {z}");
        assert!((w * w + x * x + z * z - 1.0).abs() < 1e-6);
    }

    #[test]
    fn packed_rotations_come_back() {
        for q in [[1.0, 0.0, 0.0, 0.0], [-0.2, 0.9, 0.3, -0.1], [0.5, -0.5, 0.5, 0.5], [0.1, 0.2, -0.3, 0.4]] {
            let length = q.iter().map(|x| x * x).sum::<f32>().sqrt();
            for (back, least) in
                [(unpack_rotation(pack_rotation(q)), 0.999_995), (first_three(&pack_first_three(q)), 0.9995)]
            {
                let dot: f32 = back.iter().zip(&q).map(|(a, b)| a * b / length).sum();
                assert!(dot.abs() > least, "{q:?} {back:?}");
            }
        }
    }
}
