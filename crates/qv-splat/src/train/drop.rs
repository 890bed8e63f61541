//! Gaussians that a step leaves out at random, so that none of them explains a photograph alone: few photographs are otherwise learned by
//! heart (Park, Ryu and Kim, *DropGaussian: Structural Regularization for Sparse-view Gaussian Splatting*, CVPR 2025, eq. 3 and 4).
//!
//! The others are denser by one over the share that stays, as far as opacities go.

use super::moments::logistic;
use super::options::TrainOptions;
use super::random::{Purpose, unit, words};

/// Logit of a Gaussian that is left out: nothing is seen of it.
const TRANSPARENT: f32 = -40.0;
/// Most that an opacity becomes.
const DENSEST: f32 = 0.9999;

/// Which Gaussians a step leaves out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drop {
    /// Share of them.
    pub share: f32,
    seed: u32,
    iteration: u32,
}

impl Drop {
    /// Those of a step; none where none are asked for. The share rises from 0 to what is asked for over the run.
    pub fn of(options: &TrainOptions, iteration: u32) -> Option<Self> {
        let share = options.drop * iteration as f32 / options.iterations.max(1) as f32;
        (share > 0.0).then_some(Self { share: share.min(options.drop), seed: options.seed, iteration })
    }

    fn leaves_out(&self, index: usize) -> bool {
        unit(words(self.seed, self.iteration, index as u32, Purpose::Drop)[0]) < self.share
    }

    fn denser(&self, logit: f32) -> f32 {
        (logistic(logit) / (1.0 - self.share)).min(DENSEST)
    }

    /// Logits as the step sees them.
    pub fn seen(&self, logits: &[f32]) -> Vec<f32> {
        let of = |(i, logit): (usize, &f32)| {
            let opacity = self.denser(*logit);
            if self.leaves_out(i) { TRANSPARENT } else { (opacity / (1.0 - opacity)).ln() }
        };
        logits.iter().enumerate().map(of).collect()
    }

    /// Derivatives by the logits, from those by what the step sees.
    pub fn back(&self, logits: &[f32], by: &mut [f32]) {
        for (i, (logit, by)) in logits.iter().zip(by).enumerate() {
            let (opacity, seen) = (logistic(*logit), self.denser(*logit));
            let chain = opacity * (1.0 - opacity) / ((1.0 - self.share) * seen * (1.0 - seen));
            *by *= if self.leaves_out(i) { 0.0 } else { chain };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn half_way(drop: f32) -> Drop {
        Drop::of(&TrainOptions { drop, iterations: 100, ..Default::default() }, 50).unwrap()
    }

    #[test]
    fn the_asked_share_is_left_out_and_others_in_each_step() {
        assert_eq!(Drop::of(&TrainOptions::default(), 50), None);
        let drop = half_way(0.4);
        let out: Vec<bool> = (0..10_000).map(|i| drop.leaves_out(i)).collect();
        let share = out.iter().filter(|out| **out).count() as f32 / 1e4;
        assert!((share - 0.2).abs() < 0.015, "{share}");
        let next = Drop { iteration: 51, ..drop };
        let same = (0..10_000).filter(|i| next.leaves_out(*i) == out[*i]).count() as f32 / 1e4;
        assert!((same - 0.68).abs() < 0.02, "independent: {same}");
    }

    #[test]
    fn what_is_seen_is_as_dense_on_average_and_derivatives_are_those_of_differences() {
        let drop = half_way(0.4);
        let logits: Vec<f32> = (0..200).map(|i| -3.0 + 0.02 * i as f32).collect();
        let opacity = |logits: &[f32]| logits.iter().map(|l| logistic(*l)).collect::<Vec<_>>();
        let seen = opacity(&drop.seen(&logits));
        let step = 1e-2;
        let more = opacity(&drop.seen(&logits.iter().map(|l| l + step).collect::<Vec<_>>()));
        // By what is seen: the slope of the logistic function there.
        let mut by: Vec<f32> = seen.iter().map(|o| o * (1.0 - o)).collect();
        drop.back(&logits, &mut by);
        for i in 0..200 {
            let (there, expected) = (!drop.leaves_out(i), logistic(logits[i]) / 0.8);
            assert!((seen[i] - if there { expected } else { 0.0 }).abs() < 1e-5, "{i}");
            assert!((by[i] - (more[i] - seen[i]) / step).abs() < 2e-3, "{i}: {} {}", by[i], (more[i] - seen[i]) / step);
        }
    }
}
