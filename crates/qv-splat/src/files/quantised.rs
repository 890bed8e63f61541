//! Numbers in few bits.

/// Opacity logit that stands for opacity 1, and its negative for 0: what is left to 1 is half a step of single precision.
pub const OPAQUE_LOGIT: f32 = 16.635_532;

/// Coefficient of the constant harmonic that adds one to a colour.
pub const SH_C0: f32 = 0.282_094_79;

/// A number within 0 to 1 in so many bits; outside it is clamped.
pub fn pack_unit(value: f32, bits: u32) -> u32 {
    let most = (1u32 << bits) - 1;
    ((value * most as f32 + 0.5).max(0.0) as u32).min(most)
}

/// The number that the low bits stand for.
pub fn unpack_unit(packed: u32, bits: u32) -> f32 {
    let most = (1u32 << bits) - 1;
    (packed & most) as f32 / most as f32
}

/// Opacity from its logit.
pub fn opacity(logit: f32) -> f32 {
    (1.0 / (1.0 + (-f64::from(logit)).exp())) as f32
}

/// Logit of an opacity; beyond what single precision shows from 0 and 1 it is that of [`OPAQUE_LOGIT`].
pub fn logit(opacity: f32) -> f32 {
    let p = f64::from(opacity);
    ((p / (1.0 - p)).ln() as f32).clamp(-OPAQUE_LOGIT, OPAQUE_LOGIT)
}

/// IEEE 754 binary16.
pub fn half_float(low: u8, high: u8) -> f32 {
    let bits = u16::from_le_bytes([low, high]);
    let (exponent, mantissa) = (i32::from(bits >> 10 & 31), f32::from(bits & 1023) / 1024.0);
    let size = match exponent {
        0 => mantissa * 2f32.powi(-14),
        31 if mantissa == 0.0 => f32::INFINITY,
        31 => f32::NAN,
        _ => (1.0 + mantissa) * 2f32.powi(exponent - 15),
    };
    if bits >> 15 == 1 { -size } else { size }
}

/// Logit of an opacity in a byte. 0 and 255 stand for half a step, of which this is the middle.
pub fn logit_of_byte(byte: u8) -> f32 {
    logit(f32::from(byte).clamp(0.25, 254.75) / 255.0)
}

/// The three components of a unit quaternion beside its largest, which is made positive, and the index of that one.
pub fn smallest_three(quaternion: [f32; 4]) -> (usize, [f32; 3]) {
    let length = quaternion.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt();
    let unit = quaternion.map(|x| (f64::from(x) / length) as f32);
    let largest = (1..4).fold(0, |best, i| if unit[i].abs() > unit[best].abs() { i } else { best });
    let sign = if unit[largest] < 0.0 { -1.0 } else { 1.0 };
    let mut rest = (0..4).filter(|i| *i != largest).map(|i| sign * unit[i]);
    (largest, std::array::from_fn(|_| rest.next().unwrap_or(0.0)))
}

/// The quaternion with these components beside its largest.
pub fn from_smallest_three(largest: usize, rest: [f32; 3]) -> [f32; 4] {
    let squared: f32 = rest.iter().map(|x| x * x).sum();
    let mut rest = rest.into_iter();
    let top = (1.0 - squared).max(0.0).sqrt();
    std::array::from_fn(|i| if i == largest { top } else { rest.next().unwrap_or(0.0) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_of_opacity_comes_back() {
        for byte in 0..=255u8 {
            let back = (opacity(logit_of_byte(byte)) * 255.0).round();
            assert_eq!(back, f32::from(byte));
        }
        assert!(logit(1.0) == OPAQUE_LOGIT && logit(0.0) == -OPAQUE_LOGIT && logit(0.5) == 0.0);
    }

    #[test]
    fn units_round_to_the_nearest() {
        for bits in [8, 10, 11] {
            let step = 1.0 / ((1u32 << bits) - 1) as f32;
            for k in 0..1000 {
                let x = k as f32 / 999.0;
                assert!((unpack_unit(pack_unit(x, bits), bits) - x).abs() <= 0.5001 * step, "{bits} {x}");
            }
            assert_eq!((pack_unit(-1.0, bits), pack_unit(2.0, bits)), (0, (1 << bits) - 1));
        }
        assert_eq!(pack_unit(f32::NAN, 8), 0);
    }

    #[test]
    fn a_quaternion_comes_back_up_to_sign_and_length() {
        for q in [[1.0, 0.0, 0.0, 0.0], [0.1, -0.9, 0.2, 0.4], [-0.5, 0.5, -0.5, 0.5], [0.0, 0.0, 0.0, -2.0]] {
            let (largest, rest) = smallest_three(q);
            let back = from_smallest_three(largest, rest);
            let length = q.iter().map(|x| x * x).sum::<f32>().sqrt();
            let dot: f32 = back.iter().zip(&q).map(|(a, b)| a * b / length).sum();
            assert!((dot.abs() - 1.0).abs() < 1e-6, "{q:?} {back:?}");
        }
    }
}
