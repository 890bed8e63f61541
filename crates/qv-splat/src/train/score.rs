//! How far drawn images are from photographs.
//!
//! PSNR and SSIM of the image as it is drawn, cut off to 0 to 1, are what others publish. When exposures differ from photograph to
//! photograph they say more about the exposure than about the scene. Besides them, therefore, the two halves of an image are distinguished: an
//! affine colour transform, and one factor for each colour, is fitted to the left half by least squares, and the right half is scored with
//! them and without. An image that lacks detail is made dull by the affine fit, which the factors are not.

use super::dataset::Photograph;
use super::exposure::{exposed_image, fitted, fitted_gains};
use super::loss::ssim_map;

/// Scores of one image. A part of which every pixel is masked has none: NaN, which means leave out and nothing prints.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Score {
    /// Peak signal to noise ratio of the whole image \[dB\].
    pub psnr: f64,
    /// SSIM of the whole image.
    pub ssim: f64,
    /// Of the right half \[dB\].
    pub psnr_right: f64,
    /// Of the right half.
    pub ssim_right: f64,
    /// Of the right half, with the exposure fitted to the left half \[dB\].
    pub psnr_right_fitted: f64,
    /// Of the right half, with the exposure fitted to the left half.
    pub ssim_right_fitted: f64,
    /// Of the right half, with a factor for each colour fitted to the left half \[dB\].
    pub psnr_right_gains: f64,
}

impl Score {
    /// Mean of each number over the images that have it; `None` of nothing.
    pub fn mean(scores: &[Self]) -> Option<Self> {
        let mean = |of: fn(&Self) -> f64| {
            let there: Vec<f64> = scores.iter().map(of).filter(|score| !score.is_nan()).collect();
            there.iter().sum::<f64>() / there.len() as f64
        };
        (!scores.is_empty()).then(|| Self {
            psnr: mean(|s| s.psnr),
            ssim: mean(|s| s.ssim),
            psnr_right: mean(|s| s.psnr_right),
            ssim_right: mean(|s| s.ssim_right),
            psnr_right_fitted: mean(|s| s.psnr_right_fitted),
            ssim_right_fitted: mean(|s| s.ssim_right_fitted),
            psnr_right_gains: mean(|s| s.psnr_right_gains),
        })
    }
}

/// Scores a drawn colour image, shape `[height, width, 3]`. Masked pixels count as right in windows and are left out of means.
pub fn score(image: &[f32], photograph: &Photograph) -> Score {
    let width = photograph.pixels.width;
    let (wanted, valid) = (photograph.colour(), photograph.valid());
    let of = |image: &[f32], right: bool| {
        let counts = |pixel: usize| valid[pixel] && (!right || pixel % width >= width / 2);
        one(image, &wanted, &valid, width, &counts)
    };
    let left = (0..valid.len()).filter(|pixel| valid[*pixel] && pixel % width < width / 2);
    let pairs = left.map(|pixel| (&image[3 * pixel..3 * pixel + 3], &wanted[3 * pixel..3 * pixel + 3]));
    let (exposure, gains) = (fitted(pairs.clone()), fitted_gains(pairs));
    let (psnr, ssim) = of(image, false);
    let (psnr_right, ssim_right) = of(image, true);
    let (psnr_right_fitted, ssim_right_fitted) = of(&exposed_image(&exposure, image), true);
    let (psnr_right_gains, _) = of(&exposed_image(&gains, image), true);
    Score { psnr, ssim, psnr_right, ssim_right, psnr_right_fitted, ssim_right_fitted, psnr_right_gains }
}

/// Scores of the pixels of a held-out photograph that show the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundScore {
    /// Peak signal to noise ratio \[dB\].
    pub psnr: f64,
    /// SSIM.
    pub ssim: f64,
    /// Share of the photograph's pixels.
    pub share: f64,
}

impl GroundScore {
    /// The mean over photographs, each weighed alike; `None` of nothing.
    pub fn mean(scores: &[Self]) -> Option<Self> {
        let mean = |of: fn(&Self) -> f64| scores.iter().map(of).sum::<f64>() / scores.len() as f64;
        (!scores.is_empty()).then(|| Self { psnr: mean(|s| s.psnr), ssim: mean(|s| s.ssim), share: mean(|s| s.share) })
    }
}

