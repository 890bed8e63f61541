//! Seeded draws, and the noise of the sensors.

use std::f64::consts::TAU;

/// Standard deviations of the noise on each sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct Deviations {
    /// Joint positions \[rad\].
    pub position: f64,
    /// Joint speeds \[rad/s\].
    pub velocity: f64,
    /// Torque estimates \[N m\].
    pub torque: f64,
    /// Gyroscope \[rad/s\].
    pub gyro: f64,
    /// Accelerometer \[m/s²\].
    pub acceleration: f64,
    /// Orientation by the IMU \[rad\].
    pub orientation: f64,
    /// Foot forces \[N\].
    pub force: f64,
    /// Position of the base \[m\].
    pub pose_position: f64,
    /// Orientation of the base \[rad\].
    pub pose_orientation: f64,
}

impl Deviations {
    /// What a Go2's sensors have, roughly.
    pub const NOMINAL: Self = Self {
        position: 0.0008,
        velocity: 0.03,
        torque: 0.2,
        gyro: 0.01,
        acceleration: 0.1,
        orientation: 0.001,
        force: 2.0,
        pose_position: 0.002,
        pose_orientation: 0.002,
    };

    /// Each deviation times a factor of its own, drawn between `least` and `most`.
    pub fn drawn(draws: &mut Draws, least: f64, most: f64) -> Self {
        let mut out = Self::NOMINAL;
        let all = [
            &mut out.position,
            &mut out.velocity,
            &mut out.torque,
            &mut out.gyro,
            &mut out.acceleration,
            &mut out.orientation,
            &mut out.force,
            &mut out.pose_position,
            &mut out.pose_orientation,
        ];
        all.into_iter().for_each(|deviation| *deviation *= draws.between(least, most));
        out
    }
}

/// Independent deviates from a seed: SplitMix64 (Steele, Lea, Flood 2014) and the transform of Box and Muller.
#[derive(Debug, Clone)]
pub struct Draws(pub u64);

/// The finaliser of SplitMix64: every bit of the input reaches every bit of the output.
fn scrambled(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A seed of its own for the `index`-th thing that is made from `seed`.
pub fn sub_seed(seed: u64, index: u64) -> u64 {
    scrambled(scrambled(seed ^ 0x5eed_0f5e_ed00_0001).wrapping_add(index.wrapping_mul(0x9e37_79b9_7f4a_7c15)))
}

impl Draws {
    /// Uniform in (0, 1].
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        ((scrambled(self.0) >> 11) + 1) as f64 / (1u64 << 53) as f64
    }

    /// Uniform between two numbers.
    pub fn between(&mut self, least: f64, most: f64) -> f64 {
        least + (most - least) * self.uniform()
    }

    /// Uniform over several intervals, each as likely as it is long.
    pub fn among(&mut self, intervals: &[(f64, f64)]) -> f64 {
        let mut left = self.uniform() * intervals.iter().map(|(a, b)| b - a).sum::<f64>();
        for (a, b) in intervals {
            if left <= b - a {
                return a + left;
            }
            left -= b - a;
        }
        // Only rounding leads here.
        intervals.last().map_or(0.0, |(_, b)| *b)
    }

    /// One of `count` indices, each as likely; 0 of none.
    pub fn index(&mut self, count: usize) -> usize {
        ((self.uniform() * count as f64).ceil() as usize).clamp(1, count.max(1)) - 1
    }

    /// True with this probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.uniform() <= probability
    }

    /// 1 or -1.
    pub fn sign(&mut self) -> f64 {
        if self.chance(0.5) { 1.0 } else { -1.0 }
    }

    /// Normal with mean 0.
    pub fn normal(&mut self, deviation: f64) -> f64 {
        let (a, b) = (self.uniform(), self.uniform());
        deviation * (-2.0 * a.ln()).sqrt() * (TAU * b).cos()
    }

    /// `values` with independent normal noise.
    pub fn add<const N: usize>(&mut self, values: [f64; N], deviation: f64) -> [f64; N] {
        values.map(|x| x + self.normal(deviation))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_its_deviation_and_repeats() {
        let mut draws = Draws(7);
        let drawn: Vec<f64> = (0..20_000).map(|_| draws.normal(2.0)).collect();
        let mean = drawn.iter().sum::<f64>() / 20_000.0;
        let variance = drawn.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 20_000.0;
        assert!(mean.abs() < 0.05 && (variance.sqrt() - 2.0).abs() < 0.04, "{mean} {variance}");
        assert_eq!(Draws(7).normal(2.0), drawn[0]);
        assert_ne!(Draws(8).normal(2.0), drawn[0]);
    }

    #[test]
    fn draws_stay_in_their_intervals_and_reach_all_of_them() {
        let mut draws = Draws(3);
        let (mut low, mut counts) = (0, [0; 3]);
        for _ in 0..3000 {
            let x = draws.among(&[(-1.0, -0.5), (1.0, 2.0)]);
            assert!((-1.0..=-0.5).contains(&x) || (1.0..=2.0).contains(&x), "{x}");
            low += usize::from(x < 0.0);
            counts[draws.index(3)] += 1;
        }
        assert!((900..1100).contains(&low), "a third of the length: {low}");
        assert!(counts.iter().all(|count| (900..1100).contains(count)), "{counts:?}");
        assert_eq!(draws.index(0), 0);
    }

    #[test]
    fn sub_seeds_are_apart() {
        let mut seeds: Vec<u64> = (0..100).flat_map(|s| (0..100).map(move |i| sub_seed(s, i))).collect();
        seeds.sort_unstable();
        seeds.dedup();
        assert_eq!(seeds.len(), 10_000);
    }
}
