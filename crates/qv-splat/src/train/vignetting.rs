//! Vignetting: how a lens darkens a photograph towards its corners, by the same factor for all colours,
//!
//! ```text
//! 1 + a r² + b r⁴ + c r⁶
//! ```
//!
//! with r the distance from the principal point in half diagonals of the image (Goldman, *Vignette and Exposure Calibration and Compensation*,
//! PAMI 2010). It belongs to the lens: all photographs of one camera share it, those that are held out as well. Light falls on the sensor before it
//! is exposed, so a photograph is `E (V C)` of the drawn colours C with its exposure E. Colours are those of the photographs, not linear light:
//! where they are a power of it, the fall-off of the light to that power is such a factor, too.

use qv_core::Camera;
use rayon::prelude::*;

/// The coefficients a, b and c.
pub(crate) type Vignetting = [f32; 3];

/// Of a lens that darkens nothing.
pub const NONE: Vignetting = [0.0; 3];

/// Squared distance of a pixel's middle from the principal point in units of half the diagonal.
fn squared(camera: &Camera, column: usize, row: usize) -> f32 {
    let (x, y) = (column as f64 + 0.5 - camera.cx, row as f64 + 0.5 - camera.cy);
    ((x * x + y * y) * one_over_square(camera)) as f32
}

/// One over the square of half the diagonal.
pub fn one_over_square(camera: &Camera) -> f64 {
    4.0 / (f64::from(camera.width).powi(2) + f64::from(camera.height).powi(2))
}

/// The factor at a squared distance.
fn factor([a, b, c]: Vignetting, squared: f32) -> f32 {
    1.0 + squared * (a + squared * (b + squared * c))
}

/// What a lens makes of an image, shape `[height, width, 3]`.
pub(crate) fn vignetted(by: Vignetting, camera: &Camera, image: &[f32]) -> Vec<f32> {
    let mut out = image.to_vec();
    let width = camera.width as usize;
    if by != NONE {
        out.par_chunks_mut(3 * width).enumerate().for_each(|(row, out)| {
            for (column, colour) in out.chunks_exact_mut(3).enumerate() {
                let factor = factor(by, squared(camera, column, row));
                colour.iter_mut().for_each(|c| *c *= factor);
            }
        });
    }
    out
}

/// From the derivative by a vignetted image to that by the image, in place, and that by the coefficients.
pub fn back(of: Vignetting, camera: &Camera, image: &[f32], by: &mut [f32]) -> Vignetting {
    let width = camera.width as usize;
    let rows = (image.par_chunks(3 * width), by.par_chunks_mut(3 * width)).into_par_iter().enumerate();
    let of_row = |(row, (image, by)): (usize, (&[f32], &mut [f32]))| {
        let mut sums = [0.0f64; 3];
        for (column, (colour, by)) in image.chunks_exact(3).zip(by.chunks_exact_mut(3)).enumerate() {
            let squared = squared(camera, column, row);
            let by_factor = f64::from(by[0] * colour[0] + by[1] * colour[1] + by[2] * colour[2]);
            (0..3).for_each(|k| sums[k] += by_factor * f64::from(squared).powi(k as i32 + 1));
            let factor = factor(of, squared);
            by.iter_mut().for_each(|by| *by *= factor);
        }
        sums
    };
    let sums: Vec<[f64; 3]> = rows.map(of_row).collect();
    [0, 1, 2].map(|k| sums.iter().map(|sum| sum[k]).sum::<f64>() as f32)
}

#[cfg(test)]
mod tests {
    use super::super::{CpuEngine, Engine, Model, Score, Strategy, TrainOptions, cameras, scores, tiny, train};
    use super::*;

    const LENS: Vignetting = [-0.3, 0.05, -0.1];

    #[test]
    fn derivatives_are_those_of_a_weighted_sum() {
        let camera = tiny::ring(1, 20).remove(0);
        let image: Vec<f32> = (0..20 * 20 * 3).map(|i| 0.5 + 0.4 * (i as f32 * 1.7).sin()).collect();
        let weights: Vec<f32> = image.iter().map(|x| (9.0 * x).cos()).collect();
        let value = |of: Vignetting, image: &[f32]| -> f64 {
            vignetted(of, &camera, image).iter().zip(&weights).map(|(x, w)| f64::from(x * w)).sum()
        };
        let mut by = weights.clone();
        let by_lens = back(LENS, &camera, &image, &mut by);
        for k in 0..3 {
            let moved = |h: f32| {
                let mut of = LENS;
                of[k] += h;
                value(of, &image)
            };
            let expected = (moved(0.05) - moved(-0.05)) / 0.1;
            assert!(
                (f64::from(by_lens[k]) - expected).abs() < 1e-3 * (1.0 + expected.abs()),
                "{k}: {by_lens:?} {expected}"
            );
        }
        for at in [0, 7, 599, 1199] {
            let moved = |h: f32| {
                let mut image = image.clone();
                image[at] += h;
                value(LENS, &image)
            };
            let expected = (moved(0.05) - moved(-0.05)) / 0.1;
            assert!((f64::from(by[at]) - expected).abs() < 1e-3, "{at}");
        }
        // A corner is half a diagonal away from the middle.
        assert!((factor(LENS, squared(&camera, 0, 0)) - 0.65).abs() < 0.06, "{}", squared(&camera, 0, 0));
        assert_eq!(vignetted(NONE, &camera, &image), image);
    }

    #[test]
    fn the_fall_off_of_a_lens_is_found_and_held_out_photographs_have_it() {
        let mut scene = tiny::scene(120, 9, 56);
        for one in &mut scene.dataset.training {
            let bytes = vignetted(LENS, &one.camera, &one.colour());
            for (pixel, colour) in one.pixels.rgba.iter_mut().zip(bytes.chunks_exact(3)) {
                (0..3).for_each(|c| pixel[c] = (colour[c].clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
            }
        }
        let held_out = scene.dataset.training.remove(4);
        let learned = |vignetting: bool| {
            let strategy = Strategy::Classic;
            let mut options =
                TrainOptions { iterations: 500, strategy, refine_from: 10_000, vignetting, ..Default::default() };
            options.weights.vignetting = 1e-3;
            let model = Model::new(scene.cloud.clone(), &scene.dataset);
            let mut engine = CpuEngine::new(&scene.dataset, &options, model).unwrap();
            assert_eq!(train(&mut engine, 8, 500, 1, 100, &mut |_, _| Ok(true)), Ok(true));
            let model = engine.model().unwrap();
            let looked_at = [cameras::as_learned(&model, &scene.dataset, &held_out)];
            (Score::mean(&scores(&model.cloud, &looked_at, &scene.dataset).unwrap()).unwrap().psnr, model)
        };
        let ((without, _), (with, model)) = (learned(false), learned(true));
        let found = model.shared[0].vignetting;
        println!("{without:.2} dB without, {with:.2} dB with: {found:?}");
        for squared in [0.1, 0.3, 0.6] {
            let (found, there) = (factor(found, squared), factor(LENS, squared));
            assert!((found - there).abs() < 0.03, "at {squared}: {found}, not {there}");
        }
        assert!(with > without + 3.0, "{without} {with}");
    }
}