/// Scores the pixels for which `shown` is true and that are not masked; `None` where fewer than a hundredth of the image are.
pub(super) fn score_of(image: &[f32], photograph: &Photograph, shown: &[bool]) -> Option<GroundScore> {
    let (wanted, valid) = (photograph.colour(), photograph.valid());
    let counts = |pixel: usize| valid[pixel] && shown[pixel];
    let share = (0..valid.len()).filter(|pixel| counts(*pixel)).count() as f64 / valid.len() as f64;
    let (psnr, ssim) = one(image, &wanted, &valid, photograph.pixels.width, &counts);
    (share >= 0.01).then_some(GroundScore { psnr, ssim, share })
}

fn one(image: &[f32], wanted: &[f32], valid: &[bool], width: usize, counts: &dyn Fn(usize) -> bool) -> (f64, f64) {
    let cut: Vec<f32> =
        image.iter().enumerate().map(|(at, x)| if valid[at / 3] { x.clamp(0.0, 1.0) } else { wanted[at] }).collect();
    let (mut square, mut similar, mut count) = (0.0f64, 0.0f64, 0.0f64);
    for (pixel, ssim) in ssim_map(&cut, wanted, width).iter().enumerate().filter(|(pixel, _)| counts(*pixel)) {
        square += (3 * pixel..3 * pixel + 3).map(|at| (cut[at] - wanted[at]) as f64).map(|d| d * d).sum::<f64>() / 3.0;
        similar += *ssim as f64;
        count += 1.0;
    }
    let error = square / count;
    // What is not a number stays that: a maximum would make the best score of it.
    (if error < 1e-10 { 100.0 } else { -10.0 * error.log10() }, similar / count)
}

#[cfg(test)]
mod tests {
    use super::super::tiny;
    use super::*;

    #[test]
    fn a_wrong_exposure_is_told_from_a_wrong_scene() {
        let scene = tiny::scene(40, 3, 32);
        let photograph = &scene.dataset.training[0];
        let right = photograph.colour();
        let perfect = score(&right, photograph);
        assert!(perfect.psnr > 90.0 && perfect.ssim > 0.9999, "{perfect:?}");
        let dim: Vec<f32> = right.iter().map(|c| 0.7 * c + 0.05).collect();
        let found = score(&dim, photograph);
        assert!(found.psnr < 30.0 && found.psnr_right < 35.0 && found.psnr_right_fitted > 45.0, "{found:?}");
        assert_eq!(Score::mean(&[]), None);
    }

    #[test]
    fn pixels_that_are_picked_are_scored_alone() {
        let scene = tiny::scene(40, 3, 32);
        let photograph = &scene.dataset.training[0];
        let mut image = photograph.colour();
        let lower: Vec<bool> = (0..32 * 32).map(|pixel| pixel >= 24 * 32).collect();
        image[3 * 24 * 32..].iter_mut().for_each(|c| *c += if *c > 0.5 { -0.1 } else { 0.1 });
        let found = score_of(&image, photograph, &lower).unwrap();
        assert!((found.psnr - 20.0).abs() < 0.1 && found.share == 0.25, "{found:?}");
        let upper: Vec<bool> = lower.iter().map(|is| !is).collect();
        assert_eq!(score_of(&image, photograph, &upper).unwrap().psnr, 100.0);
        assert_eq!(score_of(&image, photograph, &[false; 32 * 32]), None);
    }

    #[test]
    fn a_half_that_is_masked_counts_in_no_mean() {
        let scene = tiny::scene(40, 3, 32);
        let mut photograph = scene.dataset.training[0].clone();
        let (image, width) = (vec![0.3; 3 * photograph.pixels.rgba.len()], photograph.pixels.width);
        let whole = score(&image, &photograph);
        for (index, pixel) in photograph.pixels.rgba.iter_mut().enumerate() {
            pixel[3] = if index % width < width / 2 { 255 } else { 0 };
        }
        let half = score(&image, &photograph);
        assert!(half.psnr.is_finite() && half.psnr_right.is_nan() && half.ssim_right.is_nan(), "{half:?}");
        let mean = Score::mean(&[half, whole]).unwrap();
        assert_eq!((mean.psnr_right, mean.psnr), (whole.psnr_right, 0.5 * (half.psnr + whole.psnr)));
        assert!(Score::mean(&[half]).unwrap().psnr_right.is_nan());
    }
}
