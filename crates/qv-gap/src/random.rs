//! Seeded random numbers.

use std::f64::consts::TAU;

/// Independent deviates from a seed: SplitMix64 (Steele, Lea, Flood, OOPSLA 2014) and the transform of Box and Muller.
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// Streams of different `stream` are independent.
    pub fn new(seed: u64, stream: u64) -> Self {
        let mut random = Self(seed ^ stream.wrapping_mul(0xd1b5_4a32_d192_ed03));
        random.uniform();
        random
    }

    /// Uniform in (0, 1].
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        ((z >> 11) + 1) as f64 / (1u64 << 53) as f64
    }

    /// Normal with mean 0.
    pub fn normal(&mut self, deviation: f64) -> f64 {
        let (a, b) = (self.uniform(), self.uniform());
        if deviation == 0.0 {
            return 0.0;
        }
        deviation * (-2.0 * a.ln()).sqrt() * (TAU * b).cos()
    }
}
