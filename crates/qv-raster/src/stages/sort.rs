//! Stable sorting by least significant digits first.

/// Bits of a digit.
const BITS: u32 = 8;
const DIGITS: usize = 1 << BITS;

/// The order that sorts the keys, equal keys in the order in which they came: `keys[order[i]]` rises with i. Only the lowest
/// `bits` bits count.
pub fn sort(keys: &[u32], bits: u32) -> Vec<u32> {
    let mut order: Vec<u32> = (0..keys.len() as u32).collect();
    let mut next = vec![0; keys.len()];
    for shift in (0..bits).step_by(BITS as usize) {
        let digit = |index: u32| (keys[index as usize] >> shift) as usize % DIGITS;
        let mut place = [0usize; DIGITS];
        for &index in &order {
            place[digit(index)] += 1;
        }
        let mut sum = 0;
        for slot in &mut place {
            sum += std::mem::replace(slot, sum);
        }
        for &index in &order {
            let slot = &mut place[digit(index)];
            next[*slot] = index;
            *slot += 1;
        }
        std::mem::swap(&mut order, &mut next);
    }
    order
}

/// Key by which depths are sorted: the bits of a positive float rise with it. What touches no tile comes first.
pub fn depth_key(depth: f32, count: u32) -> u32 {
    if count == 0 { 0 } else { depth.to_bits() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sorts_stably() {
        let keys: Vec<u32> = (0..5000u32).map(|i| i.wrapping_mul(2_654_435_761) % 1000).collect();
        let mut expected: Vec<u32> = (0..5000).collect();
        expected.sort_by_key(|&i| keys[i as usize]);
        assert_eq!(sort(&keys, 10), expected);
        assert_eq!(sort(&keys, 32), expected);
        assert_eq!(sort(&[], 32), Vec::<u32>::new());
    }

    #[test]
    fn depths_rise_with_their_keys() {
        let depths = [f32::from_bits(1), 0.01, 0.010_000_001, 1.0, 1e3, f32::MAX];
        assert!(depths.windows(2).all(|pair| depth_key(pair[0], 1) < depth_key(pair[1], 1)));
        assert_eq!(depth_key(5.0, 0), 0);
    }
}
