//! Distributions, posteriors and whitening against closed forms.

use qv_contact::posterior::{Distribution, Evidence, evidence, interpolate, posterior};
use qv_contact::prior::{Prior, RANGE};
use qv_contact::report::Estimate;
use qv_contact::whiten::Usual;
use qv_core::random::SplitMix64;

/// Quantiles of the standard normal distribution at 2.5, 5, 50, 95 and 97.5 %.
const NORMAL: [(f64, f64); 5] =
    [(0.025, -1.959_964), (0.05, -1.644_854), (0.5, 0.0), (0.95, 1.644_854), (0.975, 1.959_964)];

fn narrow() -> Prior {
    // Far from the ends of the range, which cut off less than 1e-9 of it.
    Prior::new("x", 0.3, 0.06, "", "").unwrap()
}

/// Moments and quantiles of a lognormal distribution: Johnson, Kotz and Balakrishnan, Continuous Univariate Distributions 1, chapter 14.
#[test]
fn a_prior_is_the_lognormal_of_its_mean_and_deviation() {
    let prior = narrow();
    let variance = (1.0f64 + (0.06f64 / 0.3).powi(2)).ln();
    let (middle, deviation) = (0.3f64.ln() - 0.5 * variance, variance.sqrt());
    let [mean, sd] = prior.log_moments();
    assert!((mean - middle).abs() < 1e-12 && (sd - deviation).abs() < 1e-12);
    let found = Distribution::prior(&prior, RANGE);
    assert!((found.mean() - 0.3).abs() < 1e-4, "{}", found.mean());
    let [mean, sd] = found.log_moments();
    assert!((mean - middle).abs() < 1e-4 && (sd / deviation - 1.0).abs() < 1e-3, "{mean} {sd}");
    for (share, z) in NORMAL {
        let expected = (middle + deviation * z).exp();
        assert!((found.quantile(share) / expected - 1.0).abs() < 2e-3, "{share}: {}", found.quantile(share));
    }
    let estimate = Estimate::of(&found);
    assert_eq!(estimate.interval90, [found.quantile(0.05), found.quantile(0.95)]);
    assert_eq!(estimate.interval95, [found.quantile(0.025), found.quantile(0.975)]);
}

/// The divergence of two normal distributions of the logarithm: ln(s2/s1) + (s1² + (m1 - m2)²) / (2 s2²) - 1/2.
#[test]
fn information_is_the_divergence_of_normal_distributions() {
    let [first, second] = [(0.3, 0.05), (0.4, 0.10)].map(|(mean, sd)| Prior::new("x", mean, sd, "", "").unwrap());
    let ([m1, s1], [m2, s2]) = (first.log_moments(), second.log_moments());
    let expected = (s2 / s1).ln() + (s1 * s1 + (m1 - m2).powi(2)) / (2.0 * s2 * s2) - 0.5;
    let [first, second] = [first, second].map(|prior| Distribution::prior(&prior, RANGE));
    assert!((first.gain(&second) / expected - 1.0).abs() < 1e-3, "{} {expected}", first.gain(&second));
    assert!(first.gain(&first) < 1e-12);
}

/// Precisions of a normal prior and a normal likelihood add up (Gelman et al., Bayesian Data Analysis, section 2.5); an own error adds to the
/// variance of the likelihood.
#[test]
fn normal_evidence_and_prior_add_their_precisions() {
    let prior = narrow();
    let [middle, deviation] = prior.log_moments();
    for own_error in [1e-6, 0.08] {
        let (at, width) = (0.36f64.ln(), 0.1);
        let friction = Distribution::prior(&prior, RANGE).friction;
        let losses = friction.iter().map(|mu| 0.5 * ((mu.ln() - at) / width).powi(2)).collect();
        let evidence = Evidence { losses, weight: 1.0, least: 0.36 };
        let found = posterior(&prior, &evidence, RANGE, own_error);
        let [a, b] = [deviation.powi(-2), (width * width + own_error * own_error).recip()];
        let [mean, sd] = found.log_moments();
        assert!((mean - (a * middle + b * at) / (a + b)).abs() < 1e-3, "{own_error}: {mean}");
        assert!((sd * (a + b).sqrt() - 1.0).abs() < 5e-3, "{own_error}: {sd}");
    }
}

