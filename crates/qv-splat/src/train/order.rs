//! In which order photographs are learned from: all before the first comes again, or some more often than others.

use super::random::{Purpose, shuffled, unit, words};

/// The photographs of a round, by index, in a random order: as many as there are, each in proportion to its weight. In one round a
/// photograph comes as often as its share of the round says, rounded up or down by chance (systematic resampling: Carpenter, Clifford and Fearnhead,
/// 1999); with equal weights each comes once.
pub fn round(weights: &[f32], seed: u32, round: u32) -> Vec<usize> {
    let count = weights.len();
    let total: f64 = weights.iter().map(|weight| f64::from(*weight)).sum();
    let offset = f64::from(unit(words(seed, round, count as u32, Purpose::Order)[1]));
    let (mut drawn, mut reached) = (Vec::with_capacity(count), 0.0);
    for (index, weight) in weights.iter().enumerate() {
        reached += f64::from(*weight);
        while drawn.len() < count && (drawn.len() as f64 + offset) * total < reached * count as f64 {
            drawn.push(index);
        }
    }
    // Rounding may leave one out at the end.
    drawn.resize(count, count.saturating_sub(1));
    shuffled(count, seed, round).into_iter().map(|place| drawn[place]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_weights_are_the_plain_order_and_others_come_in_proportion() {
        for count in [1, 2, 7, 40] {
            assert_eq!(round(&vec![1.0; count], 3, 5), shuffled(count, 3, 5));
            assert_eq!(round(&vec![0.3; count], 3, 5), shuffled(count, 3, 5));
        }
        let weights = [1.0, 2.0, 0.5, 1.5, 1.0];
        let mut often = [0; 5];
        for number in 0..600 {
            let one = round(&weights, 1, number);
            for (index, weight) in weights.iter().enumerate() {
                let here = one.iter().filter(|drawn| **drawn == index).count();
                let share = f64::from(*weight) * 5.0 / 6.0;
                assert!((here as f64 - share).abs() < 1.0, "{number}: {one:?}");
                often[index] += here;
            }
        }
        for (often, weight) in often.iter().zip(&weights) {
            assert!((*often as f32 / 500.0 - weight).abs() < 0.1 * weight, "{often:?}");
        }
        assert_ne!(round(&weights, 1, 0), round(&weights, 1, 1));
        assert!(round(&[], 1, 0).is_empty());
    }
}
