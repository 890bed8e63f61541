//! Zero-phase smoothing and differentiation by local polynomials, on the stamps as they are.
//!
//! At a time t a polynomial is fitted by least squares to the samples within a half-width h of t; its value and slope at
//! t are the result. On even stamps this is the Savitzky-Golay filter, which shifts no phase. Source: Savitzky and
//! Golay, Analytical Chemistry 36 (1964); for the bandwidth, Schafer, IEEE Signal Processing Magazine 28(4), 2011.

use qv_core::JointSeries;

/// Coefficients of the highest polynomial: a cubic.
const MAX_TERMS: usize = 4;
/// Most samples on either side of one that a filter of a bandwidth has.
const FARTHEST: f64 = 10_000.0;

/// A local polynomial filter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalPolynomial {
    /// Samples within this distance count \[s\].
    pub half_width: f64,
    /// Degree of the polynomial, at most 3; lowered where there are too few samples.
    pub degree: usize,
}

/// Value and slope of one column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValueAndSlope {
    /// Value, in the column's unit.
    pub value: f64,
    /// Derivative, in the column's unit per second.
    pub slope: f64,
}

impl LocalPolynomial {
    /// Fits all columns at `time` \[s\], shape `[n]`. A column is NaN where fewer than two of its samples are near.
    pub fn at(&self, series: &JointSeries, time: f64) -> Vec<ValueAndSlope> {
        let slack = 1e-9 * (1.0 + time.abs());
        let first = series.time.partition_point(|&t| t < time - self.half_width - slack);
        let last = series.time.partition_point(|&t| t <= time + self.half_width + slack);
        let near: Vec<f64> = series.time[first..last].iter().map(|t| (t - time) / self.half_width).collect();
        let shared = weights(&near, self.degree);
        (0..series.joints)
            .map(|column| {
                let values: Vec<f64> = (first..last).map(|i| series.values[i * series.joints + column]).collect();
                if values.iter().any(|x| x.is_nan()) {
                    self.with_gaps(&near, &values)
                } else {
                    self.apply(shared.as_ref(), &values)
                }
            })
            .collect()
    }

    fn with_gaps(&self, near: &[f64], values: &[f64]) -> ValueAndSlope {
        let good: Vec<usize> = (0..values.len()).filter(|&i| !values[i].is_nan()).collect();
        let near: Vec<f64> = good.iter().map(|&i| near[i]).collect();
        let values: Vec<f64> = good.iter().map(|&i| values[i]).collect();
        self.apply(weights(&near, self.degree).as_ref(), &values)
    }

    fn apply(&self, weights: Option<&[Vec<f64>; 2]>, values: &[f64]) -> ValueAndSlope {
        let Some([value, slope]) = weights else { return ValueAndSlope { value: f64::NAN, slope: f64::NAN } };
        let dot = |w: &[f64]| w.iter().zip(values).map(|(w, x)| w * x).sum::<f64>();
        ValueAndSlope { value: dot(value), slope: dot(slope) / self.half_width }
    }

    /// Slopes of all columns at all stamps: the velocity of a position series. Rows without enough samples near are NaN.
    pub fn derivative(&self, series: &JointSeries) -> JointSeries {
        let values = series.time.iter().flat_map(|&t| self.at(series, t)).map(|s| s.slope).collect();
        JointSeries { time: series.time.clone(), values, joints: series.joints }
    }

    /// Frequency \[Hz\] at which the amplitude has fallen by 3 dB on stamps that are `period` \[s\] apart: of the value,
    /// or of the slope against the true derivative. NaN when it does not fall so far below the Nyquist frequency.
    pub fn bandwidth(&self, period: f64, of_slope: bool) -> f64 {
        let reach = (self.half_width / period + 1e-6).floor();
        if !(0.0..=FARTHEST).contains(&reach) {
            return f64::NAN;
        }
        let reach = reach as i64;
        let near: Vec<f64> = (-reach..=reach).map(|k| k as f64 * period / self.half_width).collect();
        let Some([value, slope]) = weights(&near, self.degree) else { return f64::NAN };
        let gain = |f: f64| {
            let phase = |u: &f64| std::f64::consts::TAU * f * u * self.half_width;
            if of_slope {
                let sum: f64 = near.iter().zip(&slope).map(|(u, w)| w * phase(u).sin()).sum();
                sum / self.half_width / (std::f64::consts::TAU * f)
            } else {
                near.iter().zip(&value).map(|(u, w)| w * phase(u).cos()).sum()
            }
        };
        let nyquist = 0.5 / period;
        let steps = 4000;
        (1..=steps).map(|k| nyquist * k as f64 / steps as f64).find(|&f| gain(f) < 0.5f64.sqrt()).unwrap_or(f64::NAN)
    }
}

