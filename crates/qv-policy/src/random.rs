//! Seeded random numbers: xoshiro256++ (Blackman and Vigna 2021), seeded by splitmix64. One stream per robot, so that nothing depends on
//! the number of threads.

/// A stream of random numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Random {
    state: [u64; 4],
}

impl Random {
    /// The stream of a seed.
    pub fn new(seed: u64) -> Self {
        let mut at = seed;
        let state = std::array::from_fn(|_| {
            at = at.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = at;
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            z ^ (z >> 31)
        });
        Self { state }
    }

    /// The stream of one of many: `index` under a seed and a purpose.
    pub fn of(seed: u64, purpose: u64, index: u64) -> Self {
        let mixed = Self::new(seed).bits() ^ Self::new(purpose ^ 0x5851_f42d_4c95_7f2d).bits().rotate_left(17);
        Self::new(mixed ^ Self::new(index.wrapping_mul(0x2545_f491_4f6c_dd1d)).bits().rotate_left(31))
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        let s = &mut self.state;
        let out = s[0].wrapping_add(s[3]).rotate_left(23).wrapping_add(s[0]);
        let t = s[1] << 17;
        s[2] ^= s[0];
        s[3] ^= s[1];
        s[1] ^= s[2];
        s[0] ^= s[3];
        s[2] ^= t;
        s[3] = s[3].rotate_left(45);
        out
    }

    /// Uniform in 0 (within) to 1 (without).
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 * (1.0 / 16_777_216.0)
    }

    /// Uniform between two numbers.
    pub fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// Uniform among `0..count`.
    pub fn below(&mut self, count: usize) -> usize {
        (((self.bits() >> 32) * count as u64) >> 32) as usize
    }

    /// Standard normal (Box and Muller 1958, of whose two numbers one is used).
    pub fn normal(&mut self) -> f32 {
        let radius = (-2.0 * f64::from(1.0 - self.unit()).ln()).sqrt();
        let angle = std::f64::consts::TAU * f64::from(self.unit());
        (radius * angle.cos()) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_the_distributions() {
        let mut random = Random::of(3, 1, 4);
        let count = 200_000i32;
        let normal: Vec<f64> = (0..count).map(|_| f64::from(random.normal())).collect();
        let mean = normal.iter().sum::<f64>() / f64::from(count);
        let variance = normal.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / f64::from(count);
        let fourth = normal.iter().map(|x| (x - mean).powi(4)).sum::<f64>() / f64::from(count);
        assert!(
            mean.abs() < 0.01 && (variance - 1.0).abs() < 0.02 && (fourth - 3.0).abs() < 0.1,
            "{variance} {fourth}"
        );
        let unit: Vec<f32> = (0..count).map(|_| random.unit()).collect();
        assert!(unit.iter().all(|x| (0.0..1.0).contains(x)));
        let mut counts = [0i32; 5];
        (0..count).for_each(|_| counts[random.below(5)] += 1);
        assert!(counts.iter().all(|c| (c - count / 5).abs() < 1000), "{counts:?}");
    }

    #[test]
    fn streams_differ() {
        let first = |mut random: Random| random.bits();
        let mut seen: Vec<u64> = (0..50).flat_map(|i| (0..4).map(move |p| first(Random::of(1, p, i)))).collect();
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), 200);
    }
}
