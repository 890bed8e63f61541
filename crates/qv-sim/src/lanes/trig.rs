//! Sine and cosine in exactly rounded steps, so that they are the same bits on every machine and in every lane.

use super::Real;

/// `(sin x, cos x)`, x in radians. Within 2 units in the last place for |x| < 1e5 in `f64`; argument reduction by
/// three parts of pi/2 (Cody and Waite 1980), then the Taylor polynomials on ±pi/4, cut where they fall below rounding.
#[inline(always)]
pub(crate) fn sin_cos<L: Real>(x: L) -> (L, L) {
    let quarter = (x * L::splat(std::f64::consts::FRAC_2_PI)).round();
    // Each part has few enough bits that its product with `quarter` is exact in both precisions' working ranges.
    let r = ((x - quarter * L::splat(1.5703125)) - quarter * L::splat(4.837512969970703e-4))
        - quarter * L::splat(7.549_789_954_891_882e-8);
    let z = r * r;
    let sin = r + r * z * polynomial(z, &SIN);
    let cos = L::one() - z * L::splat(0.5) + z * z * polynomial(z, &COS);
    // quadrant 0..3 as a number: quarter - 4 floor(quarter / 4), with the floor taken from a rounding at -3/8.
    let quadrant = quarter - L::splat(4.0) * (quarter * L::splat(0.25) - L::splat(0.375)).round();
    let even = (quadrant - L::splat(2.0) * (quadrant * L::splat(0.5) - L::splat(0.25)).round()).lt(L::splat(0.5));
    let (s, c) = (L::select(even, sin, cos), L::select(even, cos, sin));
    let negate_sin = L::splat(1.5).lt(quadrant);
    let negate_cos = L::splat(0.5).lt(quadrant) & quadrant.lt(L::splat(2.5));
    (L::select(negate_sin, -s, s), L::select(negate_cos, -c, c))
}

const SIN: [f64; 7] = [
    -1.0 / 6.0,
    1.0 / 120.0,
    -1.0 / 5040.0,
    1.0 / 362880.0,
    -1.0 / 39916800.0,
    1.0 / 6227020800.0,
    -1.0 / 1307674368000.0,
];
const COS: [f64; 7] = [
    1.0 / 24.0,
    -1.0 / 720.0,
    1.0 / 40320.0,
    -1.0 / 3628800.0,
    1.0 / 479001600.0,
    -1.0 / 87178291200.0,
    1.0 / 20922789888000.0,
];

#[inline(always)]
fn polynomial<L: Real>(z: L, coefficients: &[f64; 7]) -> L {
    let mut sum = L::splat(coefficients[6]);
    for i in (0..6).rev() {
        sum = sum * z + L::splat(coefficients[i]);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_standard_library() {
        let mut worst = 0.0f64;
        for i in -40_000..40_000 {
            let x = i as f64 * 0.001 + 1e-5;
            let (s, c) = sin_cos(x);
            worst = worst.max((s - x.sin()).abs()).max((c - x.cos()).abs());
        }
        assert!(worst < 5e-15, "worst error {worst:e}");
    }

    #[test]
    fn quadrants_and_single_precision() {
        for x in [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, -1.0, -2.5, -4.0, -6.2f64] {
            let (s, c) = sin_cos(x as f32);
            assert!((f64::from(s) - x.sin()).abs() < 4e-7 && (f64::from(c) - x.cos()).abs() < 4e-7, "{x}");
        }
    }
}
