//! A made-up cloud for the tests of files.

use qv_core::GaussianCloud;
use qv_core::random::SplitMix64;

/// Numbers within 0 to 1 that look random.
pub struct Numbers(SplitMix64);

impl Numbers {
    /// Those of a seed.
    pub fn new(seed: u64) -> Self {
        Self(SplitMix64::new(seed))
    }

    /// The next one.
    pub fn next(&mut self) -> f32 {
        (self.0.bits() >> 40) as f32 / (1u64 << 24) as f32
    }

    /// The next one within a range.
    pub fn within(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.next()
    }
}

/// Gaussians within what all formats hold.
pub fn cloud(count: usize, sh_degree: u8, feature_count: usize) -> GaussianCloud {
    let mut n = Numbers::new(7);
    let functions = (sh_degree as usize + 1).pow(2);
    let mut cloud = GaussianCloud { sh_degree, feature_count, ..Default::default() };
    for _ in 0..count {
        cloud.means.push([n.within(-20.0, 30.0), n.within(-5.0, 5.0), n.within(0.0, 3.0)]);
        cloud.log_scales.push([n.within(-8.0, -1.0), n.within(-8.0, -1.0), n.within(-9.0, -3.0)]);
        cloud.rotations.push([n.within(-1.0, 1.0), n.within(-1.0, 1.0), n.within(-1.0, 1.0), n.within(-1.0, 1.0)]);
        cloud.opacity_logits.push(n.within(-5.0, 6.0));
        cloud.sh.push([n.within(-2.0, 3.0), n.within(-2.0, 3.0), n.within(-2.0, 3.0)]);
        for _ in 1..functions {
            cloud.sh.push([n.within(-0.9, 0.9), n.within(-0.9, 0.9), n.within(-0.9, 0.9)]);
        }
        cloud.features.extend((0..feature_count).map(|_| n.next()));
    }
    cloud
}
