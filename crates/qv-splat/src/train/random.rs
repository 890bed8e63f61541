//! Random numbers without a state: a hash of what they are for, so that the same ones come on any thread and on the card.

/// What a number is for: the last word that is hashed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// Where Gaussians begin.
    Start = 1,
    /// In which order photographs are taken.
    Order = 2,
    /// Which Gaussians are copied.
    Sample = 3,
    /// Noise on the means.
    Noise = 4,
    /// Second photograph of a pair.
    Pair = 6,
    /// Which Gaussians a step leaves out.
    Drop = 7,
}

/// Four words of a hash (Jarzynski and Olano, *Hash Functions for GPU Rendering*, 2020: pcg4d).
pub fn words(seed: u32, step: u32, index: u32, purpose: Purpose) -> [u32; 4] {
    let mut v = [seed, step, index, purpose as u32].map(|x| x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    let mix = |v: &mut [u32; 4]| {
        v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[3]));
        v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
        v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
        v[3] = v[3].wrapping_add(v[1].wrapping_mul(v[2]));
    };
    mix(&mut v);
    v = v.map(|x| x ^ (x >> 16));
    mix(&mut v);
    v
}

/// From 0 to below 1, of 24 bits.
pub fn unit(word: u32) -> f32 {
    (word >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Three numbers of the normal distribution (Box and Muller, 1958).
pub fn normals(words: [u32; 4]) -> [f32; 3] {
    let radius = |word: u32| (-2.0 * (1.0 - unit(word)).ln()).sqrt();
    let turn = |word: u32| unit(word) * std::f32::consts::TAU;
    let (a, b) = (radius(words[0]), radius(words[2]));
    [a * turn(words[1]).cos(), a * turn(words[1]).sin(), b * turn(words[3]).cos()]
}

/// The numbers below `count` in a random order (Fisher and Yates).
pub fn shuffled(count: usize, seed: u32, round: u32) -> Vec<usize> {
    let mut out: Vec<usize> = (0..count).collect();
    for last in (1..count).rev() {
        let word = words(seed, round, last as u32, Purpose::Order)[0];
        out.swap(last, ((word as u64 * (last as u64 + 1)) >> 32) as usize);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_normal_and_differ_by_purpose() {
        let all: Vec<f32> = (0..20_000).flat_map(|i| normals(words(7, 3, i, Purpose::Noise))).collect();
        let mean = all.iter().sum::<f32>() / all.len() as f32;
        let variance = all.iter().map(|x| x * x).sum::<f32>() / all.len() as f32;
        let fourth = all.iter().map(|x| x.powi(4)).sum::<f32>() / all.len() as f32;
        assert!(
            mean.abs() < 0.015 && (variance - 1.0).abs() < 0.02 && (fourth - 3.0).abs() < 0.15,
            "{mean} {variance}"
        );
        assert_ne!(words(7, 3, 5, Purpose::Noise), words(7, 3, 5, Purpose::Pair));
    }

    #[test]
    fn an_order_has_each_number_once() {
        let mut order = shuffled(50, 1, 2);
        assert_ne!(order, (0..50).collect::<Vec<_>>());
        assert_ne!(order, shuffled(50, 1, 3));
        order.sort_unstable();
        assert_eq!(order, (0..50).collect::<Vec<_>>());
    }
}
