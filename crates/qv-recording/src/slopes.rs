//! What one channel is of another that says the same: a slope, and the convention that it is of.

/// Correlation from which on two channels say the same.
pub(crate) const SAME: f64 = 0.8;

/// How two channels go together.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fit {
    /// What one is of the other: least squares through the origin.
    pub slope: f64,
    pub correlation: f64,
}

/// `None` where `expected` stays below `least`.
pub(crate) fn fit(pairs: &[(f64, f64)], least: f64) -> Option<Fit> {
    let known: Vec<(f64, f64)> = pairs.iter().copied().filter(|(x, y)| x.is_finite() && y.is_finite()).collect();
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for (expected, found) in &known {
        (xx, xy, yy) = (xx + expected * expected, xy + expected * found, yy + found * found);
    }
    let moves = known.len() > 50 && xx / known.len() as f64 > least * least && yy > 0.0;
    moves.then(|| Fit { slope: xy / xx, correlation: xy / (xx * yy).sqrt() })
}

/// How values become those of this crate's convention.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Reading {
    /// Times this.
    Scaled(f64),
    /// Quaternions of x, y, z, w.
    ScalarLast,
    /// Quaternions of w, x, y, z that were taken for x, y, z, w.
    ScalarFirst,
    /// Quaternions of the other direction.
    Inverse,
    /// Nobody knows.
    Unknown,
}

/// What convention a slope is of; `None` for this crate's own, and for what is none.
pub(crate) fn convention(fit: Fit) -> Option<(String, Reading)> {
    if fit.correlation.abs() < SAME {
        return None;
    }
    let (size, sign) = (fit.slope.abs(), fit.slope.signum());
    let near = |x: f64| (size / x).ln().abs() < 0.3;
    let degrees = 180.0 / std::f64::consts::PI;
    let (unit, reading) = if near(degrees) {
        ("degrees", Reading::Scaled(sign / degrees))
    } else if near(1e3) {
        ("thousandths of the unit", Reading::Scaled(sign * 1e-3))
    } else if !(0.2..5.0).contains(&size) {
        ("another unit", Reading::Unknown)
    } else if sign < 0.0 {
        ("the sign is turned", Reading::Scaled(-1.0))
    } else {
        return None;
    };
    Some((format!("{:.3} times what was expected: {unit}", fit.slope), reading))
}

impl Reading {
    pub fn of(self, values: &mut [f64]) {
        match self {
            Self::Scaled(by) => values.iter_mut().for_each(|x| *x *= by),
            Self::ScalarLast => values.rotate_right(1),
            Self::ScalarFirst => values.rotate_left(1),
            Self::Inverse => values[1..].iter_mut().for_each(|x| *x = -*x),
            Self::Unknown => {}
        }
    }
}
