//! Seeded random numbers: [`SplitMix64`] and [`Xoshiro256PlusPlus`].
//!
//! Which stream a part of the workspace draws from is part of its results: goldens and sealed recordings rest on these bits.

use std::f64::consts::TAU;

/// What the state of [`SplitMix64`] grows by.
pub const GAMMA: u64 = 0x9e37_79b9_7f4a_7c15;

/// The finaliser of SplitMix64: every bit of the input reaches every bit of the output.
#[inline]
pub fn scrambled(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A seed of its own for the `index`-th thing that is made from `seed`.
pub fn sub_seed(seed: u64, index: u64) -> u64 {
    scrambled(scrambled(seed ^ 0x5eed_0f5e_ed00_0001).wrapping_add(index.wrapping_mul(GAMMA)))
}

/// Independent deviates from a seed: SplitMix64 (Steele, Lea, Flood, OOPSLA 2014) and the transform of Box and Muller.
#[derive(Debug, Clone)]
pub struct SplitMix64(u64);

impl SplitMix64 {
    /// The stream of a seed.
    #[inline]
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// One of many streams of a seed: those of different `stream` are independent.
    pub fn of(seed: u64, stream: u64) -> Self {
        let mut random = Self(seed ^ stream.wrapping_mul(0xd1b5_4a32_d192_ed03));
        random.bits();
        random
    }

    /// 64 random bits.
    #[inline]
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(GAMMA);
        scrambled(self.0)
    }

    /// Uniform in (0, 1].
    #[inline]
    pub fn uniform(&mut self) -> f64 {
        ((self.bits() >> 11) + 1) as f64 / (1u64 << 53) as f64
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

    /// Normal with mean 0; 0 when the deviation is 0, which takes two draws as any other.
    pub fn normal(&mut self, deviation: f64) -> f64 {
        let (a, b) = (self.uniform(), self.uniform());
        if deviation == 0.0 {
            return 0.0;
        }
        deviation * (-2.0 * a.ln()).sqrt() * (TAU * b).cos()
    }

    /// `values` with independent normal noise.
    pub fn add<const N: usize>(&mut self, values: [f64; N], deviation: f64) -> [f64; N] {
        values.map(|x| x + self.normal(deviation))
    }
}

/// A stream of random numbers: xoshiro256++ (Blackman and Vigna 2021), seeded by SplitMix64. One stream per robot, so that nothing depends on
/// the number of threads.
#[derive(Debug, Clone, PartialEq)]
pub struct Xoshiro256PlusPlus {
    state: [u64; 4],
}

impl Xoshiro256PlusPlus {
    /// The stream of a seed.
    pub fn new(seed: u64) -> Self {
        let mut of_seed = SplitMix64::new(seed);
        Self { state: std::array::from_fn(|_| of_seed.bits()) }
    }

    /// The stream of one of many: `index` under a seed and a purpose.
    pub fn of(seed: u64, purpose: u64, index: u64) -> Self {
        let mixed = Self::new(seed).bits() ^ Self::new(purpose ^ 0x5851_f42d_4c95_7f2d).bits().rotate_left(17);
        Self::new(mixed ^ Self::new(index.wrapping_mul(0x2545_f491_4f6c_dd1d)).bits().rotate_left(31))
    }

    /// 64 random bits.
    #[inline]
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
    #[inline]
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 * (1.0 / 16_777_216.0)
    }

    /// Uniform between two numbers.
    #[inline]
    pub fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// Uniform among `0..count`.
    #[inline]
    pub fn below(&mut self, count: usize) -> usize {
        (((self.bits() >> 32) * count as u64) >> 32) as usize
    }

    /// Standard normal (Box and Muller 1958, of whose two numbers one is used).
    #[inline]
    pub fn normal(&mut self) -> f32 {
        let radius = (-2.0 * f64::from(1.0 - self.unit()).ln()).sqrt();
        let angle = TAU * f64::from(self.unit());
        (radius * angle.cos()) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What goldens and sealed recordings were made with.
    #[test]
    fn no_stream_has_changed() {
        // The authors' splitmix64.c with seed 1234567, and xoshiro256++ of the crate rand_xoshiro with seed_from_u64(0).
        let mut random = SplitMix64::new(1_234_567);
        assert_eq!([random.bits(), random.bits()], [6_457_827_717_110_365_317, 3_203_168_211_198_807_973]);
        assert_eq!(Xoshiro256PlusPlus::new(0).bits(), 5_987_356_902_031_041_503);
        let mut random = SplitMix64::of(3, 71);
        assert_eq!(random.uniform().to_bits(), 4_595_836_708_824_805_612);
        near(random.normal(2.0), 4_614_552_558_743_966_254);
        assert_eq!(random.normal(0.0).to_bits(), 0);
        assert_eq!(random.uniform().to_bits(), 4_606_668_158_673_891_540);
        let mut random = SplitMix64::new(7);
        assert_eq!(random.uniform().to_bits(), 4_600_694_168_356_277_380);
        near(random.normal(2.0), 4_616_912_496_937_840_493);
        assert_eq!(random.among(&[(-1.0, -0.5), (1.0, 2.0)]).to_bits(), 4_608_868_545_962_028_500);
        assert_eq!((random.index(12), random.sign()), (5, 1.0));
        assert_eq!(random.between(25.0, 60.0).to_bits(), 4_631_020_303_085_275_602);
        let [a, b] = random.add([1.0, 2.0], 0.5);
        near(a, 4_609_417_419_047_043_570);
        near(b, 4_612_877_162_889_672_941);
        assert_eq!(sub_seed(5, 2), 17_335_858_890_843_284_938);
        let mut random = Xoshiro256PlusPlus::of(3, 1, 4);
        assert_eq!((random.bits(), random.unit().to_bits()), (97_660_997_369_498_784, 1_056_897_976));
        near(f64::from(random.normal()), f64::from(f32::from_bits(3_188_015_575)).to_bits());
        assert_eq!((random.below(1000), random.between(-1.0, 2.0).to_bits()), (69, 1_052_209_432));
    }

    /// Logarithm and cosine are those of the machine's C library.
    fn near(found: f64, bits: u64) {
        let expected = f64::from_bits(bits);
        assert!((found - expected).abs() < 1e-7 * expected.abs(), "{found} {expected}");
    }

    #[test]
    fn noise_has_its_deviation_and_repeats() {
        let mut random = SplitMix64::new(7);
        let drawn: Vec<f64> = (0..20_000).map(|_| random.normal(2.0)).collect();
        let mean = drawn.iter().sum::<f64>() / 20_000.0;
        let variance = drawn.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 20_000.0;
        assert!(mean.abs() < 0.05 && (variance.sqrt() - 2.0).abs() < 0.04, "{mean} {variance}");
        assert_eq!(SplitMix64::new(7).normal(2.0), drawn[0]);
        assert_ne!(SplitMix64::new(8).normal(2.0), drawn[0]);
    }

    #[test]
    fn draws_stay_in_their_intervals_and_reach_all_of_them() {
        let mut random = SplitMix64::new(3);
        let (mut low, mut counts) = (0, [0; 3]);
        for _ in 0..3000 {
            let x = random.among(&[(-1.0, -0.5), (1.0, 2.0)]);
            assert!((-1.0..=-0.5).contains(&x) || (1.0..=2.0).contains(&x), "{x}");
            low += usize::from(x < 0.0);
            counts[random.index(3)] += 1;
        }
        assert!((900..1100).contains(&low), "a third of the length: {low}");
        assert!(counts.iter().all(|count| (900..1100).contains(count)), "{counts:?}");
        assert_eq!(random.index(0), 0);
    }

    #[test]
    fn sub_seeds_are_apart() {
        let mut seeds: Vec<u64> = (0..100).flat_map(|s| (0..100).map(move |i| sub_seed(s, i))).collect();
        seeds.sort_unstable();
        seeds.dedup();
        assert_eq!(seeds.len(), 10_000);
    }

    #[test]
    fn moments_are_those_of_the_distributions() {
        let mut random = Xoshiro256PlusPlus::of(3, 1, 4);
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
        let first = |mut random: Xoshiro256PlusPlus| random.bits();
        let mut seen: Vec<u64> =
            (0..50).flat_map(|i| (0..4).map(move |p| first(Xoshiro256PlusPlus::of(1, p, i)))).collect();
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), 200);
    }
}
