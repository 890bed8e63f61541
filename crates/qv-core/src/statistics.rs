//! What is typical of many numbers.

/// Median, of an even number the upper of the two in the middle; NaN when empty. Reorders its input. Values that are not numbers are in
/// the order of [`f64::total_cmp`].
pub fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_of_the_sorted_is_the_median() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&mut [4.0, 1.0, 2.0, 3.0]), 3.0);
        assert_eq!(median(&mut [f64::INFINITY, f64::NEG_INFINITY, 0.5]), 0.5);
        assert!(median(&mut []).is_nan());
    }
}
