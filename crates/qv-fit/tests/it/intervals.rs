//! How often intervals hold the truth, where numbers of a block go together.

use qv_core::random::SplitMix64;
use qv_fit::{Blocks, FitError, Options, Problem, fit};

/// Recordings, blocks of each, and numbers of a block.
const RECORDINGS: u64 = 400;
const BLOCKS: usize = 40;
const NUMBERS: usize = 10;

/// A mean and a slope along a number that is a block's own; noise that a block has in common beside each number's own, of one size.
fn recording(seed: u64) -> Vec<(f64, Vec<f64>)> {
    let mut random = SplitMix64::of(seed, 0);
    let mut block = || {
        let (place, shared) = (random.normal(1.0), random.normal(1.0));
        (place, (0..NUMBERS).map(|_| 0.5 - 0.8 * place + shared + random.normal(1.0)).collect())
    };
    (0..BLOCKS).map(|_| block()).collect()
}

#[test]
fn intervals_by_blocks_hold_the_truth_where_those_by_curvature_do_not() {
    let (mut by_blocks, mut by_curvature) = ([0; 2], [0; 2]);
    let options = Options::default();
    for seed in 0..RECORDINGS {
        let all = recording(seed);
        let residuals = |points: &[Vec<f64>]| -> Result<Vec<Blocks>, FitError> {
            let block = |p: &[f64], (place, y): &(f64, Vec<f64>)| {
                y.iter().map(|y| (y - p[0] - p[1] * place) / 2f64.sqrt()).collect()
            };
            Ok(points.iter().map(|p| all.iter().map(|b| block(p, b)).collect()).collect())
        };
        let found = fit(&Problem::new(&[0.0, 0.0], &[0.1, 0.1]), &options, residuals).unwrap();
        let holds = |deviations: &[f64], k: usize, truth: f64| {
            let [low, high] = found.intervals(deviations, 1.96)[k];
            usize::from(low <= truth && truth <= high)
        };
        for (k, truth) in [0.5, -0.8].into_iter().enumerate() {
            by_blocks[k] += holds(&found.block_deviations(), k, truth);
            by_curvature[k] += holds(&found.deviations(), k, truth);
        }
    }
    // Of 400 at 95 %: 380, and three standard errors of that are 13; forty blocks are few, which takes a few per cent.
    assert!(by_blocks.iter().all(|n| (356..=393).contains(n)), "{by_blocks:?}");
    assert!(by_curvature.iter().all(|n| *n < 280), "{by_curvature:?}");
}
