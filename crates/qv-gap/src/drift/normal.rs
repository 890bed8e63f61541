//! Tails of the standard normal distribution, also far out.

use std::f64::consts::{PI, SQRT_2};

/// Probability that a standard normal number is at least `z` away from 0. Relative error below 1e-9 (series near 0, Abramowitz and Stegun 1964,
/// eq. 26.2.10; continued fraction beyond, eq. 26.2.14).
pub(super) fn two_sided(z: f64) -> f64 {
    let z = z.abs();
    let density = (-0.5 * z * z).exp() / (2.0 * PI).sqrt();
    if z < 2.5 {
        let (mut term, mut sum, mut k) = (z, z, 0.0);
        while term > 1e-17 * sum {
            k += 1.0;
            term *= z * z / (2.0 * k + 1.0);
            sum += term;
        }
        return 1.0 - 2.0 * density * sum;
    }
    let fraction = (1..=60).rev().fold(z, |rest, k| z + f64::from(k) / rest);
    2.0 * density / fraction
}

/// The `z` of which [`two_sided`] is `p`, between 0 and 40.
pub(super) fn quantile(p: f64) -> f64 {
    let (mut low, mut high) = (0.0, 40.0 * SQRT_2);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if two_sided(middle) > p { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_are_those_of_tables() {
        for (z, p) in [(0.0, 1.0), (1.0, 0.317_310_507_86), (1.959_963_984_54, 0.05), (3.0, 2.699_796_063e-3)] {
            assert!((two_sided(z) / p - 1.0).abs() < 1e-9, "{z}: {}", two_sided(z));
        }
        assert!((two_sided(6.0) / 1.973_175_290e-9 - 1.0).abs() < 1e-8, "{}", two_sided(6.0));
        assert!(
            (two_sided(2.499_999_99) / two_sided(2.500_000_01) - 1.0).abs() < 1e-6,
            "no step where the method changes"
        );
        assert!((quantile(0.05) - 1.959_963_985).abs() < 1e-8 && (two_sided(quantile(1e-6)) / 1e-6 - 1.0).abs() < 1e-9);
    }
}
