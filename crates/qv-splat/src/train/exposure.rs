//! Affine colour transforms: what a camera's automatic exposure and white balance did to a photograph.

use rayon::prelude::*;

/// An affine colour transform: three rows of red, green, blue and one.
pub type Exposure = [f32; 12];

/// The exposure that changes nothing.
pub const NEUTRAL: Exposure = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];

/// The transform of a colour.
pub fn exposed(e: &Exposure, [r, g, b]: [f32; 3]) -> [f32; 3] {
    [0, 4, 8].map(|row| e[row] * r + e[row + 1] * g + e[row + 2] * b + e[row + 3])
}

/// The transform of an image, shape `[height, width, 3]`.
pub(crate) fn exposed_image(e: &Exposure, image: &[f32]) -> Vec<f32> {
    image.chunks_exact(3).flat_map(|c| exposed(e, [c[0], c[1], c[2]])).collect()
}

/// From the derivative by a transformed image to that by the image, in place, and that by the transform.
pub(crate) fn exposed_backward(e: &Exposure, image: &[f32], by: &mut [f32]) -> Exposure {
    // Sums of rows of a fixed length, so that the order does not depend on threads.
    const ROW: usize = 3 * 4096;
    let rows = (image.par_chunks(ROW), by.par_chunks_mut(ROW)).into_par_iter();
    let sums: Vec<[f64; 12]> = rows
        .map(|(image, by)| {
            let mut sum = [0.0f64; 12];
            for (c, by) in image.chunks_exact(3).zip(by.chunks_exact_mut(3)) {
                for row in 0..3 {
                    (0..3).for_each(|k| sum[4 * row + k] += (by[row] * c[k]) as f64);
                    sum[4 * row + 3] += by[row] as f64;
                }
                let back = [0, 1, 2].map(|k| e[k] * by[0] + e[4 + k] * by[1] + e[8 + k] * by[2]);
                by.copy_from_slice(&back);
            }
            sum
        })
        .collect();
    let mut out = [0.0; 12];
    (0..12).for_each(|k| out[k] = sums.iter().map(|sum| sum[k]).sum::<f64>() as f32);
    out
}

/// Adds the derivative of `weight` times the squared distance from identity.
pub(crate) fn regularise(e: &Exposure, weight: f32, by: &mut Exposure) {
    (0..12).for_each(|k| by[k] += 2.0 * weight * (e[k] - NEUTRAL[k]));
}

/// The transform that brings colours of an image to those of a photograph in the sense of least squares, both `[pixels, 3]`. A weak pull
/// to identity keeps it defined when all pixels are alike.
pub fn fitted<'a>(pairs: impl Iterator<Item = (&'a [f32], &'a [f32])>) -> Exposure {
    let mut normal = [[0.0f64; 4]; 4];
    let mut wanted = [[0.0f64; 4]; 3];
    let mut count = 0.0;
    for (from, to) in pairs {
        let x = [from[0] as f64, from[1] as f64, from[2] as f64, 1.0];
        for i in 0..4 {
            (0..4).for_each(|j| normal[i][j] += x[i] * x[j]);
            (0..3).for_each(|c| wanted[c][i] += x[i] * to[c] as f64);
        }
        count += 1.0;
    }
    let pull = 1e-4 * count + 1e-9;
    for i in 0..4 {
        normal[i][i] += pull;
        (0..3).for_each(|c| wanted[c][i] += pull * NEUTRAL[4 * c + i] as f64);
    }
    let matrix = glam::DMat4::from_cols_array_2d(&normal).inverse();
    let mut out = [0.0; 12];
    for c in 0..3 {
        let row = matrix * glam::DVec4::from_array(wanted[c]);
        (0..4).for_each(|k| out[4 * c + k] = row[k] as f32);
    }
    out
}

/// The factor of each colour that brings an image to a photograph in the sense of least squares, both `[pixels, 3]`, as a transform.
pub(crate) fn fitted_gains<'a>(pairs: impl Iterator<Item = (&'a [f32], &'a [f32])>) -> Exposure {
    let (mut own, mut both) = ([1e-9f64; 3], [1e-9f64; 3]);
    for (from, to) in pairs {
        for c in 0..3 {
            own[c] += (from[c] * from[c]) as f64;
            both[c] += (from[c] * to[c]) as f64;
        }
    }
    let mut out = NEUTRAL;
    (0..3).for_each(|c| out[5 * c] = (both[c] / own[c]) as f32);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const E: Exposure = [1.1, 0.1, 0.0, 0.05, -0.1, 0.8, 0.02, 0.1, 0.0, 0.05, 1.3, -0.1];

    fn image() -> Vec<f32> {
        (0..30 * 3).map(|i| 0.5 + 0.4 * (i as f32 * i as f32 * 1.7).sin()).collect()
    }

    #[test]
    fn a_transform_is_found_again() {
        let (a, b) = (image(), exposed_image(&E, &image()));
        let found = fitted(a.chunks_exact(3).zip(b.chunks_exact(3)));
        assert!(found.iter().zip(&E).all(|(a, b)| (a - b).abs() < 0.02), "{found:?}");
        assert_eq!(fitted(std::iter::empty()), NEUTRAL);
        let dim: Vec<f32> = a.iter().enumerate().map(|(at, x)| x * [0.5, 0.7, 0.9][at % 3]).collect();
        let gains = fitted_gains(a.chunks_exact(3).zip(dim.chunks_exact(3)));
        assert!([0.5, 0.7, 0.9].iter().enumerate().all(|(c, x)| (gains[5 * c] - x).abs() < 1e-5), "{gains:?}");
        assert_eq!(fitted_gains(std::iter::empty()), NEUTRAL);
    }

    #[test]
    fn derivatives_are_those_of_a_weighted_sum() {
        let (a, weights) = (image(), image().iter().map(|x| x - 0.3).collect::<Vec<f32>>());
        let value = |e: &Exposure, a: &[f32]| -> f64 {
            exposed_image(e, a).iter().zip(&weights).map(|(x, w)| (x * w) as f64).sum()
        };
        let mut by = weights.clone();
        let by_e = exposed_backward(&E, &a, &mut by);
        for k in 0..12 {
            let (mut plus, mut minus) = (E, E);
            (plus[k], minus[k]) = (E[k] + 0.01, E[k] - 0.01);
            let expected = (value(&plus, &a) - value(&minus, &a)) / 0.02;
            assert!((by_e[k] as f64 - expected).abs() < 1e-3, "{k}");
        }
        for k in [0, 7, 50] {
            let (mut plus, mut minus) = (a.clone(), a.clone());
            (plus[k], minus[k]) = (a[k] + 0.01, a[k] - 0.01);
            let expected = (value(&E, &plus) - value(&E, &minus)) / 0.02;
            assert!((by[k] as f64 - expected).abs() < 1e-3, "{k}");
        }
    }
}
