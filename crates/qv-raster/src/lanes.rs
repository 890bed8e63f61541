//! A row of a tile at once: plain loops over arrays, which the compiler turns into the widest vectors that the machine
//! has. No operation is fused or reordered, so all widths give the same bits.

use crate::constants::TILE;

/// Pixels in a row of a tile.
pub const LANES: usize = TILE as usize;
/// A number per pixel of a row.
pub type Lanes = [f32; LANES];

/// exp(-x) for x >= 0 with a relative error below 2e-7; the least value is exp(-80).
#[inline(always)]
pub fn exp_negative(x: f32) -> f32 {
    // Adding this rounds to an integer, which stands in the lowest bits, with the bias of the exponent.
    const ROUNDER: f32 = 12_582_912.0 + 127.0;
    const LN2_HIGH: f32 = 0.693_145_75;
    const LN2_LOW: f32 = 1.428_606_8e-6;
    let x = if x < 80.0 { -x } else { -80.0 };
    let shifted = x * std::f32::consts::LOG2_E + ROUNDER;
    let k = shifted - ROUNDER;
    let r = (x - k * LN2_HIGH) - k * LN2_LOW;
    let series = 1.0 / 120.0 + r * (1.0 / 720.0 + r * (1.0 / 5040.0));
    let series = 1.0 + r * (1.0 + r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * series))));
    f32::from_bits(shifted.to_bits() << 23) * series
}

/// Runs `$body` compiled for the widest vectors that the machine has. `$body` must be `#[inline(always)]`.
macro_rules! widest {
    ($(#[$doc:meta])* $visible:vis fn $name:ident = $body:ident($($argument:ident: $type:ty),* $(,)?)) => {
        $(#[$doc])*
        $visible fn $name($($argument: $type),*) {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
                fn avx512($($argument: $type),*) {
                    $body($($argument),*)
                }
                #[target_feature(enable = "avx2")]
                fn avx2($($argument: $type),*) {
                    $body($($argument),*)
                }
                if is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw")
                {
                    // SAFETY: the features were found just now.
                    return unsafe { avx512($($argument),*) };
                }
                if is_x86_feature_detected!("avx2") {
                    // SAFETY: the feature was found just now.
                    return unsafe { avx2($($argument),*) };
                }
            }
            $body($($argument),*)
        }
    };
}
pub(crate) use widest;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponential_is_accurate() {
        for i in 0..100_000 {
            let x = i as f32 * 6e-4;
            let expected = (-(x as f64)).exp();
            assert!((exp_negative(x) as f64 / expected - 1.0).abs() < 2e-7, "{x}");
        }
        assert_eq!(exp_negative(0.0), 1.0);
        assert_eq!(exp_negative(f32::INFINITY), exp_negative(80.0));
    }
}