/// Weights of the samples at `near` (in half-widths) for value and slope at 0; `None` with fewer than two samples.
fn weights(near: &[f64], degree: usize) -> Option<[Vec<f64>; 2]> {
    let distinct = near.windows(2).filter(|w| w[1] - w[0] > 1e-9).count() + usize::from(!near.is_empty());
    let terms = (degree + 1).min(MAX_TERMS).min(distinct);
    if terms < 2 {
        return None;
    }
    let mut moments = [[0.0; MAX_TERMS]; MAX_TERMS];
    for &u in near {
        let powers = powers(u);
        for i in 0..terms {
            for j in 0..terms {
                moments[i][j] += powers[i] * powers[j];
            }
        }
    }
    let value = solve(moments, 0, terms)?;
    let slope = solve(moments, 1, terms)?;
    let weigh =
        |c: [f64; MAX_TERMS]| near.iter().map(|&u| (0..terms).map(|i| c[i] * powers(u)[i]).sum()).collect::<Vec<f64>>();
    Some([weigh(value), weigh(slope)])
}

fn powers(u: f64) -> [f64; MAX_TERMS] {
    [1.0, u, u * u, u * u * u]
}

/// Column `unit` of the inverse of the leading `terms` x `terms` block, by elimination with pivots.
fn solve(mut a: [[f64; MAX_TERMS]; MAX_TERMS], unit: usize, terms: usize) -> Option<[f64; MAX_TERMS]> {
    let mut b = [0.0; MAX_TERMS];
    b[unit] = 1.0;
    for k in 0..terms {
        let pivot = (k..terms).max_by(|&i, &j| a[i][k].abs().total_cmp(&a[j][k].abs()))?;
        if a[pivot][k].abs() < 1e-12 {
            return None;
        }
        a.swap(k, pivot);
        b.swap(k, pivot);
        for i in k + 1..terms {
            let factor = a[i][k] / a[k][k];
            for j in k..terms {
                a[i][j] -= factor * a[k][j];
            }
            b[i] -= factor * b[k];
        }
    }
    for k in (0..terms).rev() {
        let sum: f64 = (k + 1..terms).map(|j| a[k][j] * b[j]).sum();
        b[k] = (b[k] - sum) / a[k][k];
    }
    Some(b)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cubic(t: f64) -> f64 {
        1.0 + 2.0 * t - 3.0 * t * t + 0.5 * t * t * t
    }

    #[test]
    fn a_cubic_on_uneven_stamps_comes_back_exactly() {
        let time: Vec<f64> = (0..60).map(|i| f64::from(i) * 0.01 + 0.002 * f64::from(i % 3)).collect();
        let mut values: Vec<f64> = time.iter().map(|&t| cubic(t)).collect();
        values[30] = f64::NAN;
        let series = JointSeries::new(time, values, 1).unwrap();
        let filter = LocalPolynomial { half_width: 0.06, degree: 3 };
        let at = filter.at(&series, 0.303)[0];
        assert!((at.value - cubic(0.303)).abs() < 1e-9, "{at:?}");
        assert!((at.slope - (2.0 - 6.0 * 0.303 + 1.5 * 0.303 * 0.303)).abs() < 1e-7, "{at:?}");
        assert!(filter.at(&series, 9.0)[0].value.is_nan());
    }

    #[test]
    fn the_stated_bandwidth_is_where_a_sine_falls_by_3_db() {
        let filter = LocalPolynomial { half_width: 0.02, degree: 3 };
        for of_slope in [false, true] {
            let frequency = filter.bandwidth(0.002, of_slope);
            let omega = std::f64::consts::TAU * frequency;
            let time: Vec<f64> = (0..1000).map(|i| f64::from(i) * 0.002).collect();
            let values = time.iter().map(|t| (omega * t).sin()).collect();
            let series = JointSeries::new(time, values, 1).unwrap();
            let largest = (200..800).map(|i| {
                let at = filter.at(&series, series.time[i])[0];
                if of_slope { at.slope / omega } else { at.value }
            });
            let gain = largest.fold(0.0, f64::max);
            assert!((gain - 0.5f64.sqrt()).abs() < 0.01, "gain {gain} at {frequency} Hz");
        }
    }
}
