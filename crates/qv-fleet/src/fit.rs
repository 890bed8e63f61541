//! One number of many uncertain ones, how it moves with time, and which of them stand apart.
//!
//! Values `y` with standard deviations `s` are taken as `y = X b + u + e`, `e ~ N(0, s²)`, `u ~ N(0, τ²)`: recordings differ by
//! more than each knows of itself. τ² is by moments (DerSimonian & Laird 1986; of a line Raudenbush 2009), intervals are by
//! Knapp & Hartung 2003 with a factor of at least 1.

use qv_core::statistics::median;
use serde::Serialize;

/// Robust z-score from which on a value stands apart (Iglewicz & Hoaglin 1993).
pub const OUTLIER: f64 = 3.5;
/// Fewest values of which one can stand apart.
pub const FEWEST: usize = 5;
/// A robust z-score is this times the distance from the median, in units of the median distance.
const NORMAL: f64 = 0.6745;
/// What a value without an uncertainty is taken to be uncertain by, as a share of it.
const SURE: f64 = 1e-3;

/// A number with its interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Estimate {
    /// Best value.
    pub value: f64,
    /// From the 2.5 % to the 97.5 % quantile.
    pub ci95: [f64; 2],
}

impl Estimate {
    /// Whether its interval holds zero.
    pub fn may_be_zero(&self) -> bool {
        self.ci95[0] <= 0.0 && self.ci95[1] >= 0.0
    }
}

/// The mean of values with standard deviations; of a single one its own interval. None without any.
pub fn mean(values: &[f64], deviations: &[f64]) -> Option<Estimate> {
    if let ([value], [s]) = (values, deviations) {
        return Some(Estimate { value: *value, ci95: [value - 1.96 * s, value + 1.96 * s] });
    }
    line(values, deviations, None).map(|[level, _]| level)
}

/// The slope of values over `at`, with its interval; none for fewer than three, or where all are at one place.
pub fn slope(values: &[f64], deviations: &[f64], at: &[f64]) -> Option<Estimate> {
    let (low, high) = at.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), t| (l.min(*t), h.max(*t)));
    if values.len() < 3 || high <= low {
        return None;
    }
    line(values, deviations, Some(at)).map(|[_, slope]| slope)
}

/// Level and slope; without places the slope is 0.
fn line(values: &[f64], deviations: &[f64], at: Option<&[f64]>) -> Option<[Estimate; 2]> {
    let n = values.len();
    let columns = if at.is_some() { 2 } else { 1 };
    if n <= columns {
        return None;
    }
    let centre = at.map_or(0.0, |t| t.iter().sum::<f64>() / n as f64);
    let x: Vec<f64> = (0..n).map(|k| at.map_or(0.0, |t| t[k] - centre)).collect();
    let largest = values.iter().fold(0.0f64, |m, v| m.max(v.abs())).max(f64::MIN_POSITIVE);
    let variance: Vec<f64> = deviations.iter().map(|s| s.max(SURE * largest).powi(2)).collect();
    let weights = |between: f64| -> Vec<f64> { variance.iter().map(|v| 1.0 / (v + between)).collect() };
    let own = weights(0.0);
    let (first, normal) = solve(values, &x, &own, columns)?;
    let excess = misfit(values, &x, &own, first) - (n - columns) as f64;
    // Expected misfit for each unit of variance between recordings.
    let squares: Vec<f64> = own.iter().map(|w| w * w).collect();
    let each = own.iter().sum::<f64>() - trace_of_product(normal, sums(&x, &squares, columns));
    let between = if each > 0.0 { (excess / each).max(0.0) } else { 0.0 };
    let all = weights(between);
    let (best, inverse) = solve(values, &x, &all, columns)?;
    let factor = (misfit(values, &x, &all, best) / (n - columns) as f64).max(1.0);
    let reach = |variance: f64| student(n - columns) * (factor * variance).sqrt();
    let estimate = |value: f64, variance: f64| {
        let reach = reach(variance);
        Estimate { value, ci95: [value - reach, value + reach] }
    };
    Some([estimate(best[0], inverse[0]), estimate(best[1], inverse[2])])
}

/// Sums of `w`, `w x`, `w x²`; those of `x` are 0 where there is one column.
fn sums(x: &[f64], weights: &[f64], columns: usize) -> [f64; 3] {
    let with = |power: i32| x.iter().zip(weights).map(|(x, w)| w * x.powi(power)).sum::<f64>();
    if columns == 1 { [with(0), 0.0, 0.0] } else { [with(0), with(1), with(2)] }
}

