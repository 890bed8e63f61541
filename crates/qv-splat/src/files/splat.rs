//! antimatter15's `.splat` (antimatter15/splat, `convert.py` and `main.js`, 2023): rows of 32 bytes and nothing else. Position and standard
//! deviations as floats; red, green, blue, opacity in a byte each; rotation w, x, y, z in a byte each, 128 times the number plus 128. The frame
//! is that of the PLY that it was made of. Colours are those that the constant harmonic gives; there are no others.

use super::format::{Format, SplatFile};
use super::quantised::{SH_C0, logit_of_byte};
use super::sieve::{Sieve, Splat};
use crate::SplatError;
use crate::cursor::f32_at;
use crate::error::off;

/// Bytes of a Gaussian.
const ROW: usize = 32;

/// Reads a file.
///
/// # Errors
/// It is empty, its length is no multiple of 32, or no row of it holds a Gaussian: then it is another file of that name.
pub fn read(bytes: &[u8]) -> Result<SplatFile, SplatError> {
    if bytes.is_empty() || !bytes.len().is_multiple_of(ROW) {
        return Err(off(".splat file", "rows of 32 bytes", format!("{} bytes", bytes.len())));
    }
    let mut sieve = Sieve::new(bytes.len() / ROW, 0, 0);
    for row in bytes.chunks_exact(ROW) {
        sieve.push(&Splat {
            mean: [0, 4, 8].map(|at| f32_at(row, at)),
            log_scale: [12, 16, 20].map(|at| f32_at(row, at).ln()),
            rotation: [28, 29, 30, 31].map(|at| (f32::from(row[at]) - 128.0) / 128.0),
            opacity_logit: logit_of_byte(row[27]),
            sh: &[colour(&row[24..27])],
            features: &[],
        });
    }
    let file = sieve.finish(Format::Splat, vec![]);
    if file.cloud.is_empty() {
        return Err(off(".splat file", "a row with finite numbers", format!("none in {}", file.left_out)));
    }
    Ok(file)
}

/// Coefficients of the constant harmonic of a colour in bytes.
pub fn colour(bytes: &[u8]) -> [f32; 3] {
    std::array::from_fn(|c| (f32::from(bytes[c]) / 255.0 - 0.5) / SH_C0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use crate::files::{quantised::opacity, read_named};

    fn row(mean: [f32; 3], scale: [f32; 3], bytes: [u8; 8]) -> Vec<u8> {
        mean.iter().chain(&scale).flat_map(|x| x.to_le_bytes()).chain(bytes).collect()
    }

    #[test]
    fn rows_are_gaussians() {
        let good = row([1.0, 2.0, 3.0], [0.1, 0.2, 0.0], [255, 0, 128, 51, 0, 128, 128, 255]);
        let bad = row([f32::NAN, 0.0, 0.0], [0.1; 3], [0; 8]);
        let below = row([0.0; 3], [-0.1; 3], [0; 8]);
        let bytes = [good, bad, below].concat();
        let file = read_named(&bytes, "a/Scene.SPLAT", &mut |_| Err("none".into())).unwrap();
        assert_eq!((file.format, file.cloud.len(), file.left_out), (Format::Splat, 1, 2));
        let cloud = &file.cloud;
        assert_eq!((cloud.means[0], cloud.rotations[0]), ([1.0, 2.0, 3.0], [-1.0, 0.0, 0.0, 127.0 / 128.0]));
        assert!((cloud.log_scales[0][1] - 0.2f32.ln()).abs() < 1e-6 && cloud.log_scales[0][2] < -27.0);
        assert!((opacity(cloud.opacity_logits[0]) - 0.2).abs() < 1e-6);
        assert!((cloud.sh[0][0] * SH_C0 - 0.5).abs() < 1e-6 && (cloud.sh[0][1] * SH_C0 + 0.5).abs() < 1e-6);
        for bytes in [&bytes[..31], &[], &[255; 64]] {
            assert!(read(bytes).unwrap_err().to_string().states(".splat"));
        }
    }
}
