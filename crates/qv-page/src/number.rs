//! Numbers as people write them: a dash for what is not finite, a true minus sign, no zero with a sign.
//!
//! One rule: numbers of one column have the same decimals ([`fixed`]), a number that stands alone has three digits that count
//! ([`significant`]), and a share is whole percents ([`percent`]).

/// What stands for a number that is not known.
pub const DASH: &str = "–";

/// With this many decimals.
pub fn fixed(x: f64, decimals: usize) -> String {
    if !x.is_finite() {
        return DASH.into();
    }
    let text = format!("{x:.decimals$}");
    let digits = text.trim_start_matches('-');
    let is_zero = digits.chars().all(|c| c == '0' || c == '.');
    if text.starts_with('-') && !is_zero { format!("−{digits}") } else { digits.to_owned() }
}

/// With this many digits that count, as long as that needs neither an exponent nor many zeros.
pub fn significant(x: f64, digits: i32) -> String {
    if !x.is_finite() {
        return DASH.into();
    }
    if x == 0.0 {
        return "0".into();
    }
    let magnitude = x.abs().log10().floor() as i32;
    if !(-6..9).contains(&magnitude) {
        return format!("{x:.*e}", (digits - 1).max(0) as usize).replace('-', "−");
    }
    fixed(x, (digits - 1 - magnitude).clamp(0, 9) as usize)
}

/// A share in percent; near its ends it says that it is not all of it.
pub fn percent(share: f64) -> String {
    match 100.0 * share {
        p if !p.is_finite() => DASH.into(),
        p if p > 0.0 && p < 0.95 => "< 1 %".into(),
        p if p > 99.05 && p < 100.0 => "> 99 %".into(),
        p => format!("{} %", fixed(p, 0)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_without_surprises() {
        assert_eq!(fixed(-0.001, 2), "0.00");
        assert_eq!(fixed(-1.25, 1), "−1.2");
        assert_eq!(fixed(f64::INFINITY, 1), "–");
        assert_eq!(significant(0.000_123_456, 3), "0.000123");
        assert_eq!(significant(123_456.0, 3), "123456");
        assert_eq!(significant(-1.5e12, 2), "−1.5e12");
        assert_eq!(significant(f64::NAN, 2), "–");
        assert_eq!(percent(0.004), "< 1 %");
        assert_eq!(percent(0.0), "0 %");
        assert_eq!(percent(0.995), "> 99 %");
        assert_eq!(percent(f64::NAN), "–");
    }
}