/// Level and slope by weighted least squares, and the inverse of the normal matrix as its three numbers.
fn solve(values: &[f64], x: &[f64], weights: &[f64], columns: usize) -> Option<([f64; 2], [f64; 3])> {
    let [a, b, c] = sums(x, weights, columns);
    let right = |power: i32| (0..x.len()).map(|k| weights[k] * values[k] * x[k].powi(power)).sum::<f64>();
    if columns == 1 {
        return (a > 0.0).then(|| ([right(0) / a, 0.0], [1.0 / a, 0.0, 0.0]));
    }
    let determinant = a * c - b * b;
    if determinant <= 0.0 {
        return None;
    }
    let inverse = [c / determinant, -b / determinant, a / determinant];
    let (p, q) = (right(0), right(1));
    Some(([inverse[0] * p + inverse[1] * q, inverse[1] * p + inverse[2] * q], inverse))
}

fn trace_of_product(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + 2.0 * a[1] * b[1] + a[2] * b[2]
}

fn misfit(values: &[f64], x: &[f64], weights: &[f64], [level, slope]: [f64; 2]) -> f64 {
    (0..x.len()).map(|k| weights[k] * (values[k] - level - slope * x[k]).powi(2)).sum()
}

/// The 97.5 % quantile of Student's t.
fn student(freedom: usize) -> f64 {
    const FEW: [f64; 10] = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228];
    let z = 1.959_964f64;
    let v = freedom as f64;
    // Cornish and Fisher's expansion: right to 3e-3 from eleven on.
    let far = z + (z.powi(3) + z) / (4.0 * v) + (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / (96.0 * v * v);
    FEW.get(freedom.wrapping_sub(1)).copied().unwrap_or(far)
}

/// Robust z-score of each value; none for few values, or where most are the same.
pub fn robust_z(values: &[f64]) -> Option<Vec<f64>> {
    if values.len() < FEWEST {
        return None;
    }
    let centre = median(&mut values.to_vec());
    let spread = median(&mut values.iter().map(|v| (v - centre).abs()).collect::<Vec<_>>());
    (spread > 0.0).then(|| values.iter().map(|v| NORMAL * (v - centre) / spread).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mean_of_recordings_that_agree_and_of_those_that_do_not() {
        let agree = mean(&[1.0, 1.1, 0.9, 1.0], &[0.1; 4]).unwrap();
        assert!((agree.value - 1.0).abs() < 1e-12);
        // 0.1 / sqrt(4) x t(3), since the misfit is smaller than chance gives.
        assert!((agree.ci95[1] - 1.0 - 0.05 * 3.182).abs() < 1e-9, "{agree:?}");
        let differ = mean(&[1.0, 3.0, 2.0, 2.0], &[0.01; 4]).unwrap();
        // Then it is the usual interval of a mean: deviation 0.8165, four of them.
        assert!((differ.ci95[1] - 2.0 - 3.182 * 0.8165 / 2.0).abs() < 1e-3, "{differ:?}");
        assert_eq!(mean(&[5.0], &[1.0]).unwrap().ci95, [3.04, 6.96]);
        assert!(mean(&[], &[]).is_none());
    }

    #[test]
    fn a_drift_is_found_and_noise_is_none() {
        let at: Vec<f64> = (0..12).map(f64::from).collect();
        let wobble = [0.3, -0.2, 0.1, -0.4, 0.2, 0.0, -0.1, 0.4, -0.3, 0.1, 0.2, -0.3];
        let moved: Vec<f64> = at.iter().zip(wobble).map(|(t, w)| 8.0 + 0.5 * t + w).collect();
        let found = slope(&moved, &[0.25; 12], &at).unwrap();
        assert!(!found.may_be_zero() && (found.value - 0.5).abs() < 0.05, "{found:?}");
        assert!(found.ci95[0] < 0.5 && found.ci95[1] > 0.5);
        assert!(slope(&wobble, &[0.25; 12], &at).unwrap().may_be_zero());
        assert!(
            slope(&[1.0, 2.0], &[0.1; 2], &[0.0, 1.0]).is_none() && slope(&moved, &[0.1; 12], &[3.0; 12]).is_none()
        );
    }

    #[test]
    fn students_quantiles() {
        // Of the tables: 11, 20, 30, 120 degrees of freedom.
        for (freedom, right) in [(1, 12.706), (10, 2.228), (11, 2.201), (20, 2.086), (30, 2.042), (120, 1.980)] {
            assert!((student(freedom) - right).abs() < 3e-3, "{freedom}: {}", student(freedom));
        }
    }

    #[test]
    fn one_value_stands_apart() {
        let z = robust_z(&[1.0, 1.1, 0.9, 1.05, 0.95, 9.0]).unwrap();
        assert!(z[5] > OUTLIER && z[..5].iter().all(|z| z.abs() < OUTLIER), "{z:?}");
        assert!(robust_z(&[1.0, 2.0, 3.0, 4.0]).is_none() && robust_z(&[1.0; 6]).is_none());
    }
}