/// Losses that are parabolas of one bend about scattered places weigh H / V, which both follow from the places alone.
#[test]
fn the_weight_is_the_bend_over_the_variance_of_the_slopes() {
    let grid: Vec<f64> = (0..60).map(|k| 0.04 * (1.4f64 / 0.04).powf(f64::from(k) / 59.0)).collect();
    let (bend, mut random) = (25.0, SplitMix64::new(5));
    let places: Vec<f64> = (0..40).map(|_| 0.25f64.ln() + 1.4 * (random.uniform() - 0.5)).collect();
    let loss = |at: f64| grid.iter().map(|mu| 0.5 * bend * (mu.ln() - at).powi(2)).collect::<Vec<f64>>();
    let windows: Vec<(usize, Vec<f64>)> = places.iter().enumerate().map(|(k, at)| (k, loss(*at))).collect();
    let found = evidence(&grid, &windows, RANGE);
    let count = places.len() as f64;
    let mean = places.iter().sum::<f64>() / count;
    assert!((found.least.ln() - mean).abs() < 0.03, "{}", found.least);
    // Slopes of the parabolas differ by the bend times the distance of their places.
    let variance = places.iter().map(|at| (bend * (at - mean)).powi(2)).sum::<f64>() * count / (count - 1.0);
    let expected = count * bend / variance;
    assert!((found.weight / expected - 1.0).abs() < 0.1, "{} {expected}", found.weight);
}

/// A parabola through evenly spread points is met between them to third order in their distance.
#[test]
fn interpolation_meets_a_smooth_function_between_points() {
    let grid: Vec<f64> = (0..30).map(|k| 0.1 * f64::from(k)).collect();
    let values: Vec<f64> = grid.iter().map(|x| x.exp()).collect();
    for k in 20..270 {
        let x = 0.01 * f64::from(k);
        assert!((interpolate(&grid, &values, x) / x.exp() - 1.0).abs() < 1e-4, "{x}");
    }
}

/// Of normal numbers with a known covariance, squares have the mean of their number of degrees of freedom, up to the scale of Student's t.
#[test]
fn whitened_squares_follow_the_covariance() {
    let mut random = SplitMix64::new(9);
    let mut normal = || (0..12).map(|_| random.uniform()).sum::<f64>() - 6.0;
    let drawn: Vec<Vec<f64>> = (0..4000)
        .map(|_| {
            let (a, b, c) = (normal(), normal(), normal());
            vec![1.0 + 2.0 * a, -3.0 + 0.5 * b, 10.0 * c]
        })
        .collect();
    let usual = Usual::of(&drawn).unwrap();
    // One deviation along each axis is equally far, whatever the unit.
    let along = [[3.0, -3.0, 0.0], [1.0, -2.5, 0.0], [1.0, -3.0, 10.0]].map(|x| usual.square(&x));
    assert!(along.iter().all(|x| (x / along[0] - 1.0).abs() < 0.1), "{along:?}");
    // The scale of a t of 4 degrees that is fitted to normal numbers lies below their covariance.
    assert!((1.0..1.7).contains(&along[0]), "{along:?}");
    assert!(usual.square(&[1.0, -3.0, 0.0]) < 0.02);
    let apart = usual.distance(&[5.0, -3.0, 0.0], &[3.0, -3.0, 0.0]);
    assert!((apart / along[0] - 1.0).abs() < 0.05, "a distance does not depend on the place: {apart} {along:?}");
    assert!(usual.distance(&[0.0], &[0.0, 1.0]).is_infinite());
    let loss = |square: f64| 0.5 * 7.0 * (1.0 + square / 4.0).ln();
    assert!((usual.loss(&[3.0, -3.0, 0.0]) - loss(along[0])).abs() < 1e-9, "Student's t of 4 degrees in 3 dimensions");
    assert!(usual.centred().square(&[0.0, 0.0, 0.0]) < 1e-12);
}
