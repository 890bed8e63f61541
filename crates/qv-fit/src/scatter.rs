//! How rows of numbers usually lie: middle and covariance that rows with tails hardly move.

use crate::linear::{Cholesky, Matrix, add_outer, add_scaled, diagonal, minus};
use qv_core::statistics::median;

/// Degrees of freedom of Student's t: one row that lies elsewhere must not decide.
const FREEDOM: f64 = 4.0;
/// Share of the covariance that is put onto its diagonal.
const SHRINKAGE: f64 = 0.2;
const ROUNDS: usize = 12;
/// Median of the absolute value of a standard normal number.
const MEDIAN: f64 = 0.674;

/// Middle and covariance of a multivariate t distribution, by expectation and maximisation (Lange, Little and Taylor, Journal of the American
/// Statistical Association 84, 1989).
#[derive(Debug, Clone)]
pub struct Scatter {
    /// The middle.
    pub middle: Vec<f64>,
    /// Of the covariance.
    pub factor: Cholesky,
}

impl Scatter {
    /// Of rows of one length; `None` when there are none, they differ in length, or they hold a number that is not finite.
    pub fn of(rows: &[Vec<f64>]) -> Option<Self> {
        let middle = (0..rows.first()?.len()).map(|i| median(&mut rows.iter().map(|r| r[i]).collect::<Vec<_>>()));
        Self::found(rows, middle.collect(), false)
    }

    /// The same about zero.
    pub fn about_zero(rows: &[Vec<f64>]) -> Option<Self> {
        Self::found(rows, vec![0.0; rows.first()?.len()], true)
    }

    fn found(rows: &[Vec<f64>], mut middle: Vec<f64>, is_fixed: bool) -> Option<Self> {
        let size = middle.len();
        if rows.iter().any(|row| row.len() != size || row.iter().any(|x| !x.is_finite())) {
            return None;
        }
        let spread = |i: usize| {
            let mut away: Vec<f64> = rows.iter().map(|r| (r[i] - middle[i]).abs()).collect();
            (median(&mut away) / MEDIAN).max(1e-9)
        };
        let mut factor = Cholesky::new(&diagonal(&(0..size).map(|i| spread(i).powi(2)).collect::<Vec<_>>()))?;
        for _ in 0..ROUNDS {
            let weight = |r: &Vec<f64>| (FREEDOM + size as f64) / (FREEDOM + factor.length(&minus(r, &middle)));
            let weights: Vec<f64> = rows.iter().map(weight).collect();
            if !is_fixed {
                let total: f64 = weights.iter().sum();
                middle = vec![0.0; size];
                rows.iter().zip(&weights).for_each(|(r, w)| add_scaled(&mut middle, w / total, r));
            }
            let mut covariance = Matrix::zeros(size, size);
            for (r, w) in rows.iter().zip(&weights) {
                add_outer(&mut covariance, w / rows.len() as f64, &minus(r, &middle));
            }
            for i in 0..size {
                for j in (0..size).filter(|&j| j != i) {
                    covariance[(i, j)] *= 1.0 - SHRINKAGE;
                }
                covariance[(i, i)] = covariance[(i, i)].max(1e-18);
            }
            factor = Cholesky::new(&covariance)?;
        }
        Some(Self { middle, factor })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pairs that go together, evenly spread.
    fn pairs() -> Vec<Vec<f64>> {
        let even = |k: f64, step: f64| ((k * step).fract() - 0.5) * 3.46;
        (1..400)
            .map(|k| (even(f64::from(k), 0.754_877_666), even(f64::from(k), 0.569_840_291)))
            .map(|(a, b)| vec![2.0 + a, 5.0 * (a + 0.3 * b)])
            .collect()
    }

    #[test]
    fn outliers_hardly_move_it_and_what_goes_together_is_near() {
        let mut rows = pairs();
        let clean = Scatter::of(&rows).unwrap();
        rows.extend((0..20).map(|_| vec![500.0, -900.0]));
        for found in [clean, Scatter::of(&rows).unwrap()] {
            assert!((found.middle[0] - 2.0).abs() < 0.1, "{:?}", found.middle);
            let away = |x: f64, y: f64| found.factor.length(&[x, y]);
            assert!(away(1.0, -5.0) > 5.0 * away(1.0, 5.0));
        }
    }

    #[test]
    fn about_zero_the_middle_counts_as_spread() {
        let rows: Vec<Vec<f64>> = pairs().into_iter().map(|r| vec![r[0]]).collect();
        // Mean square 5 about zero, 1 about the middle.
        let [about, own] =
            [Scatter::about_zero(&rows), Scatter::of(&rows)].map(|s| 1.0 / s.unwrap().factor.length(&[1.0]));
        assert!(about > 3.0 * own, "{about} {own}");
        assert!(Scatter::of(&[]).is_none() && Scatter::of(&[vec![f64::NAN]]).is_none());
    }
}
