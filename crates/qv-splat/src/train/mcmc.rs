//! Gaussians that come and go as in Kheradmand et al., *3D Gaussian Splatting as Markov Chain Monte Carlo* (2024).
//!
//! Dead Gaussians move to living ones, and new ones come to them, chosen with probabilities in proportion to opacity. Where N Gaussians
//! stand in the place of one of opacity o, each has opacity 1 - (1 - o)^(1/N), and scales that keep the integral of the opacity along a ray
//! (eq. 8, 9): divided by Σ_{i=1}^N Σ_{k=0}^{i-1} C(i-1, k) (-1)^k / √(k+1) o_new^{k+1} / o.

use super::model::Model;
use super::moments::logistic;
use super::random::{Purpose, words};

/// Opacity at and below which a Gaussian is dead.
const DEAD: f32 = 0.005;
/// Share by which the number grows each time.
pub(crate) const GROWTH: f64 = 0.05;
/// Most Gaussians that stand in the place of one.
const MOST: usize = 51;

/// A Gaussian that becomes one of several in a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// Its index.
    pub index: u32,
    /// Its new opacity logit.
    pub logit: f32,
    /// What is added to its log scales.
    pub shift: f32,
}

/// What is done to the Gaussians: first the changes, then the copies.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Relocation {
    /// Gaussians that become one of several.
    pub changes: Vec<Change>,
    /// Target and source; targets beyond the last Gaussian are new and come in order.
    pub copies: Vec<[u32; 2]>,
}

impl Relocation {
    /// Moves dead Gaussians to living ones, chosen by opacity.
    pub(crate) fn of_dead(logits: &[f32], seed: u32, step: u32) -> Self {
        let lives = |logit: &f32| logistic(*logit) > DEAD;
        let weight = |i: usize| if lives(&logits[i]) { logistic(logits[i]) } else { 0.0 };
        let targets: Vec<u32> = (0..logits.len() as u32).filter(|&i| !lives(&logits[i as usize])).collect();
        Self::new(logits, weight, &targets, seed, 2 * step)
    }

    /// Lets the number grow by [`GROWTH`], up to `cap`; they come to others as the dead do.
    pub(crate) fn of_new(logits: &[f32], cap: usize, seed: u32, step: u32) -> Self {
        let wanted = cap.min(((1.0 + GROWTH) * logits.len() as f64) as usize).max(logits.len());
        let targets: Vec<u32> = (logits.len() as u32..wanted as u32).collect();
        Self::new(logits, |i| logistic(logits[i]), &targets, seed, 2 * step + 1)
    }

    fn new(logits: &[f32], weight: impl Fn(usize) -> f32, targets: &[u32], seed: u32, step: u32) -> Self {
        let mut total = 0.0f64;
        let sums: Vec<f64> = (0..logits.len())
            .map(|i| {
                let weight = weight(i) as f64;
                total += if weight.is_finite() { weight } else { 0.0 };
                total
            })
            .collect();
        if total <= 0.0 {
            return Self::default();
        }
        let mut copies: Vec<[u32; 2]> = targets
            .iter()
            .enumerate()
            .map(|(k, &target)| {
                let word = words(seed, step, k as u32, Purpose::Sample)[0];
                let place = (word as f64 + 0.5) / 4_294_967_296.0 * total;
                [target, sums.partition_point(|sum| *sum <= place).min(logits.len() - 1) as u32]
            })
            .collect();
        let mut together = vec![1usize; logits.len()];
        copies.iter().for_each(|[_, source]| together[*source as usize] += 1);
        let changed = (0..logits.len()).filter(|&i| together[i] > 1);
        let change = |index: usize| {
            let opacity = logistic(logits[index]) as f64;
            let (each, factor) = shared(opacity, together[index].min(MOST));
            let each = each.clamp(DEAD as f64, 1.0 - 1e-7);
            Change { index: index as u32, logit: (each / (1.0 - each)).ln() as f32, shift: factor.ln() as f32 }
        };
        let changes = changed.map(change).collect();
        copies.sort_unstable();
        Self { changes, copies }
    }

    /// Does it.
    pub fn apply(&self, model: &mut Model) {
        for change in &self.changes {
            let index = change.index as usize;
            model.cloud.opacity_logits[index] = change.logit;
            model.cloud.log_scales[index].iter_mut().for_each(|scale| *scale += change.shift);
            model.forget(index);
        }
        for [target, source] in &self.copies {
            model.copy(*target as usize, *source as usize);
        }
    }
}

/// Opacity of each of `count` Gaussians in the place of one, and the factor of their scales.
fn shared(opacity: f64, count: usize) -> (f64, f64) {
    let each = 1.0 - (1.0 - opacity).powf(1.0 / count as f64);
    let mut sum = 0.0;
    for i in 1..=count {
        // C(i - 1, k) (-1)^k, from one k to the next.
        let mut binomial = 1.0;
        let mut power = each;
        for k in 0..i {
            sum += binomial * power / ((k + 1) as f64).sqrt();
            binomial *= -((i - 1 - k) as f64) / (k + 1) as f64;
            power *= each;
        }
    }
    let factor = opacity / sum;
    (each, if factor.is_finite() && factor > 0.0 { factor } else { 1.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Opacity along a ray across `count` Gaussians of one place: the integral of 1 - (1 - o exp(-x²/2 s²))^count.
    fn integral(opacity: f64, scale: f64, count: i32) -> f64 {
        let h = 1e-3;
        (-8000..8000)
            .map(|k| k as f64 * h)
            .map(|x| h * (1.0 - (1.0 - opacity * (-x * x / (2.0 * scale * scale)).exp()).powi(count)))
            .sum()
    }

    #[test]
    fn several_in_a_place_look_like_one() {
        for (opacity, count) in [(0.3, 2), (0.9, 3), (0.6, 7)] {
            let (each, factor) = shared(opacity, count);
            assert!((1.0 - (1.0 - each).powi(count as i32) - opacity).abs() < 1e-12);
            let (one, many) = (integral(opacity, 1.0, 1), integral(each, factor, count as i32));
            assert!((one - many).abs() < 1e-4 * one, "{opacity} {count}: {one} {many}");
        }
    }

    #[test]
    fn the_dead_move_and_the_number_grows() {
        let mut logits = vec![2.0f32; 100];
        logits[..30].fill(-8.0);
        let dead = Relocation::of_dead(&logits, 5, 1);
        assert_eq!(dead.copies.len(), 30);
        assert!(dead.copies.iter().all(|[target, source]| *target < 30 && *source >= 30));
        assert_eq!(dead, Relocation::of_dead(&logits, 5, 1));
        assert_ne!(dead, Relocation::of_dead(&logits, 6, 1));
        assert!(dead.changes.iter().all(|change| change.logit < 2.0 && change.shift < 0.1));
        let new = Relocation::of_new(&logits, 103, 5, 1);
        let targets: Vec<u32> = new.copies.iter().map(|copy| copy[0]).collect();
        assert_eq!(targets, [100, 101, 102]);
        assert_eq!(Relocation::of_dead(&[-9.0; 4], 1, 1), Relocation::default());
        assert_eq!(Relocation::of_new(&[], 10, 1, 1), Relocation::default());
    }
}
