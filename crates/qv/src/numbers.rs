//! Numbers on the command line.

/// A number from `low` to `high`.
pub fn within(text: &str, low: f64, high: f64) -> Result<f64, String> {
    let found = || format!("expected {low} to {high}, found `{text}`");
    text.parse().ok().filter(|x| (low..=high).contains(x)).ok_or_else(found)
}

/// A whole number from `low` to `high`.
#[cfg(any(test, feature = "learn"))]
pub fn count(text: &str, low: usize, high: usize) -> Result<usize, String> {
    let found = || format!("expected {low} to {high}, found `{text}`");
    text.trim().parse().ok().filter(|n| (low..=high).contains(n)).ok_or_else(found)
}

/// A number from 0 to 1.
pub fn share(text: &str) -> Result<f64, String> {
    within(text, 0.0, 1.0)
}

/// A finite number above 0.
pub fn positive(text: &str) -> Result<f64, String> {
    let found = || format!("expected a number above 0, found `{text}`");
    not_negative(text).ok().filter(|x| *x > 0.0).ok_or_else(found)
}

/// A finite number of at least 0.
pub fn not_negative(text: &str) -> Result<f64, String> {
    let found = || format!("expected a number of at least 0, found `{text}`");
    text.parse().ok().filter(|x: &f64| x.is_finite() && *x >= 0.0).ok_or_else(found)
}

/// Three finite numbers with commas, of which the usage speaks as `names`.
pub fn three(text: &str, names: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    let three = numbers.and_then(|list| list.try_into().ok());
    let found = || format!("expected three numbers {names}, found `{text}`");
    three.filter(|list: &[f64; 3]| list.iter().all(|x| x.is_finite())).ok_or_else(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn what_is_no_such_number_is_told() {
        assert_eq!((count(" 7", 1, 7), count("0", 1, 7)), (Ok(7), Err("expected 1 to 7, found `0`".into())));
        assert_eq!((within("0.5", 0.0, 1.0), positive("2"), not_negative("0")), (Ok(0.5), Ok(2.0), Ok(0.0)));
        assert_eq!(three("1, -2,3e1", "X,Y,YAW"), Ok([1.0, -2.0, 30.0]));
        for odd in ["nan", "2", "-0.1", "", "x"] {
            assert!(within(odd, 0.0, 1.0).unwrap_err().states("expected 0 1"), "{odd}");
        }
        assert!(positive("0").is_err() && positive("inf").is_err() && not_negative("-1").is_err());
        for odd in ["1,2", "1,2,3,4", "1,2,nan", "1,,3", "1;2;3"] {
            assert!(three(odd, "X,Y,YAW").unwrap_err().states("X,Y,YAW"), "{odd}");
        }
    }
}
